"""A truth flight, compiled: pilot, actuators and engine around the equations of motion.

One manoeuvre per call. The step is that of the schedules: classical Runge-Kutta, controls and air held over it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proof.polynomial.equations import (
    CONSTANT,
    FOLLOW,
    SCHEDULE,
    SETTING,
    STATE,
    STATES,
    VARIABLE,
    Conditions,
    Loads,
    attached_chord,
    derivative,
    indices,
)
from proof.polynomial.terms import VARIABLES
from structsel.numerics.atmosphere import standard_air
from structsel.numerics.compiling import njit

GAINS = ("q", "theta", "p", "phi", "r", "alpha", "h", "h_dot", "V")
TRIMS = ("de", "alpha", "theta", "throttle", "V")
SURFACE = ("lag", "rate", "low", "high", "backlash", "delay", "aug_q", "aug_alpha", "aug_p", "aug_r", "aug_beta")
"""Of each of de, da, dr: the dynamics between the command, which is recorded, and the surface."""
READS = ("ax", "ay", "az", "p_dot", "q_dot", "r_dot", "rho", "qbar", "mach", "V", "thrust", "thrust_model", "throttle",
         "rpm", "mass", "de", "da", "dr", "de_true", "da_true", "dr_true", "gu", "gv", "gw", "cfg", "df")  # fmt: skip
"""Quantities recorded in addition to states, variables and coefficients."""
_GAIN = indices("Gain", GAINS)
_TRIM = indices("Trim", TRIMS)
_FIELD = indices("Field", SURFACE)
_READ = indices("Read", READS)
_N_STATES, _N_VARIABLES, _N_READS = len(STATES), len(VARIABLES), len(READS)
_STAGES = (0.5, 0.5, 1.0)


class Pilot(NamedTuple):
    """The pilot's `GAINS`, the `TRIMS`, (3, `SURFACE`) actuators, and whether the height is held."""

    gains: np.ndarray
    trims: np.ndarray
    surfaces: np.ndarray
    height_hold: float


class Actuators(NamedTuple):
    """Workspace: commands (3,) and their history (steps, 3), positions after backlash and after the actuator (3,),
    surface deflections (3,)."""  # noqa: D209

    command: np.ndarray
    history: np.ndarray
    after_backlash: np.ndarray
    position: np.ndarray
    surface: np.ndarray


class FlightLog(NamedTuple):
    """Logged samples: states, variables, all and added coefficients (n, 6), `READS`."""

    states: np.ndarray
    variables: np.ndarray
    coefficients: np.ndarray
    added: np.ndarray
    reads: np.ndarray


