"""Time delays between channels: estimated below the sample, and taken out. Arrays only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from structsel.errors import DataError, DomainError
from structsel.numerics.arrays import Array
from structsel.numerics.smoothing import smooth_spline

_LEAST_SAMPLES = 40
_ROUNDS = 12
_GAP = 3.0  # median steps: what lies further apart is not interpolated


def estimate_delay(signal: np.ndarray, reference: np.ndarray, dt: float, max_delay: float) -> tuple[float, float]:
    """How late one channel is against another that measures the same motion.

    Least squares of::

        signal(t) = offset + gain reference(t - delay) + e(t)

    over delay, gain and offset: the best whole number of samples first, then Newton steps below the sample.
    The reference is smoothed (spline), because interpolated noise has less variance between the samples than
    on them, which draws the delay to half samples; the smoother shifts nothing. Both channels are noisy, so
    the residual is weighed with the mean of their slopes, and the information is the product of the two
    slopes, in which noise that they do not share has no part. e may be coloured: its autocovariance (lags
    up to a fifth of the record) goes into the standard deviation, as [KM16] has it for equation error.

    Parameters
    ----------
    signal, reference : (n,) arrays
        On one even clock; NaN samples are missing.
    dt : float [s]
    max_delay : float [s]
        The delay is sought from -max_delay to max_delay. The motion must not repeat itself within that.

    Returns
    -------
    delay : float [s]
        Positive when `signal` is late.
    std : float [s]
        Standard deviation: the actual error is 1.05 to 1.1 times as large on white noise, 1.3 times where
        the noise remembers ten samples (measured: 3-2-1-1 response, noise 1 to 10 % of it). It knows nothing
        of a lag that a filter gives some frequencies and not others.

    Raises
    ------
    DataError
        When too few samples overlap, one of the channels does not move, or the best delay is `max_delay` itself.
    DomainError
        When dt or max_delay is not above zero, or the channels differ in length.

    References
    ----------
    [KM16] for the covariance with coloured residuals.
    """
    late, leader = np.asarray(signal, dtype=float), np.asarray(reference, dtype=float)
    if not dt > 0.0 or not max_delay > 0.0 or late.shape != leader.shape:
        raise DomainError(
            f"estimate_delay needs dt and max_delay above zero and channels of one length; it was given dt {dt:g} s, "
            f"max_delay {max_delay:g} s, {late.size} and {leader.size} samples."
        )
    most = max(1, int(np.ceil(max_delay / dt)))
    inside = np.arange(most + 1, late.size - most - 1)
    if inside.size < _LEAST_SAMPLES:
        raise DataError(
            f"estimate_delay has {max(inside.size, 0)} samples that overlap at every delay up to {max_delay:g} s; it "
            f"needs {_LEAST_SAMPLES}.\nGive a smaller max_delay, or a longer recording."
        )
    for name, values in (("signal", late), ("reference", leader)):
        finite = values[np.isfinite(values)]
        if finite.size < _LEAST_SAMPLES or not np.ptp(finite) > 0.0:
            raise DataError(f"estimate_delay needs a {name} that moves; it stands still or is missing.")
    pair = _Pair(late, leader, inside)
    shares = [pair.explained(lag) for lag in range(-most, most + 1)]
    best = int(np.argmax(shares))
    if best in (0, 2 * most):
        raise DataError(
            f"estimate_delay finds the channels most alike at {dt * (best - most):g} s, the end of the range.\n"
            "Give a larger max_delay, or a stretch with one clear motion."
        )
    samples, std = pair.refine(float(best - most))
    return samples * dt, std * dt


class _Pair:
    """A channel and its smoothed leader, time counted in samples."""

    def __init__(self, late: Array, leader: Array, inside: NDArray[np.intp]):
        at = np.arange(leader.size, dtype=float)
        smooth = smooth_spline(leader, at)
        self.curve = CubicHermiteSpline(at, smooth.values, smooth.derivative)
        self.slope = self.curve.derivative()
        self.missing = np.cumsum(np.concatenate(([0], ~np.isfinite(leader))))
        self.late, self.inside = late, inside
        self.late_slope = smooth_spline(late, at).derivative

    def _there(self, lag: float) -> NDArray[np.bool_]:
        """Rows whose sample exists and whose leader has both samples about it."""
        first = np.floor(self.inside - lag).astype(int)
        return np.isfinite(self.late[self.inside]) & (self.missing[first + 2] == self.missing[first])

    def explained(self, lag: float) -> float:
        """Share of the variance that gain and offset explain at a delay."""
        rows = self.inside[self._there(lag)]
        if rows.size < _LEAST_SAMPLES:
            return 0.0
        moved = self.curve(rows - lag)
        return float(np.corrcoef(self.late[rows], moved)[0, 1] ** 2) if np.ptp(moved) > 0.0 else 0.0

    def refine(self, lag: float) -> tuple[float, float]:
        """Delay and its standard deviation, in samples."""
        start = lag
        for _ in range(_ROUNDS):
            there = self._there(lag)
            rows = self.inside[there]
            moved, slope = self.curve(rows - lag), self.slope(rows - lag)
            basis = np.column_stack([np.ones(rows.size), moved])
            y = self.late[rows]
            gain = float(np.linalg.lstsq(basis, y, rcond=None)[0][1])
            # Residual and both slopes with what offset and gain can take up removed.
            table = np.column_stack([y, gain * slope, self.late_slope[rows]])
            residual, by_leader, by_late = (table - basis @ np.linalg.lstsq(basis, table, rcond=None)[0]).T
            information = float(by_leader @ by_late)
            if not information > 1e-9 * float(np.sqrt((table[:, 1] @ table[:, 1]) * (table[:, 2] @ table[:, 2]))):
                raise DataError(
                    "estimate_delay cannot tell a delay from an offset: the channels move in one straight line."
                )
            weight = 0.5 * (by_leader + by_late)
            # Beyond one sample a step leaves what the slopes describe.
            step = float(np.clip(-(weight @ residual) / information, -1.0, 1.0))
            lag = float(np.clip(lag + step, start - 2.0, start + 2.0))
            if abs(step) < 1e-6:
                break
        spread = np.zeros((2, self.inside.size))
        spread[0, there], spread[1, there] = residual, weight
        return lag, float(np.sqrt(_variance_of_sum(spread[1], spread[0]))) / information


def _variance_of_sum(weight: Array, noise: Array) -> float:
    """Variance of sum_t weight_t noise_t, from the autocovariance of the noise (missing samples are zeros)."""
    n = noise.size
    size = next_fast_len(2 * n, real=True)
    own = irfft(np.abs(rfft(noise, size)) ** 2, size)[:n]
    pairs = irfft(np.abs(rfft(weight, size)) ** 2, size)[:n]
    # Far lags are mostly scatter, and Bartlett's taper keeps the variance positive.
    taper = np.clip(1.0 - np.arange(n) / (n // 5), 0.0, None)
    terms = taper * own * pairs / np.count_nonzero(noise)
    return max(float(terms[0] + 2.0 * terms[1:].sum()), 0.0)


def shift(x: np.ndarray, t: np.ndarray, delay: float) -> Array:
    """Advance a late channel: what it showed `delay` later, so that it is on time.

    Between samples by a cubic spline through each unbroken stretch, which a whole number of samples of an even
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
    for stretch in np.split(there, np.flatnonzero(far) + 1):
        if stretch.size < 2:
            continue
        first, last = clock[stretch[0]], clock[stretch[-1]]
        rows = np.flatnonzero((clock + delay >= first - slack) & (clock + delay <= last + slack))
        if rows.size:
            made[rows] = CubicSpline(clock[stretch], values[stretch])(np.clip(clock[rows] + delay, first, last))
    return made
