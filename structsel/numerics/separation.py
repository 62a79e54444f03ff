"""Separation of the flow at the trailing edge, by Goman and Khrabrov [GK94].

x is the separation point on the chord, 1 for attached flow and 0 for separated flow::

    tau1 x' + x = x0(alpha - tau2 alpha')        x0(alpha) = (1 - tanh(a1 (alpha - alpha*))) / 2

Lift is that of attached flow times ((1 + sqrt(x)) / 2)^2 (Kirchhoff).
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.first_order import first_order_lag


def steady_separation_point(alpha: Array, a1: float, alpha_star: float) -> Array:
    """x0 at an angle of attack [rad]; a1 [1/rad], alpha_star [rad]."""
    return 0.5 * (1.0 - np.tanh(a1 * (alpha - alpha_star)))


def separation_point(
    alpha: Array, alpha_dot: Array, dt: float, tau1: float, tau2: float, a1: float, alpha_star: float
) -> Array:
    """X along a record on an even clock, from rest; tau1 and tau2 [s]."""
    steady = steady_separation_point(alpha - tau2 * alpha_dot, a1, alpha_star)
    return first_order_lag(steady, dt, tau1) if tau1 > 0.0 else steady


def lift_factor(x: Array) -> Array:
    """Lift over that of attached flow."""
    return 0.25 * (1.0 + np.sqrt(x)) ** 2


def steady_formula(angle: str, a1: float, alpha_star: float) -> str:
    """x0 as text, for a term of a model; `angle` is a formula."""
    return f"0.5*(1 - tanh({float(a1)!r}*({angle} - {float(alpha_star)!r})))"
