"""Compiled equations of motion of a rigid aircraft with six degrees of freedom, for a single state.

Body axes; v is the velocity relative to a steady wind W0 (that at the initial altitude), f the specific force, I the
inertia tensor, h_r = (H, 0, 0) the angular momentum of the rotors and M the moment of air and thrust about the centre
of gravity [M86], [KM16] ch. 3::

    v' = f + R'g - omega x v                       I omega' = M - omega x (I omega + h_r)
    (phi, theta, psi)' by Euler's kinematics       (x, y, -h)' = R v + W0

The air moves with the wind W(h) and the gust v_g. Velocity and rates relative to the air are therefore
v - R'(W(h) - W0) - v_g and omega - omega_g; the coefficients are evaluated there.

Terms in alpha_dot_hat or beta_dot_hat make the equations implicit, because those rates depend on the force. Each such
term is linear in its rate (`structsel.simulation` refuses others), so the two rates follow exactly from two linear
equations. The rate of a gust is left out of them.

The state may be longer than 12: then come the model's states with a memory (`flight_model.Memory`), each with the input
x, and the distance s travelled through the air::

    T y' + y = x      or, by distance L,      L y' = V (x - y)                 s' = V

The entry of a delay stays zero; its value is looked up in the history of its input, linear between the steps.
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.air_data import body_from_wind_compiled, flow_angle_rates_compiled
from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.atmosphere import HIGHEST, LOWEST, standard_air
from structsel.numerics.compiling import njit
from structsel.numerics.expressions import run_program
from structsel.numerics.flight_model import (
    AIRSPEED,
    ALPHA_DOT_HAT,
    BETA_DOT_HAT,
    DENSITY,
    FIRST_CONTROL,
    GUST,
    HEIGHT,
    INERTIA,
    MASS,
    OUT_ALPHA_DOT,
    OUT_AX,
    OUT_CX,
    OUT_P_DOT,
    OUT_RHO,
    OUT_V,
    OUT_VN,
    OUT_WIND,
    PHI,
    PSI,
    THETA,
    P,
    Q,
    R,
)


@njit(**UNCOUNTED, forceinline=True)
def wind_at(h, heights, wind, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Wind at a height, linear between known heights."""
    last = heights.size - 1
    outside = last == 0 or h <= heights[0] or h >= heights[last]
    j = (0 if last == 0 or h <= heights[0] else last) if outside else np.searchsorted(heights, h) - 1
    for i in range(3):
        out[i] = wind[j, i]
        if not outside:
            out[i] += (h - heights[j]) / (heights[j + 1] - heights[j]) * (wind[j + 1, i] - wind[j, i])