@njit(cache=True)
def simulate_flight(start, schedules, dt, every, first, plant, pilot):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Simulate one manoeuvre; returns the number of samples and their `FlightLog`.

    start (`STATES`), schedules (steps, `SCHEDULES`). From step `first` on every `every`-th is logged. The mass chooses
    the inertia. Fewer samples than the log has room for are returned where the flight diverges.
    """
    steps = schedules.shape[0]
    count = (steps - 1 - first) // every + 1
    log = FlightLog(
        np.zeros((count, _N_STATES)), np.zeros((count, _N_VARIABLES)), np.zeros((count, 6)), np.zeros((count, 6)),
        np.zeros((count, _N_READS)),
    )  # fmt: skip
    loads = Loads(np.zeros(_N_VARIABLES), np.zeros(6), np.zeros(6), np.zeros(3))
    actuators = Actuators(np.zeros(3), np.zeros((steps, 3)), np.zeros(3), np.zeros(3), np.zeros(3))
    actuators.command[0] = pilot.trims[_TRIM.de]
    actuators.after_backlash[:] = actuators.command
    actuators.position[:] = actuators.command
    delayed, past = np.zeros(plant.signals.shape[0]), np.zeros((steps, plant.signals.shape[0]))
    s, k, mid, spool = start.copy(), np.zeros((4, _N_STATES)), np.zeros(_N_STATES), np.full(2, -1.0)
    x, alpha_dot, row = loads.variables, 0.0, 0
    for n in range(steps):
        now = schedules[n]
        V = np.sqrt(s[STATE.u] ** 2 + s[STATE.v] ** 2 + s[STATE.w] ** 2)
        alpha = np.arctan2(s[STATE.w], s[STATE.u])
        # Pilot, actuators, engine.
        throttle = _command(s, now, V, alpha, pilot, actuators.command)
        _move_surfaces(n, dt, s, V, alpha, now, pilot, actuators)
        thrust, rpm = _engine(now, throttle, V, s[STATE.h], dt, plant, spool)
        mass = now[SCHEDULE.mass]
        release = 0 if mass > 0.999 * schedules[0, SCHEDULE.mass] else 1
        held = Conditions(actuators.surface, now, thrust, rpm, mass, release, alpha_dot, delayed)
        # One Runge-Kutta step.
        _delay_signals(n, dt, plant.signals, past, delayed)
        air = derivative(s, held, plant, loads, k[0])
        if n == 0:
            _start_memory(s, x, plant)
        for j in range(delayed.size):
            past[n, j] = x[int(plant.signals[j, FOLLOW.variable])]
        if n >= first and (n - first) % every == 0:
            _log(log, row, s, held, loads, k[0], actuators, air)
            log.reads[row, _READ.thrust_model], log.reads[row, _READ.throttle] = spool[0], throttle
            row += 1
        before = x[VARIABLE.alpha]
        for stage in range(3):
            for j in range(_N_STATES):
                mid[j] = s[j] + _STAGES[stage] * dt * k[stage, j]
            derivative(mid, held, plant, loads, k[stage + 1])
        for j in range(_N_STATES):
            s[j] += dt / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])
        alpha_dot += 0.3 * ((x[VARIABLE.alpha] - before) / dt - alpha_dot)
        if not (np.isfinite(s[STATE.u]) and s[STATE.u] > 5.0 and abs(s[STATE.theta]) < 1.4):
            break
    return row, log


@njit(cache=True)
def _command(s, now, V, alpha, pilot, command):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Commanded surfaces, into `command`; returns the throttle wanted."""
    gains, trims = pilot.gains, pilot.trims
    phi, theta = s[STATE.phi], s[STATE.theta]
    active = 1.0 - 0.75 * now[SCHEDULE.free]
    theta_ref, wanted = now[SCHEDULE.theta], now[SCHEDULE.throttle]
    # Height and speed.
    up = np.sin(theta) * s[STATE.u] - np.cos(theta) * s[STATE.w]
    if pilot.height_hold > 0.0:
        theta_ref += min(max(gains[_GAIN.h] * (now[SCHEDULE.h] - s[STATE.h]) - gains[_GAIN.h_dot] * up, -0.12), 0.12)
        wanted += min(max(gains[_GAIN.V] * (trims[_TRIM.V] - V), -0.3), 0.3)
    # Pitch, roll, yaw.
    command[0] = trims[_TRIM.de] + now[SCHEDULE.de] + active * gains[_GAIN.q] * s[STATE.q]
    if now[SCHEDULE.alpha] > -1.0:
        command[0] += gains[_GAIN.alpha] * (alpha - now[SCHEDULE.alpha])
    else:
        command[0] += active * gains[_GAIN.theta] * (theta - theta_ref)
    turn = 9.81 / V * np.sin(phi) * np.cos(theta)
    roll = gains[_GAIN.p] * s[STATE.p] + gains[_GAIN.phi] * (phi - now[SCHEDULE.phi])
    command[1] = now[SCHEDULE.da] + active * roll
    command[2] = now[SCHEDULE.dr] + active * gains[_GAIN.r] * (s[STATE.r] - turn)
    for j in range(3):
        command[j] = min(max(command[j], -0.5), 0.5)
    return min(max(wanted, 0.02), 1.0)


