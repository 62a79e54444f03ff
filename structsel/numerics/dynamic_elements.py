"""Dynamic elements along a signal: lags, delays, actuators, flow separation, and a Runge-Kutta step. Arrays only."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

_PARTS = 20  # steps per time constant; a step is exact, so this resolves the begin and end of a limit only
_GAP = 3.0  # median steps; longer gaps are not interpolated


def first_order_lag(x: Array, dt: float, tau: float) -> Array:
    """First-order lag ``tau y' + y = x`` from rest, exact for a signal that is linear between samples."""
    keep = np.exp(-dt / tau)
    mean = (1.0 - keep) * tau / dt  # of exp(-s / tau) over a sample
    start = (mean - keep) * x[0] + keep * x[0]
    return scipy.signal.lfilter([1.0 - mean, mean - keep], [1.0, -keep], x, zi=np.array([start]))[0]


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
    """x(t - delay), linear or held between samples; beyond the ends the first or last value.

    Parameters
    ----------
    x : (n,) array
    clock : float or (n,) array
        Sample interval, or the times of the samples; in the unit of the delay, which may be a distance.
    delay : float
        An advance if negative.
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
    return scipy.signal.lfilter([1.0], [1.0, -np.exp(-step)], drive)


def shift(x: np.ndarray, t: np.ndarray, delay: float) -> Array:
    """Advance a delayed channel: x(t + delay).

    By a cubic spline through each segment without gaps; a delay of an integer number of samples on an even clock is
    exact. The spline overshoots at a step between two samples.

    Parameters
    ----------
    x : (n,) array
    t : (n,) array [s]
        Strictly increasing.
    delay : float [s]
        Positive to advance, negative to delay.

    Returns
    -------
    (n,) array
        NaN where there are no samples around that time: at the end (at the start for a negative delay), next to
        NaN samples, and in a gap of more than three median steps.

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
    # Times differ by rounding; within a thousandth of a step they are equal.
    slack = 1e-3 * float(np.median(step))
    there = np.flatnonzero(np.isfinite(values))
    far = (np.diff(there) > 1) | (np.diff(clock[there]) > _GAP * float(np.median(step)))
    for segment in np.split(there, np.flatnonzero(far) + 1):
        if segment.size < 2:
            continue
        first, last = clock[segment[0]], clock[segment[-1]]
        rows = np.flatnonzero((clock + delay >= first - slack) & (clock + delay <= last + slack))
        if rows.size:
            made[rows] = scipy.interpolate.CubicSpline(clock[segment], values[segment])(
                np.clip(clock[rows] + delay, first, last)
            )
    return made


def actuate(
    t: Array,
    command: Array,
    *,
    lag: float = 0.0,
    rate: float = np.inf,
    backlash: float = 0.0,
    start: float = 0.0,
    low: float = -np.inf,
    high: float = np.inf,
    hold: bool = False,
) -> Array:
    """Position of an actuator that follows a command::

        x' = clip((c - x) / lag, -rate, rate)       low <= x <= high

    where c is the command after backlash: it is constant until the command differs by half the backlash. At the start
    the actuator is at rest.

    Parameters
    ----------
    t : (n,) array [s]
    command : (n,) array
    lag : float [s]
        Time constant; with zero the position follows the command as fast as the rate allows.
    rate : float [command's unit / s]
    backlash : float [command's unit]
        Total width.
    start : float
        Of c less the command at the start, in half widths, -1 to 1.
    low, high : float [command's unit]
    hold : bool
        Command held from sample to sample; otherwise linear between them.

    Returns
    -------
    (n,) array

    Raises
    ------
    DomainError
        A negative lag, rate or backlash, or travel limits in the wrong order.
    """
    if not (lag >= 0.0 and rate > 0.0 and backlash >= 0.0 and low < high):
        raise DomainError(
            f"An actuator with lag {lag:g} s, rate {rate:g}, backlash {backlash:g} and limits {low:g} to {high:g} "
            "cannot be: lag and backlash are 0 or more, the rate is above 0, the limits ascend."
        )
    out = np.empty(len(t))
    _actuate(
        np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(command, dtype=float),
        float(lag), float(rate), 0.5 * float(backlash), float(start), float(low), float(high), hold, out,
    )  # fmt: skip
    return out


@njit(cache=True)
def _actuate(t, command, lag, rate, half, start, low, high, hold, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    middle = command[0] + start * half
    x = min(max(middle, low), high)
    out[0] = x
    for k in range(1, t.size):
        interval = t[k] - t[k - 1]
        steps = 1
        if (lag > 0.0 and np.isfinite(rate)) or not hold:
            steps = max(4, int(np.ceil(_PARTS * interval / lag))) if lag > 0.0 else 4
        dt = interval / steps
        keep = np.exp(-dt / lag) if lag > 0.0 else 0.0
        for s in range(steps):
            # The command is constant over the step, at its value in the middle.
            part = 0.0 if hold else (s + (0.5 if lag > 0.0 else 1.0)) / steps
            wanted = command[k - 1] + part * (command[k] - command[k - 1])
            middle = min(max(middle, wanted - half), wanted + half)
            moved = (middle - x) * (1.0 - keep)
            moved = min(max(moved, -rate * dt), rate * dt)
            x = min(max(x + moved, low), high)
        out[k] = x


def steady_separation_point(alpha: Array, a1: float, alpha_star: float) -> Array:
    """Steady separation point x0 at an angle of attack [rad]; a1 [1/rad], alpha_star [rad]."""
    return 0.5 * (1.0 - np.tanh(a1 * (alpha - alpha_star)))


def separation_point(
    alpha: Array, alpha_dot: Array, dt: float, tau1: float, tau2: float, a1: float, alpha_star: float
) -> Array:
    """Separation point X along a record on an even clock, from rest; tau1 and tau2 [s]."""
    steady = steady_separation_point(alpha - tau2 * alpha_dot, a1, alpha_star)
    return first_order_lag(steady, dt, tau1) if tau1 > 0.0 else steady


def lift_factor(x: Array) -> Array:
    """Lift over that of attached flow."""
    return 0.25 * (1.0 + np.sqrt(x)) ** 2


def steady_formula(angle: str, a1: float, alpha_star: float) -> str:
    """x0 as text, for a term of a model; `angle` is a formula."""
    return f"0.5*(1 - tanh({float(a1)!r}*({angle} - {float(alpha_star)!r})))"


def rk4(slope: Callable[[float, np.ndarray], np.ndarray], x: np.ndarray, t: float, dt: float) -> np.ndarray:
    """State at t + dt, by the classical Runge-Kutta step of fourth order; ``slope(t, x)`` is dx/dt."""
    k1 = slope(t, x)
    k2 = slope(t + 0.5 * dt, x + 0.5 * dt * k1)
    k3 = slope(t + 0.5 * dt, x + 0.5 * dt * k2)
    k4 = slope(t + dt, x + dt * k3)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
