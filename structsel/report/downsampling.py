"""Decimation of long recordings for charts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array

_GAP = 5.0  # multiple of the median interval between measurements, beyond which a line is interrupted


def keep_extremes(series: Sequence[Array], maximum: int) -> NDArray[np.intp]:
    """Samples at which several series on the same time axis are drawn, with all their peaks.

    Parameters
    ----------
    series : sequence of (n,) arrays
        Where the first one is NaN nothing is drawn; its line is interrupted at a long gap.
    maximum : int
        Approximate number of samples to keep.

    Returns
    -------
    (k,) array of int
        Ascending indices: all samples if they are few; else the minimum and the maximum of each series in segments
        with the same number of samples.
    """
    there = np.flatnonzero(np.isfinite(series[0]))
    if not there.size:
        return there
    kept = there
    if there.size > maximum:
        count = max(1, maximum // (2 * len(series)))
        wide = -(-there.size // count)
        # The last segment is padded with the last sample, which is kept in any case.
        rows = np.pad(there, (0, -there.size % wide), mode="edge").reshape(-1, wide)
        picked = [there[[0, -1]]]
        for values in series:
            y = values[rows]
            for minimised in (np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), np.inf, -y)):
                picked.append(rows[np.arange(len(rows)), minimised.argmin(axis=1)])
        kept = np.unique(np.concatenate(picked))
    steps = np.diff(there)
    if steps.size:
        breaks = there[:-1][steps > max(_GAP * float(np.median(steps)), 1.0)] + 1
        kept = np.union1d(kept, breaks)
    return kept
