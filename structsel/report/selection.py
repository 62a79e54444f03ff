"""Page of a selection: the terms of the model, their accuracy, and how they were selected."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from structsel.formatting import (
    count_of,
    display_unit,
    format_decimals,
    format_explained,
    format_number,
    format_percent,
    join_names,
)
from structsel.nomenclature import unit_of
from structsel.recording import Recording
from structsel.report.chart_data import ChartFlight, chart_data, is_varying, single_chart
from structsel.report.page_model import (
    INTERVAL,
    INTERVAL_NOTE,
    Page,
    Section,
    Status,
    interval_bar,
    list_history,
    list_sources,
    merge_notes,
)
from structsel.selection import Selection, Selections
from structsel.selection.methods import METHODS
from structsel.tables import Bar, Column, Table, text_column
from structsel.validation import Validation

_FURTHER_CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "de", "da", "dr", "df", "mach", "h")
_MAX_CHANNELS = 16
_MAX_RUNNERS_UP, _MIN_PROBABILITY = 6, 0.05
_PROBABLE = 0.5  # probability above which a candidate that was not selected is marked
_WAS = ("was", "were")
_LEGEND = (
    "Standard errors and intervals include the uncertainty of the structure if there was a bootstrap. F: partial F of "
    "the term in the model. prob.: probability that the term belongs in the model, from resampled selections. "
    "VIF: variance inflation factor. PSE: predicted squared error, as a fraction of the variance of the response. "
    "Cross-validated: each manoeuvre (or part of a single one) is predicted by a model selected without it. Values are "
    "in SI units and radians."
)


def page_of(
    found: Selections, recordings: Sequence[Recording], judged: Validation | None, reasons: Sequence[str]
) -> Page:
    """Page of a selection; `recordings` are those used for the selection and those used for validation."""
    each = list(found.values())
    held_out = [] if judged is None else list(dict.fromkeys(score.recording for score in judged.scores))
    warnings = merge_notes((s.response, text) for s in each for text in s.doubts)
    if judged is not None:
        warnings += merge_notes(("validation", text) for text in judged.doubts)
    predicted = _predicted(each, judged)
    headline, *summary = _headline(each, predicted, held_out)
    verdict, status = _verdict(predicted, len(each))
    biased = [s.response for s in each if s.biased]
    bias = [f"Biased estimates: {join_names(biased)} by {each[0].estimator}."] if biased else []
    sections = [_section(s) for s in each]
    if judged is not None:
        text = ("These recordings were not used for the selection.",)
        sections.insert(0, Section("Validation", text=text, tables=judged.tables()))
    sections += [one for s in each if (one := _resampling(s))]
    charts = {f"path-{k}": s for k, s in enumerate(each) if len(s.trace) > 1}
    if charts:
        sections.append(Section("Search", charts=tuple(charts), after=True))
    return Page(
        verdict=verdict,
        status="warning" if status == "good" and (warnings or biased) else status,
        headline=headline,
        summary=tuple(summary),
        about=_about(each, held_out),
        reasons=(*reasons, *bias),
        sections=tuple(sections),
        warnings=warnings,
        notes=() if judged is None else merge_notes(("", text) for text in judged.summary().notes),
        method=describe_method(each[0]),
        sources=list_sources(recordings, each[0].recordings, held_out),
        history=list_history(recordings),
        data={
            **figures_of(
                {"physics": ("model", found)}, recordings, [_search_chart(s, name) for name, s in charts.items()]
            ),
            "start": held_out[0] if held_out else "",
        },
        legend=_LEGEND,
    )


def _predicted(each: Sequence[Selection], judged: Validation | None) -> dict[str, float]:
    """R2 of each response on data that were not used: the validation recordings, else cross-validation."""
    scores = {s.response: s.held_out_r2 if judged is None else judged.score(s.response).r2 for s in each}
    return {response: r2 for response, r2 in scores.items() if math.isfinite(r2)}


def _verdict(predicted: Mapping[str, float], count: int) -> tuple[str, Status]:
    """Verdict on the predictions; a model with R2 of zero is no better than the mean of the response."""
    if failed := [response for response, r2 in predicted.items() if r2 <= 0.0]:
        return f"does not predict {join_names(failed)}", "bad"
    if len(predicted) < count:
        return "not validated", "warning"
    return f"predicts {_range_text(predicted)} of held-out data", "good"


def _range_text(predicted: Mapping[str, float], names: bool = False) -> str:
    """Smallest and largest explained fraction."""
    worst, best = (f(predicted, key=lambda r: predicted[r]) for f in (min, max))
    low, high = (format_explained(predicted[r]) for r in (worst, best))
    if names:
        return f"from {low} ({worst}) to {high} ({best})" if len(predicted) > 1 else low
    return low if low == high else f"{low.removesuffix(' %')} to {high}"


def _headline(each: Sequence[Selection], predicted: Mapping[str, float], held_out: Sequence[str]) -> tuple[str, ...]:
    """Sentences on the prediction of held-out data, on the terms, and on the explained variance."""
    where = (
        f"of {join_names(held_out)}, which {_WAS[len(held_out) > 1]} not used" if held_out else "in cross-validation"
    )
    of = f"of {each[0].response} " if len(each) == 1 else ""
    model, predict, explain = (
        (f"model {of}", "predicts", "explains") if len(each) == 1 else ("models ", "predict", "explain")
    )
    if predicted:
        first = f"The {model}{predict} {_range_text(predicted, True)} of the variance {where}."
    else:
        first = f"The {model}{'was' if of else 'were'} not validated: no data were held out."
    candidates = count_of(len(each[0].pool), "candidate term")
    if len(each) == 1:
        terms = join_names(map(str, each[0].terms)) if each[0].terms else "none but the constant"
        selected = f"It has {len(each[0].terms)} of {candidates}: {terms}."
    else:
        counts = join_names([f"{len(s.terms)} for {s.response}" for s in each], len(each))
        selected = f"Of {candidates}, {counts} were selected."
    fit = f"On the data of the selection, the {model}{explain} {_range_text({s.response: s.r2 for s in each}, True)}."
    return first, selected, fit


def _about(each: Sequence[Selection], held_out: Sequence[str]) -> str:
    validation = f"; validation with {join_names(held_out)}" if held_out else ""
    return f"Selected from {count_of(len(each[0].recordings), 'recording')} with {each[0].n} samples{validation}."


def _section(s: Selection) -> Section:
    """Terms of one response, and its fit."""
    (terms,) = s.tables()
    rows = s.to_frame().to_dict("records")
    bars = [interval_bar(row["term"], row["value"], row["low95"], row["high95"]) for row in rows]
    place = [column.name for column in terms.columns].index("F")
    tables = (replace(terms.with_column(place, INTERVAL, bars), title="Terms", note=INTERVAL_NOTE),)
    badges = (f"{len(s.terms)} of {len(s.pool)} candidates", s.residual_description)
    fit = f"R² {format_decimals(s.r2)}, adjusted {format_decimals(s.adjusted_r2)}, rms error {format_number(s.rms, 3)}"
    if math.isfinite(s.held_out_r2):
        fit += f"; cross-validated R² {format_decimals(s.held_out_r2)}, rms error {format_number(s.held_out_rms, 3)}"
    warnings = (f"{count_of(len(s.doubts), 'warning')} about {s.response}, see below.",) if s.doubts else ()
    return Section(s.response, badges, warnings, (f"{fit}.",), tables)


def _resampling(s: Selection) -> Section | None:
    """Candidates that were nearly selected, and cross-validation by manoeuvre."""
    tables = []
    if s.probability and (runners_up := _runners_up(s)):
        tables.append(runners_up)
    if len(s.held_out) > 1:
        parts = tuple((p.name, p.n, p.r2, p.rms) for p in s.held_out)
        unit = display_unit(unit_of(s.response))[1] or "-"
        heads = (text_column("predicted"), Column("samples"), Column("R2", "4f"), Column("rms error", "3g", unit))
        tables.append(Table(heads, parts, "Cross-validation"))
    return Section(f"{s.response}: resampling", tables=tuple(tables), after=True) if tables else None


def _runners_up(s: Selection) -> Table | None:
    """Candidates outside the model that may belong in it, the most probable first."""
    own = set(map(str, s.terms))
    found = sorted(((x, n) for n, x in s.probability.items() if n not in own and x >= _MIN_PROBABILITY), reverse=True)
    if not found:
        return None
    rows = tuple(
        (n, x, Bar(0.0, round(100.0 * x, 1), f"{n}: {format_percent(x)}", "refitted" if x > _PROBABLE else "other"))
        for x, n in found[:_MAX_RUNNERS_UP]
    )
    heads = (text_column("term"), Column("prob.", "%"), Column(""))
    return Table(heads, rows, "Candidates that may belong in the model")


def _search_chart(s: Selection, name: str) -> dict[str, Any]:
    """Chart of the unexplained fraction and the PSE after each move of the search."""
    moves = [f"{k}. {m.action} {m.term}" + (f" for {m.other}" if m.other else "") for k, m in enumerate(s.trace, 1)]
    lines = [
        ("unexplained, 1 − R²", "measured", [1.0 - m.R2 for m in s.trace]),
        ("PSE", "physics", [m.PSE for m in s.trace]),
    ]
    caption = (
        f"The search for {s.response}: unexplained fraction of the variance, and PSE, after each of "
        f"{count_of(len(moves), 'move')}. It ended: {s.stop_reason}"
    )
    return single_chart(name, range(1, len(moves) + 1), lines, x_label="move of the search",
                        y_label="fraction of variance [-]", title=f"Search: {s.response}", caption=caption,
                        log=True, labels=moves)  # fmt: skip


def describe_method(s: Selection) -> tuple[str, ...]:
    """Sentences on the method of selection and estimation, the bootstrap, and the candidates."""
    o = s.options
    method = METHODS[o.method]
    words = method.heading
    if "F_in" in method.options:
        words += f", partial F to enter {o.F_in}" + ("" if o.F_out is None else f", to stay {o.F_out:g}")
    rule = f", model size by {o.criterion}" if o.criterion else ""
    bootstrap = f"{o.bootstrap} bootstrap selections (seed {o.seed})." if o.bootstrap else "No bootstrap."
    candidates = join_names([str(t) for t in s.pool], 40)
    return (
        f"{words}{rule}; {s.residual_description}; estimates by {s.estimator}. {bootstrap}",
        f"Candidates: {candidates}.",
    )


def figures_of(
    found: Mapping[str, tuple[str, Selections]],
    recordings: Sequence[Recording],
    charts: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Data of the charts.

    Parameters
    ----------
    found : mapping of line style to (name, Selections)
        Models of the same responses, each with its name in the legend.
    recordings : sequence of Recording
    charts : sequence of mapping
        Further charts.
    """
    responses = list(next(iter(found.values()))[1])
    flights: dict[str, ChartFlight] = {}
    shown = [r for r in recordings if all(response in r for response in responses)]
    channels_of: list[dict[str, Any]] = [dict(r.channels) for r in shown]
    pool = [c for _, each in found.values() for s in each.values() for c in _used_first(s)]
    wanted = [c for c in dict.fromkeys((*pool, *_FURTHER_CHANNELS)) if c not in responses]
    channels = [c for c in wanted if is_varying(c, channels_of)][:_MAX_CHANNELS]
    models = {style: each.model for style, (_, each) in found.items()}
    for r in shown:
        modelled = {style: model.evaluate(r, outside="ignore") for style, model in models.items()}
        each = {
            name: {"measured": r[name], **{style: np.asarray(values[name]) for style, values in modelled.items()}}
            for name in responses
        }
        flights[r.name] = ChartFlight(r.t, each, {c: r[c] for c in channels})
    own = shown[0].units if shown else {}
    units = {name: display_unit(unit_of(name, own)) for name in (*responses, *channels)}
    stages = {style: name for style, (name, _) in found.items()}
    return chart_data(flights, stages, units, verb="modelled", charts=charts)


def _used_first(s: Selection) -> list[str]:
    used = {c for term in s.terms for c in term.channels}
    return sorted(s.pool.channels, key=lambda c: (c not in used, c))
