"""Attitude without a singularity: unit quaternions, and rotation vectors for what differs from one.

Compiled; arrays and scalars. A quaternion (e0, e1, e2, e3) turns body axes to earth axes, C its direction cosines. A
rotation vector d turns about its own direction by the angle |d|; with z = |d|^2 and x the vector product

    exp(d) v = v + s d x v + c d x (d x v),          s = sin|d| / |d|,  c = (1 - cos|d|) / z
    d'       = w + d x w / 2 + b d x (d x w),        b = 1/12 + z/720 + z^2/30240 + ...

for an attitude C exp(d) that turns with the rates w in body axes [B71].
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit

_SERIES = 0.1  # of z; the series below are exact to 1e-14 up to it


@njit(cache=True, inline="always")
def rotation_factors(z):  # type: ignore[no-untyped-def]
    """The factors s, c and b for a rotation vector of squared length z."""
    b = 1.0 / 12.0 + z * (1.0 / 720.0 + z * (1.0 / 30240.0 + z / 1209600.0))
    if z < _SERIES:
        s = 1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0 * (1.0 - z / 72.0 * (1.0 - z / 110.0))))
        c = 0.5 - z / 24.0 * (1.0 - z / 30.0 * (1.0 - z / 56.0 * (1.0 - z / 90.0 * (1.0 - z / 132.0))))
        return s, c, b
    angle = np.sqrt(z)
    return np.sin(angle) / angle, (1.0 - np.cos(angle)) / z, b


@njit(cache=True, inline="always")
def cross(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Vector product (a, b, c) x (x, y, z)."""
    return b * z - c * y, c * x - a * z, a * y - b * x


@njit(cache=True)
def quaternion_of(phi, theta, psi):  # type: ignore[no-untyped-def]
    """Quaternion of Euler angles."""
    sf, cf = np.sin(0.5 * phi), np.cos(0.5 * phi)
    st, ct = np.sin(0.5 * theta), np.cos(0.5 * theta)
    sp, cp = np.sin(0.5 * psi), np.cos(0.5 * psi)
    return (
        cf * ct * cp + sf * st * sp,
        sf * ct * cp - cf * st * sp,
        cf * st * cp + sf * ct * sp,
        cf * ct * sp - sf * st * cp,
    )


@njit(**UNCOUNTED)
def cosines_of(e, C):  # type: ignore[no-untyped-def]
    """Fill C (3, 3), the turn from body to earth axes, from a quaternion e (4,)."""
    a, b, c, d = e[0], e[1], e[2], e[3]
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - 2.0 * (c * c + d * d), 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)
    C[1, 0], C[1, 1], C[1, 2] = 2.0 * (b * c + a * d), 1.0 - 2.0 * (b * b + d * d), 2.0 * (c * d - a * b)
    C[2, 0], C[2, 1], C[2, 2] = 2.0 * (b * d - a * c), 2.0 * (c * d + a * b), 1.0 - 2.0 * (b * b + c * c)


@njit(**UNCOUNTED)
def cosines_of_angles(phi, theta, psi, C):  # type: ignore[no-untyped-def]
    """Fill C (3, 3) from Euler angles."""
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    C[0, 0], C[0, 1], C[0, 2] = ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp
    C[1, 0], C[1, 1], C[1, 2] = ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp
    C[2, 0], C[2, 1], C[2, 2] = -st, sf * ct, cf * ct


@njit(**UNCOUNTED)
def angles_of(C):  # type: ignore[no-untyped-def]
    """Euler angles of C: phi and psi within half a turn, theta within a quarter."""
    theta = np.arctan2(-C[2, 0], np.sqrt(C[2, 1] * C[2, 1] + C[2, 2] * C[2, 2]))
    return np.arctan2(C[2, 1], C[2, 2]), theta, np.arctan2(C[1, 0], C[0, 0])


@njit(**UNCOUNTED)
def turn(e, x, y, z, out):  # type: ignore[no-untyped-def]
    """Fill `out` (4,) with the quaternion e turned by a rotation vector in body axes; it may be e itself."""
    square = 0.25 * (x * x + y * y + z * z)
    s, _, _ = rotation_factors(square)
    w = np.cos(np.sqrt(square))
    x, y, z = 0.5 * s * x, 0.5 * s * y, 0.5 * s * z
    a, b, c, d = e[0], e[1], e[2], e[3]
    n0, n1 = a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y
    n2, n3 = a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w
    scale = 1.0 / np.sqrt(n0 * n0 + n1 * n1 + n2 * n2 + n3 * n3)
    out[0], out[1], out[2], out[3] = scale * n0, scale * n1, scale * n2, scale * n3


@njit(**UNCOUNTED)
def vector_between(e, later):  # type: ignore[no-untyped-def]
    """Rotation vector in body axes that turns the quaternion e to `later`."""
    a, b, c, d = e[0], e[1], e[2], e[3]
    w, x, y, z = later[0], later[1], later[2], later[3]
    n0 = a * w + b * x + c * y + d * z
    n1, n2, n3 = a * x - b * w - c * z + d * y, a * y + b * z - c * w - d * x, a * z - b * y + c * x - d * w
    if n0 < 0.0:
        n0, n1, n2, n3 = -n0, -n1, -n2, -n3
    sine = np.sqrt(n1 * n1 + n2 * n2 + n3 * n3)
    factor = 2.0 / n0 if sine < 1e-9 else 2.0 * np.arctan2(sine, n0) / sine
    return factor * n1, factor * n2, factor * n3


@njit(cache=True, inline="always")
def to_body(C, x, y, z):  # type: ignore[no-untyped-def]
    """Vector in body axes from one in earth axes."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


@njit(cache=True, inline="always")
def to_earth(C, x, y, z):  # type: ignore[no-untyped-def]
    """Vector in earth axes from one in body axes."""
    return (
        C[0, 0] * x + C[0, 1] * y + C[0, 2] * z,
        C[1, 0] * x + C[1, 1] * y + C[1, 2] * z,
        C[2, 0] * x + C[2, 1] * y + C[2, 2] * z,
    )
