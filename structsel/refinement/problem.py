"""Recordings, a model that flies and the parameters to estimate, put together for the kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from structsel.errors import DataError
from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Constraint, OutputErrorProblem, Predict
from structsel.recording import Recording
from structsel.refinement.parameters import Parameter
from structsel.refinement.result import OutputFit, compare_output
from structsel.refinement.settings import RefineOptions

Flyer: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Model's parameters (m, k), states at the start (m, s), drifts of the states (m, s) and delays (m,) to outputs
(m, n, o) of one recording; not finite where it cannot be flown."""

_UNEVEN = 1e-3  # of the sampling interval


class Tracker(Protocol):
    """A model ready to predict one recording sample by sample, with as many parameter sets as are asked for."""

    def gain(
        self, values: np.ndarray, delay: np.ndarray, process: np.ndarray, variances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steady gain (m, s, c), and the variance (m, c) that the states' uncertainty gives the outputs.

        For process noise (m, s), and variances of the measurements (m, c).
        """

    def fly(
        self, values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray, gain: np.ndarray,
        measured: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(m, n, c) outputs expected of each sample when those before it (m, n, c) are let in."""


class FlightModel(Protocol):
    """What `refine` can fly."""

    name: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, float]
    delay: float
    shown: tuple[str, ...]
    """Outputs that are fitted where no others are asked for."""
    drifting: tuple[str, ...]
    """States whose equations can have a constant added."""
    from_rest: bool
    """Whether outputs are departures from a reference at which the recordings start."""

    def on(self, recording: Recording) -> Flyer:
        """Make ready to fly this recording's inputs."""

    def noisy(self, outputs: Sequence[str]) -> tuple[str, ...]:
        """States whose process noise these outputs can show."""

    def track(self, recording: Recording, outputs: list[int]) -> Tracker:
        """Make ready to predict these outputs of this recording."""

    def first_state(self, recording: Recording) -> np.ndarray:
        """(s,) states to start from where they are not estimated."""

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(m,) fastest growth of the motion [1/s]; below zero where it is stable."""

    def refined(self, values: Mapping[str, float], std: Mapping[str, float], delay: float) -> Any:
        """The model with its parameters replaced."""


def require_even_clock(recording: Recording) -> None:
    """Refuse a clock whose steps differ.

    Raises
    ------
    DataError
        The recording, and where.
    """
    steps = np.diff(recording.t)
    off = np.abs(steps - recording.dt)
    if off.max() > _UNEVEN * recording.dt:
        i = int(np.argmax(off))
        raise DataError(
            f"refine flies recordings of even steps; '{recording.name}' has one of {steps[i]:g} s after "
            f"t = {recording.t[i]:g} s among steps of {recording.dt:g} s. Split it at gaps with recording.split(), "
            "or interpolate it onto an even clock."
        )


def filled(thetas: np.ndarray, held: np.ndarray | None, free: np.ndarray | None) -> np.ndarray:
    """(m, k) sets whose columns `free` are given, the others held; or all given."""
    if free is None or held is None:
        return thetas
    sets = np.tile(held, (len(thetas), 1))
    sets[:, free] = thetas
    return sets


class Problem:
    """A model's outputs on all recordings as functions of one parameter vector.

    Parameters
    ----------
    model : FlightModel
    recordings : sequence of Recording
    outputs : sequence of str
    parameters : sequence of Parameter
        Those estimated; all else is held.
    starts : mapping of recording's name to (s,) array
        States at the first sample as far as they are held.
    """

    def __init__(
        self,
        model: FlightModel,
        recordings: Sequence[Recording],
        outputs: Sequence[str],
        parameters: Sequence[Parameter],
        starts: Mapping[str, np.ndarray],
    ):
        self.model, self.recordings = model, list(recordings)
        self.outputs, self.parameters = tuple(outputs), tuple(parameters)
        self.starts = starts
        self.columns = [model.outputs.index(name) for name in self.outputs]
        self.y = [np.column_stack([r[name] for name in self.outputs]) for r in self.recordings]
        self.flyers = self.make_ready()

    said = "simulated"

    def make_ready(self) -> list[Any]:
        """What flies each recording."""
        return [self.model.on(r) for r in self.recordings]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def theta0(self) -> np.ndarray:
        """(k,) where the search starts."""
        return self.inner(np.array([p.value for p in self.parameters]))

    @property
    def bounds(self) -> np.ndarray:
        """(k, 2)."""
        return np.column_stack([self.inner(np.array([getattr(p, end) for p in self.parameters]))
                                for end in ("low", "high")])  # fmt: skip

    def inner(self, values: np.ndarray) -> np.ndarray:
        """Parameters as they are searched for."""
        return values

    def outer(self, thetas: np.ndarray) -> np.ndarray:
        """Parameters (..., k) as they are told."""
        return thetas

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """(k,) derivative of `outer`."""
        return np.ones(len(theta))

    @property
    def scale(self) -> np.ndarray:
        """(k,) typical sizes."""
        return np.array([p.scale for p in self.parameters])

    @property
    def affects(self) -> list[np.ndarray]:
        """(k,) by recording: which parameters its outputs depend on."""
        return [np.array([p.recording in ("", r.name) for p in self.parameters]) for r in self.recordings]

    def predict(self, held: np.ndarray | None = None, free: np.ndarray | None = None) -> list[Predict]:
        """Outputs by parameter sets, for each recording.

        Parameters
        ----------
        held : (k,) array, optional
        free : (f,) int array, optional
            Where parameter sets have only these columns, the others are held.
        """
        return [self._predict(j, held, free) for j in range(len(self.recordings))]

    def in_numbers(
        self, R: np.ndarray | None, options: RefineOptions, constraint: Constraint | None
    ) -> OutputErrorProblem:
        """The problem as the kernels take it."""
        return OutputErrorProblem(
            self.predict(), self.y, R=R, cost=options.cost, full=options.full_noise, affects=self.affects,
            bounds=self.bounds, constraint=constraint,
        )  # fmt: skip

    def own(self, thetas: np.ndarray) -> np.ndarray:
        """(m, k_model) the model's own parameters of sets (m, k)."""
        return self._filled(np.array(list(self.model.parameters.values())), thetas, "model", self.model.parameters)

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        name = self.recordings[j].name

        def predict(thetas: np.ndarray) -> np.ndarray:
            thetas = filled(thetas, held, free)
            factor, shift = self.instrument(thetas, name)
            outputs = self.flyers[j](*self.flown(thetas, name))[:, :, self.columns]
            return factor[:, None, :] * outputs + shift[:, None, :]

        return predict

    def flown(self, thetas: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The model's parameters, start, drift and delay in a recording, as a `Flyer` takes them."""
        late = [i for i, p in enumerate(self.parameters) if p.kind == "delay"]
        states = self.model.states
        start = self._filled(self.starts[name], thetas, "start", states, name)
        drift = self._filled(np.zeros(len(states)), thetas, "drift", states, name)
        delay = thetas[:, late[0]] if late else np.full(len(thetas), self.model.delay)
        return self.own(thetas), start, drift, np.ascontiguousarray(delay)

    def instrument(self, thetas: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """(m, c) factor and constant of each output in a recording."""
        none = np.zeros(len(self.outputs))
        shift = self._filled(none, thetas, "reference", self.outputs)
        shift = shift + self._filled(none, thetas, "bias", self.outputs, name)
        return self._filled(none + 1.0, thetas, "scale", self.outputs), shift

    def portray(self, fit: OutputErrorFit) -> tuple[list[OutputFit], list[Recording], dict[str, dict[str, np.ndarray]]]:
        """How near each output came, the recordings as modelled, and the residuals."""
        fits: list[OutputFit] = []
        modelled, residuals = [], {}
        for r, z, v in zip(self.recordings, fit.outputs, fit.residuals):
            fits += [compare_output(r.name, name, r[name], z[:, c]) for c, name in enumerate(self.outputs)]
            flown = {name: np.array(z[:, c]) for c, name in enumerate(self.outputs)}
            modelled.append(r.with_channels(note=f"outputs {self.said} by refine", **flown))  # type: ignore[arg-type]
            residuals[r.name] = {name: np.array(v[:, c]) for c, name in enumerate(self.outputs)}
        return fits, modelled, residuals

    def _filled(
        self, base: np.ndarray, thetas: np.ndarray, kind: str, among: Sequence[str] | Mapping[str, float], of: str = ""
    ) -> np.ndarray:
        """(m, len(base)) with the estimated ones of this kind in their places."""
        made = np.tile(base, (len(thetas), 1))
        order = list(among)
        for i, p in enumerate(self.parameters):
            if p.kind == kind and p.recording == of:
                made[:, order.index(p.name if kind == "model" else p.name.rsplit(":", 1)[1])] = thetas[:, i]
        return made
