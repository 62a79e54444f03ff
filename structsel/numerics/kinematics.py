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

Instruments away from the centre of gravity move through the air with v + omega x r, and read [M86], [H17]::

    V = (1 + KV) |v_pitot|          alpha = atan(w_vane / u_vane) + Cup atan(w / u) + Calpha0
    beta = asin(v_vane / V_vane) + Csi asin(v / V) + Cbeta0        (a flank-angle vane: atan(v_vane / u_vane))
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.square_root import copy

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
_S3, _S5, _S7, _S9 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0
_C2, _C4, _C6, _C8, _C10 = -0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0
_SMALL = 0.1  # rad; the series of sine and cosine are exact to 1e-18 below it
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
def turned(sine, cosine, angle, by):  # type: ignore[no-untyped-def]
    """Sine and cosine of an angle turned by `by`, from those of the angle; by series, exact in all digits, if small."""
    if abs(by) > _SMALL:
        return np.sin(angle + by), np.cos(angle + by)
    z = by * by
    s = by * (1.0 + z * (_S3 + z * (_S5 + z * (_S7 + z * _S9))))
    c = 1.0 + z * (_C2 + z * (_C4 + z * (_C6 + z * (_C8 + z * _C10))))
    return sine * c + cosine * s, cosine * c - sine * s


@njit(**UNCOUNTED)
def attitude(x, out):  # type: ignore[no-untyped-def]
    """Fill `out` (6,) with sine and cosine of phi, theta and psi."""
    for j in range(3):
        out[2 * j], out[2 * j + 1] = np.sin(x[3 + j]), np.cos(x[3 + j])


@njit(**UNCOUNTED)
def attitude_near(x, near, known, out):  # type: ignore[no-untyped-def]
    """The same from that of a full vector `near` with nearly the same attitude."""
    for j in range(3):
        sine, cosine = turned(known[2 * j], known[2 * j + 1], near[3 + j], x[3 + j] - near[3 + j])
        out[2 * j], out[2 * j + 1] = sine, cosine


@njit(cache=True, inline="always")
def _slope(x, a, place, g, located, angles, by, out):  # type: ignore[no-untyped-def]
    """Derivatives of the first nine entries; those of x and y are zero unless `located`."""
    fx, fy, fz, p, q, r = _force_and_rates(x, a, place, by)
    u, v, w = x[0], x[1], x[2]
    sf, cf, st, ct = angles[0], angles[1], angles[2], angles[3]
    turn = (q * sf + r * cf) / ct
    out[0] = fx - g * st - q * w + r * v
    out[1] = fy + g * ct * sf - r * u + p * w
    out[2] = fz + g * ct * cf - p * v + q * u
    out[3] = p + turn * st
    out[4] = q * cf - r * sf
    out[5] = turn
    out[8] = u * st - v * sf * ct - w * cf * ct - x[17]
    if located:
        sp, cp = angles[4], angles[5]
        along, across = u * ct + (v * sf + w * cf) * st, v * cf - w * sf
        out[6] = along * cp - across * sp + x[15]
        out[7] = along * sp + across * cp + x[16]
    else:
        out[6] = 0.0
        out[7] = 0.0


@njit(**UNCOUNTED)
def step(x, a0, a1, dt, place, g, located, angles, work, out):  # type: ignore[no-untyped-def]
    """Full vector one sample later: Runge-Kutta of fourth order, inputs linear between samples.

    `angles` is the `attitude` of x, `work` (7, 34) scratch.
    """
    middle, k1, k2, k3, k4, at, later = work[0], work[1], work[2], work[3], work[4], work[5], work[6]
    for j in range(9):
        middle[j] = 0.5 * (a0[j] + a1[j])
    by = _inverse_scales(x)
    copy(x, at)
    _slope(x, a0, place, g, located, angles, by, k1)
    for j in range(9):
        at[j] = x[j] + 0.5 * dt * k1[j]
    attitude_near(at, x, angles, later)
    _slope(at, middle, place, g, located, later, by, k2)
    for j in range(9):
        at[j] = x[j] + 0.5 * dt * k2[j]
    attitude_near(at, x, angles, later)
    _slope(at, middle, place, g, located, later, by, k3)
    for j in range(9):
        at[j] = x[j] + dt * k3[j]
    attitude_near(at, x, angles, later)
    _slope(at, a1, place, g, located, later, by, k4)
    copy(x, out)
    for j in range(9):
        out[j] += dt / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])


