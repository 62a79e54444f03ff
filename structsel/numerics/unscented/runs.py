"""Runs over whole recordings: a filter, or a filter and a smoother."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.kinematics import CIRCULAR
from structsel.numerics.unscented.kernel import backward, forward, keep
from structsel.numerics.unscented.problem import FilterResult, KinematicsProblem, SmootherResult

_NARROWEST, _WIDEST = 0.52, 1.93  # between them the centre's weight is not negative
_BLOCK = 4096  # samples whose gains are held at once
_MOST_BYTES = 100_000_000  # of covariances handed out
STEEP = "the pitch attitude comes too near the vertical"
"""Why a run breaks down in a loop."""


class _Run:
    """A forward pass in pieces, so that only one piece's gains are ever held."""

    def __init__(self, problem: KinematicsProblem, spread: float, gate: float):
        if spread and not _NARROWEST <= spread <= _WIDEST:
            raise DomainError(
                f"the spread of the sigma points must be 0 (linearise) or {_NARROWEST} to {_WIDEST}, not {spread:g}."
            )
        self.problem, self.spread, self.gate = problem, spread, gate
        n, L = len(problem.t), len(problem.active)
        self.full, self.S = problem.start.copy(), np.diag(problem.start_std).astype(float)
        self.waiting = np.zeros(12, dtype=np.int64)
        self.x, self.std = np.full((n, L), np.nan), np.full((n, L), np.nan)
        self.innovations, self.innovation_std = np.full((n, 12), np.nan), np.full((n, 12), np.nan)
        self.nis, self.used = np.full(n, np.nan), np.zeros(n, dtype=np.int64)
        self.rejected = np.zeros((n, 12), dtype=np.bool_)

    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.full.copy(), self.S.copy(), self.waiting.copy()

    def restore(self, state: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        self.full, self.S, self.waiting = (part.copy() for part in state)

    def advance(self, first: int, last: int, held: tuple[np.ndarray, ...] | None) -> tuple[float, int, int]:
        p, L = self.problem, len(self.problem.active)
        store = held is not None
        kept = held if held is not None else (np.empty((0, L)), np.empty((0, L, L)), np.empty((0, L, L)))
        return forward(  # type: ignore[call-arg]
            first,
            last,
            p.t,
            p.inputs,
            p.input_std,
            p.measurements,
            p.measurement_std,
            CIRCULAR,
            self.full,
            self.S,
            p.active,
            p.drift,
            p.place,
            p.flank,
            p.g,
            p.gust_time,
            p.located,
            self.spread,
            self.gate,
            self.waiting,
            self.x,
            self.std,
            self.innovations,
            self.innovation_std,
            self.nis,
            self.used,
            self.rejected,
            *kept,
            store,
        )

    def result(self, total: float, failed: int, why: int) -> FilterResult:
        return FilterResult(
            self.x,
            self.std,
            self.innovations,
            self.innovation_std,
            self.nis,
            self.used,
            self.rejected,
            total,
            failed,
            ("", STEEP, "the estimates are no longer finite")[why],
        )


def ukf_filter(problem: KinematicsProblem, *, spread: float = 1.0, gate: float = 0.0) -> FilterResult:
    """Filter a flight path, forward only; see `ukf_smoother` for the arguments.

    Half the work of `ukf_smoother`: what a search over noise levels or delays needs.
    """
    run = _Run(problem, spread, gate)
    return run.result(*run.advance(0, len(problem.t), None))


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
        Measurements further than so many standard deviations from their prediction are left out, up to 25 in a
        row; 0 leaves none out.

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
    edges = [1, *range(1 + _BLOCK, n, _BLOCK), n]
    blocks = list(pairwise(edges))
    alone = len(blocks) == 1
    size = min(_BLOCK, n)
    held = (np.empty((size, L)), np.empty((size, L, L)), np.empty((size, L, L)))
    total, failed, why = run.advance(0, 1, None)
    before = []
    for first, last in blocks:
        if failed >= 0:
            break
        before.append(run.state())
        more, failed, why = run.advance(first, last, held if alone else None)
        total += more
    filtered = run.result(total, failed, why)
    if failed >= 0:
        return filtered, None
    stride = max(1, -(-n * L * L * 8 // _MOST_BYTES))
    x, std = np.empty((n, L)), np.empty((n, L))
    covariance = np.empty((-(-n // stride), L, L))
    at, S = run.full[problem.active].copy(), run.S.copy()
    keep(n - 1, at, S, x, std, covariance, stride)
    for (first, last), state in zip(reversed(blocks), reversed(before)):
        if not alone:
            run.restore(state)
            run.advance(first, last, held)
        backward(first, last, at, S, run.x, *held, x, std, covariance, stride)
    return filtered, SmootherResult(x, std, covariance, np.arange(0, n, stride))
