"""Equations of motion of the truth, compiled: variables, coefficients, and the derivative of the state.

The states with memory are independent of structsel and must stay so: the lags of the wake at tail and
fin, Wagner's function, the separation point after Goman and Khrabrov, and slosh. The rigid-body equations are not
kept for independence: a test holds them equal to `structsel.numerics.rigid_body`, and JSBSim is the foreign plant.
They are written here because pilot, actuators and states with memory run in one compiled loop with them, and because
the cases kept for evaluation stay as they were.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from proof.polynomial.terms import SIGNALS, VARIABLES, add_terms
from structsel.numerics.atmosphere import standard_air
from structsel.numerics.compiling import njit

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h",
          "downwash", "sidewash", "wagner1", "wagner2", "attached", "slosh", "slosh_rate", *SIGNALS)  # fmt: skip
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


FOLLOWED = ("variable", "time_constant", "delay")
"""Of each signal: the number of the variable that it follows; a time constant [s], or a delay [s] and 0."""


def indices(title: str, names: Iterable[str]) -> Any:
    """Named tuple of the position of each name, which compiled code reads as constants."""
    listed = ["one" if name == "1" else name for name in names]
    return namedtuple(title, listed)(*range(len(listed)))  # type: ignore[misc]


STATE = indices("State", STATES)
SETTING = indices("Setting", SETTINGS)
CONSTANT = indices("Constant", CONSTANTS)
SCHEDULE = indices("Schedule", SCHEDULES)
VARIABLE = indices("Variable", VARIABLES)
FOLLOW = indices("Follow", FOLLOWED)
_G0 = 9.80665  # m/s^2, standard gravity
_CX, _CY, _CZ, _CL, _CM, _CN = range(6)


class Plant(NamedTuple):
    """The aircraft: base and added terms (rows, values), inertias (2, 3, 3) before and after a release, inverses,
    `CONSTANTS`, `SETTINGS`, and the signals (k, `FOLLOWED`)."""  # noqa: D209

    base_rows: np.ndarray
    base_values: np.ndarray
    rows: np.ndarray
    values: np.ndarray
    inertias: np.ndarray
    inverses: np.ndarray
    constants: np.ndarray
    settings: np.ndarray
    signals: np.ndarray


class Conditions(NamedTuple):
    """What is held over a step: surfaces (3,) [rad], schedules, thrust [N], engine speed [rev/min], mass [kg],
    number of the inertia, the rate of the angle of attack [rad/s], and the delayed signals (k,)."""  # noqa: D209

    surfaces: np.ndarray
    schedule: np.ndarray
    thrust: float
    rpm: float
    mass: float
    release: int
    alpha_dot: float
    delayed: np.ndarray


class Loads(NamedTuple):
    """Workspace: row of `VARIABLES`, all coefficients (6,), those of the added physics (6,), specific force (3,)."""

    variables: np.ndarray
    coefficients: np.ndarray
    added: np.ndarray
    force: np.ndarray


class Air(NamedTuple):
    """Dynamic pressure [Pa], airspeed [m/s], density [kg/m^3] and Mach number."""

    qbar: float
    V: float
    rho: float
    mach: float


@njit(cache=True)
def attached_chord(alpha, settings):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Steady separation point: the attached fraction of the chord at an angle of attack."""
    return 0.5 * (1.0 - np.tanh(settings[SETTING.stall_slope] * (alpha - settings[SETTING.stall_alpha])))


