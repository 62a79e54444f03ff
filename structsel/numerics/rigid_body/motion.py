"""Equations of motion over a flat Earth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.atmosphere import G0
from structsel.numerics.rigid_body.air import body_to_earth
from structsel.numerics.rigid_body.loads import angular_acceleration, specific_force, thrust_moment
from structsel.numerics.rigid_body.vectors import NONE, Three, Triple, Values

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h")
"""Order of the rigid-body state: air-relative velocity, rates, attitude, position (h up)."""


def euler_rates(p: Values, q: Values, r: Values, phi: Values, theta: Values) -> Three:
    """Derivatives of phi, theta, psi [rad/s].

    Raises
    ------
    DomainError
        Within 1e-6 rad of vertical, where yaw and roll are the same turn.

    References
    ----------
    [M86] kinematics.
    """
    sf, cf, ct = np.sin(phi), np.cos(phi), np.cos(theta)
    if np.any(np.abs(ct) < 1e-6):
        i = int(np.argmax(np.abs(np.ravel(ct)) < 1e-6))
        raise DomainError(f"euler_rates has no answer at theta = +-90 deg; sample {i} is there.\nCut it out.")
    turn = (np.asarray(q) * sf + np.asarray(r) * cf) / ct
    return p + turn * np.sin(theta), np.asarray(q) * cf - np.asarray(r) * sf, turn


def velocity_derivative(
    velocity: Triple,
    rates: Triple,
    force: Triple,
    phi: Values,
    theta: Values,
    g: float = G0,
) -> Three:
    """Derivatives of u, v, w [m/s^2] from specific force at the centre of gravity, gravity and rotation.

    References
    ----------
    [M86] kinematics.
    """
    u, v, w = velocity
    p, q, r = rates
    ax, ay, az = force
    ct = np.cos(theta)
    return (
        ax - g * np.sin(theta) - np.asarray(q) * w + np.asarray(r) * v,
        ay + g * ct * np.sin(phi) - np.asarray(r) * u + np.asarray(p) * w,
        az + g * ct * np.cos(phi) - np.asarray(p) * v + np.asarray(q) * u,
    )


def state_derivative(
    state: Values,
    coefficients: Values,
    rho: Values,
    mass: float,
    inertia: np.ndarray,
    S: float,
    b: float,
    cbar: float,
    thrust: Values = 0.0,
    offset: Sequence[float] = NONE,
    inclination: float = 0.0,
    rotor_momentum: Values = 0.0,
    wind: Triple = NONE,
    g: float = G0,
) -> np.ndarray:
    """Derivative of the rigid-body state under given aerodynamic coefficients.

    Parameters
    ----------
    state : (12, ...) array
        Rows as `STATES`: u v w [m/s] relative to the air, p q r [rad/s], phi theta psi [rad], x y h [m].
    coefficients : (6, ...) array [-]
        CX, CY, CZ, Cl, Cm, Cn.
    rho : float or array [kg/m^3]
    mass, inertia, S, b, cbar, thrust, offset, inclination, rotor_momentum
        As in `moment_coefficients` and `force_coefficients`.
    wind : (3,) [m/s]
        North, east, down; constant, so it only carries the position along.

    Returns
    -------
    derivative : (12, ...) array

    References
    ----------
    [M86], [KM16] ch. 3.
    """
    state = np.asarray(state, dtype=float)
    CX, CY, CZ, Cl, Cm, Cn = np.asarray(coefficients, dtype=float)
    velocity, rates = state[0:3], state[3:6]
    phi, theta, psi = state[6:9]
    qbar = 0.5 * rho * np.sum(velocity**2, axis=0)
    force = specific_force(CX, CY, CZ, qbar, mass, S, thrust, inclination)
    LT, MT, NT = thrust_moment(thrust, offset, inclination)
    qS = qbar * S
    moment = (qS * b * Cl + LT, qS * cbar * Cm + MT, qS * b * Cn + NT)
    out = np.empty(np.broadcast_shapes(state.shape, (12, *np.shape(qS * CX))))
    out[0:3] = velocity_derivative(velocity, rates, force, phi, theta, g)
    out[3:6] = angular_acceleration(rates, moment, inertia, rotor_momentum)
    out[6:9] = euler_rates(rates[0], rates[1], rates[2], phi, theta)
    north, east, down = np.einsum("...ij,j...->i...", body_to_earth(phi, theta, psi), velocity)
    out[9], out[10], out[11] = north + wind[0], east + wind[1], -(down + np.asarray(wind[2]))
    return out
