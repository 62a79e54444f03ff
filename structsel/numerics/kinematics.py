"""The kinematics of a flight path: how velocity, attitude and position follow from accelerometers and gyros.

Compiled; arrays in, arrays out. One *full vector* holds everything that may be estimated::

    u v w | phi theta psi | x y h | bax bay baz bp bq br | wn we wd | Cup Calpha0 Csi Cbeta0 KV
    | Kphi Ktheta Kax Kay Kaz Kp Kq Kr | ug vg wg

velocity relative to the steady air [m/s], attitude [rad], position north, east and up [m]; biases of the
accelerometers [m/s^2] and gyros [rad/s]; wind, the velocity of the air north, east and down [m/s]; upwash scale and
offset of the angle-of-attack vane, sidewash scale and offset of the sideslip vane, scale error of the airspeed; scale
errors of the attitude, accelerometers and gyros [KM16]; and gusts, which add to u v w [m/s] at the vanes and the pitot
tube, but not in the inertial or position measurements. An inertial reading is (1 + K) truth + bias, an attitude angle
reads (1 + K) truth. With f the specific force at the centre of gravity and W the wind [M86]::

    u' = fx - g sin(theta) - q w + r v                phi'   = p + (q sin(phi) + r cos(phi)) tan(theta)
    v' = fy + g cos(theta) sin(phi) - r u + p w       theta' = q cos(phi) - r sin(phi)
    w' = fz + g cos(theta) cos(phi) - p v + q u       psi'   = (q sin(phi) + r cos(phi)) / cos(theta)
    (x', y', -h') = L_EB (u, v, w) + W

Attitude is stored and printed as the three Euler angles. It is integrated as a rotation vector from the attitude of the
sample before (`rotations`), which has no singularity.

Instruments away from the centre of gravity move through the air with v + omega x r, and read [M86], [H17]::

    V = (1 + KV) |v_pitot|          alpha = atan(w_vane / u_vane) + Cup atan(w / u) + Calpha0
    beta = asin(v_vane / V_vane) + Csi asin(v / V) + Cbeta0        (a flank-angle vane: atan(v_vane / u_vane))
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.rotations import (
    angles_of,
    cosines_of,
    cosines_of_angles,
    cross,
    quaternion_of,
    rotation_factors,
    turn,
)

STATES = (
    *("u", "v", "w", "phi", "theta", "psi", "x", "y", "h"),
    *("bax", "bay", "baz", "bp", "bq", "br", "wn", "we", "wd"),
    *("Cup", "Calpha0", "Csi", "Cbeta0", "KV"),
    *("Kphi", "Ktheta", "Kax", "Kay", "Kaz", "Kp", "Kq", "Kr"),
    *("ug", "vg", "wg"),
)
"""Order of the full vector."""
MOTION = 9
"""Number of entries of the motion; the others are constants, or drift slowly."""
SCALE = 23
"""First of the scale errors of attitude and inertial readings."""
INERTIAL_SCALE = 25
"""First of the scale errors of the inertial readings, in the order of `INPUTS`."""
GUST = 31
"""The entries from here on are gusts."""
INPUTS = ("ax", "ay", "az", "p", "q", "r", "p_dot", "q_dot", "r_dot")
"""Columns of the inputs, as measured; the derivatives transfer the accelerometers to the centre of gravity."""
MEASUREMENTS = ("V", "alpha", "beta", "phi", "theta", "psi", "h", "x", "y", "vn", "ve", "vd")
"""Columns of the measurements; ground velocity is vn, ve, vd."""
PLACES = ("accelerometer", "alpha_vane", "beta_vane", "pitot", "static", "gps")
"""Rows of the sensor positions."""
TURN = 2.0 * np.pi
CIRCULAR = np.array([name in ("phi", "psi") for name in MEASUREMENTS])
"""Measurements that are angles modulo 2 pi."""


@njit(cache=True, inline="always")
def _inverse_scales(x):  # type: ignore[no-untyped-def]
    """Factors that remove the scale errors of ax ay az p q r."""
    return (
        *(1.0 / (1.0 + x[25]), 1.0 / (1.0 + x[26]), 1.0 / (1.0 + x[27])),
        *(1.0 / (1.0 + x[28]), 1.0 / (1.0 + x[29]), 1.0 / (1.0 + x[30])),
    )


@njit(cache=True, inline="always")
def _force_and_rates(x, a, place, by):  # type: ignore[no-untyped-def]
    """Specific force at the centre of gravity, and rates, from readings, biases and `_inverse_scales`."""
    by_x, by_y, by_z, by_p, by_q, by_r = by
    p, q, r = (a[3] - x[12]) * by_p, (a[4] - x[13]) * by_q, (a[5] - x[14]) * by_r
    p_dot, q_dot, r_dot = a[6] * by_p, a[7] * by_q, a[8] * by_r
    rx, ry, rz = place[0, 0], place[0, 1], place[0, 2]
    inner = p * rx + q * ry + r * rz  # omega x (omega x r) = omega (omega . r) - r omega^2
    square = p * p + q * q + r * r
    fx = (a[0] - x[9]) * by_x - (q_dot * rz - r_dot * ry) - (p * inner - rx * square)
    fy = (a[1] - x[10]) * by_y - (r_dot * rx - p_dot * rz) - (q * inner - ry * square)
    fz = (a[2] - x[11]) * by_z - (p_dot * ry - q_dot * rx) - (r * inner - rz * square)
    return fx, fy, fz, p, q, r


@njit(cache=True, inline="always")
def _slope(motion, force, C, g, wind):  # type: ignore[no-untyped-def]
    """Derivatives of velocity, of the rotation vector d from the attitude C, and of x, y, h."""
    u, v, w, d0, d1, d2 = motion
    fx, fy, fz, p, q, r = force
    s, c, b = rotation_factors(d0 * d0 + d1 * d1 + d2 * d2)
    # Weight in body axes, exp(-d) C' (0, 0, g).
    gx, gy, gz = g * C[2, 0], g * C[2, 1], g * C[2, 2]
    x1, y1, z1 = cross(d0, d1, d2, gx, gy, gz)
    x2, y2, z2 = cross(d0, d1, d2, x1, y1, z1)
    du = fx + gx - s * x1 + c * x2 - q * w + r * v
    dv = fy + gy - s * y1 + c * y2 - r * u + p * w
    dw = fz + gz - s * z1 + c * z2 - p * v + q * u
    x1, y1, z1 = cross(d0, d1, d2, p, q, r)
    x2, y2, z2 = cross(d0, d1, d2, x1, y1, z1)
    e0, e1, e2 = p + 0.5 * x1 + b * x2, q + 0.5 * y1 + b * y2, r + 0.5 * z1 + b * z2
    # Velocity in earth axes, C exp(d) (u, v, w).
    x1, y1, z1 = cross(d0, d1, d2, u, v, w)
    x2, y2, z2 = cross(d0, d1, d2, x1, y1, z1)
    u, v, w = u + s * x1 + c * x2, v + s * y1 + c * y2, w + s * z1 + c * z2
    north = C[0, 0] * u + C[0, 1] * v + C[0, 2] * w + wind[0]
    east = C[1, 0] * u + C[1, 1] * v + C[1, 2] * w + wind[1]
    up = -(C[2, 0] * u + C[2, 1] * v + C[2, 2] * w) - wind[2]
    return du, dv, dw, e0, e1, e2, north, east, up


@njit(**UNCOUNTED)
def step(x, C, a0, a1, dt, place, g, located, out):  # type: ignore[no-untyped-def]
    """Full vector one sample later: Runge-Kutta of fourth order, inputs linear between samples.

    In x and `out` the attitude is a rotation vector from C (3, 3), the turn from body to earth axes.
    """
    by, wind = _inverse_scales(x), (x[15], x[16], x[17])
    f0 = _force_and_rates(x, a0, place, by)
    f1 = _force_and_rates(x, a1, place, by)
    am = (
        *(0.5 * (a0[0] + a1[0]), 0.5 * (a0[1] + a1[1]), 0.5 * (a0[2] + a1[2])),
        *(0.5 * (a0[3] + a1[3]), 0.5 * (a0[4] + a1[4]), 0.5 * (a0[5] + a1[5])),
        *(0.5 * (a0[6] + a1[6]), 0.5 * (a0[7] + a1[7]), 0.5 * (a0[8] + a1[8])),
    )
    fm = _force_and_rates(x, am, place, by)
    h = 0.5 * dt
    k = _slope((x[0], x[1], x[2], x[3], x[4], x[5]), f0, C, g, wind)
    at = (x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3], x[4] + h * k[4], x[5] + h * k[5])
    m = _slope(at, fm, C, g, wind)
    at = (x[0] + h * m[0], x[1] + h * m[1], x[2] + h * m[2], x[3] + h * m[3], x[4] + h * m[4], x[5] + h * m[5])
    n = _slope(at, fm, C, g, wind)
    at = (x[0] + dt * n[0], x[1] + dt * n[1], x[2] + dt * n[2], x[3] + dt * n[3], x[4] + dt * n[4], x[5] + dt * n[5])
    e = _slope(at, f1, C, g, wind)
    for j in range(MOTION, len(x)):
        out[j] = x[j]
    sixth = dt / 6.0
    out[0] = x[0] + sixth * (k[0] + 2.0 * m[0] + 2.0 * n[0] + e[0])
    out[1] = x[1] + sixth * (k[1] + 2.0 * m[1] + 2.0 * n[1] + e[1])
    out[2] = x[2] + sixth * (k[2] + 2.0 * m[2] + 2.0 * n[2] + e[2])
    out[3] = x[3] + sixth * (k[3] + 2.0 * m[3] + 2.0 * n[3] + e[3])
    out[4] = x[4] + sixth * (k[4] + 2.0 * m[4] + 2.0 * n[4] + e[4])
    out[5] = x[5] + sixth * (k[5] + 2.0 * m[5] + 2.0 * n[5] + e[5])
    out[6], out[7] = x[6], x[7]
    if located:
        out[6] += sixth * (k[6] + 2.0 * m[6] + 2.0 * n[6] + e[6])
        out[7] += sixth * (k[7] + 2.0 * m[7] + 2.0 * n[7] + e[7])
    out[8] = x[8] + sixth * (k[8] + 2.0 * m[8] + 2.0 * n[8] + e[8])


@njit(cache=True, inline="always")
def _moving(u, v, w, p, q, r, place, i):  # type: ignore[no-untyped-def]
    """Velocity at the position in row i from u, v, w at the centre of gravity."""
    return (
        u + q * place[i, 2] - r * place[i, 1],
        v + r * place[i, 0] - p * place[i, 2],
        w + p * place[i, 1] - q * place[i, 0],
    )


@njit(cache=True)
def observe_at(x, C, a, place, flank, wanted, out):  # type: ignore[no-untyped-def]
    """Readings of the wanted instruments from a full vector; C (3, 3) is the turn from body to earth axes."""
    p, q, r = (a[3] - x[12]) / (1.0 + x[28]), (a[4] - x[13]) / (1.0 + x[29]), (a[5] - x[14]) / (1.0 + x[30])
    ua, va, wa = x[0] + x[31], x[1] + x[32], x[2] + x[33]
    if wanted[0]:
        u, v, w = _moving(ua, va, wa, p, q, r, place, 3)
        out[0] = (1.0 + x[22]) * np.sqrt(u * u + v * v + w * w)
    if wanted[1]:
        u, v, w = _moving(ua, va, wa, p, q, r, place, 1)
        out[1] = np.arctan2(w, u) + x[18] * np.arctan2(x[2], x[0]) + x[19]
    if wanted[2]:
        u, v, w = _moving(ua, va, wa, p, q, r, place, 2)
        # asin(v/V), without its singularity. Upwash and sidewash are those of steady air; otherwise they could not be
        # distinguished from the size of the gusts.
        here = np.arctan2(v, u) if flank else np.arctan2(v, np.sqrt(u * u + w * w))
        out[2] = here + x[20] * np.arctan2(x[1], np.sqrt(x[0] * x[0] + x[2] * x[2])) + x[21]
    # A roll angle of many turns is scaled within its turn.
    out[3] = x[3] + x[23] * (x[3] - TURN * np.round(x[3] / TURN))
    # A loop in the symmetry plane alone has theta beyond the vertical.
    theta = x[4] if abs(x[4]) <= 0.5 * np.pi else np.arctan2(-C[2, 0], np.sqrt(C[2, 1] ** 2 + C[2, 2] ** 2))
    out[4], out[5] = (1.0 + x[24]) * theta, x[5]
    if wanted[6] or wanted[7] or wanted[8] or wanted[9] or wanted[10] or wanted[11]:
        rx, ry, rz = place[4, 0], place[4, 1], place[4, 2]
        out[6] = x[8] - (C[2, 0] * rx + C[2, 1] * ry + C[2, 2] * rz)
        rx, ry, rz = place[5, 0], place[5, 1], place[5, 2]
        out[7] = x[6] + C[0, 0] * rx + C[0, 1] * ry + C[0, 2] * rz
        out[8] = x[7] + C[1, 0] * rx + C[1, 1] * ry + C[1, 2] * rz
        u, v, w = _moving(x[0], x[1], x[2], p, q, r, place, 5)
        out[9] = C[0, 0] * u + C[0, 1] * v + C[0, 2] * w + x[15]
        out[10] = C[1, 0] * u + C[1, 1] * v + C[1, 2] * w + x[16]
        out[11] = C[2, 0] * u + C[2, 1] * v + C[2, 2] * w + x[17]


@njit(cache=True)
def fly(t, inputs, start, place, g, located):  # type: ignore[no-untyped-def]
    """Integrate the kinematics from a full vector at the first sample.

    Parameters
    ----------
    t : (n,) array [s]
    inputs : (n, 9) array
        Columns as `INPUTS`.
    start : (34,) array
        As `STATES`.
    place : (6, 3) array [m]
        Rows as `PLACES`.
    g : float [m/s^2]
    located : bool
        Whether x and y are computed.

    Returns
    -------
    (n, 34) array
        phi and psi are continuous, except at the vertical; they begin at those of the start.
    """
    n = t.shape[0]
    out, now = np.empty((n, start.shape[0])), start.copy()
    C, e = np.empty((3, 3)), np.empty(4)
    e[0], e[1], e[2], e[3] = quaternion_of(start[3], start[4], start[5])
    out[0] = start
    for k in range(1, n):
        cosines_of(e, C)
        now[3], now[4], now[5] = 0.0, 0.0, 0.0
        step(now, C, inputs[k - 1], inputs[k], t[k] - t[k - 1], place, g, located, out[k])
        now[:] = out[k]
        turn(e, now[3], now[4], now[5], e)
        cosines_of(e, C)
        angles = angles_of(C)
        for j in range(3):
            # The turn nearest the last angle; theta has only one.
            turns = np.round((out[k - 1, 3 + j] - angles[j]) / TURN) if j != 1 else 0.0
            out[k, 3 + j] = angles[j] + TURN * turns
    return out


@njit(**UNCOUNTED)
def slopes_at(x, C, a, place, g, out):  # type: ignore[no-untyped-def]
    """Fill `out` (9,) with the derivatives of the motion in x; C (3, 3) is the turn from body to earth axes."""
    f = _force_and_rates(x, a, place, _inverse_scales(x))
    d = _slope((x[0], x[1], x[2], 0.0, 0.0, 0.0), f, C, g, (x[15], x[16], x[17]))
    p, q, r = f[3], f[4], f[5]
    sf, cf = np.sin(x[3]), np.cos(x[3])
    about_vertical = (q * sf + r * cf) / np.cos(x[4])
    out[0], out[1], out[2] = d[0], d[1], d[2]
    out[3], out[4] = p + about_vertical * np.sin(x[4]), q * cf - r * sf
    out[5], out[6], out[7], out[8] = about_vertical, d[6], d[7], d[8]


@njit(cache=True)
def slopes(path, inputs, place, g):  # type: ignore[no-untyped-def]
    """(n, 9) derivatives of the motion along a path (n, 34); those of phi and psi are infinite at the vertical."""
    n = path.shape[0]
    out, C = np.empty((n, 9)), np.empty((3, 3))
    for k in range(n):
        cosines_of_angles(path[k, 3], path[k, 4], path[k, 5], C)
        slopes_at(path[k], C, inputs[k], place, g, out[k])
    return out


@njit(cache=True)
def readings(path, inputs, place, flank):  # type: ignore[no-untyped-def]
    """(n, 12) readings of all instruments along a path (n, 34), without noise; columns as `MEASUREMENTS`."""
    n = path.shape[0]
    wanted = np.ones(12, dtype=np.bool_)
    out, C = np.empty((n, 12)), np.empty((3, 3))
    for k in range(n):
        cosines_of_angles(path[k, 3], path[k, 4], path[k, 5], C)
        observe_at(path[k], C, inputs[k], place, flank, wanted, out[k])
    return out


@njit(cache=True)
def forces(path, inputs, place):  # type: ignore[no-untyped-def]
    """(n, 6) specific force at the centre of gravity and rates along a path, without biases and scale errors."""
    n = path.shape[0]
    out = np.empty((n, 6))
    for k in range(n):
        fx, fy, fz, p, q, r = _force_and_rates(path[k], inputs[k], place, _inverse_scales(path[k]))
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = fx, fy, fz, p, q, r
    return out
