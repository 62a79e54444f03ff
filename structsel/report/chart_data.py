"""What the page's figures are drawn from: time histories and means, packed small."""

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

MOST_VALUES = 400_000
"""About so many in all time histories of a page; more are thinned. Each takes five and a third bytes."""
_DOTS = 1600  # in the cloud of differences, all recordings together
_FEWEST = 200  # samples of a series, however many there are


@dataclass(frozen=True, eq=False)
class ChartFlight:
    """What is drawn of one recording.

    Attributes
    ----------
    t : (n,) array [s]
    responses : mapping of response to mapping of stage to (n,) array
        ``measured``, and what a model says of it at each stage; perhaps ``surprise``, a filter's own.
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
    surprise: str = "",
    binned: Mapping[str, Mapping[str, Any]] | None = None,
    charts: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Data of the figures, in the units that people read; plain values that JSON holds.

    Parameters
    ----------
    flights : mapping of recording to ChartFlight
        All of the same channels; a response may be missing in some.
    stages : mapping of stage to str
        What each is called.
    units : mapping of name to (factor, unit)
        Of responses and channels, to what is shown.
    verb : str
        What was done to the responses: simulated, modelled, ...
    hidden : sequence of stage
        Lines that are not shown at first.
    surprise : str
        What the responses' surprise is called, if there is one.
    binned : mapping of response to mapping of channel, optional
        Means of the differences; made here if not given.
    charts : sequence of mapping
        Figures that stand alone.
    """
    flights = {name: one for name, one in flights.items() if one.responses}
    responses = list(dict.fromkeys(r for one in flights.values() for r in one.responses))
    channels = list(next(iter(flights.values())).channels) if flights else []
    shares = _shares(flights)
    longest = max(((len(one.t) / shares[name], name) for name, one in flights.items()), default=(0.0, ""))
    thinned = ""
    if longest[0] > 1.0:
        one = flights[longest[1]]
        seconds = float(one.t[-1] - one.t[0]) / shares[longest[1]]
        thinned = f"{format_number(4.0 * seconds, 2)} s"
    return {
        "recordings": {name: _pack_flight(one, units, shares[name]) for name, one in flights.items()},
        "responses": responses,
        "channels": channels,
        "units": {name: unit for name, (_, unit) in units.items()},
        "stages": [list(pair) for pair in stages.items()],
        "verb": verb,
        "hidden": list(hidden),
        "surprise": surprise,
        "thinned": thinned,
        "binned": _bin_all(flights, responses, channels, stages, units) if binned is None else binned,
        "first": {c: _reach(flights, c, units[c][0]) for c in channels},
        "cloud": _cloud(flights, responses, channels, stages, units),
        "findings": [],
        "charts": list(charts),
    }


def chart(
    name: str,
    x: Sequence[float],
    lines: Sequence[tuple[str, str, Sequence[float]]],
    *,
    x_label: str,
    y_label: str,
    says: str,
    log: bool = False,
    labels: Sequence[str] = (),
    whole: bool = True,
) -> dict[str, Any]:
    """A figure that stands alone; lines are (name, ink, values), on a logarithmic scale to `log` if it is worth one.

    Lines of one name have one key. `whole` numbers along x each have a dot.
    """
    known = [y for _, _, values in lines for y in values if y > 0.0]
    log = log and bool(known) and max(known) > 10.0 * min(known)

    def value(y: float) -> float | None:
        return pack_number(math.log10(y) if y > 0.0 else math.nan) if log else pack_number(y)

    return {
        "id": name, "x": list(x), "xLabel": x_label, "yLabel": y_label, "says": says, "log": log, "whole": whole,
        "lines": [{"name": n, "ink": ink, "y": [value(float(y)) for y in values]} for n, ink, values in lines],
        "labels": list(labels) or None,
    }  # fmt: skip


def moving(name: str, flights: Sequence[Mapping[str, Array]]) -> bool:
    """Whether every flight has a channel, and it moves in some."""
    if not all(name in one for one in flights):
        return False
    known = [one[name][np.isfinite(one[name])] for one in flights]
    return all(x.size for x in known) and any(np.ptp(x) > 0.0 for x in known)


def _shares(flights: Mapping[str, ChartFlight]) -> dict[str, int]:
    """Samples of each series of each recording that are drawn."""
    whole = {
        name: len(one.t) * (1 + len(one.channels) + sum(map(len, one.responses.values())))
        for name, one in flights.items()
    }
    if sum(whole.values()) <= MOST_VALUES:
        return {name: len(one.t) for name, one in flights.items()}
    total = sum(len(one.t) for one in flights.values())
    made = {}
    for name, one in flights.items():
        # Each thinned series of values has its own clock.
        series = sum(1 + len(held) for held in one.responses.values()) + 2 * len(one.channels)
        most = int(MOST_VALUES * len(one.t) / total / max(series, 1))
        made[name] = min(len(one.t), max(most, _FEWEST))
    return made


