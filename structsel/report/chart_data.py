"""Data of the charts of a page: time histories, bin means and scatter, in a compact form."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.formatting import format_number
from structsel.numerics.arrays import Array
from structsel.numerics.binning import BinMeans, bin_means, split_into_segments
from structsel.report.downsampling import keep_extremes

MAX_VALUES = 400_000
"""Approximate number of values in all time histories of a page; longer ones are decimated. A value takes 5.3 bytes."""
_MAX_DOTS = 1600  # of the scatter plots, all recordings together
_MIN_SAMPLES = 200  # of a decimated series


@dataclass(frozen=True, eq=False)
class ChartFlight:
    """Time histories of one recording.

    Attributes
    ----------
    t : (n,) array [s]
    responses : mapping of response to mapping of stage to (n,) array
        ``measured``, and the modelled response at each stage; ``innovation`` where a filter has one.
    channels : mapping of channel to (n,) array
    """

    t: Array
    responses: Mapping[str, Mapping[str, Array]]
    channels: Mapping[str, Array]


def chart_data(
    flights: Mapping[str, ChartFlight],
    stages: Mapping[str, str],
    units: Mapping[str, tuple[float, str]],
    *,
    verb: str,
    hidden: Sequence[str] = (),
    innovation: str = "",
    binned: Mapping[str, Mapping[str, Any]] | None = None,
    charts: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Data of the charts, in display units; plain values that JSON holds.

    Parameters
    ----------
    flights : mapping of recording to ChartFlight
        They have the same channels; a response may be missing in some.
    stages : mapping of stage to str
        Name of each stage in the legend.
    units : mapping of name to (factor, unit)
        Display unit of each response and channel, and the factor to it.
    verb : str
        Origin of the responses of a stage: simulated, modelled, ...
    hidden : sequence of stage
        Lines that are hidden at first.
    innovation : str
        Name of the innovations, if the responses have any.
    binned : mapping of response to mapping of channel, optional
        Bin means of the differences; computed by default.
    charts : sequence of mapping
        Further charts, from `single_chart`.
    """
    flights = {name: one for name, one in flights.items() if one.responses}
    responses = list(dict.fromkeys(r for one in flights.values() for r in one.responses))
    channels = list(next(iter(flights.values())).channels) if flights else []
    samples = _samples_per_series(flights)
    longest = max(((len(one.t) / samples[name], name) for name, one in flights.items()), default=(0.0, ""))
    decimated = ""
    if longest[0] > 1.0:
        one = flights[longest[1]]
        seconds = float(one.t[-1] - one.t[0]) / samples[longest[1]]
        decimated = f"{format_number(4.0 * seconds, 2)} s"
    return {
        "recordings": {name: _pack_flight(one, units, samples[name]) for name, one in flights.items()},
        "responses": responses,
        "channels": channels,
        "units": {name: unit for name, (_, unit) in units.items()},
        "stages": [list(pair) for pair in stages.items()],
        "verb": verb,
        "hidden": list(hidden),
        "innovation": innovation,
        "decimated": decimated,
        "binned": _bin_all(flights, responses, channels, stages, units) if binned is None else binned,
        "first": {c: _range(flights, c, units[c][0]) for c in channels},
        "scatter": _scatter_sample(flights, responses, channels, stages, units),
        "findings": [],
        "charts": list(charts),
    }


def single_chart(
    name: str,
    x: Sequence[float],
    lines: Sequence[tuple[str, str, Sequence[float]]],
    *,
    title: str,
    x_label: str,
    y_label: str,
    caption: str,
    log: bool = False,
    labels: Sequence[str] = (),
    integers: bool = True,
) -> dict[str, Any]:
    """Chart of lines, each (name, style, values); lines of the same name share one entry of the legend.

    With `log` the y axis is logarithmic if the values span more than a decade; with `integers`, x has whole numbers and
    each value a dot.
    """
    known = [y for _, _, values in lines for y in values if y > 0.0]
    log = log and bool(known) and max(known) > 10.0 * min(known)

    def value(y: float) -> float | None:
        return pack_number(math.log10(y) if y > 0.0 else math.nan) if log else pack_number(y)

    return {
        "id": name, "title": title, "x": list(x), "xLabel": x_label, "yLabel": y_label,
        "caption": caption, "log": log, "integers": integers,
        "lines": [{"name": n, "style": style, "y": [value(float(y)) for y in values]} for n, style, values in lines],
        "labels": list(labels) or None,
    }  # fmt: skip


def is_varying(name: str, flights: Sequence[Mapping[str, Array]]) -> bool:
    """Whether every flight has a channel that is not constant in all of them."""
    if not all(name in one for one in flights):
        return False
    known = [one[name][np.isfinite(one[name])] for one in flights]
    return all(x.size for x in known) and any(np.ptp(x) > 0.0 for x in known)


