"""A diagnosis as a page: the findings, their figures, and what stays open."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from structsel.diagnosis.held_out_result import ChannelScores, ExampleWindows, HeldOutSimulation
from structsel.diagnosis.result import Bars, Diagnosis, EffectFinding, Trace
from structsel.diagnosis.story import HARD_PULL, about, headline, no_model, tied, together, untested
from structsel.diagnosis.views import (
    STAGES,
    Binned,
    acting_range,
    bin_residuals,
    driving_channel,
    moving_channels,
    shown_responses,
    unit_shown,
    worth_showing,
)
from structsel.formatting import (
    display_unit,
    format_decimals,
    format_estimate,
    format_in_unit,
    format_number,
    format_percent,
    format_probability,
    format_range,
)
from structsel.nomenclature import unit_of
from structsel.report.chart_data import ChartFlight, chart, chart_data, pack_number

_STAGES = dict(zip(STAGES, ("as delivered", "refitted", "with the physics")))


def page_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the template of a diagnosis is filled with."""
    return {
        "diagnosis": diagnosis,
        "headline": headline(diagnosis),
        "about": about(diagnosis),
        "findings": [_finding(k, f) for k, f in enumerate(diagnosis.findings)],
        "shares": [_share(k, f) for k, f in enumerate(diagnosis.findings)],
        "data": figures_of(diagnosis),
        "shaded": "Shaded: where a finding acts.",
        "remaining": [(c, format_decimals(r, 3), white) for c, (r, white) in diagnosis.remaining.items()],
        "pulls": [_pull(p.name, p.sigmas, p.value, p.std, p.unit) for p in diagnosis.pulls],
        "untested": untested(diagnosis),
        "detects": _detects(diagnosis),
        "no_model": no_model(diagnosis),
        "replayed": _replayed(diagnosis.replayed),
    }


def figures_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """Data of the figures, in the units that people read; plain values that JSON holds."""
    responses, channels = shown_responses(diagnosis), moving_channels(diagnosis)
    units = {name: display_unit(unit_shown(name)) for name in (*responses, *channels)}
    ranges = {c: _range(diagnosis, c) for c in channels}
    binned = {
        r: {c: _pack_bins(bin_residuals(diagnosis, r, c, ranges[c]), units[r][0], units[c][0]) for c in channels}
        for r in responses
    }
    flights = {name: _flight(one, responses, channels) for name, one in diagnosis.traces.items()}
    stretch = diagnosis.replayed.stretch if diagnosis.replayed else None
    charts = [_windows(diagnosis.replayed, stretch)] if diagnosis.replayed and stretch else []
    data = chart_data(flights, _STAGES, units, verb="simulated", hidden=["refitted"], binned=binned, charts=charts)
    return {
        **data,
        "first": {c: _first(diagnosis, c, ranges[c], units[c][0]) for c in channels},
        "findings": [
            {
                "effect": f.effect,
                "response": next((c for c in f.axes if c in responses), ""),
                "channel": driving_channel(diagnosis, f),
                "intervals": {name: [list(s) for s in each] for name, each in f.intervals.items()},
                "region": {c: [pack_number(units[c][0] * x) for x in at] for c, at in f.region.items() if c in units},
            }
            for f in diagnosis.findings
        ],
    }


def _windows(replay: HeldOutSimulation, stretch: ExampleWindows) -> dict[str, Any]:
    """Time history of the channel that gained most, with its band, in windows of the first and the last stage."""
    band = next(row.band for row in replay.rows if row.channel == stretch.channel)
    factor, unit = display_unit(unit_of(stretch.channel))
    first, last = (list(stretch.simulated)[i] for i in (0, -1))
    lines = [("band", "other", stretch.smoothed + edge) for edge in (-band, band)]
    lines += [("measured", "measured", stretch.measured)]
    lines += [(_STAGES[stage], stage, stretch.simulated[stage]) for stage in (first, last)]
    says = (
        f"{stretch.channel} of {stretch.recording} in windows that start from the recorded state: measured, with its "
        f"band of ± {format_in_unit(band, unit_of(stretch.channel), 2)}, {_STAGES[first]} and {_STAGES[last]}."
    )
    return chart(
        "windows",
        [pack_number(t) or 0.0 for t in stretch.t],
        [(name, ink, [factor * float(y) for y in values]) for name, ink, values in lines],
        x_label="t [s]",
        y_label=f"{stretch.channel} [{unit}]" if unit else stretch.channel,
        says=says,
        whole=False,
    )


def _replayed(replay: HeldOutSimulation | None) -> dict[str, Any] | None:
    """Table of what was flown again; None where nothing was asked to fly."""
    if replay is None:
        return None
    return {
        "reason": replay.reason,
        "seconds": f"{replay.seconds:.1f} s",
        "windows": replay.windows,
        "stages": list(replay.rows[0].stages) if replay.rows else [],
        "rows": [_replay_row(row) for row in replay.rows],
        "drawn": replay.stretch is not None,
    }


def _replay_row(row: ChannelScores) -> dict[str, Any]:
    factor, _ = display_unit(row.unit)
    each = row.stages.values()
    return {
        "channel": row.channel,
        "rms": [format_number(factor * near.rms, 2) for near in each],
        "tic": [format_decimals(near.tic, 3) for near in each],
        "inside": [format_percent(near.inside) for near in each],
        "band": f"± {format_in_unit(row.band, row.unit, 2)}",
    }


