"""Rigid-body relations between sensors, forces and moments over a flat Earth.

Arrays only, SI units and radians, body axes x forward, y right, z down. Every function broadcasts over its arguments,
so time may run along any axis; the docstring of a stacked result (a state, a matrix) names its own axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.air_data import NONE, Three, Triple, Values, body_to_earth, cross, require_positive
from structsel.numerics.atmosphere import G0

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h")
"""Order of the rigid-body state: velocity relative to the air, rates, attitude, position (h up)."""


def acceleration_at_cg(
    ax: Values,
    ay: Values,
    az: Values,
    rates: Triple,
    rate_derivatives: Triple,
    position: Triple,
) -> Three:
    """Specific force at the centre of gravity from that at the accelerometer.

    ::

        a_cg = a_s - omega_dot x r - omega x (omega x r)

    Parameters
    ----------
    ax, ay, az : (n,) array [m/s^2]
        Specific force at the sensor.
    rates, rate_derivatives : p, q, r [rad/s] and their derivatives [rad/s^2]
    position : (3,) [m]
        Sensor from the centre of gravity.
    """
    tangential = cross(rate_derivatives, position)
    centripetal = cross(rates, cross(rates, position))
    return tuple(  # type: ignore[return-value]
        np.asarray(a, dtype=float) - t - c for a, t, c in zip((ax, ay, az), tangential, centripetal)
    )


def acceleration_at_sensor(
    ax: Values, ay: Values, az: Values, rates: Triple, rate_derivatives: Triple, position: Triple
) -> Three:
    """Specific force at a sensor from that at the centre of gravity; reverses `acceleration_at_cg`."""
    tangential = cross(rate_derivatives, position)
    centripetal = cross(rates, cross(rates, position))
    return tuple(  # type: ignore[return-value]
        np.asarray(a, dtype=float) + (t + c) for a, t, c in zip((ax, ay, az), tangential, centripetal)
    )


def thrust_force(thrust: Values, inclination: float = 0.0) -> Three:
    """Body-axis thrust; a positive inclination tilts it up: Tx = T cos i, Tz = -T sin i (z is down)."""
    thrust = np.asarray(thrust, dtype=float)
    return thrust * np.cos(inclination), np.zeros_like(thrust), -thrust * np.sin(inclination)


def thrust_moment(thrust: Values, offset: Sequence[float] = NONE, inclination: float = 0.0) -> Three:
    """Moment of the thrust about the centre of gravity, offset x force [N m].

    A line below the centre of gravity (offset z > 0) pitches the nose up.
    """
    return cross(offset, thrust_force(thrust, inclination))


def force_coefficients(
    ax: Values,
    ay: Values,
    az: Values,
    qbar: Values,
    mass: Values,
    S: float,
    thrust: Values = 0.0,
    inclination: float = 0.0,
) -> Three:
    """Body-axis aerodynamic force coefficients CX, CY, CZ.

    An accelerometer at the centre of gravity measures every force except gravity, so its reading minus the thrust
    is the aerodynamic force::

        CX = (m ax - T cos i)/(qbar S)    CY = m ay/(qbar S)    CZ = (m az + T sin i)/(qbar S)

    Parameters
    ----------
    ax, ay, az : (n,) array [m/s^2]
        Specific force at the centre of gravity.
    qbar : (n,) array [Pa]
        Dynamic pressure, above zero throughout.
    mass : float or (n,) array [kg]
    S : float [m^2]
    thrust : float or (n,) array [N]
    inclination : float [rad]
        Of the thrust line; positive tilts thrust up.

    Returns
    -------
    CX, CY, CZ : (n,) array [-]

    Raises
    ------
    DomainError
        Where qbar is not above zero; the message gives the first such sample.

    References
    ----------
    [H17], which takes i = 0; [KM16] ch. 3.
    """
    qS = require_positive("qbar", "Pa", qbar, "force_coefficients") * S
    Tx, _, Tz = thrust_force(thrust, inclination)
    mass = np.asarray(mass, dtype=float)
    ax, ay, az = (np.asarray(a, dtype=float) for a in (ax, ay, az))
    return (mass * ax - Tx) / qS, mass * ay / qS, (mass * az - Tz) / qS


def moment_coefficients(
    rates: Triple,
    rate_derivatives: Triple,
    qbar: Values,
    inertia: np.ndarray,
    S: float,
    b: float,
    cbar: float,
    thrust: Values = 0.0,
    offset: Sequence[float] = NONE,
    inclination: float = 0.0,
    rotor_momentum: Values = 0.0,
) -> Three:
    """Aerodynamic moment coefficients Cl, Cm, Cn about the centre of gravity.

    Euler's equations solved for the moment, less that of the thrust line; for a symmetric aircraft::

        L = Ix p' - Ixz (r' + p q) + (Iz - Iy) q r
        M = Iy q' + (Ix - Iz) p r + Ixz (p^2 - r^2) + H r
        N = Iz r' - Ixz (p' - q r) + (Iy - Ix) p q - H q

    Parameters
    ----------
    rates, rate_derivatives : p, q, r [rad/s] and their derivatives [rad/s^2]
    qbar : (n,) array [Pa]
    inertia : (3, 3) array [kg m^2]
        Tensor about the centre of gravity; the products of inertia enter negative.
    S, b, cbar : float [m^2, m, m]
    thrust : float or (n,) array [N]
    offset : (3,) [m]
        A point of the thrust line, from the centre of gravity.
    inclination : float [rad]
    rotor_momentum : float or (n,) array [kg m^2/s]
        H, angular momentum of propeller or rotor about body x; positive turns clockwise seen from behind.

    Returns
    -------
    Cl, Cm, Cn : (n,) array [-]

    Raises
    ------
    DomainError
        Where qbar is not above zero.

    References
    ----------
    [H17] (rederived: the scan is garbled), [M86] for the rotor terms.
    """
    qS = require_positive("qbar", "Pa", qbar, "moment_coefficients") * S
    L, M, N = inertial_moment(rates, rate_derivatives, inertia, rotor_momentum)
    LT, MT, NT = thrust_moment(thrust, offset, inclination)
    return (L - LT) / (qS * b), (M - MT) / (qS * cbar), (N - NT) / (qS * b)


def inertial_moment(
    rates: Triple,
    rate_derivatives: Triple,
    inertia: np.ndarray,
    rotor_momentum: Values = 0.0,
) -> Three:
    """Total moment L, M, N [N m] that gives these rates and accelerations; see `moment_coefficients`."""
    p, q, r = (np.asarray(x, dtype=float) for x in rates)
    hx, hy, hz = _momentum((p, q, r), inertia)
    gyroscopic = cross((p, q, r), (hx + rotor_momentum, hy, hz))
    direct = _momentum(rate_derivatives, inertia)
    L, M, N = (d + g for d, g in zip(direct, gyroscopic))
    return L, M, N


def specific_force(
    CX: Values,
    CY: Values,
    CZ: Values,
    qbar: Values,
    mass: Values,
    S: float,
    thrust: Values = 0.0,
    inclination: float = 0.0,
) -> Three:
    """Specific force at the centre of gravity [m/s^2]; reverses `force_coefficients`."""
    qS = np.asarray(qbar, dtype=float) * S
    Tx, Ty, Tz = thrust_force(thrust, inclination)
    CX, CY, CZ = (np.asarray(c, dtype=float) for c in (CX, CY, CZ))
    return (qS * CX + Tx) / mass, (qS * CY + Ty) / mass, (qS * CZ + Tz) / mass


def angular_acceleration(
    rates: Triple,
    moment: Triple,
    inertia: np.ndarray,
    rotor_momentum: Values = 0.0,
) -> Three:
    """Derivatives of p, q, r [rad/s^2] under a total moment L, M, N [N m]; reverses `inertial_moment`."""
    gyroscopic = inertial_moment(rates, NONE, inertia, rotor_momentum)
    left = tuple(np.asarray(m, dtype=float) - g for m, g in zip(moment, gyroscopic))
    return _momentum(left, np.linalg.inv(inertia))


def _momentum(rates: Triple, inertia: np.ndarray) -> Three:
    p, q, r = (np.asarray(x, dtype=float) for x in rates)
    x, y, z = (row[0] * p + row[1] * q + row[2] * r for row in np.asarray(inertia))
    return x, y, z


def euler_rates(p: Values, q: Values, r: Values, phi: Values, theta: Values) -> Three:
    """Derivatives of phi, theta, psi [rad/s].

    Raises
    ------
    DomainError
        Within 1e-6 rad of vertical, where yaw and roll are the same rotation.

    References
    ----------
    [M86] kinematics.
    """
    sf, cf, ct = np.sin(phi), np.cos(phi), np.cos(theta)
    if np.any(np.abs(ct) < 1e-6):
        i = int(np.argmax(np.abs(np.ravel(ct)) < 1e-6))
        raise DomainError(f"euler_rates is not defined at theta = +-90 deg, as in sample {i}.\nCut it out.")
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


class Airframe(NamedTuple):
    """Constants of the aircraft in the equations of motion.

    Attributes
    ----------
    mass : float [kg]
    inertia : (3, 3) array [kg m^2]
    S, b, cbar : float [m^2, m, m]
    offset, inclination, rotor_momentum
        As in `moment_coefficients`.
    """

    mass: float
    inertia: np.ndarray
    S: float
    b: float
    cbar: float
    offset: Sequence[float] = NONE
    inclination: float = 0.0
    rotor_momentum: Values = 0.0


def state_derivative(
    state: Values,
    coefficients: Values,
    rho: Values,
    airframe: Airframe,
    thrust: Values = 0.0,
    wind: Triple = NONE,
) -> np.ndarray:
    """Derivative of the rigid-body state for given aerodynamic coefficients.

    Parameters
    ----------
    state : (12, ...) array
        Rows as `STATES`: u v w [m/s] relative to the air, p q r [rad/s], phi theta psi [rad], x y h [m].
    coefficients : (6, ...) array [-]
        CX, CY, CZ, Cl, Cm, Cn.
    rho : float or array [kg/m^3]
    airframe : Airframe
    thrust : float or array [N]
    wind : (3,) [m/s]
        North, east, down; constant, so it changes the position only.

    Returns
    -------
    derivative : (12, ...) array

    References
    ----------
    [M86], [KM16] ch. 3.
    """
    state = np.asarray(state, dtype=float)
    moved = motion_derivative(state[:8], coefficients, rho, airframe, thrust)
    out = np.empty((12, *moved.shape[1:]))
    out[:9] = moved
    north, east, down = np.einsum("...ij,j...->i...", body_to_earth(*state[6:9]), state[0:3])
    out[9], out[10], out[11] = north + wind[0], east + wind[1], -(down + np.asarray(wind[2]))
    return out


def motion_derivative(
    state: Values, coefficients: Values, rho: Values, airframe: Airframe, thrust: Values = 0.0
) -> np.ndarray:
    """Derivative (9, ...) of u v w, p q r and phi theta psi from a state (8, ...) without psi and the position.

    Parameters as in `state_derivative`.
    """
    mass, inertia, S, b, cbar, offset, inclination, rotor_momentum = airframe
    state = np.asarray(state, dtype=float)
    CX, CY, CZ, Cl, Cm, Cn = np.asarray(coefficients, dtype=float)
    velocity, rates, (phi, theta) = state[0:3], state[3:6], state[6:8]
    qbar = 0.5 * rho * np.sum(velocity**2, axis=0)
    force = specific_force(CX, CY, CZ, qbar, mass, S, thrust, inclination)
    LT, MT, NT = thrust_moment(thrust, offset, inclination)
    qS = qbar * S
    moment = (qS * b * Cl + LT, qS * cbar * Cm + MT, qS * b * Cn + NT)
    out = np.empty((9, *np.broadcast_shapes(state.shape[1:], np.shape(qS * CX))))
    out[0:3] = velocity_derivative(velocity, rates, force, phi, theta)
    out[3:6] = angular_acceleration(rates, moment, inertia, rotor_momentum)
    out[6:9] = euler_rates(rates[0], rates[1], rates[2], phi, theta)
    return out