def _samples_per_series(flights: Mapping[str, ChartFlight]) -> dict[str, int]:
    """Number of samples of each series of a recording that are drawn."""
    values = {
        name: len(one.t) * (1 + len(one.channels) + sum(map(len, one.responses.values())))
        for name, one in flights.items()
    }
    if sum(values.values()) <= MAX_VALUES:
        return {name: len(one.t) for name, one in flights.items()}
    total = sum(len(one.t) for one in flights.values())
    samples = {}
    for name, one in flights.items():
        # Each decimated series has its own times.
        series = sum(1 + len(lines) for lines in one.responses.values()) + 2 * len(one.channels)
        maximum = int(MAX_VALUES * len(one.t) / total / max(series, 1))
        samples[name] = min(len(one.t), max(maximum, _MIN_SAMPLES))
    return samples


def _pack_flight(one: ChartFlight, units: Mapping[str, tuple[float, str]], maximum: int) -> dict[str, Any]:
    start = float(one.t[0])

    def times(kept: NDArray[np.intp]) -> dict[str, str]:
        # Relative to the first sample: single precision does not resolve a millisecond of a day.
        return {} if len(kept) == len(one.t) else {"t": _pack(one.t[kept] - start)}

    responses, channels = {}, {}
    for r, lines in one.responses.items():
        stages = [values for kind, values in lines.items() if kind not in ("measured", "innovation")]
        kept = keep_extremes([lines["measured"], lines["measured"] - stages[-1]], maximum)
        scaled = {kind: (1.0 if kind == "innovation" else units[r][0]) * y[kept] for kind, y in lines.items()}
        responses[r] = {"y": {kind: _pack(values) for kind, values in scaled.items()}, **times(kept)}
    for c, values in one.channels.items():
        kept = keep_extremes([values], maximum)
        channels[c] = {"y": _pack(units[c][0] * values[kept]), **times(kept)}
    own = one.t if maximum == len(one.t) else one.t[[0, -1]]  # the ends only if each series has its own times
    return {"start": start, "t": _pack(own - start), "channels": channels, "responses": responses}


def _bin_all(
    flights: Mapping[str, ChartFlight],
    responses: Sequence[str],
    channels: Sequence[str],
    stages: Mapping[str, str],
    units: Mapping[str, tuple[float, str]],
) -> dict[str, dict[str, Any]]:
    segments = split_into_segments([len(one.t) for one in flights.values()]) if flights else np.zeros(0, dtype=int)
    residuals = {r: {kind: _residual(flights, r, kind) for kind in stages} for r in responses}
    made: dict[str, dict[str, Any]] = {r: {} for r in responses}
    for c in channels:
        x = np.concatenate([one.channels[c] for one in flights.values()])
        for r in responses:
            means, half, at = {}, {}, np.zeros(0)
            for kind, e in residuals[r].items():
                known = np.isfinite(x) & np.isfinite(e)
                found = bin_means(x[known], e[known], segments[known]) if known.any() else BinMeans(at, at, at, at)
                at = found.at
                means[kind] = [pack_number(units[r][0] * y) for y in found.means]
                half[kind] = [pack_number(units[r][0] * y) for y in found.half]
            made[r][c] = {"at": [pack_number(units[c][0] * y) for y in at], "means": means, "half": half}
    return made


def _residual(flights: Mapping[str, ChartFlight], response: str, kind: str) -> Array:
    """Measured minus modelled response of all recordings; NaN where a recording does not have it."""
    each = []
    for one in flights.values():
        lines = one.responses.get(response)
        each.append(np.full(len(one.t), np.nan) if lines is None else lines["measured"] - lines[kind])
    return np.concatenate(each) if each else np.zeros(0)


def _scatter_sample(
    flights: Mapping[str, ChartFlight],
    responses: Sequence[str],
    channels: Sequence[str],
    stages: Mapping[str, str],
    units: Mapping[str, tuple[float, str]],
) -> dict[str, Any]:
    """Evenly spaced samples of all recordings: channels, and residuals of each response at each stage."""
    total = sum(len(one.t) for one in flights.values())
    some = slice(None, None, max(1, -(-total // _MAX_DOTS)))
    return {
        "channels": {
            c: _pack(units[c][0] * np.concatenate([one.channels[c] for one in flights.values()])[some])
            for c in channels
        },
        "residuals": {
            r: {kind: _pack(units[r][0] * _residual(flights, r, kind)[some]) for kind in stages} for r in responses
        },
    }


def _range(flights: Mapping[str, ChartFlight], channel: str, factor: float) -> list[float | None]:
    x = factor * np.concatenate([one.channels[channel] for one in flights.values()])
    return [pack_number(float(np.nanmin(x))), pack_number(float(np.nanmax(x)))]


def _pack(x: Array) -> str:
    """Samples as base64 of little-endian float32, which is short and holds NaN."""
    return base64.b64encode(np.ascontiguousarray(x, dtype="<f4").tobytes()).decode("ascii")


def pack_number(x: float) -> float | None:
    """Number with six significant digits; None if it is not finite."""
    return float(f"{x:.6g}") if math.isfinite(x) else None
