"""A truth flight, compiled: rigid aircraft, pilot, actuators, engine, and the effects that may be added.

One manoeuvre per call. The step is that of the schedules: classical Runge-Kutta, controls and air held over it.

What is independent of structsel here, and must stay so, are the states with memory: the lags of the wake at tail and
fin, Wagner's function, the separation point after Goman and Khrabrov, and slosh. The rigid-body equations are not
kept for independence: a test holds them equal to `structsel.numerics.rigid_body`, and JSBSim is the foreign plant.
They are written here because pilot, actuators and states with memory run in one compiled loop with them, and because
the cases kept for evaluation stay what they were.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from proof.polynomial.terms import INDEX, VARIABLES, add_terms
from structsel.numerics.atmosphere import standard_air

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h",
          "downwash", "sidewash", "wagner1", "wagner2", "attached", "slosh", "slosh_rate")  # fmt: skip
"""Velocity relative to the air mass (gusts apart), rates, attitude, position; then the states with memory."""
SETTINGS = {
    "V0": 50.0, "rho0": 1.0, "glauert0": 0.0, "mach_rise": 0.6, "tail_lag": 3.0, "fin_lag": 0.35, "ground_scale": 1.0,
    "ground_rate": 4.0, "stall_slope": 25.0, "stall_alpha": 5.0, "stall_tau1": 0.0, "stall_tau2": 0.0,
    "slosh_frequency": 4.0, "slosh_damping": 0.05, "slosh_length": 0.6, "thrust_scale": 1.0, "thrust_lag": 0.0,
    "shear_n": 0.0, "shear_e": 0.0, "shear_h": 0.0, "wind_n": 0.0, "wind_e": 0.0, "arm_x": 0.0, "arm_y": 0.0,
    "ground_h": 0.0,
}  # fmt: skip
"""Settings of the air and of the added physics, with the values that add none."""
CONSTANTS = ("S", "b", "cbar", "tx", "tz", "tilt", "static_thrust", "V_thrust", "h_power", "spool", "rpm_idle",
             "rpm_range", "engine_H")  # fmt: skip
SCHEDULES = ("de", "da", "dr", "theta", "phi", "alpha", "h", "throttle", "df", "cfg", "ice", "clock", "mass", "free",
             "aug", "thrust", "gu", "gv", "gw", "gp", "gq", "gr")  # fmt: skip
"""Of one manoeuvre: excitation of the surfaces, references, throttle, flap and so on, gusts along body axes."""
GAINS = ("q", "theta", "p", "phi", "r", "alpha", "h", "h_dot", "V")
SURFACE = ("lag", "rate", "low", "high", "backlash", "delay", "aug_q", "aug_alpha", "aug_p", "aug_r", "aug_beta")
"""Of each of de, da, dr: what stands between the command, which is recorded, and the surface."""
READS = ("ax", "ay", "az", "p_dot", "q_dot", "r_dot", "rho", "qbar", "mach", "V", "thrust", "thrust_model", "throttle",
         "rpm", "mass", "de", "da", "dr", "de_true", "da_true", "dr_true", "gu", "gv", "gw", "cfg", "df")  # fmt: skip
"""What is logged beside states, variables and coefficients."""

_S = {name: i for i, name in enumerate(SETTINGS)}
_C = {name: i for i, name in enumerate(CONSTANTS)}
_T = {name: i for i, name in enumerate(SCHEDULES)}
_N = len(VARIABLES)
# Compiled code reads plain integers.
(_V0, _RHO0, _GL0, _RISE, _TAIL, _FIN, _GSC, _GRATE, _SSL, _SAL, _TAU1, _TAU2, _SLW, _SLZ, _SLL, _TSC, _TLAG,
 _SHN, _SHE, _SHH, _WN, _WE, _ARMX, _ARMY, _GH) = range(len(SETTINGS))  # fmt: skip
(_CS, _CB, _CC, _TX, _TZ, _TILT, _TST, _VT, _HP, _SPOOL, _RPM0, _RPM1, _EH) = range(len(CONSTANTS))
(_DE, _DA, _DR, _THETA, _PHI, _ALPHA, _H, _THR, _DF, _CFG, _ICE, _CLOCK, _MASS, _FREE, _AUG, _THRUST,
 _GU, _GV, _GW, _GP, _GQ, _GR) = range(len(SCHEDULES))  # fmt: skip
_LIFT, _CT, _CZ = INDEX["CL"], INDEX["CT"], 2
_G0 = 9.80665


@njit(cache=True)
def _attached(alpha, settings):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Steady separation point: the attached fraction of the chord at an angle of attack."""
    return 0.5 * (1.0 - np.tanh(settings[_SSL] * (alpha - settings[_SAL])))


