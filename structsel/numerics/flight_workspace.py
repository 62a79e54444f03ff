"""Arguments and scratch arrays of the compiled equations of motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.flight_model import DERIVED


class Environment(NamedTuple):
    """Wind, atmosphere and gravity of one manoeuvre.

    Attributes
    ----------
    heights, wind, isa_offset, gravity
        As `flight_model.ManoeuvreInputs`.
    reference : (3,) array [m/s]
        Wind that the state's velocity is relative to, north, east, down.
    """

    heights: Array
    wind: Array
    isa_offset: float
    gravity: float
    reference: Array


class History(NamedTuple):
    """Inputs of the model's delays at the steps so far.

    Attributes
    ----------
    steps : (1,) int array
        Number of steps so far.
    time, distance : (N,) array [s, m]
    value : (M, N) array
    """

    steps: Array
    time: Array
    distance: Array
    value: Array


class Parameters(NamedTuple):
    """Parts of one full parameter vector: terms, start, drift, biases of the controls, delay, vanes."""

    terms: Array
    start: Array
    drift: Array
    biases: Array
    delay: float
    vanes: Array


class Workspace(NamedTuple):
    """Scratch arrays of the equations of motion at one instant.

    Attributes
    ----------
    time : (1,) array [s]
    controls : (c,) array
    conditions : (14,) array
        As `flight_model.CONDITIONS`.
    attitude : (4,) array
        sin phi, cos phi, sin theta, cos theta.
    rotation : (3, 3) array
        Body axes to north, east, down.
    slots, memory_slots : arrays
        Of the two programs.
    coefficients : (3, 6) array
        Without the flow-angle rates, and their derivatives with respect to each of the two rates.
    memory_input : (M,) array
        Inputs x of the states with a memory.
    derived : (DERIVED,) array
        As `flight_model.OUTPUTS`, and the velocity of the air.
    history : History
    """

    time: Array
    controls: Array
    conditions: Array
    attitude: Array
    rotation: Array
    slots: Array
    memory_slots: Array
    coefficients: Array
    memory_input: Array
    derived: Array
    history: History


@njit(cache=True)
def new_workspace(aircraft, controls, conditions, history):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Scratch arrays for a number of controls and conditions."""
    program, memory = aircraft.program, aircraft.memory
    return Workspace(
        np.zeros(1), np.empty(controls), np.empty(conditions), np.empty(4), np.empty((3, 3)),
        np.zeros(program.inputs + program.operation.size),
        np.zeros(memory.program.inputs + memory.program.operation.size),
        np.zeros((3, 6)), np.zeros(memory.slot.size), np.zeros(DERIVED), history,
    )  # fmt: skip