@njit(cache=True)
def _move_surfaces(n, dt, s, V, alpha, now, pilot, actuators):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Deflections after delay, backlash, lag, rate limit, travel limits and augmentation, at step `n`."""
    history, after_backlash, position = actuators.history, actuators.after_backlash, actuators.position
    for j in range(3):
        history[n, j] = actuators.command[j]
        a = pilot.surfaces[j]
        # Delay and backlash.
        delayed, half = history[max(n - int(a[_FIELD.delay] / dt), 0), j], 0.5 * a[_FIELD.backlash]
        if a[_FIELD.backlash] > 0.0:
            if delayed > after_backlash[j] + half:
                after_backlash[j] = delayed - half
            elif delayed < after_backlash[j] - half:
                after_backlash[j] = delayed + half
        else:
            after_backlash[j] = delayed
        # Lag and limits.
        move = after_backlash[j] - position[j]
        if a[_FIELD.lag] > 0.0:
            move *= 1.0 - np.exp(-dt / a[_FIELD.lag])
        move = min(max(move, -a[_FIELD.rate] * dt), a[_FIELD.rate] * dt)
        position[j] = min(max(position[j] + move, a[_FIELD.low]), a[_FIELD.high])
        # Augmentation, which the command does not show.
        actuators.surface[j] = position[j] + now[SCHEDULE.aug] * (
            a[_FIELD.aug_q] * s[STATE.q]
            + a[_FIELD.aug_alpha] * (alpha - pilot.trims[_TRIM.alpha])
            + a[_FIELD.aug_p] * s[STATE.p]
            + a[_FIELD.aug_r] * s[STATE.r]
            + a[_FIELD.aug_beta] * s[STATE.v] / V
        )


@njit(cache=True)
def _engine(now, throttle, V, h, dt, plant, spool):  # type: ignore[no-untyped-def]  # pragma: no cover
    """True thrust [N] and engine speed [rev/min]; `spool` holds the thrust that the model states, and its lag."""
    constants, settings = plant.constants, plant.settings
    _, _, rho, _ = standard_air(h, 0.0)
    static = constants[CONSTANT.static_thrust] * throttle * (rho / 1.225) ** constants[CONSTANT.h_power]
    static /= 1.0 + V / constants[CONSTANT.V_thrust]
    if spool[0] < 0.0:
        spool[0] = static
    else:
        spool[0] += (static - spool[0]) * (1.0 - np.exp(-dt / constants[CONSTANT.spool]))
    if spool[1] < 0.0 or settings[SETTING.thrust_lag] <= 0.0:
        spool[1] = spool[0]
    else:
        spool[1] += (spool[0] - spool[1]) * (1.0 - np.exp(-dt / settings[SETTING.thrust_lag]))
    thrust = settings[SETTING.thrust_scale] * spool[1]
    if now[SCHEDULE.thrust] >= 0.0:
        thrust = now[SCHEDULE.thrust]
        spool[0] = thrust
    largest = max(constants[CONSTANT.static_thrust], 1.0)
    return thrust, constants[CONSTANT.rpm_idle] + constants[CONSTANT.rpm_range] * spool[0] / largest


@njit(cache=True)
def _delay_signals(n, dt, signals, past, delayed):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Delayed signals at step `n`, from the variables at the steps before."""
    for j in range(delayed.size):
        steps = round(signals[j, FOLLOW.delay] / dt)
        if n > 0 and steps > 0:
            delayed[j] = past[max(n - steps, 0), j]


@njit(cache=True)
def _start_memory(s, x, plant):  # type: ignore[no-untyped-def]  # pragma: no cover
    """States with memory as after a long flight at the first variables."""
    alpha = x[VARIABLE.alpha]
    s[STATE.downwash], s[STATE.sidewash], s[STATE.wagner1], s[STATE.wagner2] = alpha, x[VARIABLE.beta], alpha, alpha
    s[STATE.attached] = attached_chord(alpha, plant.settings)
    for j in range(plant.signals.shape[0]):
        s[STATE.signal1 + j] = x[int(plant.signals[j, FOLLOW.variable])]


@njit(cache=True)
def _log(log, row, s, held, loads, slope, actuators, air):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Write one sample."""
    log.states[row], log.variables[row] = s, loads.variables
    log.coefficients[row], log.added[row] = loads.coefficients, loads.added
    o, now = log.reads[row], held.schedule
    for j in range(3):
        o[_READ.ax + j], o[_READ.p_dot + j] = loads.force[j], slope[STATE.p + j]
        o[_READ.de + j], o[_READ.de_true + j] = actuators.command[j], actuators.surface[j]
        o[_READ.gu + j] = now[SCHEDULE.gu + j]
    o[_READ.rho], o[_READ.qbar], o[_READ.mach], o[_READ.V] = air.rho, air.qbar, air.mach, air.V
    o[_READ.thrust], o[_READ.rpm], o[_READ.mass] = held.thrust, held.rpm, held.mass
    o[_READ.cfg], o[_READ.df] = now[SCHEDULE.cfg], now[SCHEDULE.df]