@njit(cache=True)
def _fill(s, deflection, now, thrust, rpm, constants, settings, x):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Row of variables at a state; returns qbar, V, rho, mach."""
    u, v, w = s[0] - now[_GU], s[1] - now[_GV], s[2] - now[_GW]
    V = np.sqrt(u * u + v * v + w * w)
    alpha, beta = np.arctan2(w, u), np.arcsin(v / V)
    _, _, rho, sound = standard_air(s[11], 0.0)
    qbar, mach = 0.5 * rho * V * V, V / sound
    b, c = constants[_CB], constants[_CC]
    x[0], x[1], x[2] = 1.0, alpha, beta
    x[3] = (s[3] - now[_GP]) * b / (2.0 * V)
    x[4] = (s[4] - now[_GQ]) * c / (2.0 * V)
    x[5] = (s[5] - now[_GR]) * b / (2.0 * V)
    x[6], x[7], x[8], x[9] = deflection[0], deflection[1], deflection[2], now[_DF]
    x[10] = thrust / (qbar * constants[_CS])
    x[11] = V / settings[_V0] - 1.0
    x[12], x[13] = abs(alpha), abs(beta)
    x[14], x[15], x[16] = abs(deflection[0]), abs(deflection[1]), abs(deflection[2])
    x[17] = 1.0 / np.sqrt(max(1.0 - mach * mach, 0.05)) - 1.0 - settings[_GL0]
    x[18] = max(mach - settings[_RISE], 0.0) ** 2
    x[19] = np.log(rho * V / (settings[_RHO0] * settings[_V0]))
    x[20] = settings[_GSC] * np.exp(-settings[_GRATE] * max(s[11] - settings[_GH], 0.0) / b)
    x[21], x[22], x[23] = now[_CFG], now[_ICE], now[_CLOCK]
    x[24] = qbar / (0.5 * settings[_RHO0] * settings[_V0] ** 2) - 1.0
    x[25], x[26] = alpha - s[12], beta - s[13]
    x[27] = -0.165 * (alpha - s[14]) - 0.335 * (alpha - s[15])
    X = min(max(s[16], 0.0), 1.0)
    if settings[_TAU1] <= 0.0:
        X = _attached(alpha, settings)
    x[28] = 1.0 - X
    x[29] = 1.0 - (0.5 * (1.0 + np.sqrt(X))) ** 2
    x[30], x[31] = s[4] * rpm * 0.104719755 / qbar, s[5] * rpm * 0.104719755 / qbar
    turns = s[8] / (0.5 * np.pi)
    x[33] = turns - np.floor(turns) - 0.5
    x[34], x[35] = s[17], s[6]
    return qbar, V, rho, mach


@njit(cache=True)
def _loads(plant, x, whole, extra):  # type: ignore[no-untyped-def]  # pragma: no cover
    """All coefficients, and those of the added physics alone."""
    constants, settings = plant.constants, plant.settings
    whole[:] = 0.0
    extra[:] = 0.0
    add_terms(plant.base_rows, plant.base_values, x, whole)
    x[_LIFT] = -whole[_CZ]
    add_terms(plant.rows, plant.values, x, extra)
    for j in range(6):
        whole[j] += extra[j]
    # A centre of gravity that lies elsewhere: the moment is about the true one.
    dx, dy = settings[_ARMX], settings[_ARMY]
    extra[4] += whole[2] * dx / constants[_CC]
    extra[5] += -whole[1] * dx / constants[_CB] + whole[0] * dy / constants[_CB]
    extra[3] += -whole[2] * dy / constants[_CB]
    whole[4] += whole[2] * dx / constants[_CC]
    whole[5] += -whole[1] * dx / constants[_CB] + whole[0] * dy / constants[_CB]
    whole[3] += -whole[2] * dy / constants[_CB]


@njit(cache=True)
def _slope(s, whole, x, qbar, V, thrust, mass, inertia, inverse, alpha_dot, constants, settings, out, force):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Derivative of the state; specific force at the centre of gravity on the way."""
    qS = qbar * constants[_CS]
    tilt = constants[_TILT]
    Tx, Tz = thrust * np.cos(tilt), -thrust * np.sin(tilt)
    force[0], force[1], force[2] = (qS * whole[0] + Tx) / mass, qS * whole[1] / mass, (qS * whole[2] + Tz) / mass
    L = qS * constants[_CB] * whole[3]
    M = qS * constants[_CC] * whole[4] + constants[_TZ] * Tx - constants[_TX] * Tz
    N = qS * constants[_CB] * whole[5]
    u, v, w, p, q, r, phi, theta, psi = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8]
    hx = inertia[0, 0] * p + inertia[0, 2] * r + constants[_EH]
    hy, hz = inertia[1, 1] * q, inertia[2, 0] * p + inertia[2, 2] * r
    L -= q * hz - r * hy
    M -= r * hx - p * hz
    N -= p * hy - q * hx
    sf, cf, st, ct, sy, cy = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    north = ct * cy * u + (sf * st * cy - cf * sy) * v + (cf * st * cy + sf * sy) * w
    east = ct * sy * u + (sf * st * sy + cf * cy) * v + (cf * st * sy - sf * cy) * w
    up = st * u - sf * ct * v - cf * ct * w
    # Wind that changes with height: the air-mass velocity changes as the aircraft climbs through it.
    wn, we = settings[_SHN] * up, settings[_SHE] * up
    out[0] = force[0] - _G0 * st - q * w + r * v - (ct * cy * wn + ct * sy * we)
    out[1] = force[1] + _G0 * ct * sf - r * u + p * w - ((sf * st * cy - cf * sy) * wn + (sf * st * sy + cf * cy) * we)
    out[2] = force[2] + _G0 * ct * cf - p * v + q * u - ((cf * st * cy + sf * sy) * wn + (cf * st * sy - sf * cy) * we)
    out[3] = inverse[0, 0] * L + inverse[0, 2] * N
    out[4] = inverse[1, 1] * M
    out[5] = inverse[2, 0] * L + inverse[2, 2] * N
    turn = (q * sf + r * cf) / ct
    out[6], out[7], out[8] = p + turn * st, q * cf - r * sf, turn
    out[9] = north + settings[_WN] + settings[_SHN] * (s[11] - settings[_SHH])
    out[10] = east + settings[_WE] + settings[_SHE] * (s[11] - settings[_SHH])
    out[11] = up
    chord, alpha = constants[_CC], x[1]
    out[12] = x[25] * V / (settings[_TAIL] * chord)
    out[13] = x[26] * V / (settings[_FIN] * constants[_CB])
    out[14] = 0.0455 * 2.0 * V / chord * (alpha - s[14])
    out[15] = 0.3 * 2.0 * V / chord * (alpha - s[15])
    out[16] = 0.0
    if settings[_TAU1] > 0.0:
        out[16] = (_attached(alpha - settings[_TAU2] * alpha_dot, settings) - s[16]) / settings[_TAU1]
    w0 = settings[_SLW]
    out[17] = s[18]
    out[18] = -w0 * w0 * s[17] - 2.0 * settings[_SLZ] * w0 * s[18] - force[1] / settings[_SLL]


