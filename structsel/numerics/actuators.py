"""Actuators between command and surface: backlash, lag, rate limit, travel limits."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from structsel.errors import DomainError

_PARTS = 20  # steps per time constant; the step itself is exact, so this only resolves a limit's beginning and end


def actuate(
    t: NDArray[np.float64],
    command: NDArray[np.float64],
    *,
    lag: float = 0.0,
    rate: float = np.inf,
    backlash: float = 0.0,
    low: float = -np.inf,
    high: float = np.inf,
    hold: bool = False,
) -> NDArray[np.float64]:
    """Position of an actuator that follows a command::

        x' = clip((c - x) / lag, -rate, rate)       low <= x <= high

    where c is the command after backlash: it stays until the command has moved half the backlash beyond it. The
    command starts in the middle of the backlash, the actuator at rest there.

    Parameters
    ----------
    t : (n,) array [s]
    command : (n,) array
    lag : float [s]
        Time constant; without one the command is followed as fast as the rate allows.
    rate : float [command's unit / s]
    backlash : float [command's unit]
        Complete width.
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
        float(lag), float(rate), 0.5 * float(backlash), float(low), float(high), hold, out,
    )  # fmt: skip
    return out


@njit(cache=True)
def _actuate(t, command, lag, rate, half_backlash, low, high, hold, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    middle = command[0]
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
            middle = min(max(middle, wanted - half_backlash), wanted + half_backlash)
            moved = (middle - x) * (1.0 - keep)
            moved = min(max(moved, -rate * dt), rate * dt)
            x = min(max(x + moved, low), high)
        out[k] = x
