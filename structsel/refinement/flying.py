"""Models made ready to fly recordings' inputs with many parameter sets at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from structsel.numerics.linear_systems import simulate_linear
from structsel.recording import Recording
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.problem import Flyer
from structsel.simulation.linear import LinearModel


class LinearFlight:
    """A linear structure, or a linear model in its own parameters, flown exactly between samples."""

    from_rest = True

    def __init__(self, model: LinearStructure | LinearModel):
        self.model = model
        self.structure = structure = LinearStructure.from_model(model) if isinstance(model, LinearModel) else model
        self.name, self.delay = structure.name, structure.delay
        self.states, self.outputs = structure.states, structure.outputs
        self.shown, self.drifting = structure.outputs, structure.states
        self.parameters: Mapping[str, float] = structure.parameters

    def on(self, recording: Recording) -> Flyer:
        """Make ready to fly this recording's inputs."""
        structure = self.structure
        recording.require(*structure.inputs, finite=True, by="refine")
        u = np.column_stack([recording[name] - structure.input_reference.get(name, 0.0) for name in structure.inputs])
        latest = (len(u) - 1) * recording.dt

        def fly(values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray) -> np.ndarray:
            made = structure.matrices(values)
            y = simulate_linear(
                made.A, made.B, made.C, made.D, u, recording.dt, delay=np.clip(made.delay + delay, 0.0, latest),
                bias=made.drift + drift, y_ref=made.reference, x0=start, hold=structure.hold,
            )  # fmt: skip
            return np.asarray(y)

        return fly

    def first_state(self, recording: Recording) -> np.ndarray:
        """At rest: a linear model's states count from its reference."""
        return np.zeros(len(self.states))

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(m,) largest real part of the eigenvalues of A [1/s]."""
        return self.structure.growth(values)

    def refined(
        self, values: Mapping[str, float], std: Mapping[str, float], delay: float
    ) -> LinearStructure | LinearModel:
        """The model with the parameters found; a structure where a delay was added that the model has no place for."""
        if isinstance(self.model, LinearModel) and delay == self.delay:
            return self.model.with_parameters(values)
        return self.structure.replace(values, delay)
