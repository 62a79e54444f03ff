"""Fixed-step integration of many parameter sets, and slopes at given states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from structsel.errors import DataError, DomainError
from structsel.numerics import flight_path
from structsel.numerics.atmosphere import HIGHEST, LOWEST
from structsel.numerics.flight_dynamics import slope as at
from structsel.numerics.flight_dynamics.layout import FIRST_READING, OUTPUTS, STATES
from structsel.numerics.flight_dynamics.plan import Flight, FlightPlan
from structsel.numerics.flight_dynamics.slope import ASIDE, slope, wind_at

_VERTICAL = 0.5 * np.pi - 1e-6
_VANE_STATE = flight_path.STATES.index("Cup")
_WIND_STATE = flight_path.STATES.index("wn")
_FULL = len(flight_path.STATES)


@dataclass(frozen=True, eq=False)
class Batch:
    """What many parameter sets flew.

    Attributes
    ----------
    outputs : (m, n, c) array
        NaN from where a set blew up.
    flown : (m,) int array
        Samples that hold; n where the whole flight does.
    reason : (m,) int array
        Why it stopped: `REASONS` by number.
    """

    outputs: NDArray[np.float64]
    flown: NDArray[np.int64]
    reason: NDArray[np.int64]


def fly_batch(
    plan: FlightPlan,
    flight: Flight,
    theta: NDArray[np.float64],
    index: NDArray[np.int64],
    observed: NDArray[np.int64],
    *,
    substeps: int = 1,
) -> Batch:
    """Fly m parameter sets through one manoeuvre.

    Parameters
    ----------
    plan : FlightPlan
    flight : Flight
    theta : (m, k) array
    index : (k,) int array
        Which entry of the full parameter vector each column replaces; see `FlightPlan.parameter_index`.
    observed : (c,) int array
        Columns of `OUTPUTS`; see `outputs_index`.
    substeps : int
        Steps of the integration per sample.

    Returns
    -------
    Batch

    Raises
    ------
    DataError
        When the sizes do not fit.
    DomainError
        When `substeps` is below 1.
    """
    theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
    if theta.shape[1] != len(index):
        raise DataError(f"theta has {theta.shape[1]} columns for {len(index)} parameters; each needs its own.")
    if substeps < 1:
        raise DomainError(f"substeps is {substeps}; a sample needs at least 1 step.")
    full = np.tile(plan.parameters(flight), (len(theta), 1))
    full[:, index] = theta
    outputs = np.full((len(theta), len(flight.t), len(observed)), np.nan)
    flown = np.zeros(len(theta), dtype=np.int64)
    reason = np.zeros(len(theta), dtype=np.int64)
    clock = (flight.t, flight.controls, flight.surroundings, flight.hold, flight.delayed)
    air = (flight.heights, flight.wind, flight.warmer, flight.gravity)
    seen = (flight.places, flight.flank, np.asarray(observed, dtype=np.int64))
    _fly(plan.kernel, full, *clock, *air, *seen, substeps, flight.start[11], outputs, flown, reason)
    return Batch(outputs, flown, reason)


def slopes(
    plan: FlightPlan,
    flight: Flight,
    states: NDArray[np.float64],
    controls: NDArray[np.float64],
    parameters: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slopes and outputs at given states, each with its own controls, in the surroundings of the first sample.

    Parameters
    ----------
    plan : FlightPlan
    flight : Flight
    states : (m, 12) array
    controls : (m, c) array
    parameters : (P,) array, optional
        Full parameter vector; the plan's own by default.

    Returns
    -------
    slopes : (m, 12) array
        Derivatives of `STATES`.
    outputs : (m, len(OUTPUTS)) array
    """
    full = plan.parameters(flight) if parameters is None else parameters
    states = np.ascontiguousarray(states, dtype=float)
    made = np.empty((len(states), len(STATES)))
    outputs = np.empty((len(states), len(OUTPUTS)))
    air = (flight.heights, flight.wind, flight.warmer, flight.gravity)
    seen = (flight.places, flight.flank)
    controls = np.ascontiguousarray(controls, dtype=float)
    _slopes(plan.kernel, full, states, controls, flight.surroundings[0], *air, *seen, flight.start[11], made, outputs)
    return made, outputs


