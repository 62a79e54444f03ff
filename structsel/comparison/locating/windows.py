"""Intervals in which an effect acts, from its contribution to the differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.numerics.arrays import Array

Flags = NDArray[np.bool_]

Contributions = Sequence[Mapping[str, Array]]
"""Per flight: what an effect adds to measured less simulated, by response, (n,) arrays."""
Intervals = dict[str, list[tuple[float, float]]]
"""Start and end [s] of each interval, by the flight's name."""

_ACTING = 0.21  # of the effect's peak, above which it acts
_PEAK_QUANTILE = 0.995  # quantile taken as the peak: one sample does not set it
_SEEN = 0.1  # of the noise, below which nothing acts
_GAP = 0.7  # s, shorter pauses are none
_BLIP = 0.2  # s, shorter segments are none
_EVERYWHERE = 0.8  # of all time


def clearest(contributions: Contributions, noise_rms: Mapping[str, float]) -> str:
    """Response that the effect moves most, in units of its noise; empty where it moves none."""
    power: dict[str, float] = {}
    for one in contributions:
        for c, x in one.items():
            if noise_rms.get(c, 0.0) > 0.0:
                power[c] = power.get(c, 0.0) + float(x @ x) / noise_rms[c] ** 2
    return max(power, key=lambda c: power[c]) if power and max(power.values()) > 0.0 else ""


def acting(contributions: Contributions, noise_rms: Mapping[str, float]) -> list[Flags]:
    """Samples at which an effect acts: by more than a fraction of its peak and of the noise, in its clearest response.

    Parameters
    ----------
    contributions : sequence of mapping of response to (n,) array
    noise_rms : mapping of response to float
        In the compared band. A response without any does not count.

    Returns
    -------
    list of (n,) bool arrays
        Per flight; empty arrays where nothing is contributed at all.
    """
    response = clearest(contributions, noise_rms)
    lengths = [max((len(x) for x in one.values()), default=0) for one in contributions]
    if not response:
        return [np.zeros(n, dtype=bool) for n in lengths]
    sizes = [np.abs(one[response]) if response in one else np.zeros(n) for one, n in zip(contributions, lengths)]
    peak = max(float(np.quantile(s, _PEAK_QUANTILE)) for s in sizes if len(s))
    limit = max(_ACTING * peak, _SEEN * noise_rms[response])
    return [s > limit for s in sizes]


def find_intervals(
    flights: Sequence[Flight], contributions: Contributions, noise_rms: Mapping[str, float]
) -> Intervals:
    """Intervals in which an effect acts.

    Parameters
    ----------
    flights : sequence of Flight
    contributions : sequence of mapping of response to (n,) array
        Per flight: what the fitted effect adds to measured less simulated.
    noise_rms : mapping of response to float
        In the compared band.

    Returns
    -------
    mapping of flight to list of (start, end) [s]
        Every flight is in it; the mapping is empty where the effect acts nearly all the time in all flights.
    """
    on = [a if len(a) else np.zeros(len(f), dtype=bool) for f, a in zip(flights, acting(contributions, noise_rms))]
    made = {f.name: segments_of(f.t, a) for f, a in zip(flights, on)}
    covered = sum(b - a for each in made.values() for a, b in each)
    if covered > _EVERYWHERE * sum(float(f.t[-1] - f.t[0]) for f in flights):
        return {}
    return made


def segments_of(t: Array, on: Flags, gap: float = _GAP, blip: float = _BLIP) -> list[tuple[float, float]]:
    """Segments [s] in which a flag is set; short pauses closed, then short segments left out."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    joined: list[tuple[float, float]] = []
    for a, b in zip(edges[::2], edges[1::2] - 1):
        if joined and t[a] - joined[-1][1] < gap:
            joined[-1] = (joined[-1][0], float(t[b]))
        else:
            joined.append((float(t[a]), float(t[b])))
    return [(a, b) for a, b in joined if b - a > blip]
