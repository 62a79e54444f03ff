"""Page of a diagnosis: the findings, their figures, and what could not be decided."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from structsel.diagnosis.held_out_result import STAGES, ChannelScores, HeldOutSimulation
from structsel.diagnosis.result import UNNAMED, Diagnosis, EffectFinding, ToleranceDeviation
from structsel.diagnosis.text_report import (
    LARGE_DEVIATION,
    about,
    headline,
    is_shown,
    no_model,
    ranges_and_events,
    shown_findings,
    stages_of,
    tied,
    together,
    untested,
)
from structsel.formatting import (
    display_unit,
    format_estimate,
    format_in_unit,
    format_number,
    format_percent,
    format_probabilities,
    format_probability,
)
from structsel.report.diagnosis_charts import STAGE_NAMES, figures_of
from structsel.report.page_model import Section, place_sections
from structsel.tables import Bar, Cell, Column, Table, text_column

_PRINTED_RESPONSES = 3  # whose errors the printed summary has
_LEGEND = (
    "RRMSE: rms error over the rms of the measured response. R² = 1 − RRMSE². TIC: Theil's inequality coefficient, 0 "
    "perfect, 1 useless. All are computed in the compared frequency band, on recordings not used for fitting. Retuned: "
    "the simulation with its own parameters adjusted within their tolerances. Angles are in degrees."
)


def page_of(diagnosis: Diagnosis, changes: tuple[Section, ...] = ()) -> dict[str, Any]:
    """Content of the template of a diagnosis; `changes` is the section that compares it with a result before."""
    details = (f(diagnosis) for f in (_remaining, _tolerances, _untested, _detectability))
    sections = [
        *changes,
        _explained(diagnosis),
        _resimulation(diagnosis.replayed),
        *(replace(s, after=True) for s in details if s),
    ]
    return {
        "diagnosis": diagnosis,
        "headline": headline(diagnosis),
        "about": about(diagnosis),
        "seconds": format_number(diagnosis.seconds, 2) if diagnosis.seconds > 0.0 else "",
        "findings": [_finding(k, f) for k, f in enumerate(shown_findings(diagnosis))],
        "parts": place_sections([s for s in sections if s]),
        "summary": _summary(diagnosis),
        "data": figures_of(diagnosis),
        "shaded": "Shaded: the intervals in which a finding acts, and the times of changes.",
        "legend": _LEGEND,
    }


def _summary(diagnosis: Diagnosis) -> list[str]:
    """Sentences on what the findings improve on recordings that were not used for fitting, and on random effects."""
    sentences = []
    shown = shown_findings(diagnosis)
    if shown and (bars := shown[-1].bars):
        # The response whose error falls most.
        c = min(bars, key=lambda name: bars[name].physics.rrmse / max(bars[name].delivered.rrmse, 1e-12))
        last = stages_of(shown[-1], len(shown))[-1]
        before, after = bars[c].delivered.rrmse, getattr(bars[c], last).rrmse
        if math.isfinite(before) and math.isfinite(after):
            sentences.append(
                f"On recordings not used for fitting, the rms error of {c} is {format_percent(before)} of the rms of "
                f"the measured response as given, and {format_percent(after)} {STAGE_NAMES[last]}."
            )
    sentences += [f.physics[0].says for f in diagnosis.findings if not is_shown(f)]
    return sentences


def _finding(place: int, finding: EffectFinding) -> dict[str, Any]:
    first = finding.physics[0]
    values = [(name, format_estimate(e.value, e.std, e.unit, "±")) for name, e in first.parameters.items()]
    intervals = [
        (name, [(a, b, f"{a:.1f} to {b:.1f}") for a, b in each]) for name, each in finding.intervals.items() if each
    ]
    return {
        "place": place,
        "number": place + 1,
        "effect": finding.effect,
        "kind": finding.kind,
        "axes": ", ".join(finding.axes),
        "probability": format_probability(first.probability),
        "description": first.says,
        "implausible": first.plausible,
        "check": first.check,
        "terms": ", ".join(first.terms),
        "regions": ranges_and_events(finding),
        "intervals": intervals,
        "estimates": Table((text_column("parameter"), Column("estimate")), tuple(values), "Values"),
        "effects": _possible_effects(finding),
        "ambiguous_with": tied(finding),
        "together": format_probability(together(finding)),
        "to_separate": finding.to_separate,
        "errors": _errors(place, finding),
        "errors_printed": place == 0 and len(finding.bars) <= _PRINTED_RESPONSES,
        "explained": _explained_text(place, finding),
    }


def _possible_effects(finding: EffectFinding) -> Table:
    """Probabilities of the effects that may cause a finding; they add up to 1."""
    probabilities = [p.probability for p in finding.physics]
    shown, rest = format_probabilities(probabilities)
    rows = [(p.effect, p.probability, text, p.says) for p, text in zip(finding.physics, shown)]
    if rest:
        rows.append(("another effect, or none", 1.0 - sum(probabilities), rest, ""))
    cells = []
    for k, (name, probability, text, description) in enumerate(rows):
        bar = Bar(0.0, _percent(probability) or 0.0, f"{name}: {text}. {description}", "other" if k else "physics")
        cells.append((name, bar, text))
    return Table((text_column("effect"), Column(""), Column("probability")), tuple(cells), "Possible effects")


def _explained_text(place: int, finding: EffectFinding) -> str:
    """Sentence on the explained variance."""
    with_others = " with the findings before it" if place else ""
    regression = (
        f"; a regression on all recorded channels explains {format_percent(finding.explainable)}"
        if math.isfinite(finding.explainable)
        else ""
    )
    if finding.effect == UNNAMED:
        return f"No effect explains the differences{regression}."
    if not finding.is_fitted:
        return "It was detected, and not added to the simulation."
    return (
        f"Explains {format_percent(finding.explained)} of the variance of the differences{with_others}{regression}. "
        f"Its fraction of all that is explained is {format_percent(finding.fraction)}."
    )


def _errors(place: int, finding: EffectFinding) -> Table:
    """Errors at the three stages, responses in which the finding shows first; the longest bar is the largest error."""
    order = [c for c in finding.axes if c in finding.bars]
    order += [c for c in finding.bars if c not in order]
    stages = {s: STAGE_NAMES[s] for s in stages_of(finding, place + 1)}
    largest = max((getattr(b, s).rrmse for b in finding.bars.values() for s in STAGES), default=1.0) or 1.0
    rows = []
    for c in order:
        for k, (stage, name) in enumerate(stages.items()):
            fit = getattr(finding.bars[c], stage)
            bar = Bar(0.0, round(100.0 * fit.rrmse / largest, 1), f"{c} {name}: {fit.rrmse:.3f}", stage)
            rows.append(("" if k else c, name, fit.rrmse, bar, fit.r2, fit.tic))
    numbers = (Column("RRMSE", "3f"), Column("error"), Column("R2", "3f"), Column("TIC", "3f"))
    together_text = f", findings 1 to {place + 1} together" if place else ""
    rules = tuple(range(0, len(rows), len(stages)))
    return Table((text_column("response"), text_column("simulation"), *numbers), tuple(rows),
                 f"Errors in validation{together_text}", rules)  # fmt: skip


def _explained(diagnosis: Diagnosis) -> Section | None:
    """Explained variance of all findings that were added to the simulation, or that a regression predicts."""
    rows = []
    for k, f in enumerate(shown_findings(diagnosis)):
        if not (f.is_fitted or math.isfinite(f.explainable)):
            continue
        text = f"{format_percent(f.explained)} explained, {format_percent(f.explainable)} explainable"
        bar = Bar(0.0, _percent(f.explained) or 0.0, text, f"f{k % 4}", mark=_percent(f.explainable))
        rows.append((f"{k + 1}. {f.effect}", ", ".join(f.axes), f.explained, bar, f.explainable, f.fraction))
    if not rows:
        return None
    numbers = (
        Column("explained", "%"),
        Column("mark: regression"),
        Column("explainable", "%"),
        Column("fraction", "%"),
    )
    note = (
        "Fractions of the variance of the differences in the responses in which a finding shows, in validation, with "
        "this finding and those before it. Explainable: by a regression on all recorded channels. Fraction: of what "
        "all findings explain, by the logarithm of the residual power."
    )
    table = Table((text_column("finding"), text_column("responses"), *numbers), tuple(rows), note=note)
    return Section("Explained variance of the differences", tables=(table,))


def _percent(fraction: float) -> float | None:
    """Position on a bar; None if the fraction is unknown."""
    return round(100.0 * float(np.clip(fraction, 0.0, 1.0)), 1) if math.isfinite(fraction) else None


def _resimulation(result: HeldOutSimulation | None) -> Section | None:
    """Simulation of recordings that were not used for fitting, in short windows."""
    title = "Re-simulation in short windows"
    if result is None:
        return None
    if not result.rows:
        reason = result.reason or "no channel that the simulation computes was recorded"
        return Section(title, text=(f"Not done: {reason}.",))
    text = (
        f"The recordings that were not used for fitting are divided into {result.windows} windows of "
        f"{format_number(result.seconds, 2)} s. Each window is simulated from the recorded state, with the "
        "coefficients of the simulation along the recorded path and their derivatives for deviations from it."
    )
    stages = [STAGE_NAMES.get(stage, stage) for stage in result.rows[0].stages]
    columns = [Column(f"{quantity}, {stage}") for quantity in ("rms error", "TIC", "in band") for stage in stages]
    note = (
        "rms errors are relative to the smoothed recording, in the unit of the band. TIC is of the change since the "
        "start of a window. The band is two standard deviations of the measurement noise: 95 % of the measurements are "
        "within the band of a perfect simulation."
    )
    rows = tuple(map(_resimulation_row, result.rows))
    table = Table((text_column("channel"), Column("band"), *columns), rows, note=note)
    return Section(title, text=(text,), tables=(table,), charts=("windows",) if result.example else ())


def _resimulation_row(row: ChannelScores) -> tuple[Any, ...]:
    factor, _ = display_unit(row.unit)
    each = row.stages.values()
    rms = (format_number(factor * one.rms, 2) for one in each)
    tic = (f"{one.tic:.3f}" if math.isfinite(one.tic) else "-" for one in each)
    inside = (format_percent(one.inside) for one in each)
    return (row.channel, f"± {format_in_unit(row.band, row.unit, 2)}", *rms, *tic, *inside)


def _remaining(diagnosis: Diagnosis) -> Section:
    """Errors that remain after all findings."""
    rows = tuple(
        (c, rrmse, Cell("white", "good") if white else Cell("coloured: an effect may be missing", "warning"))
        for c, (rrmse, white) in diagnosis.remaining.items()
    )
    tables = (Table((text_column("response"), Column("RRMSE", "3f"), text_column("residual")), rows),) if rows else ()
    text = [] if rows else ["No response could be validated."]
    if reason := no_model(diagnosis):
        text.append(f"No model: {reason}.")
    return Section("Remaining differences", text=tuple(text), tables=tables)


def _tolerances(diagnosis: Diagnosis) -> Section | None:
    """Estimated deviations of parameters with a tolerance."""
    if not diagnosis.deviations:
        return None
    text = (
        "Estimated deviations of the parameters of the simulation and the instruments, in their stated standard "
        "deviations (σ)."
    )
    heads = (text_column("parameter"), Column("σ"), Column("−4 σ to +4 σ"), Column("deviation"))
    return Section("Deviations from the stated values", text=(text,),
                   tables=(Table(heads, tuple(map(_tolerance_row, diagnosis.deviations))),))  # fmt: skip


def _tolerance_row(one: ToleranceDeviation) -> tuple[Any, ...]:
    factor, unit = display_unit(one.unit)
    large = abs(one.deviations) >= LARGE_DEVIATION
    length = round(min(50.0, 12.5 * abs(one.deviations)), 1)  # half of the width is 4 sigma
    low, high = (50.0, 50.0 + length) if one.deviations >= 0.0 else (50.0 - length, 50.0)
    value = f"{format_number(factor * one.value, 2, signed=True)} ± {format_number(factor * one.std, 1)} {unit}".strip()
    sigmas, tone = f"{one.deviations:+z.1f}", "bad" if large else ""
    bar = Bar(low, high, f"{one.name}: {sigmas} standard deviations", "delivered" if large else "other", 50.0)
    return one.name, Cell(sigmas, tone), bar, Cell(value, tone)  # type: ignore[arg-type]


def _untested(diagnosis: Diagnosis) -> Section | None:
    """Effects that these recordings cannot test."""
    found = untested(diagnosis)
    if not found:
        return None
    rows = tuple((", ".join(effects), needs) for needs, effects in found.items())
    table = Table((text_column("effects", wrap=True), text_column("needed", wrap=True)), rows)
    return Section("Effects that could not be tested", tables=(table,))


def _detectability(diagnosis: Diagnosis) -> Section | None:
    """Smallest detectable size of each effect, the smallest first."""
    rows = []
    for effect, found in diagnosis.detects.items():
        size = found.get("size", math.nan)
        others = sorted((gain, name) for name, gain in found.items() if name != "size")
        similar = f"{others[0][1].removeprefix('nats against ')} ({format_number(others[0][0], 3)})" if others else "-"
        known = math.isfinite(size)
        rows.append((size if known else math.inf, effect, f"{100.0 * size:.1f} %" if known else "at no size", similar))
    if not rows:
        return None
    text = (
        "Each effect was added to these recordings with increasing size. The size is the smallest one that is "
        "identified, in percent of the rms of the response in which the effect is largest. The last column is the most "
        "similar effect, with the log Bayes factor that separates the two."
    )
    heads = (text_column("effect"), Column("identified from"), text_column("most similar effect"))
    table = Table(heads, tuple(row[1:] for row in sorted(rows)))
    return Section("Detectability", text=(text,), tables=(table,), folded=diagnosis.verdict == "mismatch")