@njit(**UNCOUNTED)
def state_derivative(x, parameters, aircraft, air, work, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Derivative `out` of a state `x`, (12,) or longer; `work.derived` holds the outputs of the centre of gravity.

    Parameters
    ----------
    x : (12 + M + 1,) or (12,) array
    parameters : Parameters
        `drift` is zero in a physical simulation.
    aircraft : AircraftArrays
    air : Environment
    work : Workspace
        With the time, controls and conditions of this instant.
    """
    _motion_through_air(x, air, work)
    if x.size == 12:
        _rigid_body(x, parameters, aircraft, air, work, out)
    else:
        _with_memory(x, parameters, aircraft, air, work, out)


@njit(**UNCOUNTED, forceinline=True)
def _motion_through_air(x, air, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Attitude, motion relative to the air and air data: fills the rotation, the channels and the air's velocity."""
    sf, cf, st, ct = np.sin(x[PHI]), np.cos(x[PHI]), np.sin(x[THETA]), np.cos(x[THETA])
    sp, cp = np.sin(x[PSI]), np.cos(x[PSI])
    r00, r01, r02 = ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp
    r10, r11, r12 = ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp
    r20, r21, r22 = -st, sf * ct, cf * ct
    rotation, gust, slots = work.rotation, work.conditions[GUST : GUST + 6], work.slots
    attitude, reference, given_rho = work.attitude, air.reference, work.conditions[DENSITY]
    attitude[0], attitude[1], attitude[2], attitude[3] = sf, cf, st, ct
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = r00, r01, r02
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = r10, r11, r12
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = r20, r21, r22
    # Velocity relative to the air: minus the change of the wind from the reference, minus the gust
    wind = work.derived[OUT_WIND : OUT_WIND + 3]
    wind_at(x[HEIGHT], air.heights, air.wind, wind)
    north, east, down = wind[0] - reference[0], wind[1] - reference[1], wind[2] - reference[2]
    u = x[0] - (r00 * north + r10 * east + r20 * down) - gust[0]
    v = x[1] - (r01 * north + r11 * east + r21 * down) - gust[1]
    w = x[2] - (r02 * north + r12 * east + r22 * down) - gust[2]
    wind[0] = wind[0] + r00 * gust[0] + r01 * gust[1] + r02 * gust[2]
    wind[1] = wind[1] + r10 * gust[0] + r11 * gust[1] + r12 * gust[2]
    wind[2] = wind[2] + r20 * gust[0] + r21 * gust[1] + r22 * gust[2]
    # Air data; the altitude is checked at the end of each step, and within a step it is limited to the table
    speed = np.sqrt(u * u + v * v + w * w)
    atmosphere = standard_air(min(max(x[HEIGHT], LOWEST), HIGHEST), air.isa_offset)
    rho = atmosphere[2] if np.isnan(given_rho) else given_rho
    slots[0], slots[1], slots[2] = u, v, w
    slots[3], slots[4], slots[5] = x[P] - gust[3], x[Q] - gust[4], x[R] - gust[5]
    for i in range(6, 12):
        slots[i] = x[i]
    slots[AIRSPEED] = speed
    slots[AIRSPEED + 1], slots[AIRSPEED + 2] = np.arctan2(w, u), np.arctan2(v, np.sqrt(u * u + w * w))
    slots[AIRSPEED + 3], slots[AIRSPEED + 4] = rho, 0.5 * rho * speed * speed
    slots[AIRSPEED + 5] = speed / atmosphere[3]
    slots[ALPHA_DOT_HAT] = slots[BETA_DOT_HAT] = 1.0


@njit(**UNCOUNTED, forceinline=True)
def _rigid_body(x, parameters, aircraft, air, work, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The first 12 derivatives and the outputs, from the channels and controls in the workspace."""
    slots, rotation = work.slots, work.rotation
    _evaluate_coefficients(parameters.terms, aircraft, work)
    c = work.coefficients[0]
    thrust = slots[aircraft.thrust_slot] if aircraft.thrust_slot >= 0 else 0.0
    mass, qS = work.conditions[MASS], slots[AIRSPEED + 4] * aircraft.S
    push, arm, g = aircraft.thrust_direction, aircraft.thrust_arm, air.gravity
    attitude = work.attitude
    sf, cf, st, ct = attitude[0], attitude[1], attitude[2], attitude[3]
    p, q, r = x[P], x[Q], x[R]
    # Acceleration without the aerodynamic force
    bu = thrust * push[0] / mass - g * st - q * x[2] + r * x[1]
    bv = thrust * push[1] / mass + g * ct * sf - r * x[0] + p * x[2]
    bw = thrust * push[2] / mass + g * ct * cf - p * x[1] + q * x[0]
    if aircraft.implicit:
        _solve_for_flow_rates(bu, bv, bw, qS / mass, aircraft, work)
    out[0] = bu + qS * c[0] / mass
    out[1] = bv + qS * c[1] / mass
    out[2] = bw + qS * c[2] / mass
    # Moments, less the gyroscopic ones
    tensor = work.conditions[INERTIA : INERTIA + 6]
    Ix, Iy, Iz, Ixz, Ixy, Iyz = tensor[0], tensor[1], tensor[2], tensor[3], tensor[4], tensor[5]
    hx = Ix * p - Ixy * q - Ixz * r + aircraft.rotor_momentum
    hy = -Ixy * p + Iy * q - Iyz * r
    hz = -Ixz * p - Iyz * q + Iz * r
    L = qS * aircraft.b * c[3] + thrust * arm[0] - (q * hz - r * hy)
    M = qS * aircraft.cbar * c[4] + thrust * arm[1] - (r * hx - p * hz)
    N = qS * aircraft.b * c[5] + thrust * arm[2] - (p * hy - q * hx)
    # Inverse of the symmetric tensor by its cofactors
    c00, c01, c02 = Iy * Iz - Iyz * Iyz, Ixy * Iz + Ixz * Iyz, Ixy * Iyz + Ixz * Iy
    c11, c12, c22 = Ix * Iz - Ixz * Ixz, Ix * Iyz + Ixy * Ixz, Ix * Iy - Ixy * Ixy
    volume = Ix * c00 - Ixy * c01 - Ixz * c02
    out[3] = (c00 * L + c01 * M + c02 * N) / volume
    out[4] = (c01 * L + c11 * M + c12 * N) / volume
    out[5] = (c02 * L + c12 * M + c22 * N) / volume
    # Kinematics
    turn = (q * sf + r * cf) / ct
    out[6] = p + turn * st
    out[7] = q * cf - r * sf
    out[8] = turn
    reference, drift = air.reference, parameters.drift
    for i in range(3):
        out[9 + i] = rotation[i, 0] * x[0] + rotation[i, 1] * x[1] + rotation[i, 2] * x[2] + reference[i]
    out[11] = -out[11]
    for i in range(12):
        out[i] += drift[i]
    _write_outputs(x, thrust, qS, aircraft, work, out)


@njit(**UNCOUNTED, forceinline=True)
def _write_outputs(x, thrust, qS, aircraft, work, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Outputs at the centre of gravity, of the derivative `out`."""
    slots, derived, c = work.slots, work.derived, work.coefficients[0]
    mass, push = work.conditions[MASS], aircraft.thrust_direction
    for i in range(3):
        derived[i], derived[OUT_V + i], derived[OUT_RHO + i] = slots[i], slots[AIRSPEED + i], slots[AIRSPEED + 3 + i]
        derived[OUT_AX + i] = (qS * c[i] + thrust * push[i]) / mass
        derived[OUT_P_DOT + i], derived[OUT_VN + i] = out[3 + i], out[9 + i]
    derived[OUT_VN + 2] = -out[11]
    for i in range(3, 12):
        derived[i] = x[i]
    rates = flow_angle_rates_compiled(slots[0], slots[1], slots[2], out[0], out[1], out[2])
    derived[OUT_ALPHA_DOT], derived[OUT_ALPHA_DOT + 1], derived[OUT_ALPHA_DOT + 2] = rates
    derived[OUT_RHO + 3], derived[OUT_RHO + 4] = thrust, mass
    for i in range(6):
        derived[OUT_CX + i] = c[i]


@njit(**UNCOUNTED, forceinline=True)
def _evaluate_coefficients(values, aircraft, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Body-axis coefficients without the flow-angle rates, and their derivatives with respect to these."""
    slots, c = work.slots, work.coefficients
    slot, response, rate = aircraft.term_slot, aircraft.term_response, aircraft.term_rate
    controls = work.controls
    for i in range(controls.size):
        slots[FIRST_CONTROL + i] = controls[i]
    run_program(aircraft.program, slots)
    c[:] = 0.0
    for i in range(slot.size):
        c[rate[i], response[i]] += values[i] * slots[slot[i]]
    if aircraft.wind_axes:
        u, v, w, speed = slots[0], slots[1], slots[2], slots[AIRSPEED]
        ground = np.sqrt(u * u + w * w)
        for i in range(3 if aircraft.implicit else 1):
            # CD and CL are in the columns of CX and CZ.
            c[i, 0], c[i, 2] = body_from_wind_compiled(
                c[i, 2], c[i, 0], c[i, 1], w / ground, u / ground, v / speed, ground / speed
            )


@njit(**UNCOUNTED, forceinline=True)
def _solve_for_flow_rates(bu, bv, bw, k, aircraft, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Add the contributions of the two dimensionless rates r to the coefficients; they solve r = r0 + J r."""
    slots, c = work.slots, work.coefficients
    u, v, w, speed = slots[0], slots[1], slots[2], slots[AIRSPEED]
    half_c, half_b = aircraft.cbar / (2.0 * speed), aircraft.b / (2.0 * speed)
    a0, b0, _ = flow_angle_rates_compiled(u, v, w, bu + k * c[0, 0], bv + k * c[0, 1], bw + k * c[0, 2])
    aa, ba, _ = flow_angle_rates_compiled(u, v, w, k * c[1, 0], k * c[1, 1], k * c[1, 2])
    ab, bb, _ = flow_angle_rates_compiled(u, v, w, k * c[2, 0], k * c[2, 1], k * c[2, 2])
    a0, aa, ab = a0 * half_c, aa * half_c, ab * half_c
    b0, ba, bb = b0 * half_b, ba * half_b, bb * half_b
    determinant = (1.0 - aa) * (1.0 - bb) - ab * ba
    alpha_dot_hat = (a0 * (1.0 - bb) + ab * b0) / determinant
    beta_dot_hat = (b0 * (1.0 - aa) + ba * a0) / determinant
    for i in range(6):
        c[0, i] += c[1, i] * alpha_dot_hat + c[2, i] * beta_dot_hat


# --- states of the model with a memory ------------------------------------------------------------


@njit(**UNCOUNTED)
def _with_memory(x, parameters, aircraft, air, work, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Derivatives of a motion whose coefficients depend on states with a memory."""
    for _ in range(3 if aircraft.memory.implicit else 1):
        _set_memory_values(x, aircraft, work)
        _rigid_body(x, parameters, aircraft, air, work, out)
        _memory_derivative(x, aircraft, work, out)


@njit(**UNCOUNTED)
def _run_memory_program(aircraft, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Inputs x of the states, with the last values of the flow-angle rates."""
    memory, slots, speed = aircraft.memory, work.memory_slots, work.slots[AIRSPEED]
    for i in range(FIRST_CONTROL):
        slots[i] = work.slots[i]
    slots[ALPHA_DOT_HAT] = work.derived[OUT_ALPHA_DOT] * aircraft.cbar / (2.0 * speed)
    slots[BETA_DOT_HAT] = work.derived[OUT_ALPHA_DOT + 1] * aircraft.b / (2.0 * speed)
    for i in range(work.controls.size):
        slots[FIRST_CONTROL + i] = work.controls[i]
    run_program(memory.program, slots)
    for i in range(memory.slot.size):
        work.memory_input[i] = slots[memory.slot[i]]


@njit(**UNCOUNTED)
def _set_memory_values(x, aircraft, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Set the controls that hold the values of the states, at this instant."""
    memory, history = aircraft.memory, work.history
    _run_memory_program(aircraft, work)
    for i in range(memory.slot.size):
        given = work.memory_input[i]
        y = x[12 + i]
        if memory.is_delay[i]:
            clock, now = (history.distance, x[x.size - 1]) if memory.by_distance[i] else (history.time, work.time[0])
            y = _delayed(clock, history.value[i], history.steps[0], now, given, memory.constant[i])
        work.controls[memory.control[i]] = given + memory.fraction[i] * (y - given)


@njit(**UNCOUNTED)
def _memory_derivative(x, aircraft, work, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Derivatives of the lags and of the distance, with the present flow-angle rates."""
    memory, speed = aircraft.memory, work.slots[AIRSPEED]
    _run_memory_program(aircraft, work)
    for i in range(memory.slot.size):
        out[12 + i] = 0.0
        if not memory.is_delay[i]:
            pace = speed if memory.by_distance[i] else 1.0
            out[12 + i] = pace * (work.memory_input[i] - x[12 + i]) / memory.constant[i]
    out[x.size - 1] = speed


@njit(**UNCOUNTED)
def _delayed(clock, value, count, now, given, delay):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Value of an input at now - delay; `given` is its value now, and it is constant before the first step."""
    wanted = now - delay
    if count == 0:
        return given
    if wanted <= clock[0]:
        return value[0]
    if wanted >= clock[count - 1]:
        part = (wanted - clock[count - 1]) / (now - clock[count - 1])
        return value[count - 1] + part * (given - value[count - 1])
    j = np.searchsorted(clock[:count], wanted, side="right") - 1
    part = (wanted - clock[j]) / (clock[j + 1] - clock[j])
    return value[j] + part * (value[j + 1] - value[j])