@njit(cache=True)
def derivative(s, held, plant, loads, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Derivative of the state `s`, into `out`; variables, coefficients and forces into `loads`. Returns `Air`."""
    air = _variables(s, held, plant, loads.variables)
    _memory_variables(s, held, plant, loads.variables, air)
    _coefficients(plant, loads)
    _motion(s, held, plant, loads, air, out)
    _memory_states(s, held, plant, loads, air, out)
    return air


@njit(cache=True)
def _variables(s, held, plant, x):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Variables of the flight condition, into the row `x`; returns `Air`."""
    now, surface, settings = held.schedule, held.surfaces, plant.settings
    b, c = plant.constants[CONSTANT.b], plant.constants[CONSTANT.cbar]
    V0, rho0 = settings[SETTING.V0], settings[SETTING.rho0]
    # Air data.
    u, v, w = s[STATE.u] - now[SCHEDULE.gu], s[STATE.v] - now[SCHEDULE.gv], s[STATE.w] - now[SCHEDULE.gw]
    V = np.sqrt(u * u + v * v + w * w)
    alpha, beta = np.arctan2(w, u), np.arcsin(v / V)
    _, _, rho, sound = standard_air(s[STATE.h], 0.0)
    qbar, mach = 0.5 * rho * V * V, V / sound
    x[VARIABLE.one], x[VARIABLE.alpha], x[VARIABLE.beta] = 1.0, alpha, beta
    # Rates, controls, thrust.
    x[VARIABLE.p_hat] = (s[STATE.p] - now[SCHEDULE.gp]) * b / (2.0 * V)
    x[VARIABLE.q_hat] = (s[STATE.q] - now[SCHEDULE.gq]) * c / (2.0 * V)
    x[VARIABLE.r_hat] = (s[STATE.r] - now[SCHEDULE.gr]) * b / (2.0 * V)
    x[VARIABLE.de], x[VARIABLE.da], x[VARIABLE.dr] = surface[0], surface[1], surface[2]
    x[VARIABLE.df], x[VARIABLE.CT] = now[SCHEDULE.df], held.thrust / (qbar * plant.constants[CONSTANT.S])
    x[VARIABLE.abs_alpha], x[VARIABLE.abs_beta] = abs(alpha), abs(beta)
    x[VARIABLE.abs_de], x[VARIABLE.abs_da], x[VARIABLE.abs_dr] = abs(surface[0]), abs(surface[1]), abs(surface[2])
    # Speed, density, Mach and Reynolds number, relative to the reference.
    x[VARIABLE.dV] = V / V0 - 1.0
    x[VARIABLE.glauert] = 1.0 / np.sqrt(max(1.0 - mach * mach, 0.05)) - 1.0 - settings[SETTING.glauert0]
    x[VARIABLE.rise] = max(mach - settings[SETTING.mach_rise], 0.0) ** 2
    x[VARIABLE.lnRe] = np.log(rho * V / (rho0 * V0))
    x[VARIABLE.dqbar] = qbar / (0.5 * rho0 * V0**2) - 1.0
    # Ground, schedules, gyroscopic rates, attitude.
    h_agl = max(s[STATE.h] - settings[SETTING.ground_h], 0.0)
    x[VARIABLE.ground] = settings[SETTING.ground_scale] * np.exp(-settings[SETTING.ground_rate] * h_agl / b)
    x[VARIABLE.cfg], x[VARIABLE.ice], x[VARIABLE.clock] = now[SCHEDULE.cfg], now[SCHEDULE.ice], now[SCHEDULE.clock]
    x[VARIABLE.gyro_q] = s[STATE.q] * held.rpm * 0.104719755 / qbar  # rev/min to rad/s
    x[VARIABLE.gyro_r] = s[STATE.r] * held.rpm * 0.104719755 / qbar
    turns = s[STATE.psi] / (0.5 * np.pi)
    x[VARIABLE.heading] = turns - np.floor(turns) - 0.5
    x[VARIABLE.angle_of_bank] = s[STATE.phi]
    return Air(qbar, V, rho, mach)


@njit(cache=True)
def _memory_variables(s, held, plant, x, air):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Variables of the states with memory, into the row `x`."""
    alpha, beta = x[VARIABLE.alpha], x[VARIABLE.beta]
    x[VARIABLE.downwash], x[VARIABLE.sidewash] = alpha - s[STATE.downwash], beta - s[STATE.sidewash]
    # Wagner's function, Jones' approximation: 1 - 0.165 exp(-0.0455 t) - 0.335 exp(-0.3 t), t in half chords.
    x[VARIABLE.wagner] = -0.165 * (alpha - s[STATE.wagner1]) - 0.335 * (alpha - s[STATE.wagner2])
    # Separated fraction of the chord, and Kirchhoff's loss of lift.
    X = min(max(s[STATE.attached], 0.0), 1.0)
    if plant.settings[SETTING.stall_tau1] <= 0.0:
        X = attached_chord(alpha, plant.settings)
    x[VARIABLE.stall] = 1.0 - X
    x[VARIABLE.lost] = 1.0 - (0.5 * (1.0 + np.sqrt(X))) ** 2
    x[VARIABLE.slosh] = s[STATE.slosh]
    for j in range(plant.signals.shape[0]):
        lagged = plant.signals[j, FOLLOW.time_constant] > 0.0
        x[VARIABLE.signal1 + j] = s[STATE.signal1 + j] if lagged else held.delayed[j]


@njit(cache=True)
def _coefficients(plant, loads):  # type: ignore[no-untyped-def]  # pragma: no cover
    """All coefficients, and those of the added physics alone."""
    x, total, added = loads.variables, loads.coefficients, loads.added
    total[:] = 0.0
    added[:] = 0.0
    add_terms(plant.base_rows, plant.base_values, x, total)
    x[VARIABLE.CL] = -total[_CZ]
    add_terms(plant.rows, plant.values, x, added)
    for j in range(6):
        total[j] += added[j]
    # A centre of gravity that lies elsewhere: the moment is about the true one.
    dx, dy = plant.settings[SETTING.arm_x], plant.settings[SETTING.arm_y]
    b, c = plant.constants[CONSTANT.b], plant.constants[CONSTANT.cbar]
    pitch, yaw, roll = total[_CZ] * dx / c, -total[_CY] * dx / b + total[_CX] * dy / b, -total[_CZ] * dy / b
    for held in (added, total):
        held[_CM] += pitch
        held[_CN] += yaw
        held[_CL] += roll


@njit(cache=True)
def _motion(s, held, plant, loads, air, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Rigid-body equations in body axes, with an engine's angular momentum and wind that changes with height."""
    settings, constants, C, force = plant.settings, plant.constants, loads.coefficients, loads.force
    inertia, inverse = plant.inertias[held.release], plant.inverses[held.release]
    u, v, w, p, q, r = s[STATE.u], s[STATE.v], s[STATE.w], s[STATE.p], s[STATE.q], s[STATE.r]
    phi, theta, psi = s[STATE.phi], s[STATE.theta], s[STATE.psi]
    # Forces and moments.
    qS, mass = air.qbar * constants[CONSTANT.S], held.mass
    tilt = constants[CONSTANT.tilt]
    Tx, Tz = held.thrust * np.cos(tilt), -held.thrust * np.sin(tilt)
    force[0], force[1], force[2] = (qS * C[_CX] + Tx) / mass, qS * C[_CY] / mass, (qS * C[_CZ] + Tz) / mass
    L = qS * constants[CONSTANT.b] * C[_CL]
    M = qS * constants[CONSTANT.cbar] * C[_CM] + constants[CONSTANT.tz] * Tx - constants[CONSTANT.tx] * Tz
    N = qS * constants[CONSTANT.b] * C[_CN]
    # Gyroscopic moments.
    hx = inertia[0, 0] * p + inertia[0, 2] * r + constants[CONSTANT.engine_H]
    hy, hz = inertia[1, 1] * q, inertia[2, 0] * p + inertia[2, 2] * r
    L -= q * hz - r * hy
    M -= r * hx - p * hz
    N -= p * hy - q * hx
    # Velocity in earth axes.
    sf, cf, st, ct, sy, cy = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    north = ct * cy * u + (sf * st * cy - cf * sy) * v + (cf * st * cy + sf * sy) * w
    east = ct * sy * u + (sf * st * sy + cf * cy) * v + (cf * st * sy - sf * cy) * w
    up = st * u - sf * ct * v - cf * ct * w
    # Wind that changes with height: the air-mass velocity changes as the aircraft climbs through it.
    wn, we = settings[SETTING.shear_n] * up, settings[SETTING.shear_e] * up
    out[STATE.u] = force[0] - _G0 * st - q * w + r * v - (ct * cy * wn + ct * sy * we)
    side = (sf * st * cy - cf * sy) * wn + (sf * st * sy + cf * cy) * we
    out[STATE.v] = force[1] + _G0 * ct * sf - r * u + p * w - side
    down = (cf * st * cy + sf * sy) * wn + (cf * st * sy - sf * cy) * we
    out[STATE.w] = force[2] + _G0 * ct * cf - p * v + q * u - down
    out[STATE.p] = inverse[0, 0] * L + inverse[0, 2] * N
    out[STATE.q] = inverse[1, 1] * M
    out[STATE.r] = inverse[2, 0] * L + inverse[2, 2] * N
    # Attitude and position.
    turn = (q * sf + r * cf) / ct
    out[STATE.phi], out[STATE.theta], out[STATE.psi] = p + turn * st, q * cf - r * sf, turn
    above = s[STATE.h] - settings[SETTING.shear_h]
    out[STATE.x] = north + settings[SETTING.wind_n] + settings[SETTING.shear_n] * above
    out[STATE.y] = east + settings[SETTING.wind_e] + settings[SETTING.shear_e] * above
    out[STATE.h] = up


@njit(cache=True)
def _memory_states(s, held, plant, loads, air, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Wake lags, Wagner's function, separation after Goman and Khrabrov, slosh as a damped pendulum, lagged signals."""
    settings, x, V = plant.settings, loads.variables, air.V
    chord, span, alpha = plant.constants[CONSTANT.cbar], plant.constants[CONSTANT.b], x[VARIABLE.alpha]
    out[STATE.downwash] = x[VARIABLE.downwash] * V / (settings[SETTING.tail_lag] * chord)
    out[STATE.sidewash] = x[VARIABLE.sidewash] * V / (settings[SETTING.fin_lag] * span)
    out[STATE.wagner1] = 0.0455 * 2.0 * V / chord * (alpha - s[STATE.wagner1])
    out[STATE.wagner2] = 0.3 * 2.0 * V / chord * (alpha - s[STATE.wagner2])
    out[STATE.attached] = 0.0
    tau1, tau2 = settings[SETTING.stall_tau1], settings[SETTING.stall_tau2]
    if tau1 > 0.0:
        out[STATE.attached] = (attached_chord(alpha - tau2 * held.alpha_dot, settings) - s[STATE.attached]) / tau1
    w0 = settings[SETTING.slosh_frequency]
    damping = 2.0 * settings[SETTING.slosh_damping] * w0 * s[STATE.slosh_rate]
    out[STATE.slosh] = s[STATE.slosh_rate]
    out[STATE.slosh_rate] = -w0 * w0 * s[STATE.slosh] - damping - loads.force[1] / settings[SETTING.slosh_length]
    for j in range(plant.signals.shape[0]):
        lag, followed = plant.signals[j, FOLLOW.time_constant], x[int(plant.signals[j, FOLLOW.variable])]
        out[STATE.signal1 + j] = (followed - s[STATE.signal1 + j]) / lag if lag > 0.0 else 0.0
