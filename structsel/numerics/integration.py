"""Integration of a motion with numpy, by fixed steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def rk4(slope: Callable[[float, np.ndarray], np.ndarray], x: np.ndarray, t: float, dt: float) -> np.ndarray:
    """State at t + dt, by the classical Runge-Kutta step of fourth order; ``slope(t, x)`` is dx/dt."""
    k1 = slope(t, x)
    k2 = slope(t + 0.5 * dt, x + 0.5 * dt * k1)
    k3 = slope(t + 0.5 * dt, x + 0.5 * dt * k2)
    k4 = slope(t + dt, x + dt * k3)
    return x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