def _flight(trace: Trace, responses: list[str], channels: list[str]) -> ChartFlight:
    held = {"measured": trace.measured} | dict(zip(STAGES, (trace.simulated, trace.refitted, trace.explained)))
    each = {r: {kind: values[r] for kind, values in held.items()} for r in responses}
    return ChartFlight(trace.t, each, {c: trace.channels[c] for c in channels})


def _range(diagnosis: Diagnosis, channel: str) -> tuple[float, float] | None:
    """Where on a channel the first finding that is bounded there acts."""
    each = (acting_range(diagnosis, f, channel) for f in diagnosis.findings)
    return next((one for one in each if one is not None), None)


def _first(diagnosis: Diagnosis, channel: str, region: tuple[float, float] | None, factor: float) -> list[float | None]:
    x = np.concatenate([one.channels[channel] for one in diagnosis.traces.values()])
    return [pack_number(factor * end) for end in worth_showing(x, region)]


def _pack_bins(binned: Binned, response: float, channel: float) -> dict[str, Any]:
    means = {stage: [pack_number(response * x) for x in binned.means[stage]] for stage in STAGES}
    half = {stage: [pack_number(response * x) for x in binned.half[stage]] for stage in STAGES}
    return {"at": [pack_number(channel * x) for x in binned.at], "means": means, "half": half}


def _finding(place: int, finding: EffectFinding) -> dict[str, Any]:
    first = finding.physics[0]
    return {
        "place": place,
        "number": place + 1,
        "effect": finding.effect,
        "kind": finding.kind,
        "axes": ", ".join(finding.axes),
        "chance": format_probability(first.probability),
        "percent": format_percent(first.probability),
        "share": format_percent(finding.share),
        "says": first.says,
        "plausible": first.plausible,
        "check": first.check,
        "terms": ", ".join(first.terms),
        "regions": [format_range(c, limits) for c, limits in finding.region.items()],
        "stretches": [
            (name, ", ".join(f"{a:.1f} to {b:.1f}" for a, b in each))
            for name, each in finding.intervals.items()
            if each
        ],
        "parameters": [(name, format_estimate(e.value, e.std, e.unit, "±")) for name, e in first.parameters.items()],
        "rivals": [
            (p.effect, format_probability(p.probability), format_percent(p.probability), p.says)
            for p in finding.physics
        ],
        "ties": tied(finding),
        "together": format_probability(together(finding)),
        "to_separate": finding.to_separate,
        "bars": _bars(finding),
        "explained": format_percent(finding.explained),
        "explainable": format_percent(finding.explainable),
    }


def _bars(finding: EffectFinding) -> list[dict[str, Any]]:
    """Rows of the three bars, responses in which it shows first; lengths in percent of the longest."""
    order = [c for c in finding.axes if c in finding.bars]
    order += [c for c in finding.bars if c not in order]
    longest = max((getattr(b, s).rrmse for b in finding.bars.values() for s in STAGES), default=1.0) or 1.0
    return [{"response": c, "stages": _stages(finding.bars[c], longest)} for c in order]


def _stages(bars: Bars, longest: float) -> list[dict[str, Any]]:
    made = []
    for stage, name in _STAGES.items():
        fit = getattr(bars, stage)
        numbers = {
            "rrmse": format_decimals(fit.rrmse, 3),
            "r2": format_decimals(fit.r2, 3),
            "tic": format_decimals(fit.tic, 3),
        }
        made.append({"stage": stage, "name": name, "long": round(100.0 * fit.rrmse / longest, 1), **numbers})
    return made


def _share(place: int, finding: EffectFinding) -> dict[str, Any]:
    """How much of the mismatch is explained where a finding shows, and how much could be."""
    told, most = (
        round(100.0 * float(np.clip(x, 0.0, 1.0)), 1) if np.isfinite(x) else None
        for x in (finding.explained, finding.explainable)
    )
    return {"place": place, "name": finding.effect, "axes": ", ".join(finding.axes), "told": told, "most": most,
            "explained": format_percent(finding.explained), "explainable": format_percent(finding.explainable),
            "share": format_percent(finding.share)}  # fmt: skip


def _pull(name: str, sigmas: float, value: float, std: float, unit: str) -> dict[str, Any]:
    factor, shown = display_unit(unit)
    return {
        "name": name,
        "sigmas": f"{sigmas:+.1f}",
        "long": round(min(50.0, 12.5 * abs(sigmas)), 1),  # half of the cell is four sigma
        "side": "up" if sigmas >= 0.0 else "down",
        "hard": abs(sigmas) >= HARD_PULL,
        "value": f"{factor * value:+.2g} ± {factor * std:.1g} {shown}".strip(),
    }


def _detects(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Self-test, smallest size first, with the rival hardest to tell apart."""
    made = []
    for effect, found in diagnosis.detects.items():
        rivals = sorted((nats, name) for name, nats in found.items() if name != "size")
        near = f"{rivals[0][1].removeprefix('nats against ')} ({rivals[0][0]:.3g} nats)" if rivals else "-"
        size = found.get("size", float("nan"))
        made.append((size if math.isfinite(size) else math.inf, effect, near))
    return [
        {"effect": effect, "size": f"{100.0 * size:.1f} %" if math.isfinite(size) else "not at any size", "near": near}
        for size, effect, near in sorted(made)
    ]
