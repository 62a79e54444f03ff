"""What the page's figures are drawn from: time histories and means, packed small."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from structsel.diagnosis.result import Diagnosis, Trace
from structsel.diagnosis.story import displayed
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
from structsel.numerics.smoothing.result import Array

MOST_VALUES = 300_000
"""In all time histories of a page; more are thinned. Each takes five and a third bytes."""


def chart_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """Data of the figures, in the units that people read; plain values that JSON holds."""
    responses, channels = shown_responses(diagnosis), moving_channels(diagnosis)
    per_sample = 1 + len(channels) + 4 * len(responses)
    total = per_sample * sum(len(one.t) for one in diagnosis.traces.values())
    every = max(1, -(-total // MOST_VALUES))
    scale = {name: displayed(unit_shown(name)) for name in (*responses, *channels)}
    ranges = {c: _range(diagnosis, c) for c in channels}
    return {
        "recordings": {
            name: _pack_trace(one, responses, channels, scale, slice(None, None, every))
            for name, one in diagnosis.traces.items()
        },
        "responses": responses,
        "channels": channels,
        "units": {name: unit for name, (_, unit) in scale.items()},
        "binned": {
            r: {c: _pack_bins(bin_residuals(diagnosis, r, c, ranges[c]), scale[r][0], scale[c][0]) for c in channels}
            for r in responses
        },
        "first": {c: _first(diagnosis, c, ranges[c], scale[c][0]) for c in channels},
        "findings": [
            {
                "effect": f.effect,
                "response": next((c for c in f.axes if c in responses), ""),
                "channel": driving_channel(diagnosis, f),
                "intervals": {name: [list(s) for s in each] for name, each in f.intervals.items()},
                "region": {c: [_number(scale[c][0] * x) for x in at] for c, at in f.region.items() if c in scale},
            }
            for f in diagnosis.findings
        ],
    }


def _range(diagnosis: Diagnosis, channel: str) -> tuple[float, float] | None:
    """Where on a channel the first finding that is bounded there acts."""
    each = (acting_range(diagnosis, f, channel) for f in diagnosis.findings)
    return next((one for one in each if one is not None), None)


def _pack_trace(
    trace: Trace, responses: list[str], channels: list[str], scale: dict[str, tuple[float, str]], some: slice
) -> dict[str, Any]:
    held = {"measured": trace.measured} | dict(zip(STAGES, (trace.simulated, trace.refitted, trace.explained)))
    return {
        "t": _pack(trace.t[some]),
        "channels": {c: _pack(scale[c][0] * trace.channels[c][some]) for c in channels},
        "responses": {r: {k: _pack(scale[r][0] * one[r][some]) for k, one in held.items()} for r in responses},
    }


def _pack(x: Array) -> str:
    """Samples as base64 of little-endian float32: short, and it holds nan."""
    return base64.b64encode(np.ascontiguousarray(x, dtype="<f4").tobytes()).decode("ascii")


def _pack_bins(binned: Binned, response: float, channel: float) -> dict[str, Any]:
    means = {stage: [_number(response * x) for x in binned.means[stage]] for stage in STAGES}
    half = {stage: [_number(response * x) for x in binned.half[stage]] for stage in STAGES}
    return {"at": [_number(channel * x) for x in binned.at], "means": means, "half": half}


def _first(diagnosis: Diagnosis, channel: str, region: tuple[float, float] | None, factor: float) -> list[float | None]:
    x = np.concatenate([one.channels[channel] for one in diagnosis.traces.values()])
    return [_number(factor * end) for end in worth_showing(x, region)]


def _number(x: float) -> float | None:
    """Six digits; what is not a finite number as null."""
    return float(f"{x:.6g}") if math.isfinite(x) else None
