"""The compiled loop of the simulation with six degrees of freedom: integration, controls, sensors, correction.

`flight_simulation` is its interface. Arrays are packed in tuples; see `numerics.arrays.UNCOUNTED`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics import kinematics
from structsel.numerics.arrays import UNCOUNTED, Array
from structsel.numerics.atmosphere import HIGHEST, LOWEST
from structsel.numerics.compiling import njit
from structsel.numerics.flight_dynamics import state_derivative
from structsel.numerics.flight_model import (
    DENSITY,
    FIRST_READING,
    HEIGHT,
    OUT_AX,
    OUT_P_DOT,
    OUT_V,
    OUT_WIND,
    PHI,
    THETA,
    AircraftArrays,
    P,
    Q,
    R,
)
from structsel.numerics.flight_workspace import Environment, History, Parameters, new_workspace
from structsel.numerics.rotations import cosines_of_angles

_VERTICAL = 0.5 * np.pi - 1e-6  # rad; beyond it yaw and roll are the same rotation
_SLOWEST = 1e-3  # m/s; no coefficient is defined below
_AT_REST = 1e-13  # change of the states with a memory at which their initial values are found
_VANE_STATE = kinematics.STATES.index("Cup")
_WIND_STATE = kinematics.STATES.index("wn")
_PATH_STATES, _PATH_READINGS = len(kinematics.STATES), len(kinematics.MEASUREMENTS)


class Correction(NamedTuple):
    """Correction of the states by the innovations at each sample.

    Attributes
    ----------
    states : (s,) int array
        States that are corrected.
    gain : (m, s, o) array
        Kalman gain of each parameter set.
    measured : (m, n, o) array
        Measurements of the observed outputs; NaN corrects nothing.
    """

    states: NDArray[np.int64]
    gain: Array
    measured: Array


class Clock(NamedTuple):
    """Samples of one manoeuvre: time, controls and conditions; fields as `ManoeuvreInputs`."""

    t: Array
    controls: Array
    conditions: Array
    hold: bool
    delayed: NDArray[np.bool_]
    substeps: int


class Sensors(NamedTuple):
    """Positions and kind of the sensors; whether any of their readings is wanted."""

    positions: Array
    flank_angle_vane: bool
    wanted: bool


class Setup(NamedTuple):
    """Data common to all parameter sets of a batch; `observed` are columns of `OUTPUTS`."""

    aircraft: AircraftArrays
    clock: Clock
    environment: Environment
    sensors: Sensors
    correction: Correction
    observed: NDArray[np.int64]


class Scratch(NamedTuple):
    """Scratch arrays of one simulation.

    Attributes
    ----------
    rate, trial, total : (size,) array
        Of the Runge-Kutta step.
    path, inputs : (34,), (9,) array
        State and inputs of the sensor equations, see `kinematics`.
    attitude : (3, 3) array
        Turn from body to earth axes.
    wanted : (12,) bool array
        All readings.
    intervals : (2,) int array
        Sampling intervals in which the undelayed and the delayed controls were last; the search starts there.
    """

    rate: Array
    trial: Array
    total: Array
    path: Array
    inputs: Array
    attitude: Array
    wanted: NDArray[np.bool_]
    intervals: NDArray[np.int64]


@njit(cache=True)
def _new_scratch(size):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Scratch arrays for a state of this size."""
    return Scratch(
        np.empty(size), np.empty(size), np.empty(size), np.zeros(_PATH_STATES), np.zeros(9),
        np.empty((3, 3)), np.ones(_PATH_READINGS, dtype=np.bool_), np.zeros(2, dtype=np.int64),
    )  # fmt: skip


@njit(cache=True)
def _parts(full, terms, controls):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """A full parameter vector by its parts, for this many terms and controls."""
    bias = terms + 24
    delay = bias + controls
    return Parameters(
        full[:terms], full[terms : terms + 12], full[terms + 12 : bias], full[bias:delay], full[delay],
        full[delay + 1 : delay + 6],
    )  # fmt: skip


