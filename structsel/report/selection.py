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
_MAX_RUNNERS_UP, _MIN_FREQUENCY = 6, 0.05
_PROBABLE = 0.5  # selection frequency above which a candidate that was not selected is marked
_LEGEND = (
    "Standard errors and intervals include the uncertainty of the structure if there was a bootstrap. F: partial F of "
    "the term in the model. freq.: selection frequency, the fraction of the bootstrap selections that have the term. "
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
    headline, summary = _headline(each)
    biased = [s.response for s in each if s.biased]
    bias = [f"Biased estimates: {join_names(biased)} by {each[0].estimator}."] if biased else []
    sections = [_section(s, f"path-{k}") for k, s in enumerate(each)]
    if judged is not None:
        text = ("These recordings were not used for the selection.",)
        sections.append(Section("Validation", text=text, tables=judged.tables()))
    return Page(
        verdict=count_of(len(warnings), "warning") if warnings else "no warnings",
        status="warning" if warnings or biased else "good",
        headline=headline,
        summary=(summary,),
        about=_about(each, held_out),
        reasons=(*reasons, *bias),
        sections=tuple(sections),
        warnings=warnings,
        notes=() if judged is None else merge_notes(("", text) for text in judged.summary().notes),
        method=describe_method(each[0]),
        sources=list_sources(recordings, each[0].recordings, held_out),
        history=list_history(recordings),
        data=figures_of(
            {"physics": ("model", found)},
            recordings,
            [_search_chart(s, f"path-{k}") for k, s in enumerate(each) if s.trace],
        ),
        legend=_LEGEND,
    )


def _headline(each: Sequence[Selection]) -> tuple[str, str]:
    """Sentences on the terms, and on the explained variance."""
    if len(each) == 1:
        s = each[0]
        terms = join_names(map(str, s.terms)) if s.terms else "none but the constant"
        fit = f"The model explains {format_explained(s.r2)} of the variance"
        prediction = f", and {format_explained(s.held_out_r2)} in cross-validation"
        return (
            f"The model of {s.response} has {len(s.terms)} of {count_of(len(s.pool), 'candidate term')}: {terms}.",
            fit + (prediction if math.isfinite(s.held_out_r2) else "") + ".",
        )
    selected = join_names([f"{len(s.terms)} for {s.response}" for s in each], len(each))
    worst, best = (f(each, key=lambda s: s.r2) for f in (min, max))
    return (
        f"Of {count_of(len(each[0].pool), 'candidate term')}, {selected} were selected.",
        f"The models explain from {format_explained(worst.r2)} of the variance ({worst.response}) to "
        f"{format_explained(best.r2)} ({best.response}).",
    )


def _about(each: Sequence[Selection], held_out: Sequence[str]) -> str:
    validation = f"; validation with {join_names(held_out)}" if held_out else ""
    return f"Selected from {count_of(len(each[0].recordings), 'recording')} with {each[0].n} samples{validation}."


def _section(s: Selection, name: str) -> Section:
    """Terms of one response, candidates that were nearly selected, and cross-validation."""
    (terms,) = s.tables()
    rows = s.to_frame().to_dict("records")
    bars = [interval_bar(row["term"], row["value"], row["low95"], row["high95"]) for row in rows]
    place = [column.name for column in terms.columns].index("F")
    tables = [replace(terms.with_column(place, INTERVAL, bars), title="Terms", note=INTERVAL_NOTE)]
    if s.inclusion and (runners_up := _runners_up(s)):
        tables.append(runners_up)
    if len(s.held_out) > 1:
        parts = tuple((p.name, p.n, p.r2, p.rms) for p in s.held_out)
        heads = (text_column("predicted"), Column("samples"), Column("R2", "4f"), Column("rms error", "3g"))
        tables.append(Table(heads, parts, "Cross-validation"))
    badges = (f"{len(s.terms)} of {len(s.pool)} candidates", s.residual_description)
    fit = f"R² {format_decimals(s.r2)}, adjusted {format_decimals(s.adjusted_r2)}, rms error {format_number(s.rms, 3)}"
    if math.isfinite(s.held_out_r2):
        fit += f"; cross-validated R² {format_decimals(s.held_out_r2)}, rms error {format_number(s.held_out_rms, 3)}"
    warnings = (f"{count_of(len(s.doubts), 'warning')} about {s.response}, see below.",) if s.doubts else ()
    return Section(s.response, badges, warnings, (f"{fit}.",), tuple(tables), (name,) if s.trace else ())


def _runners_up(s: Selection) -> Table | None:
    """Candidates outside the model that bootstrap selections have, the most frequent first."""
    own = set(map(str, s.terms))
    found = sorted(((x, n) for n, x in s.inclusion.items() if n not in own and x >= _MIN_FREQUENCY), reverse=True)
    if not found:
        return None
    rows = tuple(
        (n, x, Bar(0.0, round(100.0 * x, 1), f"{n}: {format_percent(x)}", "refitted" if x > _PROBABLE else "other"))
        for x, n in found[:_MAX_RUNNERS_UP]
    )
    heads = (text_column("term"), Column("freq.", "%"), Column(""))
    return Table(heads, rows, "Candidates selected in the bootstrap only")


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
                        y_label="fraction of variance", caption=caption, log=True, labels=moves)  # fmt: skip


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
