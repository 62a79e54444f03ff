"""Unscented (or extended) Kalman filter and smoother over complete recordings.

The compiled filter and its equations are in `structsel.numerics.unscented_filter`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.numerics import unscented_filter as kernel
from structsel.numerics.kinematics import CIRCULAR, MEASUREMENTS, STATES, readings, slopes
from structsel.numerics.square_root import LARGEST_SPREAD, SMALLEST_SPREAD, sigma_points
from structsel.numerics.unscented_smoother import (
    SmootherOutput,
    SmootherSteps,
    last_smoothed,
    smooth_samples,
    store_smoothed,
)

_BLOCK = 4096  # samples whose gains are held at once: 30 MB with 21 states; chosen, not critical
_MAX_BYTES = 100_000_000  # of covariances returned; chosen, not critical
STEEP = "the pitch attitude comes too near the vertical"
"""Reason of a failure in a loop."""
_REASONS = {kernel.COMPLETE: "", kernel.STEEP: STEEP, kernel.NOT_FINITE: "the estimates are no longer finite"}


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
        turns = np.where(CIRCULAR & np.isfinite(difference), np.round(difference / (2.0 * np.pi)), 0.0)
        return difference - 2.0 * np.pi * turns

    def integrated_heading(self, path: np.ndarray) -> np.ndarray:
        """(n,) heading [rad] from the body rates along a path (n, 34), from its initial value."""
        path = path.copy()
        path[:, 5] = self.start[5]
        return self.start[5] + scipy.integrate.cumulative_trapezoid(self.slopes(path)[:, 5], self.t, initial=0.0)


@dataclass(frozen=True)
class FilterResult:
    """A filter run.

    Attributes
    ----------
    x, std : (n, L) array
        Estimates of the active states from the samples so far, and their standard deviations.
    innovations, innovation_std : (n, 12) array
        Measured minus predicted, and the predicted standard deviation of this; NaN where not sampled.
    nis : (n,) array [-]
        Normalised innovation squared of each sample; NaN without a measurement.
    used : (n,) int array
        Measurements used at each sample.
    rejected : (n, 12) bool array
        Measurements outside the gate.
    log_likelihood : float
        Of the innovations used.
    failed : int
        Sample at which the filter failed, or -1.
    reason : str
        Reason of the failure.
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


class _Run:
    """A filter run in blocks, of which only one has its gains in memory."""

    def __init__(self, problem: KinematicsProblem, spread: float, gate: float):
        smallest, largest = SMALLEST_SPREAD, LARGEST_SPREAD
        if spread and not smallest <= spread <= largest:
            raise DomainError(
                f"the spread of the sigma points must be 0 (linearise) or {smallest} to {largest}, not {spread:g}."
            )
        p, n, L, M = problem, len(problem.t), len(problem.active), len(MEASUREMENTS)
        self.data = kernel.FlightData(
            *(p.t, p.inputs, p.input_std, p.measurements, p.measurement_std, p.active, p.drift, p.place),
            *(bool(p.flank), float(p.g), float(p.gust_time), p.located, float(gate)),
        )
        self.points = sigma_points(spread, L)
        self.work = kernel.workspace(len(STATES), p.active, p.drift, self.points.linear)
        self.estimate = kernel.FilterState(
            p.start.astype(float), np.diag(p.start_std).astype(float), np.zeros(M, dtype=np.int64)
        )
        self.output = kernel.FilterOutput(
            *(np.full((n, L), np.nan), np.full((n, L), np.nan), np.full((n, M), np.nan), np.full((n, M), np.nan)),
            nis=np.full(n, np.nan),
            used=np.zeros(n, dtype=np.int64),
            rejected=np.zeros((n, M), dtype=np.bool_),
        )

    def steps(self, size: int) -> SmootherSteps:
        """Storage for the smoother's gains of so many samples."""
        L, moving = len(self.data.active), self.work.moving
        constants, m = np.setdiff1d(np.arange(L), moving), len(moving)
        storage = np.empty((size, L)), np.empty((size, m, L)), np.empty((size, m, m))
        return SmootherSteps(np.concatenate([constants, moving]), len(constants), *storage)

    def copy_estimate(self) -> kernel.FilterState:
        full, S, waiting = self.estimate
        return kernel.FilterState(full.copy(), S.copy(), waiting.copy())

    def advance(self, first: int, last: int, steps: SmootherSteps) -> tuple[float, int, int]:
        arguments = (self.data, self.points, self.estimate, self.output, steps, self.work)
        return kernel.filter_samples(first, last, *arguments)  # type: ignore[no-any-return]

    def result(self, log_likelihood: float, failed: int, ending: int) -> FilterResult:
        return FilterResult(*self.output, log_likelihood, failed, _REASONS[ending])  # type: ignore[arg-type]


def ukf_filter(problem: KinematicsProblem, *, spread: float = 1.0, gate: float = 0.0) -> FilterResult:
    """Filter a flight path, forward only; see `ukf_smoother` for the arguments.

    It takes half the time of `ukf_smoother`, and is enough for a search over noise levels or delays.
    """
    run = _Run(problem, spread, gate)
    return run.result(*run.advance(0, len(problem.t), run.steps(0)))


def negative_log_likelihood(problem: KinematicsProblem) -> float:
    """Minus the log-likelihood of the innovations of an extended Kalman filter; large if the filter fails."""
    run = ukf_filter(problem, spread=0.0)
    return 1e12 if run.failed >= 0 else -run.log_likelihood


def ukf_smoother(
    problem: KinematicsProblem, *, spread: float = 1.0, gate: float = 0.0
) -> tuple[FilterResult, SmootherResult | None]:
    """Filter a flight path forward and smooth it backward (Rauch, Tung and Striebel).

    Parameters
    ----------
    problem : KinematicsProblem
    spread : float [-]
        Of the sigma points, a in the module's equations; 0 for the extended Kalman filter.
    gate : float [-]
        Measurements farther than this from their prediction, in standard deviations, are not used, up to 25 in a
        row; 0 uses all.

    Returns
    -------
    filtered : FilterResult
    smoothed : SmootherResult or None
        None where the filter failed.

    Raises
    ------
    DomainError
        A spread for which a weight would be negative.
    """
    run = _Run(problem, spread, gate)
    n, L = len(problem.t), len(problem.active)
    blocks = list(pairwise([1, *range(1 + _BLOCK, n, _BLOCK), n]))
    single = len(blocks) == 1
    steps = run.steps(min(_BLOCK, n))
    log_likelihood, failed, ending = run.advance(0, 1, run.steps(0))
    starts = []
    for first, last in blocks:
        if failed >= 0:
            break
        starts.append(run.copy_estimate())
        more, failed, ending = run.advance(first, last, steps if single else run.steps(0))
        log_likelihood += more
    filtered = run.result(log_likelihood, failed, ending)
    if failed >= 0:
        return filtered, None
    stride = max(1, -(-n * L * L * 8 // _MAX_BYTES))
    output = SmootherOutput(np.empty((n, L)), np.empty((n, L)), np.empty((-(-n // stride), L, L)), stride)
    x, S = last_smoothed(run.estimate.full[problem.active], run.estimate.S, steps)
    store_smoothed(n - 1, x, S, steps.order, output)
    for (first, last), start in zip(reversed(blocks), reversed(starts)):
        if not single:
            run.estimate = start
            run.advance(first, last, steps)
        smooth_samples(first, last, x, S, run.output.x, steps, output)
    return filtered, SmootherResult(output.x, output.std, output.covariance, np.arange(0, n, stride))