@njit(**UNCOUNTED)
def _control_at(t, table, tau, before, hold, bias, j, column, eps):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Value of one control at time tau, and its sampling interval; `before` takes the limit from the left."""
    n = t.size
    if hold:
        tau = tau - eps if before else tau + eps
    while j > 0 and tau < t[j]:
        j -= 1
    while j < n - 2 and tau >= t[j + 1]:
        j += 1
    if tau <= t[0]:
        return table[0, column] + bias, j
    if tau >= t[n - 1]:
        return table[n - 1, column] + bias, j
    if hold:
        return table[j, column] + bias, j
    part = (tau - t[j]) / (t[j + 1] - t[j])
    return table[j, column] + part * (table[j + 1, column] - table[j, column]) + bias, j


@njit(**UNCOUNTED, forceinline=True)
def _set_instant(clock, k, tau, part, before, parameters, intervals, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Controls at the time tau, and conditions at the fraction `part` of the interval after sample k."""
    # Arrays are taken out of their tuples before a loop; inside it, every access would count references.
    t, table, delayed, biases, delay = clock.t, clock.controls, clock.delayed, parameters.biases, parameters.delay
    controls = work.controls
    eps = 1e-9 * (t[t.size - 1] - t[0]) / (t.size - 1)
    work.time[0] = tau
    for i in range(table.shape[1]):
        which = 1 if delayed[i] else 0
        when = tau - delay if delayed[i] else tau
        controls[i], intervals[which] = _control_at(
            t, table, when, before, clock.hold, biases[i], intervals[which], i, eps
        )
    now, known, following = work.conditions, clock.conditions, min(k + 1, t.size - 1)
    for i in range(known.shape[1]):
        now[i] = (1.0 - part) * known[k, i] + part * known[following, i]


@njit(**UNCOUNTED)
def _trouble(x, airspeed, given_rho):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Index in `REASONS` if the simulation cannot continue from a state, otherwise 0."""
    for i in range(x.size):
        if not np.isfinite(x[i]):
            return 1
    if abs(x[THETA]) >= _VERTICAL:
        return 3
    if np.isnan(given_rho) and not (x[HEIGHT] >= LOWEST and x[HEIGHT] <= HIGHEST):
        return 4
    if not airspeed > _SLOWEST:
        return 2
    return 0


@njit(**UNCOUNTED)
def _read_sensors(x, vanes, sensors, scratch, derived):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Readings of the instruments at their positions, into `derived`."""
    path, inputs = scratch.path, scratch.inputs
    # The sensor equations are those of the kinematics, with the errors of the vanes only.
    path[:] = 0.0
    for i in range(3):
        path[i] = derived[i]
        path[_WIND_STATE + i] = derived[OUT_WIND + i]
        inputs[3 + i] = x[P + i]
    for i in range(6):
        path[3 + i] = x[PHI + i]
    for i in range(5):
        path[_VANE_STATE + i] = vanes[i]
    last = FIRST_READING + _PATH_READINGS
    cosines_of_angles(x[PHI], x[PHI + 1], x[PHI + 2], scratch.attitude)
    kinematics.observe_at(
        path, scratch.attitude, inputs, sensors.positions, sensors.flank_angle_vane, scratch.wanted,
        derived[FIRST_READING:last],
    )  # fmt: skip
    # Specific force at the accelerometer: a + omega' x r + omega x (omega x r)
    p, q, r = x[P], x[Q], x[R]
    p_dot, q_dot, r_dot = derived[OUT_P_DOT], derived[OUT_P_DOT + 1], derived[OUT_P_DOT + 2]
    rx, ry, rz = sensors.positions[0, 0], sensors.positions[0, 1], sensors.positions[0, 2]
    inner, square = p * rx + q * ry + r * rz, p * p + q * q + r * r
    derived[last] = derived[OUT_AX] + (q_dot * rz - r_dot * ry) + (p * inner - rx * square)
    derived[last + 1] = derived[OUT_AX + 1] + (r_dot * rx - p_dot * rz) + (q * inner - ry * square)
    derived[last + 2] = derived[OUT_AX + 2] + (p_dot * ry - q_dot * rx) + (r * inner - rz * square)


@njit(**UNCOUNTED)
def _start_memory(x, parameters, aircraft, environment, work, rate):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Initial values of the states with a memory: at rest, y = x, where x may depend on y through a rate."""
    count = aircraft.memory.slot.size
    for _ in range(50):
        state_derivative(x, parameters, aircraft, environment, work, rate)
        change = 0.0
        for i in range(count):
            if not aircraft.memory.is_delay[i]:
                change = max(change, abs(work.memory_input[i] - x[12 + i]))
                x[12 + i] = work.memory_input[i]
        if not change > _AT_REST:
            break


@njit(**UNCOUNTED)
def _remember(x, work):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Store the inputs of the states with a memory at the beginning of a step."""
    history = work.history
    k = history.steps[0]
    if k < history.time.size:
        history.time[k], history.distance[k] = work.time[0], x[x.size - 1]
        for i in range(work.memory_input.size):
            history.value[i, k] = work.memory_input[i]
        history.steps[0] = k + 1


