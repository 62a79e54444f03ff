"""Which samples of a long recording are drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array

_GAP = 5.0  # times the usual step between readings, beyond which a line breaks


def keep_extremes(series: Sequence[Array], most: int) -> NDArray[np.intp]:
    """Samples at which to draw several series of one clock, so that none of their peaks is lost.

    Parameters
    ----------
    series : sequence of (n,) arrays
        The readings of the first say where there are samples: where they are NaN nothing is drawn, and a line breaks
        where they fail for long.
    most : int
        About how many samples to keep.

    Returns
    -------
    (k,) array of int
        Ascending. All readings where they are few; else, in stretches of alike many, the least and the greatest of
        each series.
    """
    there = np.flatnonzero(np.isfinite(series[0]))
    if not there.size:
        return there
    kept = there
    if there.size > most:
        count = max(1, most // (2 * len(series)))
        wide = -(-there.size // count)
        # The last stretch is filled up with the last sample, which is kept anyway.
        rows = np.pad(there, (0, -there.size % wide), mode="edge").reshape(-1, wide)
        picked = [there[[0, -1]]]
        for values in series:
            y = values[rows]
            for least in (np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), np.inf, -y)):
                picked.append(rows[np.arange(len(rows)), least.argmin(axis=1)])
        kept = np.unique(np.concatenate(picked))
    steps = np.diff(there)
    if steps.size:
        breaks = there[:-1][steps > max(_GAP * float(np.median(steps)), 1.0)] + 1
        kept = np.union1d(kept, breaks)
    return kept
