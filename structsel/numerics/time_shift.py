"""Shift of a channel in time. Arrays only."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from structsel.errors import DomainError
from structsel.numerics.arrays import Array

_GAP = 3.0  # median steps: what lies further apart is not interpolated


def shift(x: np.ndarray, t: np.ndarray, delay: float) -> Array:
    """Advance a late channel: what it showed `delay` later, so that it is on time.

    Between samples by a cubic spline through each unbroken segment, which a whole number of samples of an even
    clock reproduces exactly. A step between two samples makes it overshoot.

    Parameters
    ----------
    x : (n,) array
    t : (n,) array [s]
        Strictly increasing.
    delay : float [s]
        Positive advances, negative holds back.

    Returns
    -------
    (n,) array
        x(t + delay). NaN where no samples are about that time: at the end (at the start for a negative
        delay), next to NaN samples, and in a gap of more than three median steps.

    Raises
    ------
    DomainError
        When delay is not finite.
    """
    if not np.isfinite(delay):
        raise DomainError(f"shift needs a finite delay; it is {delay} s.")
    values, clock = np.asarray(x, dtype=float), np.asarray(t, dtype=float)
    made = np.full(values.size, np.nan)
    step = np.diff(clock)
    # Sums of decimal times miss each other by rounding; a thousandth of a step is the same time.
    slack = 1e-3 * float(np.median(step))
    there = np.flatnonzero(np.isfinite(values))
    far = (np.diff(there) > 1) | (np.diff(clock[there]) > _GAP * float(np.median(step)))
    for segment in np.split(there, np.flatnonzero(far) + 1):
        if segment.size < 2:
            continue
        first, last = clock[segment[0]], clock[segment[-1]]
        rows = np.flatnonzero((clock + delay >= first - slack) & (clock + delay <= last + slack))
        if rows.size:
            made[rows] = CubicSpline(clock[segment], values[segment])(np.clip(clock[rows] + delay, first, last))
    return made
