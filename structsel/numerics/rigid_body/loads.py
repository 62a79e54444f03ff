"""Forces and moments: from sensor readings to coefficients, and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.numerics.rigid_body.vectors import NONE, Three, Triple, Values, cross, require_positive


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

    An accelerometer at the centre of gravity feels every force except gravity, so its reading less the
    thrust is the aerodynamic force::

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
        Tensor about the centre of gravity, see `inertia_tensor`.
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


def lift_and_drag(
    CX: Values, CY: Values, CZ: Values, alpha: Values, beta: Values = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Lift and drag coefficients from the body-axis ones.

    ::

        CL = CX sin(alpha) - CZ cos(alpha)
        CD = -CX cos(alpha) cos(beta) - CY sin(beta) - CZ sin(alpha) cos(beta)
    """
    CX, CY, CZ = (np.asarray(x, dtype=float) for x in (CX, CY, CZ))
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    return CX * sa - CZ * ca, -CX * ca * cb - CY * sb - CZ * sa * cb


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
    """What an accelerometer at the centre of gravity reads [m/s^2]; the reverse of `force_coefficients`."""
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


def inertia_tensor(Ix: float, Iy: float, Iz: float, Ixz: float = 0.0, Ixy: float = 0.0, Iyz: float = 0.0) -> np.ndarray:
    """(3, 3) tensor [kg m^2]; products are integrals of x z, ... over the mass, so they enter negative."""
    return np.array([[Ix, -Ixy, -Ixz], [-Ixy, Iy, -Iyz], [-Ixz, -Iyz, Iz]])


def _momentum(rates: Triple, inertia: np.ndarray) -> Three:
    p, q, r = (np.asarray(x, dtype=float) for x in rates)
    x, y, z = (row[0] * p + row[1] * q + row[2] * r for row in np.asarray(inertia))
    return x, y, z
