"""Kinematic closure: the two sides of the equations that connect attitude, rates, air data, accelerations and altitude.

Each equation is averaged over a window of k samples, which needs no derivative of a signal::

    p:   mean(p)  = change of phi / time   - mean((q sin phi + r cos phi) tan theta)
    q:   mean(q)  = change of theta / time + mean(r sin phi + q (1 - cos phi))
    r:   mean(r)  = change of psi / time   - mean((q sin phi + r cos phi) / cos theta - r)
    ax:  mean(ax) = change of u / time + mean(g sin theta + q w - r v)
    ay:  mean(ay) = change of v / time - mean(g cos theta sin phi - r u + p w)
    az:  mean(az) = change of w / time - mean(g cos theta cos phi - p v + q u)
    h:   change of h / time = mean(u sin theta - (v sin phi + w cos phi) cos theta)

with u, v, w from airspeed and vanes. Arrays only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy

from structsel.numerics.air_data import body_velocity, cross
from structsel.numerics.arrays import Array

NEEDS = {
    "p": ("p", "phi", "theta"),
    "q": ("q", "theta"),
    "r": ("r", "psi", "theta"),
    "ax": ("ax", "V", "alpha", "theta", "q"),
    "ay": ("ay", "V", "alpha", "beta", "theta", "phi", "r"),
    "az": ("az", "V", "alpha", "theta", "q"),
    "h": ("h", "V", "alpha", "theta"),
}
"""Equation: the channels without which it has no meaning; others are zero if absent."""
USES = {
    **NEEDS,
    "p": ("p", "q", "r", "phi", "theta"),
    "q": ("q", "r", "phi", "theta"),
    "r": ("q", "r", "phi", "theta", "psi"),
    "az": ("p", "q", "az", "V", "alpha", "beta", "phi", "theta"),
    "h": ("h", "V", "alpha", "beta", "phi", "theta"),
}
"""Equation: all channels in it."""


Windowed = Callable[[int], Array]
"""(n - samples,) values over the windows from each sample to the one so many samples later."""


def window_means(t: Array, values: Array) -> Windowed:
    """Means of a signal by the trapezoidal rule; NaN where a sample of the window is not finite."""
    finite = np.isfinite(values)
    integral = scipy.integrate.cumulative_trapezoid(np.where(finite, values, 0.0), t, initial=0.0)
    missing = np.concatenate(([0], np.cumsum(~finite)))

    def means(samples: int) -> Array:
        complete = missing[samples + 1 :] == missing[: -samples - 1]
        return np.where(complete, (integral[samples:] - integral[:-samples]) / (t[samples:] - t[:-samples]), np.nan)

    return means


def window_slopes(t: Array, values: Array) -> Windowed:
    """Mean derivatives of a signal."""
    return lambda samples: np.asarray((values[samples:] - values[:-samples]) / (t[samples:] - t[:-samples]))


def closure_sides(
    t: Array,
    channels: Mapping[str, Array],
    equations: Sequence[str],
    *,
    g: float | Array,
    vane_position: Array | None = None,
) -> dict[str, tuple[Windowed, Windowed]]:
    """Both sides of equations, averaged over windows of any number of samples.

    Parameters
    ----------
    t : (n,) array [s]
    channels : mapping of str to (n,) array
        SI units, radians; ``p, q, r, phi, beta`` are zero if absent. NaN where not sampled.
    equations : sequence of str
        Those wanted; their `NEEDS` must be in `channels`.
    g : float [m/s^2]
    vane_position : (3,) array [m], optional
        From the point of the accelerations to the vanes; zero if absent.

    Returns
    -------
    dict of str to (callable, callable)
        Left side and right side [rad/s, m/s^2 or m/s], from the number of samples of a window, below n.
    """
    zero = np.zeros(len(t))
    phi, theta, p, q, r = (channels.get(name, zero) for name in ("phi", "theta", "p", "q", "r"))
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    u = v = w = zero
    if "V" in channels and "alpha" in channels:
        u, v, w = body_velocity(channels["V"], channels["alpha"], channels.get("beta", zero))
        if vane_position is not None:
            rotation = cross((p, q, r), tuple(vane_position))
            u, v, w = u - rotation[0], v - rotation[1], w - rotation[2]

    def mean(x: Array) -> Windowed:
        return window_means(t, x)

    def change(x: Array, added: Array | None = None) -> Windowed:
        """Mean derivative, plus the mean of another signal."""
        slopes, means = window_slopes(t, x), None if added is None else window_means(t, added)
        return slopes if means is None else lambda samples: slopes(samples) + means(samples)

    made = {
        "p": lambda: (mean(p), change(phi, -((q * sf + r * cf) * st / ct))),
        "q": lambda: (mean(q), change(theta, r * sf + q * (1.0 - cf))),
        "r": lambda: (mean(r), change(channels["psi"], -((q * sf + r * cf) / ct - r))),
        "ax": lambda: (mean(channels["ax"]), change(u, g * st + q * w - r * v)),
        "ay": lambda: (mean(channels["ay"]), change(v, -(g * ct * sf - r * u + p * w))),
        "az": lambda: (mean(channels["az"]), change(w, -(g * ct * cf - p * v + q * u))),
        "h": lambda: (change(channels["h"]), mean(u * st - (v * sf + w * cf) * ct)),
    }
    return {name: made[name]() for name in equations}