class Plant(NamedTuple):
    """The aircraft: base and added terms (rows, values), inertias (2, 3, 3) before and after a release, inverses,
    `CONSTANTS` and `SETTINGS`."""  # noqa: D209

    base_rows: np.ndarray
    base_values: np.ndarray
    rows: np.ndarray
    values: np.ndarray
    inertias: np.ndarray
    inverses: np.ndarray
    constants: np.ndarray
    settings: np.ndarray


class Pilot(NamedTuple):
    """The pilot's `GAINS`, the trim (de, alpha, theta, throttle, V), (3, `SURFACE`) actuators, height hold or not."""

    gains: np.ndarray
    trims: np.ndarray
    surfaces: np.ndarray
    height_hold: float


@njit(cache=True)
def _command(s, now, V, alpha, pilot, command):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Commanded surfaces, into `command`; returns the throttle wanted."""
    gains, trims = pilot.gains, pilot.trims
    light = 1.0 - 0.75 * now[_FREE]
    theta_ref, wanted = now[_THETA], now[_THR]
    up = np.sin(s[7]) * s[0] - np.cos(s[7]) * s[2]
    if pilot.height_hold > 0.0:
        theta_ref += min(max(gains[6] * (now[_H] - s[11]) - gains[7] * up, -0.12), 0.12)
        wanted += min(max(gains[8] * (trims[4] - V), -0.3), 0.3)
    command[0] = trims[0] + now[_DE] + light * gains[0] * s[4]
    if now[_ALPHA] > -1.0:
        command[0] += gains[5] * (alpha - now[_ALPHA])
    else:
        command[0] += light * gains[1] * (s[7] - theta_ref)
    turn = 9.81 / V * np.sin(s[6]) * np.cos(s[7])
    command[1] = now[_DA] + light * (gains[2] * s[3] + gains[3] * (s[6] - now[_PHI]))
    command[2] = now[_DR] + light * gains[4] * (s[5] - turn)
    for j in range(3):
        command[j] = min(max(command[j], -0.5), 0.5)
    return min(max(wanted, 0.02), 1.0)


@njit(cache=True)
def _actuate(j, n, dt, a, history, after_backlash, position):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Position of surface j after delay, backlash, lag, rate limit and travel limits; `a` as `SURFACE`."""
    delayed = history[max(n - int(a[5] / dt), 0), j]
    if a[4] > 0.0:
        if delayed > after_backlash[j] + 0.5 * a[4]:
            after_backlash[j] = delayed - 0.5 * a[4]
        elif delayed < after_backlash[j] - 0.5 * a[4]:
            after_backlash[j] = delayed + 0.5 * a[4]
    else:
        after_backlash[j] = delayed
    move = after_backlash[j] - position[j]
    if a[0] > 0.0:
        move *= 1.0 - np.exp(-dt / a[0])
    move = min(max(move, -a[1] * dt), a[1] * dt)
    position[j] = min(max(position[j] + move, a[2]), a[3])


