"""What a run needs and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class KinematicsProblem:
    """Everything a filter run needs, as arrays; n samples, L active states.

    Attributes
    ----------
    t : (n,) array [s]
    inputs : (n, 9) array
        Columns as `kinematics.INPUTS`; finite.
    input_std : (n, 6) array
        Standard deviation of the noise on ax ay az p q r, sample by sample.
    measurements : (n, 12) array
        Columns as `kinematics.MEASUREMENTS`; NaN where not sampled.
    measurement_std : (12,) array
    start : (26,) array
        As `kinematics.STATES`: estimates at the first sample, before its measurements are used.
    start_std : (L,) array
        Their standard deviations, for the active states.
    active : (L,) int array
        The states estimated, ascending; the others keep their start (the motion still moves).
    drift : (26,) array
        Random walk of the constants [unit / sqrt(s)]; 0 for true constants.
    place : (6, 3) array [m]
        Rows as `kinematics.PLACES`.
    flank : bool
        The sideslip vane reads atan(v/u).
    g : float [m/s^2]
    gust_time : float [s]
        In which a gust dies away to 1/e; its `drift` feeds it.
    """

    t: np.ndarray
    inputs: np.ndarray
    input_std: np.ndarray
    measurements: np.ndarray
    measurement_std: np.ndarray
    start: np.ndarray
    start_std: np.ndarray
    active: np.ndarray
    drift: np.ndarray
    place: np.ndarray
    flank: bool
    g: float
    gust_time: float = np.inf

    @property
    def located(self) -> bool:
        """Whether the position x, y is among the active states."""
        return bool(np.any((self.active == 6) | (self.active == 7)))

    def rows(self, first: int, last: int) -> KinematicsProblem:
        """Problem of samples first to last - 1; the start is left as it is."""
        kept = slice(first, last)
        return replace(
            self,
            t=self.t[kept],
            inputs=self.inputs[kept],
            input_std=self.input_std[kept],
            measurements=self.measurements[kept],
        )

    def keeping(self, states: np.ndarray) -> KinematicsProblem:
        """Problem in which of the active states only these, an (L,) bool array, are estimated."""
        return replace(self, active=self.active[states], start_std=self.start_std[states])

    def path(self, x: np.ndarray) -> np.ndarray:
        """(n, 26) full vectors with the active states at x (n, L), the others at their start."""
        full = np.tile(self.start, (len(x), 1))
        full[:, self.active] = x
        return full


@dataclass(frozen=True)
class FilterResult:
    """A filter run.

    Attributes
    ----------
    x, std : (n, L) array
        Estimates of the active states from the samples so far, and their standard deviations.
    innovations, innovation_std : (n, 12) array
        Measured less predicted, and the standard deviation predicted for it; NaN where not sampled.
    nis : (n,) array [-]
        Normalised innovation squared of each sample; NaN where nothing was measured.
    used : (n,) int array
        Measurements used at each sample.
    rejected : (n, 12) bool array
        Measurements outside the gate.
    log_likelihood : float
        Of the innovations used.
    failed : int
        -1, or the sample at which the run broke down.
    reason : str
        Why it did.
    """

    x: np.ndarray
    std: np.ndarray
    innovations: np.ndarray
    innovation_std: np.ndarray
    nis: np.ndarray
    used: np.ndarray
    rejected: np.ndarray
    log_likelihood: float
    failed: int
    reason: str


@dataclass(frozen=True)
class SmootherResult:
    """A smoother run.

    Attributes
    ----------
    x, std : (n, L) array
        Estimates of the active states from all samples, and their standard deviations.
    covariance : (c, L, L) array
        At the samples `at`.
    at : (c,) int array
    """

    x: np.ndarray
    std: np.ndarray
    covariance: np.ndarray
    at: np.ndarray
