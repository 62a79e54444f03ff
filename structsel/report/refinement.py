"""A refinement as a page: the parameters found, how sure they are, and how near the simulated flights come."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from structsel.formatting import (
    count_of,
    display_unit,
    format_decimals,
    format_in_unit,
    format_number,
    format_percent,
    join_names,
)
from structsel.nomenclature import unit_of
from structsel.recording import Recording
from structsel.refinement import Estimate, Refinement
from structsel.report.chart_data import ChartFlight, chart, chart_data, moving
from structsel.report.page_model import (
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
from structsel.validation import Resimulation
from structsel.validation.resimulation import KINDS

_PER_RECORDING = ("start", "jump", "drift", "bias")
_INPUTS = ("de", "da", "dr", "df", "throttle", "thrust")
_MOST_CHANNELS = 14
_SURE = 1.96
_LEGEND = (
    "±: one standard deviation, residuals as coloured as they are; CRLB: the Cramer-Rao bound, residuals white. "
    "R²: share of the variance explained; TIC: Theil's coefficient, 0 perfect, 1 useless. Values of parameters are in "
    "SI and radians, of outputs in the unit shown."
)


def sheet_of(
    found: Refinement, recordings: Sequence[Recording], judged: Mapping[str, Resimulation], reasons: Sequence[str]
) -> Sheet:
    """The page of a refinement; `recordings` are those it was made of, `judged` replays of others."""
    converged = found.converged and not reasons
    said = [("", text) for text in found.doubts]
    for name, one in judged.items():
        said += [(f"{name} the refinement", text) for text in (*one.divergence_notes(), *one.doubts)]
    charts = [_descent(found)] if len(found.costs) > 1 else []
    ended = () if found.converged else (f"NOT CONVERGED: {found.message}. What follows is the best found.",)
    sections = [
        Section("Parameters", (count_of(len(found.estimates), "parameter"),), tables=tuple(_parameters(found))),
        Section("Outputs", tables=(_fits(found),)),
    ]
    if judged:
        sections.insert(1, _judgement(judged))
    if charts:
        sections.append(Section("The search", text=(_search(found),), charts=("descent",)))
    headline, *told = _headline(found, judged, converged)
    flown = recordings or found.simulated
    held = [r for one in judged.values() for r in one.recordings]
    sources = list({r.name: r for r in (*flown, *held)}.values())
    return Sheet(
        verdict="converged" if converged else "failed" if reasons else "not converged",
        tone="bad" if not converged else "doubt" if found.doubts else "good",
        headline=headline,
        lead=tuple(told),
        about=_about(found, held),
        reasons=(*reasons, *ended),
        sections=tuple(sections),
        doubts=merge_remarks(said),
        notes=(),
        done=(_done(found),),
        sources=list_sources(sources, held_out=[r.name for r in held]),
        history=conversions(sources),
        data=_figures(found, recordings, charts),
        legend=_LEGEND,
    )


def _headline(found: Refinement, judged: Mapping[str, Resimulation], converged: bool) -> list[str]:
    how = "The search converged" if converged else "The search did not converge"
    known = [f.r2 for f in found.fits if math.isfinite(f.r2)]
    near = f" with R² from {format_decimals(min(known), 3)} to {format_decimals(max(known), 3)}" if known else ""
    said = [f"{how}: the model flies {join_names(found.noise_std)}{near}."]
    ranked = [e for e in found.estimates if e.kind == "model" and math.isfinite(e.std) and e.std > 0.0]
    if ranked:
        most = max(ranked, key=lambda e: abs(e.value - e.start) / e.std)
        if abs(most.value - most.start) > _SURE * most.std:
            said.append(f"Moved furthest: {most.name}, from {format_number(most.start)} to {_sized(most)}.")
    if {"before", "after"} <= set(judged):
        shared = [o for o in judged["after"].outputs if o in found.noise_std]
        ratio = {o: judged["after"].score(o).rms_error / judged["before"].score(o).rms_error for o in shared}
        left = sorted((x, o) for o, x in ratio.items() if math.isfinite(x))
        if left:
            least, most_left = (f"{format_percent(x)} of what it was ({o})" for x, o in (left[0], left[-1]))
            reach = f"{least} to {most_left}" if len(left) > 1 else least
            said.append(f"On complete recordings held out, the rms error is {reach}.")
    return said


def _sized(e: Estimate) -> str:
    return f"{format_number(e.value)} ± {format_number(e.std, 2)}"


def _about(found: Refinement, held: Sequence[Recording]) -> str:
    judges = f"; {join_names(dict.fromkeys(r.name for r in held))} held out for validation" if held else ""
    samples = sum(map(len, found.simulated))
    return f"{found.title} on {count_of(len(found.simulated), 'recording')}, {samples} samples{judges}."


def _parameters(found: Refinement) -> list[PageTable]:
    shared = [e for e in found.estimates if e.kind not in _PER_RECORDING]
    own = [e for e in found.estimates if e.kind in _PER_RECORDING]
    tables = []
    bar = {"95 % interval": "bar"}
    if shared:
        rows = tuple((e.name, *_estimate(e, e.name)) for e in shared)
        heads = columns(parameter="name", value="number", **bar, CRLB="number", start="number", remark="word")
        note = "Bars are relative to each value; the line in them is zero, and an interval across it red."
        tables.append(PageTable(heads, rows, "Of the model", note))
    if own:
        rows = tuple((_place(e), *_estimate(e, _place(e))) for e in own)
        heads = columns(of="name", value="number", **bar, CRLB="number", start="number", remark="word")
        tables.append(PageTable(heads, rows, "Of each recording"))
    return tables


def _place(e: Estimate) -> str:
    kind, recording, what = e.name.split(":", 2)  # start:m01:w
    return f"{kind} {what}, {recording}"


def _estimate(e: Estimate, name: str) -> tuple[Any, ...]:
    bar = interval_bar(name, e.value, e.value - _SURE * e.std, e.value + _SURE * e.std)
    remark = "at bound" if e.at_bound else "not determined" if math.isinf(e.std) else ""
    return _sized(e), bar, format_number(e.std_white, 2), format_number(e.start), remark


def _fits(found: Refinement) -> PageTable:
    order = list(found.noise_std)
    own = found.simulated[0].units if found.simulated else {}
    rows = tuple(
        (f.output, f.recording, str(f.n), format_in_unit(f.rms_error, unit_of(f.output, own)), *f.cells())
        for f in sorted(found.fits, key=lambda f: order.index(f.output))
    )
    heads = columns(output="name", recording="word", samples="number", rms_error="number", **metric_columns())
    return PageTable(heads, rows)


def _judgement(judged: Mapping[str, Resimulation]) -> Section:
    kinds = {"windows": "in windows", "whole": "whole"}
    rows = []
    for output in next(iter(judged.values())).outputs:
        for name, one in judged.items():
            both = [x for kind in KINDS for x in one.score(output, "all", kind).table_cells()]
            rows.append((output, name, *both))
    numbers = {**metric_columns(), "in band": "number"}
    heads = (
        *columns(output="name", refinement="word"),
        *(column for kind in KINDS for column in columns(**_first_marked(kinds[kind], numbers))),
    )
    first = next(iter(judged.values()))
    note = (
        f"In windows of {format_number(first.window)} s that each start from the recorded state, and over the complete "
        "record. In band: share of the samples that the simulation reached and met within the proof-of-match band."
    )
    return Section("On recordings held out", text=("Flown with their recorded inputs; never refined on.",),
                   tables=(PageTable(heads, tuple(rows), "", note),))  # fmt: skip


def _first_marked(mark: str, heads: Mapping[str, str]) -> dict[str, str]:
    """Columns whose first heading says what they are all of."""
    return {f"{mark}: {name}" if i == 0 else name: kind for i, (name, kind) in enumerate(heads.items())}


def _search(found: Refinement) -> str:
    told = ""
    if found.search is not None:
        told = f"Evolution over {count_of(len(found.search.costs), 'generation')}, {found.search.evaluations} flights. "
    steps = count_of(len(found.costs) - 1, "step")
    cost = f"cost from {format_number(found.costs[0], 6)} to {format_number(found.costs[-1], 6)}"
    return f"{told}Descent in {steps}, {cost}; {found.message}."


def _descent(found: Refinement) -> dict[str, Any]:
    above = found.costs - found.costs.min()
    says = f"Cost at each of {count_of(len(found.costs), 'step')} of the descent, above the least."
    return chart("descent", range(len(found.costs)), [("cost above the least", "physics", list(map(float, above)))],
                 x_label="step", y_label="cost above the least", says=says, log=True)  # fmt: skip


def _done(found: Refinement) -> str:
    cost = {"ml": "maximum likelihood, the noise estimated", "weighted": "residuals weighted as given"}[found.cost]
    name = str(getattr(found.model, "name", ""))
    model = f" of {name}" if name else ""
    return f"{found.title}{model}: {cost}. Outputs: {join_names(found.noise_std, 40)}."


def _figures(found: Refinement, recordings: Sequence[Recording], charts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    recorded = {r.name: r for r in recordings}
    held: list[dict[str, Any]] = [dict(one.channels) for one in found.simulated]
    first = dict.fromkeys((*_INPUTS, *found.noise_std, *(c for one in held for c in one)))
    channels = [c for c in first if moving(c, held)][:_MOST_CHANNELS]
    flights = {}
    for one in found.simulated:
        measured = recorded.get(one.name)
        each = {}
        for output in found.noise_std:
            if measured is not None and output in measured and len(measured) == len(one):
                y = measured[output]
            elif found.domain == "time" and len(found.residuals[one.name][output]) == len(one):
                y = one[output] + np.asarray(found.residuals[one.name][output])
            else:
                continue
            each[output] = {"measured": y, "physics": one[output]}
        flights[one.name] = ChartFlight(one.t, each, {c: one[c] for c in channels})
    own = found.simulated[0].units if found.simulated else {}
    units = {name: display_unit(unit_of(name, own)) for name in (*found.noise_std, *channels)}
    return chart_data(flights, {"physics": "simulated"}, units, verb="simulated", charts=charts)
