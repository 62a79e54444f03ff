"""When an effect acts."""

from __future__ import annotations

import numpy as np


def intervals_of(t: np.ndarray, on: np.ndarray, *, gap: float, shortest: float) -> list[tuple[float, float]]:
    """Intervals [s] in which a flag is set: those at most a gap apart are joined, those not longer than the shortest
    are left out.

    Parameters
    ----------
    t : (n,) array [s]
    on : (n,) array of bool
    gap, shortest : float [s]
    """
    if not on.any():
        return []
    at = t[on]
    cuts = np.flatnonzero(np.diff(at) > gap)
    starts, ends = np.concatenate([at[:1], at[cuts + 1]]), np.concatenate([at[cuts], at[-1:]])
    return [(float(a), float(b)) for a, b in zip(starts, ends) if b - a > shortest]
