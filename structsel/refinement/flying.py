"""Linear models made ready to fly recordings' inputs with many parameter sets at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from structsel.errors import ModelError
from structsel.nomenclature import suggest
from structsel.numerics.linear_systems import discretise, discretise_noise, interval, simulate_linear, split_delay
from structsel.recording import Recording
from structsel.refinement.filter_kernels import diagonal, predict_linear, steady_gain
from structsel.refinement.linear_structure import LinearStructure, Matrices
from structsel.refinement.problem import Flyer
from structsel.simulation.linear import LinearModel


class LinearFlight:
    """A linear structure, or a linear model in its own parameters, flown exactly between samples."""

    from_rest = True

    def __init__(self, model: LinearStructure | LinearModel, late: Iterable[str] | None = None):
        self.model = model
        self.structure = structure = LinearStructure.from_model(model) if isinstance(model, LinearModel) else model
        self.name, self.delay = structure.name, structure.delay
        self.states, self.outputs = structure.states, structure.outputs
        self.shown, self.drifting = structure.outputs, structure.states
        self.parameters: Mapping[str, float] = structure.parameters
        self.late = np.array(late_inputs(structure.inputs, structure.late if late is None else late, structure.name))

    def inputs(self, recording: Recording) -> np.ndarray:
        """(n, i) inputs of a recording as the model counts them."""
        structure = self.structure
        recording.require(*structure.inputs, finite=True, by="refine")
        return np.column_stack(
            [recording[name] - structure.input_reference.get(name, 0.0) for name in structure.inputs]
        )

    def on(self, recording: Recording) -> Flyer:
        """Make ready to fly this recording's inputs."""
        structure, u = self.structure, self.inputs(recording)
        latest = (len(u) - 1) * recording.dt
        driven = None if self.late.all() else Driven(self, recording)

        def fly(values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray) -> np.ndarray:
            made = structure.matrices(values)
            if driven is not None:
                Phi, push, feed = driven(made, delay, drift)
                none = np.zeros((len(values), start.shape[1], feed.shape[2]))
                return predict_linear(Phi, push, made.C, feed, start, none, np.full(feed.shape, np.nan))
            y = simulate_linear(
                made.A, made.B, made.C, made.D, u, recording.dt, delay=np.clip(made.delay + delay, 0.0, latest),
                bias=made.drift + drift, y_ref=made.reference, x0=start, hold=structure.hold,
            )  # fmt: skip
            return np.asarray(y)

        return fly

    def noisy(self, outputs: Sequence[str]) -> tuple[str, ...]:
        """States whose process noise the outputs can show."""
        return self.states

    def track(self, recording: Recording, outputs: list[int]) -> LinearTracker:
        """Make ready to predict this recording's samples."""
        return LinearTracker(self, recording, outputs)

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
        late = [name for name, on in zip(self.structure.inputs, self.late) if on]
        return self.structure.replace(values, delay, None if self.late.all() else late)


def late_inputs(inputs: tuple[str, ...], late: Iterable[str] | None, name: str) -> list[bool]:
    """Which inputs the delay holds for; all where none are named.

    Raises
    ------
    ModelError
        A name that is no input's.
    """
    wanted = list(inputs) if late is None else list(late)
    for one in wanted:
        if one not in inputs:
            raise ModelError(
                f"refine was asked for the delay of input '{one}'; '{name}' has: {', '.join(inputs)}."
                f"{suggest(one, inputs)}"
            )
    return [one in wanted for one in inputs]


class Driven:
    """What the inputs add to the states over each interval, and to the outputs: in time, or its transforms.

    Parameters
    ----------
    flight : LinearFlight
    recording : Recording
    weights : (f, n) complex array, optional
        Of a transform; in time where absent.
    """

    def __init__(self, flight: LinearFlight, recording: Recording, weights: np.ndarray | None = None):
        self.u, self.dt, self.hold = flight.inputs(recording), recording.dt, flight.structure.hold
        self.late, self.weights = flight.late, weights
        self.held: dict[int, np.ndarray] = {}

    def shifted(self, shift: int) -> np.ndarray:
        """(rows, i) inputs of so many samples ago, the first held before the record and the last after it."""
        if shift not in self.held:
            n = len(self.u)
            moved = self.u[np.clip(np.arange(n) - shift, 0, n - 1)]
            self.held[shift] = moved if self.weights is None else self.weights @ moved
        return self.held[shift]

    def __call__(
        self, made: Matrices, delay: np.ndarray, drift: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transition (m, s, s), what is added to states (m, rows, s) and outputs (m, rows, o)."""
        m, s = made.drift.shape
        rows = self.shifted(0)
        push = np.zeros((m, len(rows), s), dtype=rows.dtype)
        feed = np.zeros((m, len(rows), made.C.shape[1]), dtype=rows.dtype)
        latest = (len(self.u) - 1) * self.dt
        Phi = np.empty_like(made.A)
        for which, extra in ((self.late, delay), (~self.late, 0.0)):
            if not which.any():
                continue
            whole, part = split_delay(np.clip(made.delay + extra, 0.0, latest), self.dt)
            Phi, _, G = interval(made.A, made.B * which, self.dt, part, self.hold)
            D = made.D * which
            share = (part > 0.0).astype(float) if self.hold == "hold" else part
            for d in np.unique(whole):
                some = np.flatnonzero(whole == d)
                for e in range(3):
                    push[some] += np.einsum("fi,msi->mfs", self.shifted(d + 1 - e), G[e, some])
                for shift, weight in ((d, 1.0 - share), (d + 1, share)):
                    feed[some] += np.einsum("fi,moi->mfo", self.shifted(shift), D[some] * weight[some, None, None])
        if drift is not None:
            h = np.full(m, self.dt)
            push += discretise(made.A, (made.drift + drift)[:, :, None], h)[1][:, :, 0][:, None, :]
            feed += made.reference[:, None, :]
        return Phi, push, feed


class LinearTracker:
    """Predictions of a linear model on one recording."""

    def __init__(self, flight: LinearFlight, recording: Recording, outputs: list[int]):
        self.structure, self.outputs, self.dt = flight.structure, outputs, recording.dt
        self.driven = Driven(flight, recording)

    def gain(
        self, values: np.ndarray, delay: np.ndarray, process: np.ndarray, variances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steady gain (m, s, o), and by how much its states' uncertainty moves the outputs (m, o), a variance."""
        made = self.structure.matrices(values)
        C = made.C[:, self.outputs]
        Phi, Q = discretise_noise(made.A, diagonal(process**2), self.dt)
        K, P = steady_gain(Phi, C, Q, variances)
        return K, np.einsum("mos,mst,mot->mo", C, P, C)

    def fly(
        self, values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray, gain: np.ndarray,
        measured: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(m, n, o) outputs expected of each sample."""
        made = self.structure.matrices(values)
        Phi, push, feed = self.driven(made, delay, drift)
        return predict_linear(Phi, push, made.C[:, self.outputs], feed[:, :, self.outputs], start, gain, measured)