@njit(**UNCOUNTED)
def _advance(x, k, parameters, setup, known, work, scratch):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Integrate from sample k to the next; `known` if the rate at its beginning is already computed."""
    rate, trial, total, intervals = scratch.rate, scratch.trial, scratch.total, scratch.intervals
    aircraft, environment, clock = setup.aircraft, setup.environment, setup.clock
    t, substeps = clock.t, clock.substeps
    dt = (t[k + 1] - t[k]) / substeps
    for s in range(substeps):
        begin = t[k] + s * dt
        # Four stages of Runge-Kutta: at the beginning, twice in the middle, at the end.
        for stage in range(4):
            ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            if stage or s or not known:
                end = stage == 3
                tau = t[k + 1] if end and s == substeps - 1 else begin + ahead * dt
                _set_instant(clock, k, tau, (s + ahead) / substeps, end, parameters, intervals, work)
                for i in range(x.size):
                    trial[i] = x[i] + ahead * dt * rate[i] if stage else x[i]
                state_derivative(trial, parameters, aircraft, environment, work, rate)
            if stage == 0 and x.size > 12:
                _remember(x, work)
            weight = 1.0 if stage == 0 or stage == 3 else 2.0
            for i in range(x.size):
                total[i] = weight * rate[i] + (total[i] if stage else 0.0)
        for i in range(x.size):
            x[i] += dt / 6.0 * total[i]


@njit(**UNCOUNTED)
def _simulate_one(j, x, parameters, setup, work, scratch, result):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Simulate parameter set j from its initial state; fills its row of the results."""
    outputs, samples, reason, values = result
    clock, sensors, correction, observed = setup.clock, setup.sensors, setup.correction, setup.observed
    memory, states, rate, n = setup.aircraft.memory.control, correction.states, scratch.rate, clock.t.size
    scratch.intervals[:] = 0
    work.history.steps[0] = 0
    x[:] = 0.0
    for i in range(12):
        x[i] = parameters.start[i]
    for k in range(n):
        _set_instant(clock, k, clock.t[k], 0.0, False, parameters, scratch.intervals, work)
        if k == 0 and memory.size:
            _start_memory(x, parameters, setup.aircraft, setup.environment, work, rate)
        state_derivative(x, parameters, setup.aircraft, setup.environment, work, rate)
        reason[j] = _trouble(x, work.derived[OUT_V], work.conditions[DENSITY])
        if reason[j]:
            return
        if sensors.wanted:
            _read_sensors(x, parameters.vanes, sensors, scratch, work.derived)
        for i in range(observed.size):
            outputs[j, k, i] = work.derived[observed[i]]
        for i in range(memory.size):
            values[j, k, i] = work.controls[memory[i]]
        samples[j] = k + 1
        if k == n - 1:
            return
        for i in range(observed.size if states.size else 0):
            innovation = correction.measured[j, k, i] - outputs[j, k, i]
            if np.isfinite(innovation):
                for s in range(states.size):
                    x[states[s]] += correction.gain[j, s, i] * innovation
        _advance(x, k, parameters, setup, states.size == 0, work, scratch)


@njit(cache=True, nogil=True, error_model="numpy")
def simulate_all(full, setup, result):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Simulate every parameter set; fills `result`, which is outputs, samples, reason and memory."""
    aircraft, clock = setup.aircraft, setup.clock
    controls, count = clock.controls.shape[1], aircraft.memory.slot.size
    steps = (clock.t.size - 1) * clock.substeps + 1 if count else 0
    history = History(np.zeros(1, dtype=np.int64), np.empty(steps), np.empty(steps), np.empty((count, steps)))
    work = new_workspace(aircraft, controls, clock.conditions.shape[1], history)
    x = np.empty(12 + count + 1 if count else 12)
    scratch = _new_scratch(x.size)
    for j in range(full.shape[0]):
        parameters = _parts(full[j], aircraft.term_slot.size, controls)
        _simulate_one(j, x, parameters, setup, work, scratch, result)


@njit(cache=True, error_model="numpy")
def evaluate_all(aircraft, full, states, controls, conditions, environment, sensors, derivatives, outputs):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Derivatives and outputs of each state."""
    parameters = _parts(full, aircraft.term_slot.size, controls.shape[1])
    nothing = np.empty(0)
    history = History(np.zeros(1, dtype=np.int64), nothing, nothing, np.empty((0, 0)))
    work = new_workspace(aircraft, controls.shape[1], conditions.size, history)
    scratch = _new_scratch(12)
    for j in range(states.shape[0]):
        work.controls[:] = controls[j]
        work.conditions[:] = conditions
        state_derivative(states[j], parameters, aircraft, environment, work, derivatives[j])
        _read_sensors(states[j], parameters.vanes, sensors, scratch, work.derived)
        outputs[j] = work.derived[: outputs.shape[1]]
