"""Simulation with six degrees of freedom for many parameter sets at once, with or without correction by measurements.

Arrays in, arrays out. `CompiledAircraft` is the aircraft, `ManoeuvreInputs` one manoeuvre::

    simulate_batch(aircraft, manoeuvre, theta, index, observed, *, substeps=1, correction=None) -> BatchResult

    theta     (m, k) array      one row for each parameter set
    index     (k,) int array    entry of the full parameter vector that each column of theta replaces
    observed  (c,) int array    columns of `OUTPUTS` to return, see `outputs_index`

The full parameter vector (`CompiledAircraft.parameters(manoeuvre)`, names by `CompiledAircraft.parameter_names`)::

    term values, response by response                 "Cm:alpha"
    the 12 initial states, of `STATES`                "start:u", ... "start:h"
    additions to their 12 derivatives                 "drift:u", ...
    additions to each control                         "bias:de", ...
    delay of the controls [s]                         "delay"
    errors of the vanes and of the airspeed           "Cup", "Calpha0", "Csi", "Cbeta0", "KV"

so `CompiledAircraft.parameter_index(["Cm:alpha", "start:w", "delay"])` gives `index`. `structsel.simulation.prepare`
makes both from an AeroModel, an Aircraft and the inputs.

The equations (`flight_dynamics`) are integrated by the Runge-Kutta rule of fourth order over the samples, or over
`substeps` parts of each. With a `Correction` the states are corrected at each sample by the innovation, which is the
one-step prediction of the filter-error method [KM16], [J15]::

    v[k] = z[k] - y(x[k], u[k])            x[k] <- x[k] + K v[k], then on to the next sample
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.errors import DataError, DomainError
from structsel.numerics.arrays import Array
from structsel.numerics.flight_dynamics import wind_at
from structsel.numerics.flight_integration import Clock, Correction, Sensors, Setup, evaluate_all, simulate_all
from structsel.numerics.flight_model import (
    FIRST_READING,
    HEIGHT,
    OUTPUTS,
    STATES,
    CompiledAircraft,
    ManoeuvreInputs,
)
from structsel.numerics.flight_workspace import Environment

_STEP = 1e-4  # of the central differences: of the airspeed, rad, rad/s


@dataclass(frozen=True, eq=False)
class BatchResult:
    """Simulations of many parameter sets.

    Attributes
    ----------
    outputs : (m, n, c) array
        NaN after a simulation has stopped.
    samples : (m,) int array
        Valid samples; n where the simulation reached its end.
    reason : (m,) int array
        Why it stopped: index in `REASONS`, 0 if it reached the end.
    memory : (m, n, M) array
        Values of the model's states with a memory.
    """

    outputs: Array
    samples: NDArray[np.int64]
    reason: NDArray[np.int64]
    memory: Array


def simulate_batch(
    aircraft: CompiledAircraft,
    manoeuvre: ManoeuvreInputs,
    theta: Array,
    index: NDArray[np.int64],
    observed: NDArray[np.int64],
    *,
    substeps: int = 1,
    correction: Correction | None = None,
) -> BatchResult:
    """Simulate one manoeuvre with m parameter sets.

    Parameters
    ----------
    aircraft : CompiledAircraft
    manoeuvre : ManoeuvreInputs
    theta : (m, k) array
    index : (k,) int array
        Entry of the full parameter vector that each column replaces; see `CompiledAircraft.parameter_index`.
    observed : (c,) int array
        Columns of `OUTPUTS`; see `outputs_index`.
    substeps : int
        Steps of the integration per sample.
    correction : Correction, optional
        Then the outputs are one-step predictions.

    Returns
    -------
    BatchResult

    Raises
    ------
    DataError
        When the sizes do not agree.
    DomainError
        When `substeps` is below 1.
    """
    theta = np.ascontiguousarray(np.atleast_2d(theta), dtype=float)
    if theta.shape[1] != len(index):
        raise DataError(f"theta has {theta.shape[1]} columns for {len(index)} parameters; each needs its own.")
    if substeps < 1:
        raise DomainError(f"substeps is {substeps}; a sample needs at least 1 step.")
    full = np.tile(aircraft.parameters(manoeuvre), (len(theta), 1))
    full[:, index] = theta
    m, n, c = len(theta), len(manoeuvre.t), len(observed)
    if correction is None:
        correction = Correction(np.zeros(0, dtype=np.int64), np.zeros((m, 0, c)), np.zeros((m, 0, c)))
    correction = Correction(
        np.asarray(correction.states, dtype=np.int64), *(np.ascontiguousarray(a, dtype=float) for a in correction[1:])
    )
    clock = Clock(manoeuvre.t, manoeuvre.controls, manoeuvre.conditions, manoeuvre.hold, manoeuvre.delayed, substeps)  # type: ignore[arg-type]
    wanted = np.asarray(observed, dtype=np.int64)
    sensors = Sensors(
        manoeuvre.sensor_positions, manoeuvre.flank_angle_vane, bool((wanted >= FIRST_READING).any())
    )  # fmt: skip
    result = BatchResult(
        np.full((m, n, c), np.nan),
        np.zeros(m, dtype=np.int64),
        np.zeros(m, dtype=np.int64),
        np.full((m, n, len(aircraft.memory_names)), np.nan),
    )
    setup = Setup(aircraft.arrays, clock, _environment(manoeuvre), sensors, correction, wanted)
    simulate_all(full, setup, (result.outputs, result.samples, result.reason, result.memory))
    return result


def state_derivatives(
    aircraft: CompiledAircraft,
    manoeuvre: ManoeuvreInputs,
    states: Array,
    controls: Array,
    parameters: Array | None = None,
) -> tuple[Array, Array]:
    """Derivatives and outputs at given states and controls, in the conditions of the first sample.

    Parameters
    ----------
    aircraft : CompiledAircraft
    manoeuvre : ManoeuvreInputs
    states : (m, 12) array
    controls : (m, c) array
        The values of the model's states with a memory among them.
    parameters : (P,) array, optional
        Full parameter vector; the nominal one by default.

    Returns
    -------
    derivatives : (m, 12) array
        Of `STATES`.
    outputs : (m, len(OUTPUTS)) array
    """
    full = aircraft.parameters(manoeuvre) if parameters is None else parameters
    states = np.ascontiguousarray(states, dtype=float)
    derivatives, outputs = np.empty((len(states), len(STATES))), np.empty((len(states), len(OUTPUTS)))
    sensors = Sensors(manoeuvre.sensor_positions, manoeuvre.flank_angle_vane, True)
    evaluate_all(
        aircraft.arrays, full, states, np.ascontiguousarray(controls, dtype=float), manoeuvre.conditions[0],
        _environment(manoeuvre), sensors, derivatives, outputs,
    )  # fmt: skip
    return derivatives, outputs


def linearise_batch(
    aircraft: CompiledAircraft,
    manoeuvre: ManoeuvreInputs,
    full: Array,
    about: Array,
    controls: Array,
    states: NDArray[np.int64],
    observed: NDArray[np.int64],
) -> tuple[Array, Array]:
    """Matrices A and C of the small motion about one condition by central differences, for each parameter set.

    Parameters
    ----------
    full : (m, P) array
        Full parameter vectors.
    about : (12,) array
        State.
    controls : (c,) array
    states : (s,) int array
        States of the linear model; the others stay as they are.
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
    point = np.concatenate([about, controls])
    A, C = np.empty((len(full), s, s)), np.empty((len(full), len(observed), s))
    for j, parameters in enumerate(full):
        rates, outputs = central_differences(aircraft, manoeuvre, point, states, _STEP * size[states], parameters)
        A[j], C[j] = rates[states], outputs[observed]
    return A, C


