"""Recordings, a model that flies and the parameters to estimate, put together for the kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from structsel.errors import DataError
from structsel.numerics.output_error import Predict
from structsel.recording import Recording
from structsel.refinement.parameters import Parameter

Flyer: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Model's parameters (m, k), states at the start (m, s), drifts of the states (m, s) and delays (m,) to outputs
(m, n, o) of one recording; not finite where it cannot be flown."""

_UNEVEN = 1e-3  # of the sampling interval


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
        self.flyers = [model.on(r) for r in self.recordings]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def theta0(self) -> np.ndarray:
        """(k,) where the search starts."""
        return np.array([p.value for p in self.parameters])

    @property
    def bounds(self) -> np.ndarray:
        """(k, 2)."""
        return np.array([(p.low, p.high) for p in self.parameters])

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

    def own(self, thetas: np.ndarray) -> np.ndarray:
        """(m, k_model) the model's own parameters of sets (m, k)."""
        return self._filled(np.array(list(self.model.parameters.values())), thetas, "model", self.model.parameters)

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        recording, flyer = self.recordings[j], self.flyers[j]
        name, model = recording.name, self.model
        zero_state, zero_output = np.zeros(len(model.states)), np.zeros(len(self.outputs))
        late = [i for i, p in enumerate(self.parameters) if p.kind == "delay"]

        def predict(thetas: np.ndarray) -> np.ndarray:
            if free is not None and held is not None:
                sets = np.tile(held, (len(thetas), 1))
                sets[:, free] = thetas
                thetas = sets
            start = self._filled(self.starts[name], thetas, "start", model.states, name)
            drift = self._filled(zero_state, thetas, "drift", model.states, name)
            delay = thetas[:, late[0]] if late else np.full(len(thetas), model.delay)
            outputs = flyer(self.own(thetas), start, drift, np.ascontiguousarray(delay))[:, :, self.columns]
            factor = self._filled(zero_output + 1.0, thetas, "scale", self.outputs)
            shift = self._filled(zero_output, thetas, "reference", self.outputs)
            shift = shift + self._filled(zero_output, thetas, "bias", self.outputs, name)
            return factor[:, None, :] * outputs + shift[:, None, :]

        return predict

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