def _pack_flight(one: ChartFlight, units: Mapping[str, tuple[float, str]], most: int) -> dict[str, Any]:
    start = float(one.t[0])

    def clock(kept: NDArray[np.intp]) -> dict[str, str]:
        # From the first sample on: single precision does not hold the seconds of a day to a millisecond.
        return {} if len(kept) == len(one.t) else {"t": _pack(one.t[kept] - start)}

    responses, channels = {}, {}
    for r, held in one.responses.items():
        stages = [values for kind, values in held.items() if kind not in ("measured", "surprise")]
        kept = keep_extremes([held["measured"], held["measured"] - stages[-1]], most)
        scaled = {kind: (1.0 if kind == "surprise" else units[r][0]) * values[kept] for kind, values in held.items()}
        responses[r] = {"y": {kind: _pack(values) for kind, values in scaled.items()}, **clock(kept)}
    for c, values in one.channels.items():
        kept = keep_extremes([values], most)
        channels[c] = {"y": _pack(units[c][0] * values[kept]), **clock(kept)}
    own = one.t if most == len(one.t) else one.t[[0, -1]]  # the ends alone where each series has its own clock
    return {"start": start, "t": _pack(own - start), "channels": channels, "responses": responses}


def _bin_all(
    flights: Mapping[str, ChartFlight],
    responses: Sequence[str],
    channels: Sequence[str],
    stages: Mapping[str, str],
    units: Mapping[str, tuple[float, str]],
) -> dict[str, dict[str, Any]]:
    stretch = split_into_segments([len(one.t) for one in flights.values()]) if flights else np.zeros(0, dtype=int)
    left = {r: {kind: _left(flights, r, kind) for kind in stages} for r in responses}
    made: dict[str, dict[str, Any]] = {r: {} for r in responses}
    for c in channels:
        x = np.concatenate([one.channels[c] for one in flights.values()])
        for r in responses:
            means, half, at = {}, {}, np.zeros(0)
            for kind, e in left[r].items():
                seen = np.isfinite(x) & np.isfinite(e)
                found = bin_means(x[seen], e[seen], stretch[seen]) if seen.any() else BinMeans(at, at, at, at)
                at = found.at
                means[kind] = [pack_number(units[r][0] * y) for y in found.means]
                half[kind] = [pack_number(units[r][0] * y) for y in found.half]
            made[r][c] = {"at": [pack_number(units[c][0] * y) for y in at], "means": means, "half": half}
    return made


def _left(flights: Mapping[str, ChartFlight], response: str, kind: str) -> Array:
    """Measured less modelled, all recordings; NaN where there is no such response."""
    each = []
    for one in flights.values():
        held = one.responses.get(response)
        each.append(np.full(len(one.t), np.nan) if held is None else held["measured"] - held[kind])
    return np.concatenate(each) if each else np.zeros(0)


def _cloud(
    flights: Mapping[str, ChartFlight],
    responses: Sequence[str],
    channels: Sequence[str],
    stages: Mapping[str, str],
    units: Mapping[str, tuple[float, str]],
) -> dict[str, Any]:
    """Evenly spaced samples of all recordings, dots of one kind for each response and channel."""
    total = sum(len(one.t) for one in flights.values())
    some = slice(None, None, max(1, -(-total // _DOTS)))
    return {
        "channels": {
            c: _pack(units[c][0] * np.concatenate([one.channels[c] for one in flights.values()])[some])
            for c in channels
        },
        "left": {r: {kind: _pack(units[r][0] * _left(flights, r, kind)[some]) for kind in stages} for r in responses},
    }


def _reach(flights: Mapping[str, ChartFlight], channel: str, factor: float) -> list[float | None]:
    x = factor * np.concatenate([one.channels[channel] for one in flights.values()])
    return [pack_number(float(np.nanmin(x))), pack_number(float(np.nanmax(x)))]


def _pack(x: Array) -> str:
    """Samples as base64 of little-endian float32: short, and it holds nan."""
    return base64.b64encode(np.ascontiguousarray(x, dtype="<f4").tobytes()).decode("ascii")


def pack_number(x: float) -> float | None:
    """Six digits; what is not a finite number as null."""
    return float(f"{x:.6g}") if math.isfinite(x) else None
