"""Which recordings are parts of one flight."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from structsel.comparison.flight import Flight

_SLOW = ("V", "h", "theta", "phi", "psi")
_CONTINUOUS = 0.05
"""Of the standard deviation of a slow channel, by which it may differ at the start of a recording from where the end of
the one before leads."""


def sequences(flights: Sequence[Flight]) -> list[list[Flight]]:
    """Recordings of one flight, in the order in which they were flown; each sequence has at least two.

    Recordings that do not overlap in time are those of one flight. If they overlap, those that continue another one
    to the next sample, with the slow channels, belong to it.
    """
    in_order = sorted(flights, key=lambda f: float(f.t[0]))
    if all(later.t[0] > before.t[-1] for before, later in pairwise(in_order)):
        return [in_order] if len(in_order) > 1 else []
    next_of: dict[str, Flight] = {}
    for f in flights:
        candidates = [(_jump(f, g, flights), k) for k, g in enumerate(flights) if _follows(f, g)]
        if candidates and min(candidates)[0] < _CONTINUOUS:
            next_of[f.name] = flights[min(candidates)[1]]
    made = []
    for f in flights:
        if all(f is not g for g in next_of.values()):
            chain = [f]
            while chain[-1].name in next_of:
                chain.append(next_of[chain[-1].name])
            if len(chain) > 1:
                made.append(chain)
    return made


def _follows(before: Flight, after: Flight) -> bool:
    return 0.0 < after.t[0] - before.t[-1] < 1.5 * before.dt


def _jump(before: Flight, after: Flight, flights: Sequence[Flight]) -> float:
    """Largest distance of a slow channel at the start of a recording from where the end of another one leads.

    In standard deviations over all recordings.
    """
    slow = [c for c in _SLOW if all(c in f.channels for f in flights)]
    spread = {c: float(np.concatenate([f[c] for f in flights]).std()) for c in slow}
    ahead = (after.t[0] - before.t[-1]) / before.dt
    led = {c: before[c][-1] + ahead * (before[c][-1] - before[c][-2]) for c in slow}
    return max((abs(float(after[c][0] - led[c])) / spread[c] for c in slow if spread[c] > 0.0), default=np.inf)