@njit(cache=True, inline="always")
def _moving(u, v, w, p, q, r, place, i):  # type: ignore[no-untyped-def]
    """Velocity at the position in row i from u, v, w at the centre of gravity."""
    return (
        u + q * place[i, 2] - r * place[i, 1],
        v + r * place[i, 0] - p * place[i, 2],
        w + p * place[i, 1] - q * place[i, 0],
    )


@njit(cache=True)
def observe_at(x, a, place, flank, wanted, angles, out):  # type: ignore[no-untyped-def]
    """Readings of the wanted instruments from a full vector with its `attitude`."""
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
    out[4], out[5] = (1.0 + x[24]) * x[4], x[5]
    if wanted[6] or wanted[7] or wanted[8] or wanted[9] or wanted[10] or wanted[11]:
        sf, cf, st, ct, sp, cp = angles[0], angles[1], angles[2], angles[3], angles[4], angles[5]
        rx, ry, rz = place[4, 0], place[4, 1], place[4, 2]
        out[6] = x[8] + rx * st - ry * sf * ct - rz * cf * ct
        rx, ry, rz = place[5, 0], place[5, 1], place[5, 2]
        along, across = rx * ct + (ry * sf + rz * cf) * st, ry * cf - rz * sf
        out[7] = x[6] + along * cp - across * sp
        out[8] = x[7] + along * sp + across * cp
        u, v, w = _moving(x[0], x[1], x[2], p, q, r, place, 5)
        along, across = u * ct + (v * sf + w * cf) * st, v * cf - w * sf
        out[9] = along * cp - across * sp + x[15]
        out[10] = along * sp + across * cp + x[16]
        out[11] = -u * st + (v * sf + w * cf) * ct + x[17]


@njit(cache=True)
def observe(x, a, place, flank, wanted, out):  # type: ignore[no-untyped-def]
    """Readings of the wanted instruments from a full vector."""
    phi, theta, psi = x[3], x[4], x[5]
    angles = (np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi))
    observe_at(x, a, place, flank, wanted, angles, out)


@njit(cache=True)
def noise_gain(x, a, gain):  # type: ignore[no-untyped-def]
    """Fill `gain` (34, 6), the derivative of the rate of the full vector by noise on ax ay az p q r."""
    gain[:] = 0.0
    sf, cf, tt, ct = np.sin(x[3]), np.cos(x[3]), np.tan(x[4]), np.cos(x[4])
    gain[0, 0] = gain[1, 1] = gain[2, 2] = 1.0
    gain[1, 3], gain[2, 3], gain[3, 3] = x[2], -x[1], 1.0
    gain[0, 4], gain[2, 4] = -x[2], x[0]
    gain[0, 5], gain[1, 5] = x[1], -x[0]
    gain[3, 4], gain[4, 4], gain[5, 4] = sf * tt, cf, sf / ct
    gain[3, 5], gain[4, 5], gain[5, 5] = cf * tt, -sf, cf / ct
    for j in range(6):
        by = 1.0 / (1.0 + x[INERTIAL_SCALE + j])
        for i in range(6):
            gain[i, j] *= by


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
    """
    n = t.shape[0]
    out = np.empty((n, start.shape[0]))
    work, angles = np.empty((7, start.shape[0])), np.empty(6)
    out[0] = start
    for k in range(1, n):
        attitude(out[k - 1], angles)
        step(out[k - 1], inputs[k - 1], inputs[k], t[k] - t[k - 1], place, g, located, angles, work, out[k])
    return out


@njit(cache=True)
def slopes(path, inputs, place, g):  # type: ignore[no-untyped-def]
    """(n, 9) derivatives of the motion along a path (n, 34)."""
    n = path.shape[0]
    out, angles = np.empty((n, 9)), np.empty(6)
    for k in range(n):
        attitude(path[k], angles)
        _slope(path[k], inputs[k], place, g, True, angles, _inverse_scales(path[k]), out[k])
    return out


@njit(cache=True)
def readings(path, inputs, place, flank):  # type: ignore[no-untyped-def]
    """(n, 12) readings of all instruments along a path (n, 34), without noise; columns as `MEASUREMENTS`."""
    n = path.shape[0]
    wanted = np.ones(12, dtype=np.bool_)
    out, angles = np.empty((n, 12)), np.empty(6)
    for k in range(n):
        attitude(path[k], angles)
        observe_at(path[k], inputs[k], place, flank, wanted, angles, out[k])
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