@njit(cache=True)
def _evaluate(s, surface, now, air, plant, inertia, inverse, out, work):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Derivative of the state, into `out`; returns qbar, V, rho, mach. air: (thrust, rpm, mass, alpha_dot)."""
    thrust, rpm, mass, alpha_dot = air
    x, whole, extra, force = work
    qbar, V, rho, mach = _fill(s, surface, now, thrust, rpm, plant.constants, plant.settings, x)
    _loads(plant, x, whole, extra)
    _slope(s, whole, x, qbar, V, thrust, mass, inertia, inverse, alpha_dot, plant.constants, plant.settings, out, force)
    return qbar, V, rho, mach


@njit(cache=True)
def simulate_flight(start, schedules, dt, every, first, plant, pilot):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Simulate one manoeuvre.

    start (19,), schedules (steps, SCHEDULES). From step `first` on every `every`-th is logged: states, variables, whole
    and extra coefficients, READS. Of two inertias the mass chooses. Fewer rows are returned where the flight diverges.
    """
    steps = schedules.shape[0]
    count = (steps - 1 - first) // every + 1
    states, table = np.zeros((count, 19)), np.zeros((count, _N))
    coefs, extras, reads = np.zeros((count, 6)), np.zeros((count, 6)), np.zeros((count, 26))
    s, x = start.copy(), np.zeros(_N)
    whole, extra, force = np.zeros(6), np.zeros(6), np.zeros(3)
    work = (x, whole, extra, force)
    k1, k2, k3, k4, mid = np.zeros(19), np.zeros(19), np.zeros(19), np.zeros(19), np.zeros(19)
    command, after_backlash, position, surface = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    history = np.zeros((steps, 3))
    constants, settings, surfaces, trims = plant.constants, plant.settings, pilot.surfaces, pilot.trims
    command[0] = trims[0]
    after_backlash[:] = command
    position[:] = command
    spooled, lagged, alpha_dot, row = -1.0, -1.0, 0.0, 0
    whole_mass = schedules[0, _MASS]
    for n in range(steps):
        now = schedules[n]
        V = np.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2)
        alpha = np.arctan2(s[2], s[0])
        # Pilot and actuators.
        throttle = _command(s, now, V, alpha, pilot, command)
        for j in range(3):
            history[n, j] = command[j]
            a = surfaces[j]
            _actuate(j, n, dt, a, history, after_backlash, position)
            surface[j] = position[j] + now[_AUG] * (
                a[6] * s[4] + a[7] * (alpha - trims[1]) + a[8] * s[3] + a[9] * s[5] + a[10] * s[1] / V
            )
        # Engine: the thrust the model states, and the one there is.
        _, _, rho, _ = standard_air(s[11], 0.0)
        static = constants[_TST] * throttle * (rho / 1.225) ** constants[_HP] / (1.0 + V / constants[_VT])
        spooled = static if spooled < 0.0 else spooled + (static - spooled) * (1.0 - np.exp(-dt / constants[_SPOOL]))
        lagged = (
            spooled
            if lagged < 0.0 or settings[_TLAG] <= 0.0
            else (lagged + (spooled - lagged) * (1.0 - np.exp(-dt / settings[_TLAG])))
        )
        thrust = settings[_TSC] * lagged
        if now[_THRUST] >= 0.0:
            thrust = now[_THRUST]
            spooled = thrust
        rpm = constants[_RPM0] + constants[_RPM1] * spooled / max(constants[_TST], 1.0)
        mass = now[_MASS]
        which = 0 if mass > 0.999 * whole_mass else 1
        inertia, inverse = plant.inertias[which], plant.inverses[which]
        air = (thrust, rpm, mass, alpha_dot)
        # One Runge-Kutta step.
        qbar, V, rho, mach = _evaluate(s, surface, now, air, plant, inertia, inverse, k1, work)
        if n == 0:
            s[12], s[13], s[14], s[15] = x[1], x[2], x[1], x[1]
            s[16] = _attached(x[1], settings)
        if n >= first and (n - first) % every == 0:
            states[row], table[row], coefs[row], extras[row] = s, x, whole, extra
            o = reads[row]
            o[0], o[1], o[2], o[3], o[4], o[5] = force[0], force[1], force[2], k1[3], k1[4], k1[5]
            o[6], o[7], o[8], o[9], o[10], o[11], o[12], o[13] = rho, qbar, mach, V, thrust, spooled, throttle, rpm
            o[14] = mass
            for j in range(3):
                o[15 + j], o[18 + j] = command[j], surface[j]
            o[21], o[22], o[23], o[24], o[25] = now[_GU], now[_GV], now[_GW], now[_CFG], now[_DF]
            row += 1
        before = x[1]
        for j in range(19):
            mid[j] = s[j] + 0.5 * dt * k1[j]
        _evaluate(mid, surface, now, air, plant, inertia, inverse, k2, work)
        for j in range(19):
            mid[j] = s[j] + 0.5 * dt * k2[j]
        _evaluate(mid, surface, now, air, plant, inertia, inverse, k3, work)
        for j in range(19):
            mid[j] = s[j] + dt * k3[j]
        _evaluate(mid, surface, now, air, plant, inertia, inverse, k4, work)
        for j in range(19):
            s[j] += dt / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])
        alpha_dot += 0.3 * ((x[1] - before) / dt - alpha_dot)
        if not (np.isfinite(s[0]) and s[0] > 5.0 and abs(s[7]) < 1.4):
            return row, states, table, coefs, extras, reads
    return row, states, table, coefs, extras, reads
