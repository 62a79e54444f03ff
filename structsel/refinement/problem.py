"""Recordings, a model and the parameters to estimate, as an output-error problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Constraint, OutputErrorProblem, Predict
from structsel.recording import Recording
from structsel.refinement.parameters import Parameter
from structsel.refinement.protocols import RefinableModel
from structsel.refinement.result import OutputFit, compare_output
from structsel.refinement.settings import RefineOptions

FitsAndResiduals: TypeAlias = tuple[list[OutputFit], list[Recording], dict[str, dict[str, np.ndarray]]]


def filled(thetas: np.ndarray, held: np.ndarray | None, free: np.ndarray | None) -> np.ndarray:
    """(m, k) sets whose columns `free` are given, the others held; or all given."""
    if free is None or held is None:
        return thetas
    sets = np.tile(held, (len(thetas), 1))
    sets[:, free] = thetas
    return sets


class EstimationProblem:
    """A model's outputs on all recordings as functions of one parameter vector.

    Parameters
    ----------
    model : RefinableModel
    recordings : sequence of Recording
    outputs : sequence of str
    parameters : sequence of Parameter
        Those estimated; all else is held.
    starts : mapping of recording's name to (s,) array
        States at the first sample as far as they are held.
    """

    def __init__(
        self,
        model: RefinableModel,
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
        self.predictors = self.prepare_recordings()

    note = "simulated"

    def prepare_recordings(self) -> list[Any]:
        """Simulator of each recording."""
        return [self.model.simulator(r) for r in self.recordings]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def theta0(self) -> np.ndarray:
        """(k,) where the search starts."""
        return self.to_search(np.array([p.value for p in self.parameters]))

    @property
    def bounds(self) -> np.ndarray:
        """(k, 2)."""
        return np.column_stack([self.to_search(np.array([getattr(p, end) for p in self.parameters]))
                                for end in ("low", "high")])  # fmt: skip

    def to_search(self, values: np.ndarray) -> np.ndarray:
        """Parameters in the units of the search."""
        return values

    def from_search(self, thetas: np.ndarray) -> np.ndarray:
        """Parameters (..., k) in their own units."""
        return thetas

    def search_slope(self, theta: np.ndarray) -> np.ndarray:
        """(k,) derivative of `from_search`."""
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
            Columns of the parameter sets; the others are held.
        """
        return [self._predict(j, held, free) for j in range(len(self.recordings))]

    def output_error(
        self, R: np.ndarray | None, options: RefineOptions, constraint: Constraint | None
    ) -> OutputErrorProblem:
        """The problem as the kernels take it."""
        return OutputErrorProblem(
            self.predict(), self.y, R=R, cost=options.cost, full=options.full_noise, affects=self.affects,
            bounds=self.bounds, constraint=constraint,
        )  # fmt: skip

    def model_parameters(self, thetas: np.ndarray) -> np.ndarray:
        """(m, k_model) parameters of the model, of sets (m, k)."""
        return self._filled(np.array(list(self.model.parameters.values())), thetas, "model", self.model.parameters)

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        name = self.recordings[j].name

        def predict(thetas: np.ndarray) -> np.ndarray:
            thetas = filled(thetas, held, free)
            factor, shift = self.instrument(thetas, name)
            outputs = self.predictors[j](*self.simulation_arguments(thetas, name))[:, :, self.columns]
            return factor[:, None, :] * outputs + shift[:, None, :]

        return predict

    def simulation_arguments(
        self, thetas: np.ndarray, name: str
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The model's parameters, start, drift and delay in a recording, as a simulator takes them."""
        column = [i for i, p in enumerate(self.parameters) if p.kind == "delay"]
        states = self.model.states
        start = self._filled(self.starts[name], thetas, "start", states, name)
        drift = self._filled(np.zeros(len(states)), thetas, "drift", states, name)
        delay = thetas[:, column[0]] if column else np.full(len(thetas), self.model.delay)
        return self.model_parameters(thetas), start, drift, np.ascontiguousarray(delay)

    def instrument(self, thetas: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """(m, c) factor and constant of each output in a recording."""
        none = np.zeros(len(self.outputs))
        shift = self._filled(none, thetas, "reference", self.outputs)
        shift = shift + self._filled(none, thetas, "bias", self.outputs, name)
        return self._filled(none + 1.0, thetas, "scale", self.outputs), shift

    def fits_and_residuals(self, fit: OutputErrorFit) -> FitsAndResiduals:
        """Metrics of each output, the recordings as modelled, and the residuals."""
        fits: list[OutputFit] = []
        modelled, residuals = [], {}
        for r, z, v in zip(self.recordings, fit.outputs, fit.residuals):
            fits += [compare_output(r.name, name, r[name], z[:, c]) for c, name in enumerate(self.outputs)]
            outputs = {name: np.array(z[:, c]) for c, name in enumerate(self.outputs)}
            modelled.append(r.with_channels(note=f"outputs {self.note} by refine", **outputs))  # type: ignore[arg-type]
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