def central_differences(
    aircraft: CompiledAircraft,
    manoeuvre: ManoeuvreInputs,
    point: Array,
    moved: NDArray[np.int64],
    step: Array,
    parameters: Array | None = None,
) -> tuple[Array, Array]:
    """Partial derivatives of the state derivatives and of the outputs.

    Parameters
    ----------
    point : (12 + c,) array
        States, then controls.
    moved : (k,) int array
        Entries of the point to differentiate by.
    step : (k,) array
        Of each.
    parameters : (P,) array, optional
        Full parameter vector; the nominal one by default.

    Returns
    -------
    (12, k) array, (len(OUTPUTS), k) array
        NaN where the coefficients are not finite.
    """
    k = len(moved)
    points = np.tile(point, (2 * k, 1))
    points[np.arange(k), moved] += step
    points[k + np.arange(k), moved] -= step
    rates, outputs = state_derivatives(aircraft, manoeuvre, points[:, :12], points[:, 12:], parameters)
    with np.errstate(invalid="ignore", over="ignore"):
        return tuple(((x[:k] - x[k:]) / (2.0 * step[:, None])).T for x in (rates, outputs))  # type: ignore[return-value]


def _environment(manoeuvre: ManoeuvreInputs) -> Environment:
    # Copies, since the loop would be compiled a second time for arrays that cannot be written.
    heights, wind, reference = np.array(manoeuvre.heights), np.array(manoeuvre.wind), np.empty(3)
    wind_at(manoeuvre.start[HEIGHT], heights, wind, reference)
    return Environment(heights, wind, float(manoeuvre.isa_offset), float(manoeuvre.gravity), reference)
