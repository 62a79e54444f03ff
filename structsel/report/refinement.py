"""Page of a refinement: estimated parameters, their standard errors, and the fit of the simulated outputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
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
from structsel.metrics import in_tables
from structsel.nomenclature import unit_of
from structsel.recording import Recording
from structsel.refinement import Estimate, Refinement
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
from structsel.tables import Column, Table, text_column
from structsel.validation import Resimulation
from structsel.validation.resimulation import KINDS, table_heads

_INPUTS = ("de", "da", "dr", "df", "throttle", "thrust")
_MAX_CHANNELS = 14
_Z95 = 1.96
_MAX_ABOVE = 12  # rows of a table above the time histories
_KINDS = {"windows": "in windows", "whole": "complete"}
_LEGEND = (
    "Std error: with allowance for coloured residuals. CRLB: Cramer-Rao lower bound, which assumes white residuals. "
    "R²: explained fraction of the variance. TIC: Theil's inequality coefficient, 0 perfect, 1 useless. Parameters are "
    "in SI units and radians, outputs in the unit shown."
)


def page_of(
    found: Refinement, recordings: Sequence[Recording], judged: Mapping[str, Resimulation], reasons: Sequence[str]
) -> Page:
    """Page of a refinement; `recordings` are those it used, `judged` re-simulations of others."""
    converged = found.converged and not reasons
    warnings = [("", text) for text in found.doubts]
    for name, one in judged.items():
        warnings += [(f"{name} the refinement", text) for text in (*one.divergence_notes(), *one.doubts)]
    charts = [_cost_chart(found)] if len(found.costs) > 1 else []
    ended = () if found.converged else (f"NOT CONVERGED: {found.message}. The best estimates found are shown.",)
    first, *others = _parameters(found)
    sections = [
        Section("Parameters", (count_of(len(first.rows), "parameter"),), tables=(first,)),
        Section("Outputs", tables=(fits := _fits(found),), after=len(fits.rows) > _MAX_ABOVE),
    ]
    if judged:
        sections.insert(0, _validation(judged))
    sections += [Section(one.title, tables=(replace(one, title=""),), after=True) for one in others]
    if charts:
        sections.append(Section("Search", text=(_search(found),), charts=("descent",), after=True))
    held_out = [r for one in judged.values() for r in one.recordings]
    ratios = _error_ratios(found, judged)
    headline, *summary = _headline(found, ratios, held_out, converged)
    used = recordings or found.simulated
    sources = list({r.name: r for r in (*used, *held_out)}.values())
    ending = "" if converged else ", not converged"
    decided = _verdict(found, ratios)
    good = decided == "better" and not found.doubts
    return Page(
        verdict="failed" if reasons else f"{decided}{ending}",
        status="bad" if not converged or decided == "worse" else "good" if good else "warning",
        headline=headline,
        summary=tuple(summary),
        about=_about(found, held_out),
        reasons=(*reasons, *ended),
        sections=tuple(sections),
        warnings=merge_notes(warnings),
        notes=(),
        method=(_method(found),),
        sources=list_sources(sources, held_out=[r.name for r in held_out]),
        history=list_history(sources),
        data=_figures(found, recordings, charts),
        legend=_LEGEND,
    )


def _error_ratios(found: Refinement, judged: Mapping[str, Resimulation]) -> dict[str, float]:
    """Error on the validation recordings over that before the refinement, of each output."""
    if not {"before", "after"} <= set(judged):
        return {}
    shared = [o for o in judged["after"].outputs if o in found.noise_std]
    ratios = {o: judged["after"].score(o).rms_error / judged["before"].score(o).rms_error for o in shared}
    return {o: ratio for o, ratio in ratios.items() if math.isfinite(ratio)}


def _verdict(found: Refinement, ratios: Mapping[str, float]) -> str:
    """Verdict of the refinement; if it had no held-out recordings, of the re-simulations that were given."""
    if found.verdict != "not validated" or not ratios:
        return found.verdict
    if all(ratio < 1.0 for ratio in ratios.values()):
        return "better"
    return "worse" if all(ratio > 1.0 for ratio in ratios.values()) else "better in some outputs"


def _headline(
    found: Refinement, ratios: Mapping[str, float], held_out: Sequence[Recording], converged: bool
) -> list[str]:
    """Sentences on the verdict, the fit, the parameter that changed most, and the prediction."""
    search = "The search converged" if converged else "The search did not converge"
    known = [f.r2 for f in found.fits if math.isfinite(f.r2)]
    fit = f" with R² from {format_decimals(min(known), 3)} to {format_decimals(max(known), 3)}" if known else ""
    kept = " The original model is kept." if found.model is not found.refined else ""
    if found.verdict == "not validated" and ratios:
        names = join_names(dict.fromkeys(r.name for r in held_out))
        sentences = [f"The refined model is {_verdict(found, ratios)} on {names}: {_ratio_text(ratios)}."]
    else:
        verdict, _, reason = found.statement.partition(" (")
        sentences = [f"The refined model is {verdict}.{kept}"]
        sentences += [f"{reason.removesuffix(')').capitalize()}."] if reason else []
        if ratios:
            sentences.append(f"On validation recordings, {_ratio_text(ratios)}.")
    sentences.append(f"{search}: the model simulates {join_names(found.noise_std)}{fit}.")
    ranked = [e for e in found.estimates if e.kind == "model" and math.isfinite(e.std) and e.std > 0.0]
    if ranked:
        largest = max(ranked, key=lambda e: abs(e.value - e.start) / e.std)
        if abs(largest.value - largest.start) > _Z95 * largest.std:
            change = f"from {format_number(largest.start)} to {_estimate_text(largest)}"
            sentences.append(f"Most significant change: {largest.name}, {change}.")
    return sentences


def _ratio_text(ratios: Mapping[str, float]) -> str:
    """Smallest and largest ratio of the errors."""
    ranked = sorted((x, o) for o, x in ratios.items())
    ends = [f"{format_percent(x)} ({o})" for x, o in (ranked[0], ranked[-1])]
    between = f"between {ends[0]} and {ends[1]}" if len(ranked) > 1 else ends[0]
    return f"the rms error is {between} of the error before the refinement"


def _estimate_text(e: Estimate) -> str:
    return f"{format_number(e.value)} ± {format_number(e.std, 2)}"


def _about(found: Refinement, held_out: Sequence[Recording]) -> str:
    names = join_names(dict.fromkeys(r.name for r in held_out))
    validation = f"; validation with {names}" if held_out else ""
    samples = sum(map(len, found.simulated))
    return f"{found.title} with {count_of(len(found.simulated), 'recording')}, {samples} samples{validation}."


def _parameters(found: Refinement) -> Iterator[Table]:
    """Parameters of the model and of single recordings, with their intervals as bars; then the held parameters."""
    titles = {"parameter": "Parameters of the model", "of": "Parameters of single recordings"}  # by the first column
    for table in found.tables():
        names = [column.name for column in table.columns]
        if names[0] not in titles:
            continue
        if "CRLB" not in names:
            yield table
            continue
        value, std = names.index("value"), names.index("std error")
        bars = [
            interval_bar(str(row[0]), row[value], row[value] - _Z95 * row[std], row[value] + _Z95 * row[std])
            for row in table.rows
        ]
        made = table.with_column(names.index("CRLB"), INTERVAL, bars)
        yield replace(made, title=titles[names[0]], note=INTERVAL_NOTE)


def _fits(found: Refinement) -> Table:
    """Fit of every output, with rms errors in display units."""
    order = list(found.noise_std)
    own = found.simulated[0].units if found.simulated else {}
    rows = tuple(
        (f.output, f.recording, f.n, format_in_unit(f.rms_error, unit_of(f.output, own)), *f.cells())
        for f in sorted(found.fits, key=lambda f: order.index(f.output))
    )
    words = (text_column("output"), text_column("recording"))
    return Table((*words, Column("samples"), Column("rms error"), *_metric_columns()), rows)


def _metric_columns() -> list[Column]:
    return [Column(metric.label) for metric in in_tables(brief=True)]


def _validation(judged: Mapping[str, Resimulation]) -> Section:
    """Scores of the re-simulations before and after the refinement, in windows and over the complete recordings."""
    first = next(iter(judged.values()))
    rows = tuple(
        (output, name, *(x for kind in KINDS for x in one.score(output, "all", kind).table_cells()))
        for output in first.outputs
        for name, one in judged.items()
    )
    numbers = []
    for kind in KINDS:
        head, *others = table_heads()
        numbers += [Column(f"{_KINDS[kind]}: {head}"), *map(Column, others)]
    note = (
        f"In windows of {format_number(first.window)} s that each start from the recorded state, and over the complete "
        "recording. In band: fraction of the samples within the proof-of-match band."
    )
    text = ("Simulated with the recorded inputs; these recordings were not used for the refinement.",)
    table = Table((text_column("output"), text_column("refinement"), *numbers), rows, note=note)
    return Section("Validation", text=text, tables=(table,))


def _search(found: Refinement) -> str:
    evolution = ""
    if found.search is not None:
        generations = count_of(len(found.search.costs), "generation")
        evolution = f"Global search over {generations} with {found.search.evaluations} simulations. "
    steps = count_of(len(found.costs) - 1, "step")
    first, last = (f"{cost:.0f}" if abs(cost) >= 1e5 else format_number(cost, 6) for cost in found.costs[[0, -1]])
    cost = f"cost from {first} to {last}"
    return f"{evolution}Descent in {steps}, {cost}; {found.message}."


def _cost_chart(found: Refinement) -> dict[str, Any]:
    above = list(map(float, found.costs - found.costs.min()))
    caption = f"Cost minus its minimum, after each of {count_of(len(found.costs), 'step')} of the descent."
    return single_chart("descent", range(len(found.costs)), [("cost minus minimum", "physics", above)],
                        title="Search: cost after each step", x_label="step", y_label="cost minus minimum [-]",
                        caption=caption, log=True)  # fmt: skip


def _method(found: Refinement) -> str:
    cost = {"ml": "maximum likelihood with estimated noise", "weighted": "residuals with given weights"}[found.cost]
    name = str(getattr(found.model, "name", ""))
    model = f" of {name}" if name else ""
    return f"{found.title}{model}: {cost}. Outputs: {join_names(found.noise_std, 40)}."


def _figures(found: Refinement, recordings: Sequence[Recording], charts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    recorded = {r.name: r for r in recordings}
    channels_of: list[dict[str, Any]] = [dict(one.channels) for one in found.simulated]
    first = dict.fromkeys((*_INPUTS, *found.noise_std, *(c for one in channels_of for c in one)))
    channels = [c for c in first if is_varying(c, channels_of)][:_MAX_CHANNELS]
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
