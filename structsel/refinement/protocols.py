"""What `refine` needs of a model: simulations, and predictions sample by sample, of one recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from structsel.recording import Recording

Simulator: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Model parameters (m, k), states at the start (m, s), drifts of the states (m, s) and delays (m,) to outputs (m, n, o)
of one recording; not finite where the simulation diverges."""


class FilterPredictor(Protocol):
    """Predicts one recording sample by sample, for several parameter sets at once."""

    def gain(
        self, values: np.ndarray, delay: np.ndarray, process: np.ndarray, variances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steady gain (m, s, c), and the variance (m, c) that the states' uncertainty gives the outputs.

        For process noise (m, s), and variances of the measurements (m, c).
        """

    def predict(
        self, values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray, gain: np.ndarray,
        measured: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(m, n, c) outputs predicted for each sample from the measurements before it, (m, n, c)."""


class RefinableModel(Protocol):
    """A model that `refine` can simulate."""

    name: str
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, float]
    delay: float
    default_outputs: tuple[str, ...]
    """Outputs fitted by default."""
    drifting: tuple[str, ...]
    """States whose equations can have a constant added."""
    doubts: tuple[str, ...]
    """What makes any simulation of the model doubtful."""
    from_rest: bool
    """Whether outputs count from a reference, at which the recordings start."""

    def simulator(self, recording: Recording) -> Simulator:
        """Simulator of this recording."""

    def states_with_noise(self, outputs: Sequence[str]) -> tuple[str, ...]:
        """States whose process noise these outputs depend on."""

    def filter_predictor(self, recording: Recording, outputs: list[int]) -> FilterPredictor:
        """Predictor of these outputs of this recording."""

    def first_state(self, recording: Recording) -> np.ndarray:
        """(s,) states to start from where they are not estimated."""

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(m,) largest real part of the eigenvalues [1/s]; below zero where the motion is stable."""

    def held_errors(self, names: Sequence[str]) -> np.ndarray:
        """(k,) standard errors of parameters before the refinement; NaN where not known."""

    def refined(
        self, values: Mapping[str, float], covariance: np.ndarray, delay: float, method: str, recordings: Sequence[str]
    ) -> Any:
        """The model with parameters replaced, in the order of the rows of their covariance (k, k)."""
