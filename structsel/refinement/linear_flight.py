"""Linear models simulated with recorded inputs, many parameter sets at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from structsel.errors import ModelError
from structsel.nomenclature import suggest
from structsel.numerics.linear_models import LinearSystem
from structsel.numerics.linear_systems import discretise, interval, simulate_linear, split_delay
from structsel.recording import Recording
from structsel.refinement.filter_kernels import predict_linear, sampled_gain
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.protocols import Simulator
from structsel.simulation.linear import LinearModel


class LinearFlight:
    """A linear structure, or a linear model in its own parameters, simulated exactly between samples."""

    from_rest = True
    doubts: tuple[str, ...] = ()

    def __init__(self, model: LinearStructure | LinearModel, delayed: Iterable[str] | None = None):
        self.model = model
        self.structure = structure = LinearStructure.from_model(model) if isinstance(model, LinearModel) else model
        self.name, self.delay = structure.name, structure.delay
        self.states, self.outputs = structure.states, structure.outputs
        self.default_outputs, self.drifting = structure.outputs, structure.states
        self.parameters: Mapping[str, float] = structure.parameters
        named = structure.delayed if delayed is None else delayed
        self.delayed = np.array(delayed_inputs(structure.inputs, named, structure.name))

    def inputs(self, recording: Recording) -> np.ndarray:
        """(n, i) inputs of a recording, from the model's reference."""
        structure = self.structure
        recording.require(*structure.inputs, finite=True, by="refine")
        return np.column_stack(
            [recording[name] - structure.input_reference.get(name, 0.0) for name in structure.inputs]
        )

    def simulator(self, recording: Recording) -> Simulator:
        """Simulator of this recording."""
        structure, u = self.structure, self.inputs(recording)
        longest = (len(u) - 1) * recording.dt
        response = None if self.delayed.all() else InputResponse(self, recording)

        def simulate(values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray) -> np.ndarray:
            made = structure.matrices(values)
            if response is not None:
                Phi, state_input, feedthrough = response(made, delay, drift)
                none = np.zeros((len(values), start.shape[1], feedthrough.shape[2]))
                return predict_linear(
                    Phi, state_input, made.C, feedthrough, start, none, np.full(feedthrough.shape, np.nan)
                )
            y = simulate_linear(
                made.A, made.B, made.C, made.D, u, recording.dt, delay=np.clip(made.delay + delay, 0.0, longest),
                bias=made.bias + drift, y_ref=made.y_ref, x0=start, hold=structure.hold,
            )  # fmt: skip
            return np.asarray(y)

        return simulate

    def states_with_noise(self, outputs: Sequence[str]) -> tuple[str, ...]:
        """States whose process noise the outputs depend on."""
        return self.states

    def filter_predictor(self, recording: Recording, outputs: list[int]) -> LinearFilter:
        """Predictor of this recording."""
        return LinearFilter(self, recording, outputs)

    def first_state(self, recording: Recording) -> np.ndarray:
        """Zero: the states of a linear model count from its reference."""
        return np.zeros(len(self.states))

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(m,) largest real part of the eigenvalues of A [1/s]."""
        return self.structure.growth(values)

    def held_errors(self, names: Sequence[str]) -> np.ndarray:
        """NaN: a linear model has no standard errors."""
        return np.full(len(names), np.nan)

    def refined(
        self, values: Mapping[str, float], covariance: np.ndarray, delay: float, method: str, recordings: Sequence[str]
    ) -> LinearStructure | LinearModel:
        """The model with the parameters found; a structure where the model has no parameter for the delay."""
        if isinstance(self.model, LinearModel) and delay == self.delay:
            return self.model.with_parameters(values)
        delayed = [name for name, on in zip(self.structure.inputs, self.delayed) if on]
        return self.structure.replace(values, delay, None if self.delayed.all() else delayed)


def delayed_inputs(inputs: tuple[str, ...], delayed: Iterable[str] | None, name: str) -> list[bool]:
    """Whether each input is delayed; all where none are named.

    Raises
    ------
    ModelError
        A name that is no input's.
    """
    wanted = list(inputs) if delayed is None else list(delayed)
    for one in wanted:
        if one not in inputs:
            raise ModelError(
                f"refine was given the delay of input '{one}'; '{name}' has: {', '.join(inputs)}.{suggest(one, inputs)}"
            )
    return [one in wanted for one in inputs]


class InputResponse:
    """Contribution of the inputs to the states over each interval, and to the outputs; in time, or its transforms.

    Parameters
    ----------
    flight : LinearFlight
    recording : Recording
    weights : (f, n) complex array, optional
        Of a transform; without, the response is in time.
    """

    def __init__(self, flight: LinearFlight, recording: Recording, weights: np.ndarray | None = None):
        self.u, self.dt, self.hold = flight.inputs(recording), recording.dt, flight.structure.hold
        self.delayed, self.weights = flight.delayed, weights
        self.shifted_inputs: dict[int, np.ndarray] = {}

    def shifted(self, shift: int) -> np.ndarray:
        """(rows, i) inputs so many samples before, the first held before the record and the last after it."""
        if shift not in self.shifted_inputs:
            n = len(self.u)
            moved = self.u[np.clip(np.arange(n) - shift, 0, n - 1)]
            self.shifted_inputs[shift] = moved if self.weights is None else self.weights @ moved
        return self.shifted_inputs[shift]

    def __call__(
        self, made: LinearSystem, delay: np.ndarray, drift: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transition (m, s, s), and contributions to states (m, rows, s) and outputs (m, rows, o)."""
        m, s = made.bias.shape
        rows = self.shifted(0)
        state_input = np.zeros((m, len(rows), s), dtype=rows.dtype)
        feedthrough = np.zeros((m, len(rows), made.C.shape[1]), dtype=rows.dtype)
        longest = (len(self.u) - 1) * self.dt
        Phi = np.empty_like(made.A)
        for which, extra in ((self.delayed, delay), (~self.delayed, 0.0)):
            if not which.any():
                continue
            steps, part = split_delay(np.clip(made.delay + extra, 0.0, longest), self.dt)
            Phi, _, G = interval(made.A, made.B * which, self.dt, part, self.hold)
            D = made.D * which
            weight_before = (part > 0.0).astype(float) if self.hold == "hold" else part
            for d in np.unique(steps):
                some = np.flatnonzero(steps == d)
                for e in range(3):
                    state_input[some] += np.einsum("fi,msi->mfs", self.shifted(d + 1 - e), G[e, some])
                for shift, weight in ((d, 1.0 - weight_before), (d + 1, weight_before)):
                    feedthrough[some] += np.einsum(
                        "fi,moi->mfo", self.shifted(shift), D[some] * weight[some, None, None]
                    )
        if drift is not None:
            h = np.full(m, self.dt)
            state_input += discretise(made.A, (made.bias + drift)[:, :, None], h)[1][:, :, 0][:, None, :]
            feedthrough += made.y_ref[:, None, :]
        return Phi, state_input, feedthrough


class LinearFilter:
    """Predictions of a linear model on one recording."""

    def __init__(self, flight: LinearFlight, recording: Recording, outputs: list[int]):
        self.structure, self.outputs, self.dt = flight.structure, outputs, recording.dt
        self.response = InputResponse(flight, recording)

    def gain(
        self, values: np.ndarray, delay: np.ndarray, process: np.ndarray, variances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steady gain (m, s, o), and the variance of the outputs due to the uncertainty of the states, (m, o)."""
        made = self.structure.matrices(values)
        C = made.C[:, self.outputs]
        return sampled_gain(made.A, C, process, variances, self.dt)

    def predict(
        self, values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray, gain: np.ndarray,
        measured: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(m, n, o) outputs predicted for each sample."""
        made = self.structure.matrices(values)
        Phi, state_input, feedthrough = self.response(made, delay, drift)
        return predict_linear(
            Phi, state_input, made.C[:, self.outputs], feedthrough[:, :, self.outputs], start, gain, measured
        )
