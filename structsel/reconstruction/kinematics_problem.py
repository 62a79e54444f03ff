"""Input of the flight-path filters: a recording and its settings as arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.numerics.kinematics import CIRCULAR, readings, slopes


@dataclass(frozen=True)
class KinematicsProblem:
    """Input of the filter, as arrays; n samples, L active states.

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
    start : (34,) array
        As `kinematics.STATES`: estimates at the first sample, before its measurements are used.
    start_std : (L,) array
        Their standard deviations, for the active states.
    active : (L,) int array
        Estimated states, ascending; the others keep their initial value, except for the motion.
    drift : (34,) array
        Random walk of the constants [unit / sqrt(s)]; 0 for true constants.
    place : (6, 3) array [m]
        Rows as `kinematics.PLACES`.
    flank : bool
        The sideslip vane reads atan(v/u).
    g : float [m/s^2]
    gust_time : float [s]
        Correlation time of the gusts, which `drift` excites.
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

    def with_states(self, states: np.ndarray) -> KinematicsProblem:
        """Problem in which only some of the active states, an (L,) bool array, are estimated."""
        return replace(self, active=self.active[states], start_std=self.start_std[states])

    def path(self, x: np.ndarray) -> np.ndarray:
        """(n, 34) full vectors with the active states x (n, L), the others at their initial value."""
        full = np.tile(self.start, (len(x), 1))
        full[:, self.active] = x
        return full

    def predict(self, path: np.ndarray) -> np.ndarray:
        """(n, 12) measurements along a path (n, 34) of ideal instruments."""
        return readings(path, self.inputs, self.place, self.flank)

    def slopes(self, path: np.ndarray) -> np.ndarray:
        """(n, 9) derivatives of the motion along a path (n, 34)."""
        return slopes(path, self.inputs, self.place, self.g)

    def residuals(self, predicted: np.ndarray) -> np.ndarray:
        """(n, 12) measured minus predicted; angles that wrap are reduced to half a turn."""
        difference = self.measurements - predicted
        angles = difference[:, CIRCULAR]
        turns = np.where(np.isfinite(angles), np.round(angles / (2.0 * np.pi)), 0.0)
        difference[:, CIRCULAR] = angles - 2.0 * np.pi * turns
        return difference

    def integrated_heading(self, path: np.ndarray) -> np.ndarray:
        """(n,) heading [rad] from the body rates along a path (n, 34), from its initial value."""
        path = path.copy()
        path[:, 5] = self.start[5]
        return self.start[5] + scipy.integrate.cumulative_trapezoid(self.slopes(path)[:, 5], self.t, initial=0.0)
