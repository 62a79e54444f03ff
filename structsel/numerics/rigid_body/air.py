"""Attitude, air data, and carrying sensor readings to the centre of gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.numerics.rigid_body.vectors import Three, Triple, Values, cross, require_positive


def body_to_earth(phi: Values, theta: Values, psi: Values) -> np.ndarray:
    """Rotation matrix from body axes to north, east, down.

    Parameters
    ----------
    phi, theta, psi : (n,) array [rad]
        Euler angles, yaw then pitch then roll.

    Returns
    -------
    R : (n, 3, 3) array
        Its last two axes transposed it turns earth vectors into body ones.

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
    """Airspeed, incidence and sideslip: V = |(u,v,w)|, alpha = atan(w/u), beta = asin(v/V).

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
    """Body-axis velocity u, v, w [m/s] from airspeed, incidence and sideslip (the reverse of `air_data`)."""
    V = np.asarray(V, dtype=float)
    return V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)


def air_data_at_cg(
    V: Values,
    alpha: Values,
    beta: Values,
    p: Values,
    q: Values,
    r: Values,
    position: Sequence[float],
) -> Three:
    """Carry airspeed and vane angles from a boom to the centre of gravity.

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


def acceleration_at_cg(
    ax: Values,
    ay: Values,
    az: Values,
    rates: Triple,
    rate_derivatives: Triple,
    position: Sequence[float],
) -> Three:
    """Carry specific force from the accelerometer's place to the centre of gravity.

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


def nondimensional_rates(V: Values, p: Values, q: Values, r: Values, b: float, cbar: float) -> Three:
    """Body rates as p b / 2V, q cbar / 2V, r b / 2V.

    Raises
    ------
    DomainError
        Where V is not above zero.
    """
    twice = 2.0 * require_positive("V", "m/s", V, "nondimensional_rates")
    return np.asarray(p) * b / twice, np.asarray(q) * cbar / twice, np.asarray(r) * b / twice