@njit(cache=True)
def _control_at(t, table, tau, end, hold, bias, j, column, eps):  # type: ignore[no-untyped-def]  # pragma: no cover
    """One control at a time, and the interval it was found in; `end` means just before the time."""
    n = t.size
    if hold:
        tau = tau - eps if end else tau + eps
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


@njit(cache=True)
def _all_controls(t, table, tau, end, hold, delayed, delay, bias, pointer, eps, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Controls at a time, the delayed ones earlier; `pointer` (2,) remembers the two intervals."""
    for i in range(table.shape[1]):
        which = 1 if delayed[i] else 0
        here = tau - delay if delayed[i] else tau
        out[i], pointer[which] = _control_at(t, table, here, end, hold, bias[i], pointer[which], i, eps)


@njit(cache=True)
def _trouble(x, air_speed, given_rho):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Number of the reason a state cannot be flown on from; 0 where it can."""
    for i in range(12):
        if not np.isfinite(x[i]):
            return 1
    if abs(x[7]) >= _VERTICAL:
        return 3
    if np.isnan(given_rho) and not (x[11] >= LOWEST and x[11] <= HIGHEST):
        return 4
    # Below this no coefficient means anything.
    if not air_speed > 1e-3:
        return 2
    return 0


@njit(cache=True)
def _observe(x, dx, aside, vanes, places, flank, readings, vector, inputs, wanted, everything):  # type: ignore[no-untyped-def]  # pragma: no cover
    """All of OUTPUTS at one instant; the readings only where they are wanted."""
    out = everything
    out[0], out[1], out[2] = aside[0], aside[1], aside[2]
    for i in range(3, 12):
        out[i] = x[i]
    for i in range(6):
        out[12 + i] = aside[3 + i]
    out[18], out[19], out[20] = dx[3], dx[4], dx[5]
    out[21], out[22], out[23] = aside[9], aside[10], aside[11]
    out[24], out[25], out[26] = dx[9], dx[10], -dx[11]
    for i in range(11):
        out[27 + i] = aside[12 + i]
    if not readings:
        return
    vector[:] = 0.0
    vector[0], vector[1], vector[2] = aside[0], aside[1], aside[2]
    for i in range(6):
        vector[3 + i] = x[6 + i]
    for i in range(3):
        vector[_WIND_STATE + i] = aside[at.WIND + i]
    for i in range(5):
        vector[_VANE_STATE + i] = vanes[i]
    P, Q, R = x[3], x[4], x[5]
    inputs[3], inputs[4], inputs[5] = P, Q, R
    flight_path.observe(vector, inputs, places, flank, wanted, out[FIRST_READING : FIRST_READING + 12])
    rx, ry, rz = places[0, 0], places[0, 1], places[0, 2]
    inner, square = P * rx + Q * ry + R * rz, P * P + Q * Q + R * R
    last = FIRST_READING + 12
    out[last] = aside[6] + (dx[4] * rz - dx[5] * ry) + (P * inner - rx * square)
    out[last + 1] = aside[7] + (dx[5] * rx - dx[3] * rz) + (Q * inner - ry * square)
    out[last + 2] = aside[8] + (dx[3] * ry - dx[4] * rx) + (R * inner - rz * square)


@njit(cache=True, nogil=True, error_model="numpy")
def _fly(  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    plan, full, t, table, around, hold, delayed, heights, wind, warmer, g, places, flank, observed, substeps,
    start_height, out, flown, reason,
):  # fmt: skip
    n, count, first = t.size, table.shape[1], plan.term_slot.size
    bias_at = first + 24
    vane_at = bias_at + count + 1
    slots, work = np.zeros(plan.inputs + plan.operation.size), np.zeros((4, 6))
    x, trial, control, here = np.empty(12), np.empty(12), np.empty(count), np.empty(around.shape[1])
    k1, k2, k3, k4 = np.empty(12), np.empty(12), np.empty(12), np.empty(12)
    aside, spare, steady = np.empty(ASIDE), np.empty(ASIDE), np.empty(3)
    everything, vector, inputs = np.empty(FIRST_READING + 15), np.empty(_FULL), np.zeros(9)
    wanted, pointer = np.ones(12, dtype=np.bool_), np.zeros(2, dtype=np.int64)
    readings = False
    for column in observed:
        readings = readings or column >= FIRST_READING
    eps = 1e-9 * (t[n - 1] - t[0]) / (n - 1)
    wind_at(start_height, heights, wind, steady)
    for j in range(full.shape[0]):
        values, bias, delay = full[j, :first], full[j, bias_at : bias_at + count], full[j, bias_at + count]
        vanes = full[j, vane_at : vane_at + 5]
        x[:], drift = full[j, first : first + 12], full[j, first + 12 : bias_at]
        pointer[:] = 0
        for k in range(n):
            _all_controls(t, table, t[k], False, hold, delayed, delay, bias, pointer, eps, control)
            here[:] = around[k]
            slope(x, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, k1, aside)
            reason[j] = _trouble(x, aside[at.V], here[here.size - 1])
            if reason[j]:
                break
            _observe(x, k1, aside, vanes, places, flank, readings, vector, inputs, wanted, everything)
            for i in range(observed.size):
                out[j, k, i] = everything[observed[i]]
            flown[j] = k + 1
            if k == n - 1:
                break
            dt = (t[k + 1] - t[k]) / substeps
            for s in range(substeps):
                tau = t[k] + s * dt
                if s:
                    _all_controls(t, table, tau, False, hold, delayed, delay, bias, pointer, eps, control)
                    part = s / substeps
                    for i in range(here.size):
                        here[i] = (1.0 - part) * around[k, i] + part * around[k + 1, i]
                    slope(
                        x, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, k1, spare
                    )
                _all_controls(t, table, tau + 0.5 * dt, False, hold, delayed, delay, bias, pointer, eps, control)
                part = (s + 0.5) / substeps
                for i in range(here.size):
                    here[i] = (1.0 - part) * around[k, i] + part * around[k + 1, i]
                for i in range(12):
                    trial[i] = x[i] + 0.5 * dt * k1[i]
                slope(
                    trial, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, k2, spare
                )
                for i in range(12):
                    trial[i] = x[i] + 0.5 * dt * k2[i]
                slope(
                    trial, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, k3, spare
                )
                tau = t[k + 1] if s == substeps - 1 else tau + dt
                _all_controls(t, table, tau, True, hold, delayed, delay, bias, pointer, eps, control)
                part = (s + 1) / substeps
                for i in range(here.size):
                    here[i] = (1.0 - part) * around[k, i] + part * around[k + 1, i]
                for i in range(12):
                    trial[i] = x[i] + dt * k3[i]
                slope(
                    trial, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, k4, spare
                )
                for i in range(12):
                    x[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@njit(cache=True, error_model="numpy")
def _slopes(  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    plan, full, states, controls, around, heights, wind, warmer, g, places, flank, start_height, out, outputs
):  # fmt: skip
    first = plan.term_slot.size
    count = controls.shape[1]
    slots, work = np.zeros(plan.inputs + plan.operation.size), np.zeros((4, 6))
    aside, steady, vector, inputs = np.empty(ASIDE), np.empty(3), np.empty(_FULL), np.zeros(9)
    wanted = np.ones(12, dtype=np.bool_)
    vanes, drift = full[first + 24 + count + 1 :], full[first + 12 : first + 24]
    wind_at(start_height, heights, wind, steady)
    for j in range(states.shape[0]):
        slope(
            states[j], controls[j], around, full[:first], drift, plan, steady, heights, wind, warmer, g, slots, work,
            out[j], aside,
        )  # fmt: skip
        _observe(
            states[j], out[j], aside, vanes, places, flank, True, vector, inputs, wanted, outputs[j],
        )  # fmt: skip
