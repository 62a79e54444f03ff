"""Derivatives of one step of the kinematics, and of the readings, along the columns of a root. Compiled.

A column holds deviations of the estimated states from the centre; those of the attitude are a small rotation vector
in earth axes, here turned to e in body axes. With the rates w, the velocity v and the weight g, all in body axes and
at the middle of the step,

    dv' = df - w x dv - dw x v + g x e        e' = dw - w x e        (dx, dy, -dh)' = C (dv + e x v) + dW

which are integrated by the midpoint rule: the third power of (rate times step) is left out.
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.kinematics import GUST, INERTIAL_SCALE, MOTION, TURN
from structsel.numerics.rotations import cross, to_body, to_earth


@njit(cache=True, inline="always")
def _rates_change(z, by, rates):  # type: ignore[no-untyped-def]
    """Change of p, q, r by biases and scale errors of the gyros."""
    return (
        -by[3] * (z[12] + rates[0] * z[28]),
        -by[4] * (z[13] + rates[1] * z[29]),
        -by[5] * (z[14] + rates[2] * z[30]),
    )


@njit(cache=True, inline="always")
def _force_change(z, by, force, rates, turning, arm, change):  # type: ignore[no-untyped-def]
    """Change of the specific force at the centre of gravity; `force` is that at the accelerometer, `arm` its place."""
    fx, fy, fz = (
        -by[0] * (z[9] + force[0] * z[25]),
        -by[1] * (z[10] + force[1] * z[26]),
        -by[2] * (z[11] + force[2] * z[27]),
    )
    if arm[0] == 0.0 and arm[1] == 0.0 and arm[2] == 0.0:
        return fx, fy, fz
    # omega' x r + omega x (omega x r)
    ax, ay, az = -by[3] * turning[0] * z[28], -by[4] * turning[1] * z[29], -by[5] * turning[2] * z[30]
    ax, ay, az = cross(ax, ay, az, arm[0], arm[1], arm[2])
    bx, by_, bz = cross(rates[0], rates[1], rates[2], arm[0], arm[1], arm[2])
    bx, by_, bz = cross(change[0], change[1], change[2], bx, by_, bz)
    cx, cy, cz = cross(change[0], change[1], change[2], arm[0], arm[1], arm[2])
    cx, cy, cz = cross(rates[0], rates[1], rates[2], cx, cy, cz)
    return fx - ax - bx - cx, fy - ay - by_ - cy, fz - az - bz - cz


@njit(cache=True, inline="always")
def _flow(e, dv, df, dw, rates, velocity, weight):  # type: ignore[no-untyped-def]
    """Dv' and e' of the deviations dv and e."""
    ax, ay, az = cross(rates[0], rates[1], rates[2], dv[0], dv[1], dv[2])
    bx, by, bz = cross(dw[0], dw[1], dw[2], velocity[0], velocity[1], velocity[2])
    gx, gy, gz = cross(weight[0], weight[1], weight[2], e[0], e[1], e[2])
    ex, ey, ez = cross(rates[0], rates[1], rates[2], e[0], e[1], e[2])
    return (
        *(df[0] - ax - bx + gx, df[1] - ay - by + gy, df[2] - az - bz + gz),
        *(dw[0] - ex, dw[1] - ey, dw[2] - ez),
    )


@njit(cache=True, inline="always")
def _last_instrument(states):  # type: ignore[no-untyped-def]
    """Position of the last bias or scale error of an inertial reading; the columns after it contain none."""
    last = -1
    for i in range(len(states)):
        if MOTION <= states[i] < MOTION + 6 or INERTIAL_SCALE <= states[i] < GUST:
            last = i
    return last


@njit(**UNCOUNTED)
def step_columns(T, states, first, before, after, C0, C1, a0, a1, dt, place, g, fade, z, N):  # type: ignore[no-untyped-def]
    """Fill N (L, m) with the columns T (L, L) of the root one sample later, entries of the moving states only.

    `states` has the `first` constants first. `before`, `after` (34,) are the centre at both samples, C0, C1 its
    attitude; z (34,) is scratch.
    """
    L, half = len(states), 0.5 * dt
    by = (
        *(1.0 / (1.0 + before[25]), 1.0 / (1.0 + before[26]), 1.0 / (1.0 + before[27])),
        *(1.0 / (1.0 + before[28]), 1.0 / (1.0 + before[29]), 1.0 / (1.0 + before[30])),
    )
    force = (
        (0.5 * (a0[0] + a1[0]) - before[9]) * by[0],
        (0.5 * (a0[1] + a1[1]) - before[10]) * by[1],
        (0.5 * (a0[2] + a1[2]) - before[11]) * by[2],
    )
    rates = (
        (0.5 * (a0[3] + a1[3]) - before[12]) * by[3],
        (0.5 * (a0[4] + a1[4]) - before[13]) * by[4],
        (0.5 * (a0[5] + a1[5]) - before[14]) * by[5],
    )
    turning = (0.5 * (a0[6] + a1[6]) * by[3], 0.5 * (a0[7] + a1[7]) * by[4], 0.5 * (a0[8] + a1[8]) * by[5])
    velocity = (0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2]))
    weight = (0.5 * g * (C0[2, 0] + C1[2, 0]), 0.5 * g * (C0[2, 1] + C1[2, 1]), 0.5 * g * (C0[2, 2] + C1[2, 2]))
    arm = (place[0, 0], place[0, 1], place[0, 2])
    disturbed = _last_instrument(states) + 1
    z[:] = 0.0
    for j in range(L):
        for i in range(L):
            z[states[i]] = T[j, i] if i >= j else 0.0
        z[3], z[4], z[5] = to_body(C0, z[3], z[4], z[5])
        dw, df = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if j < disturbed:
            dw = _rates_change(z, by, rates)
            df = _force_change(z, by, force, rates, turning, arm, dw)
        dv, e = (z[0], z[1], z[2]), (z[3], z[4], z[5])
        s = _flow(e, dv, df, dw, rates, velocity, weight)
        dv = (z[0] + half * s[0], z[1] + half * s[1], z[2] + half * s[2])
        e = (z[3] + half * s[3], z[4] + half * s[4], z[5] + half * s[5])
        s = _flow(e, dv, df, dw, rates, velocity, weight)
        x1, y1, z1 = cross(e[0], e[1], e[2], velocity[0], velocity[1], velocity[2])
        x1, y1, z1 = half * (dv[0] + x1), half * (dv[1] + y1), half * (dv[2] + z1)
        north = (C0[0, 0] + C1[0, 0]) * x1 + (C0[0, 1] + C1[0, 1]) * y1 + (C0[0, 2] + C1[0, 2]) * z1
        east = (C0[1, 0] + C1[1, 0]) * x1 + (C0[1, 1] + C1[1, 1]) * y1 + (C0[1, 2] + C1[1, 2]) * z1
        down = (C0[2, 0] + C1[2, 0]) * x1 + (C0[2, 1] + C1[2, 1]) * y1 + (C0[2, 2] + C1[2, 2]) * z1
        z[0] += dt * s[0]
        z[1] += dt * s[1]
        z[2] += dt * s[2]
        z[3] += dt * s[3]
        z[4] += dt * s[4]
        z[5] += dt * s[5]
        z[6] += north + dt * z[15]
        z[7] += east + dt * z[16]
        z[8] -= down + dt * z[17]
        z[3], z[4], z[5] = to_earth(C1, z[3], z[4], z[5])
        for i in range(first, L):
            state = states[i]
            N[j, i - first] = fade * z[state] if state >= GUST else z[state]
        for i in range(MOTION):  # also those that are not estimated
            z[i] = 0.0


@njit(**UNCOUNTED)
def noise_columns(x, C, std, gain):  # type: ignore[no-untyped-def]
    """Fill `gain` (6, 6): velocity and rotation by noise `std` (6,) on ax ay az p q r; C (3, 3) is the attitude."""
    gain[:] = 0.0
    for j in range(6):
        level = std[j] / (1.0 + x[INERTIAL_SCALE + j])
        if j < 3:
            gain[j, j] = level
        if j == 3:
            gain[1, j], gain[2, j] = level * x[2], -level * x[1]
        elif j == 4:
            gain[0, j], gain[2, j] = -level * x[2], level * x[0]
        elif j == 5:
            gain[0, j], gain[1, j] = level * x[1], -level * x[0]
        if j >= 3:
            gain[3, j], gain[4, j], gain[5, j] = level * C[0, j - 3], level * C[1, j - 3], level * C[2, j - 3]


@njit(cache=True, inline="always")
def _speed_at(x, rates, place, i):  # type: ignore[no-untyped-def]
    """Velocity relative to the air at the position in row i."""
    p, q, r = rates
    return (
        x[0] + x[31] + q * place[i, 2] - r * place[i, 1],
        x[1] + x[32] + r * place[i, 0] - p * place[i, 2],
        x[2] + x[33] + p * place[i, 1] - q * place[i, 0],
    )


@njit(**UNCOUNTED)
def reading_columns(T, states, x, C, a, place, flank_angle_vane, wanted, z, out):  # type: ignore[no-untyped-def]
    """Fill out (L, 12) with the derivatives of the wanted readings along the columns T (L, L) of the root.

    x (34,) is the centre with its Euler angles, C (3, 3) its attitude; z (34,) is scratch.
    """
    L = len(states)
    by = (1.0, 1.0, 1.0, 1.0 / (1.0 + x[28]), 1.0 / (1.0 + x[29]), 1.0 / (1.0 + x[30]))
    rates = ((a[3] - x[12]) * by[3], (a[4] - x[13]) * by[4], (a[5] - x[14]) * by[5])
    # Air data.
    pu, pv, pw = _speed_at(x, rates, place, 3)
    speed = np.sqrt(pu * pu + pv * pv + pw * pw)
    pu, pv, pw = pu / speed, pv / speed, pw / speed
    au, _, aw = _speed_at(x, rates, place, 1)
    asq = 1.0 / (au * au + aw * aw)
    bu, bv, bw = _speed_at(x, rates, place, 2)
    # A flank-angle vane compares v with u alone.
    bw = 0.0 if flank_angle_vane else bw
    broot = bu if flank_angle_vane else np.sqrt(bu * bu + bw * bw)
    bsq = 1.0 / (broot * broot + bv * bv)
    plane = x[0] * x[0] + x[2] * x[2]
    root = np.sqrt(plane)
    asq0, bsq0 = 1.0 / plane, 1.0 / (plane + x[1] * x[1])
    alpha, beta = np.arctan2(x[2], x[0]), np.arctan2(x[1], root)
    # Euler angles; at the vertical phi and psi have no derivative.
    sf, cf = np.sin(x[3]), np.cos(x[3])
    secant = 1.0 / max(np.cos(x[4]), 1e-6)
    tangent = -C[2, 0] * secant
    roll = x[3] - TURN * np.round(x[3] / TURN)
    # Velocity of the antenna.
    gu = x[0] + rates[1] * place[5, 2] - rates[2] * place[5, 1]
    gv = x[1] + rates[2] * place[5, 0] - rates[0] * place[5, 2]
    gw = x[2] + rates[0] * place[5, 1] - rates[1] * place[5, 0]
    ground = wanted[6] or wanted[7] or wanted[8] or wanted[9] or wanted[10] or wanted[11]
    z[:] = 0.0
    for j in range(L):
        for i in range(L):
            z[states[i]] = T[j, i] if i >= j else 0.0
        z[3], z[4], z[5] = to_body(C, z[3], z[4], z[5])
        y = out[j]
        dw = _rates_change(z, by, rates)
        if wanted[0]:
            u, v, w = _speed_at(z, dw, place, 3)
            y[0] = (1.0 + x[22]) * (pu * u + pv * v + pw * w) + z[22] * speed
        if wanted[1]:
            u, v, w = _speed_at(z, dw, place, 1)
            steady = (x[0] * z[2] - x[2] * z[0]) * asq0
            y[1] = (au * w - aw * u) * asq + x[18] * steady + z[18] * alpha + z[19]
        if wanted[2]:
            u, v, w = _speed_at(z, dw, place, 2)
            along = (bu * u + bw * w) / broot
            steady = (root * z[1] - x[1] * (x[0] * z[0] + x[2] * z[2]) / root) * bsq0
            y[2] = (broot * v - bv * along) * bsq + x[20] * steady + z[20] * beta + z[21]
        about = sf * z[4] + cf * z[5]
        y[3] = (1.0 + x[23]) * (z[3] + tangent * about) + z[23] * roll
        y[4] = (1.0 + x[24]) * (cf * z[4] - sf * z[5]) + z[24] * x[4]
        y[5] = secant * about
        if ground:
            x1, y1, z1 = cross(z[3], z[4], z[5], place[4, 0], place[4, 1], place[4, 2])
            y[6] = z[8] - (C[2, 0] * x1 + C[2, 1] * y1 + C[2, 2] * z1)
            x1, y1, z1 = cross(z[3], z[4], z[5], place[5, 0], place[5, 1], place[5, 2])
            y[7] = z[6] + C[0, 0] * x1 + C[0, 1] * y1 + C[0, 2] * z1
            y[8] = z[7] + C[1, 0] * x1 + C[1, 1] * y1 + C[1, 2] * z1
            x1, y1, z1 = cross(z[3], z[4], z[5], gu, gv, gw)
            x1 += z[0] + dw[1] * place[5, 2] - dw[2] * place[5, 1]
            y1 += z[1] + dw[2] * place[5, 0] - dw[0] * place[5, 2]
            z1 += z[2] + dw[0] * place[5, 1] - dw[1] * place[5, 0]
            y[9] = C[0, 0] * x1 + C[0, 1] * y1 + C[0, 2] * z1 + z[15]
            y[10] = C[1, 0] * x1 + C[1, 1] * y1 + C[1, 2] * z1 + z[16]
            y[11] = C[2, 0] * x1 + C[2, 1] * y1 + C[2, 2] * z1 + z[17]
        z[3], z[4], z[5] = 0.0, 0.0, 0.0
