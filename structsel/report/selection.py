"""A selection as a page: the terms that belong in the model, how sure they are, and why they are there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
from structsel.report.chart_data import ChartFlight, chart, chart_data, moving
from structsel.report.page_model import (
    Bar,
    PageTable,
    Section,
    Sheet,
    columns,
    conversions,
    interval_bar,
    list_sources,
    merge_remarks,
    metric_columns,
)
from structsel.selection import Selection, Selections
from structsel.selection.methods import METHODS
from structsel.validation import Validation

_ALSO = ("V", "alpha", "beta", "p", "q", "r", "de", "da", "dr", "df", "mach", "h")
_MOST_CHANNELS = 16
_RUNNERS_UP, _LEAST_SHARE = 6, 0.05
_POOR = 0.5
_LEGEND = (
    "Standard errors and intervals hold the structure's own uncertainty where it was resampled. F: partial F of the "
    "term in the model. Kept: share of the resampled selections that kept the term. VIF: variance inflation. PSE: "
    "predicted squared error, a share of the response's mean square about its mean. Left out: predicting, in turn, "
    "manoeuvres (parts of a single one) left out of the selection. Values are in SI and radians."
)


def sheet_of(
    found: Selections, recordings: Sequence[Recording], judged: Validation | None, reasons: Sequence[str]
) -> Sheet:
    """The page of a selection; `recordings` are those it was made from and those that judge it."""
    each = list(found.values())
    held = [] if judged is None else list(dict.fromkeys(score.recording for score in judged.scores))
    doubts = merge_remarks((s.response, text) for s in each for text in s.doubts)
    if judged is not None:
        doubts += merge_remarks(("held out", text) for text in judged.doubts)
    headline, told = _headline(each)
    biased = [s.response for s in each if s.biased]
    warned = [f"Biased on purpose: {join_names(biased)} by {each[0].estimator}."] if biased else []
    charts = [_path(s, f"path-{k}") for k, s in enumerate(each) if s.trace]
    sections = [_section(s, f"path-{k}") for k, s in enumerate(each)]
    if judged is not None:
        sections.append(_judgement(judged))
    return Sheet(
        verdict=count_of(len(doubts), "warning") if doubts else "no warnings",
        tone="doubt" if doubts or biased else "good",
        headline=headline,
        lead=(told,),
        about=_about(each, held),
        reasons=(*reasons, *warned),
        sections=tuple(sections),
        doubts=doubts,
        notes=(),
        done=describe_method(each[0]),
        sources=list_sources(recordings, each[0].recordings, held),
        history=conversions(recordings),
        data=figures_of({"physics": ("model", found)}, recordings, charts),
        legend=_LEGEND,
    )


def _headline(each: Sequence[Selection]) -> tuple[str, str]:
    if len(each) == 1:
        s = each[0]
        terms = join_names(map(str, s.terms)) if s.terms else "none but the constant"
        told = f"Together they explain {format_explained(s.r2)} of its variance"
        left = f", and {format_explained(s.held_out_r2)} in what was left out of the selection"
        return (
            f"The model of {s.response} needs {len(s.terms)} of {count_of(len(s.pool), 'candidate term')}: {terms}.",
            told + (left if math.isfinite(s.held_out_r2) else "") + ".",
        )
    kept = join_names([f"{s.response} needs {len(s.terms)}" for s in each], len(each))
    worst, best = (f(each, key=lambda s: s.r2) for f in (min, max))
    return (
        f"Of {count_of(len(each[0].pool), 'candidate term')}, {kept}.",
        f"They explain from {format_explained(worst.r2)} of the variance ({worst.response}) to "
        f"{format_explained(best.r2)} ({best.response}).",
    )


def _about(each: Sequence[Selection], held: Sequence[str]) -> str:
    judges = f"; {join_names(held)} held out for validation" if held else ""
    return f"From {count_of(len(each[0].recordings), 'recording')}, {each[0].n} samples{judges}."


def _section(s: Selection, name: str) -> Section:
    resampled = bool(s.inclusion)
    head = columns(
        term="name", value="number", std_error="number", **{"95 % interval": "bar"}, F="number",
        **({"kept": "number"} if resampled else {}), VIF="number",
    )  # fmt: skip
    rows = []
    for row in s.to_frame().to_dict("records"):
        bar = interval_bar(row["term"], row["value"], row["low95"], row["high95"])
        mine = [
            row["term"],
            format_number(row["value"]),
            format_number(row["std_error"], 2),
            bar,
            format_number(row["partial_F"], 3),
        ]
        rows.append((*mine, *([format_percent(row["inclusion"])] if resampled else []), format_number(row["vif"], 2)))
    note = (
        "Bars are relative to each value. The line in them is zero: an interval across it (red) is a term that may not "
        "be there."
    )
    tables = [PageTable(head, tuple(rows), "Terms", note)]
    if resampled and (near := _runners_up(s)):
        tables.append(near)
    if len(s.held_out) > 1:
        parts = tuple((p.name, str(p.n), format_decimals(p.r2), format_number(p.rms, 3)) for p in s.held_out)
        heads = columns(predicted="name", samples="number", **{"R²": "number"}, rms_error="number")
        tables.append(PageTable(heads, parts, "Each part by a model selected without it"))
    chips = (f"{len(s.terms)} of {len(s.pool)} candidates", s.residual_description)
    fit = f"R² {format_decimals(s.r2)}, adjusted {format_decimals(s.adjusted_r2)}, rms error {format_number(s.rms, 3)}"
    if math.isfinite(s.held_out_r2):
        fit += f"; cross-validated R² {format_decimals(s.held_out_r2)}, rms error {format_number(s.held_out_rms, 3)}"
    warnings = (f"{count_of(len(s.doubts), 'doubt')} about {s.response}, below.",) if s.doubts else ()
    return Section(s.response, chips, warnings, (f"{fit}.",), tuple(tables), (name,) if s.trace else ())


def _runners_up(s: Selection) -> PageTable | None:
    """Candidates not kept that resampled selections kept, most often first."""
    kept = set(map(str, s.terms))
    near = sorted(((x, n) for n, x in s.inclusion.items() if n not in kept and x >= _LEAST_SHARE), reverse=True)
    if not near:
        return None
    rows = tuple(
        (
            n,
            format_percent(x),
            Bar(0.0, round(100.0 * x, 1), f"{n} kept in {format_percent(x)}", "refitted" if x > _POOR else "other"),
        )
        for x, n in near[:_RUNNERS_UP]
    )
    heads = columns(term="name", kept="number", share="bar")
    return PageTable(heads, rows, "Not in the model, but in that of resampled recordings")


def _path(s: Selection, name: str) -> dict[str, Any]:
    """The search: what each move left unexplained, and what it would cost to predict."""
    moves = [f"{k}. {m.action} {m.term}" + (f" for {m.other}" if m.other else "") for k, m in enumerate(s.trace, 1)]
    lines = [
        ("unexplained, 1 − R²", "measured", [1.0 - m.R2 for m in s.trace]),
        ("PSE", "physics", [m.PSE for m in s.trace]),
    ]
    says = f"The search for {s.response}: share left unexplained and PSE after each of {count_of(len(moves), 'move')}."
    return chart(name, range(1, len(moves) + 1), lines, x_label="move of the search", y_label="share of the variance",
                 says=f"{says} It ended: {s.stop_reason}", log=True, labels=moves)  # fmt: skip


def _judgement(judged: Validation) -> Section:
    rows = []
    for pooled in judged.pooled:
        mine = [s for s in judged.scores if s.response == pooled.response]
        for s in mine if len(mine) == 1 else [*mine, pooled]:
            residual = "white" if s.white else "coloured" if math.isfinite(s.ljung_box_p) else "-"
            rows.append((s.response, s.recording, str(s.n), *s.cells(), residual))
    heads = columns(response="name", recording="word", samples="number", **metric_columns(), residual="word")
    note = "RRMSE: rms error over that of the measured response. TIC: Theil's coefficient, 0 perfect, 1 useless."
    return Section("On recordings held out", text=("These were never selected from.",),
                   tables=(PageTable(heads, tuple(rows), "", note),))  # fmt: skip


def describe_method(s: Selection) -> tuple[str, ...]:
    """Sentences about how the terms were searched, estimated and resampled, and the candidates."""
    o = s.options
    method = METHODS[o.method]
    words = method.heading
    if "F_in" in method.options:
        words += f", partial F to enter {o.F_in}" + ("" if o.F_out is None else f", to stay {o.F_out:g}")
    rule = f", the model chosen by {o.criterion}" if o.criterion else ""
    again = f"Selected again on {o.bootstrap} resampled sets (seed {o.seed})." if o.bootstrap else "Not resampled."
    offered = join_names([str(t) for t in s.pool], 40)
    return f"{words}{rule}; {s.residual_description}; values by {s.estimator}. {again}", f"Candidates: {offered}."


def figures_of(
    found: Mapping[str, tuple[str, Selections]],
    recordings: Sequence[Recording],
    charts: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Data of the figures.

    Parameters
    ----------
    found : mapping of ink to (name, Selections)
        Models of the same responses, each with what its line is called.
    recordings : sequence of Recording
    charts : sequence of mapping
        Figures that stand alone.
    """
    responses = list(next(iter(found.values()))[1])
    flights: dict[str, ChartFlight] = {}
    shown = [r for r in recordings if all(response in r for response in responses)]
    held: list[dict[str, Any]] = [dict(r.channels) for r in shown]
    pool = [c for _, each in found.values() for s in each.values() for c in _used_first(s)]
    wanted = [c for c in dict.fromkeys((*pool, *_ALSO)) if c not in responses]
    channels = [c for c in wanted if moving(c, held)][:_MOST_CHANNELS]
    models = {ink: each.model for ink, (_, each) in found.items()}
    for r in shown:
        modelled = {ink: model.evaluate(r, outside="ignore") for ink, model in models.items()}
        each = {
            name: {"measured": r[name], **{ink: np.asarray(values[name]) for ink, values in modelled.items()}}
            for name in responses
        }
        flights[r.name] = ChartFlight(r.t, each, {c: r[c] for c in channels})
    own = shown[0].units if shown else {}
    units = {name: display_unit(unit_of(name, own)) for name in (*responses, *channels)}
    stages = {ink: name for ink, (name, _) in found.items()}
    return chart_data(flights, stages, units, verb="modelled", charts=charts)


def _used_first(s: Selection) -> list[str]:
    used = {c for term in s.terms for c in term.channels}
    return sorted(s.pool.channels, key=lambda c: (c not in used, c))
