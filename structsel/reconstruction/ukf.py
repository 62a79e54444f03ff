"""Unscented (or extended) Kalman filter and smoother over complete recordings.

The compiled filter and its equations are in `structsel.numerics.unscented_filter`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.kinematics import GUST, MEASUREMENTS, MOTION, STATES
from structsel.numerics.rotations import quaternion_of
from structsel.numerics.square_root import LARGEST_SPREAD, SMALLEST_SPREAD, sigma_points
from structsel.numerics.unscented_arrays import FilterOutput, FilterState, FlightData, workspace
from structsel.numerics.unscented_filter import COMPLETE, NOT_FINITE, filter_samples
from structsel.numerics.unscented_smoother import (
    SmootherOutput,
    SmootherSteps,
    smooth_samples,
    smoother_workspace,
    store_last,
)
from structsel.reconstruction.kinematics_problem import KinematicsProblem

_BLOCK_BYTES = 256_000_000  # of gains held at once: an hour at 50 Hz with 20 states; beyond it they are made twice
_MAX_BYTES = 100_000_000  # of covariances returned; chosen, not critical
# Standard deviation [rad] of attitude and flow angles below which sigma points are linear: their even part
# is half of this relative to the odd part, and the mean moves by as little of its own standard deviation.
_NARROW = 2e-3
_LEAST_ERROR = 1e-6  # rad, of the attitude at the start
_PHI, _THETA, _PSI = (STATES.index(name) for name in ("phi", "theta", "psi"))
_REASONS = {COMPLETE: "", NOT_FINITE: "the estimates are no longer finite"}


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
    """A filter run in blocks; only one block has its gains in memory."""

    def __init__(self, problem: KinematicsProblem, spread: float, gate: float):
        smallest, largest = SMALLEST_SPREAD, LARGEST_SPREAD
        if spread and not smallest <= spread <= largest:
            raise DomainError(
                f"the spread of the sigma points must be 0 (linearise) or {smallest} to {largest}, not {spread:g}."
            )
        p, n, M = problem, len(problem.t), len(MEASUREMENTS)
        states, constants = _internal_states(p)
        L = len(states)
        self.problem = problem
        self.data = FlightData(
            *(p.t, p.inputs, p.input_std, p.measurements, p.measurement_std, states, constants, p.drift, p.place),
            *(bool(p.flank), float(p.g), float(p.gust_time), p.located, float(gate), _NARROW),
        )
        self.points = sigma_points(spread, L)
        self.work = workspace(len(STATES), states, constants, p.drift, self.points.linear)
        start = p.start.astype(float)
        self.estimate = FilterState(
            *(start, np.array(quaternion_of(*start[3:6])), _start_root(p, states), np.zeros(M, dtype=np.int64))
        )
        self.output = FilterOutput(
            *(np.full((n, L), np.nan), np.full((n, L), np.nan), np.full((n, M), np.nan), np.full((n, M), np.nan)),
            nis=np.full(n, np.nan),
            used=np.zeros(n, dtype=np.int64),
            rejected=np.zeros((n, M), dtype=np.bool_),
            quaternion=np.full((n, 4), np.nan),
        )

    def steps(self, size: int) -> SmootherSteps:
        """Storage for the smoother's gains of so many samples."""
        L = len(self.data.states)
        m = L - self.data.constants
        # Gains of single precision move a smoothed state by 1e-7 of its standard deviation.
        single = np.empty((size, L, m), np.float32), np.empty((size, m, m), np.float32)
        return SmootherSteps(np.empty((size, m)), np.empty((size, 4)), np.empty(size, np.int64), *single)

    @property
    def block(self) -> int:
        """Samples whose gains are held at once."""
        return max(1, int(_BLOCK_BYTES // sum(part.nbytes for part in self.steps(1))))

    def copy_estimate(self) -> FilterState:
        full, quaternion, T, waiting = self.estimate
        return FilterState(full.copy(), quaternion.copy(), T.copy(), waiting.copy())

    def advance(self, first: int, last: int, steps: SmootherSteps) -> tuple[float, int, int]:
        arguments = (self.data, self.points, self.estimate, self.output, steps, self.work)
        return filter_samples(first, last, *arguments)  # type: ignore[no-any-return]

    def result(self, log_likelihood: float, failed: int, ending: int) -> FilterResult:
        o, columns = self.output, self.columns
        x = self.continuous(o.x[:, columns], o.quaternion)
        others = o.innovations, o.innovation_std, o.nis, o.used, o.rejected
        return FilterResult(x, o.std[:, columns], *others, log_likelihood, failed, _REASONS[ending])

    @property
    def columns(self) -> np.ndarray:
        """(L,) positions of the active states in the order of the filter."""
        order = {int(state): i for i, state in enumerate(self.data.states)}
        return np.array([order[int(state)] for state in self.problem.active], dtype=int)

    def continuous(self, x: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
        """Estimates (n, L) with continuous phi and psi that begin near those of the start; and theta, in a plane."""
        p = self.problem
        ends = np.flatnonzero(np.isnan(x[:, 0])) if len(x.T) else np.zeros(0, int)
        n = int(ends[0]) if ends.size else len(x)
        for j, state in enumerate(p.active):
            if state == _THETA and _in_symmetry_plane(p):
                a, b, c, d = quaternion[:n].T
                x[:n, j] = np.arctan2(2.0 * (a * c - b * d), 1.0 - 2.0 * (b * b + c * c))
            if n and (state in (_PHI, _PSI) or (state == _THETA and _in_symmetry_plane(p))):
                x[:n, j] = np.unwrap(x[:n, j])
                x[:n, j] += 2.0 * np.pi * np.round((p.start[state] - x[0, j]) / (2.0 * np.pi))
        return x


def _in_symmetry_plane(problem: KinematicsProblem) -> bool:
    """Whether the motion has no roll and yaw at all: theta is then continuous in a loop."""
    return _PHI not in problem.active and not problem.start[_PHI] and not problem.inputs[:, [3, 5]].any()


def _internal_states(problem: KinematicsProblem) -> tuple[np.ndarray, int]:
    """States of the filter, the constants without drift first, and their number."""
    active = [int(state) for state in np.sort(problem.active)]
    constant = [s for s in active if MOTION <= s < GUST and not problem.drift[s]]
    return np.array(constant + [s for s in active if s not in constant], dtype=np.int64), len(constant)


def _start_root(problem: KinematicsProblem, states: np.ndarray) -> np.ndarray:
    """(L, L) columns of the root of the initial covariance, as rows; errors of the attitude in earth axes."""
    std = dict(zip(problem.active.tolist(), problem.start_std.tolist()))
    root = np.diag([std[int(state)] for state in states])
    at = [int(i) for i in np.flatnonzero((states >= _PHI) & (states <= _PSI))]
    if at:
        st, ct = np.sin(problem.start[_THETA]), np.cos(problem.start[_THETA])
        sp, cp = np.sin(problem.start[_PSI]), np.cos(problem.start[_PSI])
        turned = np.array([[ct * cp, -sp, 0.0], [ct * sp, cp, 0.0], [-st, 0.0, 1.0]])
        rows, angles = states[at] - _PHI, np.diag(root)[at]
        # At the vertical one direction would have no error.
        part = np.c_[turned[np.ix_(rows, rows)] * angles, _LEAST_ERROR * np.eye(len(at))]
        factor: np.ndarray = np.linalg.qr(part.T, mode="r")  # type: ignore[assignment]
        root[np.ix_(at, at)] = factor.T
    return np.ascontiguousarray(root.T)


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
    (log_likelihood, failed, ending), smoothed = _forward_and_back(run)
    filtered = run.result(log_likelihood, failed, ending)
    if smoothed is None:
        return filtered, None
    output, turns = smoothed
    at = np.arange(0, len(problem.t), output.stride)
    return filtered, SmootherResult(run.continuous(output.x, turns), output.std, output.covariance, at)


def _forward_and_back(run: _Run) -> tuple[tuple[float, int, int], tuple[SmootherOutput, np.ndarray] | None]:
    """Log-likelihood, failed sample and end of the filter; output and quaternions of the smoother, if there are any."""
    n, L = len(run.problem.t), len(run.data.states)
    block = run.block
    blocks = list(pairwise([1, *range(1 + block, n, block), n]))
    single = len(blocks) == 1
    steps = run.steps(min(block, n))
    log_likelihood, failed, ending = run.advance(0, 1, run.steps(0))
    starts = []
    for first, last in blocks:
        if failed >= 0:
            break
        starts.append(run.copy_estimate())
        more, failed, ending = run.advance(first, last, steps if single else run.steps(0))
        log_likelihood += more
    ended = log_likelihood, failed, ending
    if failed >= 0:
        return ended, None
    stride = max(1, -(-n * L * L * 8 // _MAX_BYTES))
    wanted = len(run.problem.active)
    place = np.full(L, -1)
    place[run.columns] = np.arange(wanted)
    covariance = np.empty((-(-n // stride), wanted, wanted))
    output = SmootherOutput(place, np.empty((n, wanted)), np.empty((n, wanted)), covariance, stride)
    states, f = run.data.states, run.data.constants
    x, quaternion, T = run.output.x[-1].copy(), run.estimate.quaternion.copy(), run.estimate.T.copy()
    work = smoother_workspace(L, f)
    turns = np.empty((n, 4))
    store_last(states, x, quaternion, T, output)
    turns[-1] = quaternion
    for (first, last), start in zip(reversed(blocks), reversed(starts)):
        if not single:
            run.estimate = start
            run.advance(first, last, steps)
        filter_x, filter_turns = run.output.x, run.output.quaternion
        smooth_samples(first, last, f, states, x, quaternion, T, filter_x, filter_turns, turns, steps, work, output)
    return ended, (output, turns)
