"""First-order lags, delays and first-order noise along a signal.

Arrays in, arrays out. With a rate limit, backlash or travel limits see `numerics.actuators`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.signal import lfilter

from structsel.numerics.arrays import Array


def first_order_lag(x: Array, dt: float, tau: float) -> Array:
    """First-order lag ``tau y' + y = x`` from rest, exact for a signal that is linear between samples."""
    keep = np.exp(-dt / tau)
    mean = (1.0 - keep) * tau / dt  # of exp(-s / tau) over a sample
    start = (mean - keep) * x[0] + keep * x[0]
    return lfilter([1.0 - mean, mean - keep], [1.0, -keep], x, zi=np.array([start]))[0]


def varying_lag(rate: Array, dt: float, decay: Array) -> Array:
    """State of ``z' = rate - decay z`` from zero, with a decay [1/s] that changes along the signal."""
    z = np.empty(len(rate))
    _varying_lag(np.ascontiguousarray(rate), dt, np.ascontiguousarray(decay), z)
    return z


@njit(cache=True)
def _varying_lag(rate, dt, decay, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    z = 0.0
    out[0] = 0.0
    for k in range(1, rate.size):
        c = 0.5 * (decay[k - 1] + decay[k])
        keep = np.exp(-c * dt)
        # Held at the mean of two samples; the decay may be zero.
        gain = (1.0 - keep) / c if c > 0.0 else dt
        z = keep * z + gain * 0.5 * (rate[k - 1] + rate[k])
        out[k] = z


def delayed(x: Array, clock: float | Array, delay: float, *, hold: bool = False) -> Array:
    """x(t - delay), linear between samples or held from each; beyond the ends the first or last value.

    Parameters
    ----------
    x : (n,) array
    clock : float or (n,) array
        Sample interval, or the times of the samples; in the unit of the delay, which may be a distance.
    delay : float
        Below zero an advance.
    hold : bool
    """
    if not isinstance(clock, np.ndarray):
        delay, clock = delay / clock, np.arange(len(x), dtype=float)
    t = clock
    if hold:
        # Allows for rounding of the times.
        return x[np.maximum(np.searchsorted(t, t - delay + 1e-9, side="right") - 1, 0)]
    return np.interp(t - delay, t, x)


def first_order_noise(white: Array, step: float) -> Array:
    """Stationary first-order noise of unit variance from white noise of unit variance.

    ::

        y[0] = w[0]        y[k] = e^-h y[k-1] + sqrt(1 - e^-2h) w[k]

    Parameters
    ----------
    white : (n,) array
    step : float
        h, the sample interval over the time constant.
    """
    drive = np.sqrt(-np.expm1(-2.0 * step)) * white
    drive[0] = white[0]
    return lfilter([1.0], [1.0, -np.exp(-step)], drive)
