"""Predictions of the compiled flight with six degrees of freedom."""

from __future__ import annotations

import numpy as np
from numba import njit

from structsel.numerics.flight_dynamics import Flight, FlightPlan, slopes
from structsel.numerics.flight_dynamics.batch import _all_controls, _observe, _trouble
from structsel.numerics.flight_dynamics.layout import FIRST_READING
from structsel.numerics.flight_dynamics.slope import ASIDE, V, slope, wind_at
from structsel.numerics.flight_path import STATES as PATH_STATES

_STEP = 1e-4  # of the differences: of the airspeed, a radian, a radian per second


def linearise_flight(
    plan: FlightPlan,
    flight: Flight,
    full: np.ndarray,
    about: np.ndarray,
    controls: np.ndarray,
    states: np.ndarray,
    observed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of the motion and of the outputs about one condition, for each parameter set.

    Parameters
    ----------
    full : (m, P) array
        Full parameter vectors.
    about : (12,) array
        State.
    controls : (c,) array
    states : (s,) int array
        States that count; the others stay as they are.
    observed : (o,) int array
        Columns of `OUTPUTS`.

    Returns
    -------
    A : (m, s, s) array
    C : (m, o, s) array
        NaN where the coefficients are not finite.
    """
    s = len(states)
    size = np.ones(12)
    size[:3] = np.linalg.norm(about[:3])
    step = _STEP * size[states]
    moved = np.tile(about, (2 * s, 1))
    moved[np.arange(s), states] += step
    moved[s + np.arange(s), states] -= step
    held = np.tile(controls, (2 * s, 1))
    A, C = np.empty((len(full), s, s)), np.empty((len(full), len(observed), s))
    for j, parameters in enumerate(full):
        rates, outputs = slopes(plan, flight, moved, held, parameters)
        with np.errstate(invalid="ignore", over="ignore"):
            A[j] = ((rates[:s] - rates[s:])[:, states] / (2.0 * step[:, None])).T
            C[j] = ((outputs[:s] - outputs[s:])[:, observed] / (2.0 * step[:, None])).T
    return A, C


def predict_flight(
    plan: FlightPlan,
    flight: Flight,
    full: np.ndarray,
    states: np.ndarray,
    observed: np.ndarray,
    gain: np.ndarray,
    measured: np.ndarray,
    *,
    substeps: int = 1,
) -> np.ndarray:
    """Outputs expected of each sample, the measurements before it let in.

    Parameters
    ----------
    plan, flight, full, states, observed
        As `linearise_flight`.
    gain : (m, s, o) array
    measured : (m, n, o) array
        NaN where not sampled: such a sample corrects nothing.
    substeps : int
        Steps of the integration per sample.

    Returns
    -------
    (m, n, o) array
        NaN from where a set blew up.
    """
    out = np.full(measured.shape, np.nan)
    _predict(
        plan.kernel, np.ascontiguousarray(full), flight.t, flight.controls, flight.surroundings, flight.hold,
        flight.delayed, flight.heights, flight.wind, flight.warmer, flight.gravity, flight.places, flight.flank,
        np.asarray(states, dtype=np.int64), np.asarray(observed, dtype=np.int64), np.ascontiguousarray(gain),
        np.ascontiguousarray(measured), substeps, flight.start[11], out,
    )  # fmt: skip
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _predict(  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    plan, full, t, table, around, hold, delayed, heights, wind, warmer, g, places, flank, states, observed, gain,
    measured, substeps, start_height, out,
):  # fmt: skip
    n, count, first = t.size, table.shape[1], plan.term_slot.size
    bias_at = first + 24
    vane_at = bias_at + count + 1
    slots, work = np.zeros(plan.inputs + plan.operation.size), np.zeros((4, 6))
    x, trial, total, rate = np.empty(12), np.empty(12), np.empty(12), np.empty(12)
    control, here, aside, steady = np.empty(count), np.empty(around.shape[1]), np.empty(ASIDE), np.empty(3)
    everything, vector, inputs = np.empty(FIRST_READING + 15), np.empty(len(PATH_STATES)), np.zeros(9)
    wanted, pointer = np.ones(12, dtype=np.bool_), np.zeros(2, dtype=np.int64)
    readings = False
    for column in observed:
        readings = readings or column >= FIRST_READING
    eps = 1e-9 * (t[n - 1] - t[0]) / (n - 1)
    wind_at(start_height, heights, wind, steady)
    for j in range(full.shape[0]):
        values, bias, delay = full[j, :first], full[j, bias_at : bias_at + count], full[j, bias_at + count]
        vanes, drift = full[j, vane_at : vane_at + 5], full[j, first + 12 : bias_at]
        x[:] = full[j, first : first + 12]
        pointer[:] = 0
        for k in range(n):
            _all_controls(t, table, t[k], False, hold, delayed, delay, bias, pointer, eps, control)
            here[:] = around[k]
            slope(x, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, rate, aside)
            if _trouble(x, aside[V], here[here.size - 1]):
                break
            _observe(x, rate, aside, vanes, places, flank, readings, vector, inputs, wanted, everything)
            for a in range(observed.size):
                out[j, k, a] = everything[observed[a]]
            for a in range(observed.size):
                v = measured[j, k, a] - out[j, k, a]
                if np.isfinite(v):
                    for i in range(states.size):
                        x[states[i]] += gain[j, i, a] * v
            if k == n - 1:
                break
            dt = (t[k + 1] - t[k]) / substeps
            for s in range(substeps):
                begin = t[k] + s * dt
                # Runge and Kutta's four slopes: at the start, twice in the middle, at the end.
                for stage in range(4):
                    ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                    end = stage == 3
                    tau = t[k + 1] if end and s == substeps - 1 else begin + ahead * dt
                    _all_controls(t, table, tau, end, hold, delayed, delay, bias, pointer, eps, control)
                    part = (s + ahead) / substeps
                    for i in range(here.size):
                        here[i] = (1.0 - part) * around[k, i] + part * around[k + 1, i]
                    for i in range(12):
                        trial[i] = x[i] + ahead * dt * rate[i] if stage else x[i]
                    slope(
                        trial, control, here, values, drift, plan, steady, heights, wind, warmer, g, slots, work, rate,
                        aside,
                    )  # fmt: skip
                    weight = 1.0 if stage == 0 or end else 2.0
                    for i in range(12):
                        total[i] = weight * rate[i] + (total[i] if stage else 0.0)
                for i in range(12):
                    x[i] += dt / 6.0 * total[i]
