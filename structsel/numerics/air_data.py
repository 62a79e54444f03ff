"""Body axes and air data: vectors, rotation to earth axes, airspeed and flow angles, coefficients in wind axes.

Arrays only, SI units and radians, body axes x forward, y right, z down. Every function broadcasts over its arguments.
The functions ``..._compiled`` are the same formulas for a single state, for use in compiled loops.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.compiling import njit

Values = float | np.ndarray
"""A number, or an array of them."""
Triple = Sequence[float] | Sequence[Values] | np.ndarray
"""Three components: one array of three rows, or a sequence."""
Three = tuple[np.ndarray, np.ndarray, np.ndarray]
NONE = (0.0, 0.0, 0.0)


def require_positive(name: str, unit: str, values: Values, who: str) -> np.ndarray:
    """Return `values` as an array.

    Raises
    ------
    DomainError
        Where a value is not above zero or not a number; the message gives the first such sample.
    """
    array = np.asarray(values, dtype=float)
    bad = ~(array > 0.0)
    if bad.any():
        i = int(np.argmax(bad.ravel()))
        raise DomainError(
            f"{who} needs {name} [{unit}] above zero; sample {i} has {array.ravel()[i]:g}.\n"
            "Cut the recording to the part in flight."
        )
    return array


def cross(a: Triple, b: Triple) -> Three:
    """Vector product of two triples of arrays."""
    a1, a2, a3 = (np.asarray(x, dtype=float) for x in a)
    b1, b2, b3 = (np.asarray(x, dtype=float) for x in b)
    return a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1


def body_to_earth(phi: Values, theta: Values, psi: Values) -> np.ndarray:
    """Rotation matrix from body axes to north, east, down.

    Parameters
    ----------
    phi, theta, psi : (n,) array [rad]
        Euler angles, yaw then pitch then roll.

    Returns
    -------
    R : (n, 3, 3) array
        The transpose of its last two axes rotates from earth to body axes.

    References
    ----------
    [M86] (its L_EB), [KM16] ch. 3.
    """
    phi, theta, psi = np.broadcast_arrays(phi, theta, psi)
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    rows = (
        (ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp),
        (ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp),
        (-st, sf * ct, cf * ct),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def air_data(u: Values, v: Values, w: Values) -> Three:
    """Airspeed, angle of attack and sideslip: V = |(u,v,w)|, alpha = atan(w/u), beta = asin(v/V).

    Parameters
    ----------
    u, v, w : (n,) array [m/s]

    Returns
    -------
    V [m/s], alpha [rad], beta [rad] : (n,) array

    Raises
    ------
    DomainError
        Where V is not above zero.
    """
    u, v, w = (np.asarray(x, dtype=float) for x in (u, v, w))
    V = require_positive("V", "m/s", np.sqrt(u**2 + v**2 + w**2), "air_data")
    # Rounding can put |v| / V above one; asin there would give nan.
    return V, np.arctan2(w, u), np.arcsin(np.clip(v / V, -1.0, 1.0))


def body_velocity(V: Values, alpha: Values, beta: Values) -> Three:
    """Body-axis velocity u, v, w [m/s] from airspeed, angle of attack and sideslip (the reverse of `air_data`)."""
    V = np.asarray(V, dtype=float)
    return V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)


def air_data_at_cg(
    V: Values,
    alpha: Values,
    beta: Values,
    p: Values,
    q: Values,
    r: Values,
    position: Triple,
) -> Three:
    """Airspeed and flow angles at the centre of gravity from those at a boom.

    The boom moves through the air with v_cg + omega x r, so v_cg = v_boom - omega x r. No upwash.

    Parameters
    ----------
    V, alpha, beta : (n,) array [m/s, rad, rad]
        At the boom; beta = asin(v/V).
    p, q, r : (n,) array [rad/s]
    position : (3,) [m]
        Boom from the centre of gravity, body axes.

    Returns
    -------
    V, alpha, beta : (n,) array
        At the centre of gravity.

    References
    ----------
    [M86] observation equations of the vanes.
    """
    u, v, w = body_velocity(V, alpha, beta)
    du, dv, dw = cross((p, q, r), position)
    return air_data(u - du, v - dv, w - dw)


def air_data_at_sensor(
    V: Values, alpha: Values, beta: Values, p: Values, q: Values, r: Values, position: Triple
) -> Three:
    """V, alpha and beta at a sensor from those at the centre of gravity; reverses `air_data_at_cg`."""
    return air_data_at_cg(V, alpha, beta, p, q, r, -np.asarray(position, dtype=float))


def flow_angle_rates(u: Values, v: Values, w: Values, u_dot: Values, v_dot: Values, w_dot: Values) -> Three:
    """Derivatives of alpha, beta [rad/s] and V [m/s^2] from the velocity relative to the air and its derivative.

    ::

        alpha_dot = (u w' - w u') / (u^2 + w^2)
        beta_dot  = (v' (u^2 + w^2) - v (u u' + w w')) / (V^2 sqrt(u^2 + w^2))
        V_dot     = (u u' + v v' + w w') / V
    """
    level = u * u + w * w
    square = level + v * v
    V_dot = (u * u_dot + v * v_dot + w * w_dot) / np.sqrt(square)
    beta_dot = (v_dot * level - v * (u * u_dot + w * w_dot)) / (square * np.sqrt(level))
    return (u * w_dot - w * u_dot) / level, beta_dot, V_dot  # type: ignore[return-value]


flow_angle_rates_compiled = njit(cache=True, inline="always", error_model="numpy")(flow_angle_rates)


def nondimensional_rates(V: Values, p: Values, q: Values, r: Values, b: float, cbar: float) -> Three:
    """Body rates as p b / 2V, q cbar / 2V, r b / 2V.

    Raises
    ------
    DomainError
        Where V is not above zero.
    """
    twice = 2.0 * require_positive("V", "m/s", V, "nondimensional_rates")
    return np.asarray(p) * b / twice, np.asarray(q) * cbar / twice, np.asarray(r) * b / twice


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


def body_from_wind_axes(
    CL: Values, CD: Values, alpha: Values, CY: Values = 0.0, beta: Values = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Body-axis CX and CZ from lift and drag; reverses `lift_and_drag`.

    ::

        D  = (CD + CY sin(beta)) / cos(beta)
        CX = CL sin(alpha) - D cos(alpha)        CZ = -CL cos(alpha) - D sin(alpha)
    """
    return _body_from_wind(CL, CD, CY, np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta))  # type: ignore[return-value]


def _body_from_wind(CL, CD, CY, sa, ca, sb, cb):  # type: ignore[no-untyped-def]
    """`body_from_wind_axes` with the sines and cosines of the flow angles."""
    drag = (CD + CY * sb) / cb
    return CL * sa - drag * ca, -CL * ca - drag * sa


body_from_wind_compiled = njit(cache=True, inline="always", error_model="numpy")(_body_from_wind)
