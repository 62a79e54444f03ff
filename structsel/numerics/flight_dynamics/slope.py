"""The slope of the rigid-body state for one state at a time, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from structsel.numerics.atmosphere import HIGHEST, LOWEST, standard_air
from structsel.numerics.expressions import run_program

# Where each thing is left beside the slope; OUTPUTS are made of these.
AIR_U, AIR_V, AIR_W, V, ALPHA, BETA, AX, AY, AZ, ALPHA_DOT, BETA_DOT, V_DOT = range(12)
RHO, QBAR, MACH, THRUST, MASS, CX = range(12, 18)
WIND = 23  # north, east, down: all the air moves with here, gust included
ASIDE = 26


@njit(cache=True)
def wind_at(h, heights, wind, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Wind at a height, linear between known heights."""
    last = heights.size - 1
    if last == 0 or h <= heights[0]:
        out[:] = wind[0]
    elif h >= heights[last]:
        out[:] = wind[last]
    else:
        j = np.searchsorted(heights, h) - 1
        part = (h - heights[j]) / (heights[j + 1] - heights[j])
        for i in range(3):
            out[i] = wind[j, i] + part * (wind[j + 1, i] - wind[j, i])


@njit(cache=True, inline="always")
def _to_body(wind_axes, c, sa, ca, sb, cb):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Turn CD, CY, CL in place into CX, CY, CZ."""
    if wind_axes:
        drag = (c[0] + c[1] * sb) / cb
        lift = c[2]
        c[0] = lift * sa - drag * ca
        c[2] = -lift * ca - drag * sa


@njit(cache=True, inline="always")
def _rates_of_flow(u, v, w, du, dv, dw):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """alpha_dot, beta_dot, V_dot from the velocity relative to the air and its rate."""
    ground = u * u + w * w
    square = ground + v * v
    V_dot = (u * du + v * dv + w * dw) / np.sqrt(square)
    return (
        (u * dw - w * du) / ground,
        (dv * ground - v * (u * du + w * dw)) / (square * np.sqrt(ground)),
        V_dot,
    )


@njit(cache=True, error_model="numpy")
def slope(x, control, around, values, drift, plan, steady, heights, wind, warmer, g, slots, work, out, aside):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Rate of change `out` (12,) of a state `x`, and beside it what the outputs need.

    Parameters
    ----------
    x : (12,) array
    control, around : arrays
        Controls and `SURROUNDINGS` at this instant.
    values : (>= T,) array
        Coefficients of the terms.
    drift : (12,) array
        Added to the slope; zero in an honest flight.
    plan : Kernel
    steady : (3,) array [m/s]
        Wind the state's velocity is relative to.
    heights, wind, warmer, g
        Of the `Flight`.
    slots, work : scratch
        (program slots,) and (4, 6).
    """
    sf, cf, st, ct = np.sin(x[6]), np.cos(x[6]), np.sin(x[7]), np.cos(x[7])
    sp, cp = np.sin(x[8]), np.cos(x[8])
    # Rotation from body axes to north, east, down, row by row.
    r00, r01, r02 = ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp
    r10, r11, r12 = ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp
    r20, r21, r22 = -st, sf * ct, cf * ct
    here = work[3]
    wind_at(x[11], heights, wind, here[:3])
    en, ee, ed = here[0] - steady[0], here[1] - steady[1], here[2] - steady[2]
    ug, vg, wg = around[7], around[8], around[9]
    u = x[0] - (r00 * en + r10 * ee + r20 * ed) - ug
    v = x[1] - (r01 * en + r11 * ee + r21 * ed) - vg
    w = x[2] - (r02 * en + r12 * ee + r22 * ed) - wg
    p, q, r = x[3] - around[10], x[4] - around[11], x[5] - around[12]
    ground = np.sqrt(u * u + w * w)
    speed = np.sqrt(u * u + v * v + w * w)
    alpha, beta = np.arctan2(w, u), np.arctan2(v, ground)
    # Steps that end outside the atmosphere are found out at their end; inside one the nearest air will do.
    air = standard_air(min(max(x[11], LOWEST), HIGHEST), warmer)
    rho = air[2] if np.isnan(around[13]) else around[13]
    qbar = 0.5 * rho * speed * speed
    slots[0], slots[1], slots[2], slots[3], slots[4], slots[5] = u, v, w, p, q, r
    for i in range(6, 12):
        slots[i] = x[i]
    slots[12], slots[13], slots[14], slots[15], slots[16], slots[17] = speed, alpha, beta, rho, qbar, speed / air[3]
    slots[18] = slots[19] = 1.0
    slots[20 : plan.inputs] = control
    run_program(plan.operation, plan.left, plan.right, plan.value, plan.inputs, slots)
    c = work[0]
    work[:3] = 0.0  # coefficients without the flow's rates, and their derivatives with respect to each
    for i in range(plan.term_slot.size):
        work[plan.term_rate[i], plan.term_response[i]] += values[i] * slots[plan.term_slot[i]]
    sa, ca, sb, cb = w / ground, u / ground, v / speed, ground / speed
    _to_body(plan.wind_axes, c, sa, ca, sb, cb)
    thrust = slots[plan.thrust_slot] if plan.thrust_slot >= 0 else 0.0
    mass, qS = around[0], qbar * plan.S
    P, Q, R = x[3], x[4], x[5]
    # Acceleration but for the air's force.
    bu = thrust * plan.direction[0] / mass - g * st - Q * x[2] + R * x[1]
    bv = thrust * plan.direction[1] / mass + g * ct * sf - R * x[0] + P * x[2]
    bw = thrust * plan.direction[2] / mass + g * ct * cf - P * x[1] + Q * x[0]
    if plan.implicit:
        _to_body(plan.wind_axes, work[1], sa, ca, sb, cb)
        _to_body(plan.wind_axes, work[2], sa, ca, sb, cb)
        k = qS / mass
        half_c, half_b = plan.cbar / (2.0 * speed), plan.b / (2.0 * speed)
        a0, b0, _ = _rates_of_flow(u, v, w, bu + k * c[0], bv + k * c[1], bw + k * c[2])
        aa, ba, _ = _rates_of_flow(u, v, w, k * work[1, 0], k * work[1, 1], k * work[1, 2])
        ab, bb, _ = _rates_of_flow(u, v, w, k * work[2, 0], k * work[2, 1], k * work[2, 2])
        # rate = rate0 + J rate, two by two
        a0, aa, ab = a0 * half_c, aa * half_c, ab * half_c
        b0, ba, bb = b0 * half_b, ba * half_b, bb * half_b
        whole = (1.0 - aa) * (1.0 - bb) - ab * ba
        along = (a0 * (1.0 - bb) + ab * b0) / whole
        across = (b0 * (1.0 - aa) + ba * a0) / whole
        for i in range(6):
            c[i] += work[1, i] * along + work[2, i] * across
    ax = (qS * c[0] + thrust * plan.direction[0]) / mass
    ay = (qS * c[1] + thrust * plan.direction[1]) / mass
    az = (qS * c[2] + thrust * plan.direction[2]) / mass
    out[0] = bu + qS * c[0] / mass
    out[1] = bv + qS * c[1] / mass
    out[2] = bw + qS * c[2] / mass
    Ix, Iy, Iz, Ixz, Ixy, Iyz = around[1], around[2], around[3], around[4], around[5], around[6]
    hx = Ix * P - Ixy * Q - Ixz * R + plan.rotor
    hy = -Ixy * P + Iy * Q - Iyz * R
    hz = -Ixz * P - Iyz * Q + Iz * R
    L = qS * plan.b * c[3] + thrust * plan.arm[0] - (Q * hz - R * hy)
    M = qS * plan.cbar * c[4] + thrust * plan.arm[1] - (R * hx - P * hz)
    N = qS * plan.b * c[5] + thrust * plan.arm[2] - (P * hy - Q * hx)
    # Inverse of the symmetric tensor by its cofactors.
    c00, c01, c02 = Iy * Iz - Iyz * Iyz, Ixy * Iz + Ixz * Iyz, Ixy * Iyz + Ixz * Iy
    c11, c12, c22 = Ix * Iz - Ixz * Ixz, Ix * Iyz + Ixy * Ixz, Ix * Iy - Ixy * Ixy
    volume = Ix * c00 - Ixy * c01 - Ixz * c02
    out[3] = (c00 * L + c01 * M + c02 * N) / volume
    out[4] = (c01 * L + c11 * M + c12 * N) / volume
    out[5] = (c02 * L + c12 * M + c22 * N) / volume
    turn = (Q * sf + R * cf) / ct
    out[6] = P + turn * st
    out[7] = Q * cf - R * sf
    out[8] = turn
    out[9] = r00 * x[0] + r01 * x[1] + r02 * x[2] + steady[0]
    out[10] = r10 * x[0] + r11 * x[1] + r12 * x[2] + steady[1]
    out[11] = -(r20 * x[0] + r21 * x[1] + r22 * x[2] + steady[2])
    for i in range(12):
        out[i] += drift[i]
    aside[AIR_U], aside[AIR_V], aside[AIR_W] = u, v, w
    aside[V], aside[ALPHA], aside[BETA] = speed, alpha, beta
    aside[AX], aside[AY], aside[AZ] = ax, ay, az
    aside[ALPHA_DOT], aside[BETA_DOT], aside[V_DOT] = _rates_of_flow(u, v, w, out[0], out[1], out[2])
    aside[RHO], aside[QBAR], aside[MACH], aside[THRUST], aside[MASS] = rho, qbar, slots[17], thrust, mass
    for i in range(6):
        aside[CX + i] = c[i]
    aside[WIND] = here[0] + r00 * ug + r01 * vg + r02 * wg
    aside[WIND + 1] = here[1] + r10 * ug + r11 * vg + r12 * wg
    aside[WIND + 2] = here[2] + r20 * ug + r21 * vg + r22 * wg
