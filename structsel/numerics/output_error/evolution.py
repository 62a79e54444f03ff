"""Everywhere between bounds: differential evolution, a generation flown as one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize

from structsel.errors import DomainError
from structsel.numerics.output_error.records import Constraint, Predict, Records

_UNFLYABLE = 1e12  # cost of what cannot be flown, and more the sooner it is lost
_FORBIDDEN = 1e15  # cost of what the constraint forbids, and more the further


@dataclass(frozen=True)
class GlobalSearch:
    """The best of an evolution.

    Attributes
    ----------
    theta : (k,) array
    cost : float
        Infinite where no parameter set could be flown.
    costs : (g,) array
        Best of each generation.
    evaluations : int
        Parameter sets flown.
    message : str
        How the search ended.
    members : (p, k) array
        The last generation as far as it flies, the best first.
    """

    theta: np.ndarray
    cost: float
    costs: np.ndarray
    evaluations: int
    message: str
    members: np.ndarray


def search_globally(
    predict: Predict | Sequence[Predict],
    y: np.ndarray | Sequence[np.ndarray],
    bounds: np.ndarray,
    *,
    start: np.ndarray | None = None,
    R: np.ndarray | None = None,
    cost: Literal["ml", "weighted"] = "ml",
    full: bool = False,
    constraint: Constraint | None = None,
    seed: int = 0,
    population: int = 8,
    generations: int = 200,
    tolerance: float = 1e-3,
    progress: Callable[[int, float], None] | None = None,
) -> GlobalSearch:
    """Parameters with about the least output error anywhere between bounds.

    Parameter sets that blow up are ranked by how long they flew and those the constraint forbids by how far they
    are from it, so that a population that starts there finds its way out.

    Parameters
    ----------
    predict, y, R, cost, full
        As `Records` takes them.
    bounds : (k, 2) array
        Finite.
    start : (k,) array, optional
        A member of the first generation.
    constraint : Constraint, optional
    seed : int
    population : int
        Members per parameter.
    generations : int
        Most of them.
    tolerance : float
        Ends where the costs' spread falls below this share of their mean size.
    progress : callable, optional
        Called with the generation's number and its best cost.

    Raises
    ------
    DomainError
        Bounds that are infinite or cross.

    References
    ----------
    [A10], with a genetic algorithm for the same office.
    """
    limits = np.asarray(bounds, dtype=float)
    if limits.ndim != 2 or limits.shape[1] != 2 or not np.isfinite(limits).all() or (np.diff(limits) <= 0.0).any():
        raise DomainError("a global search needs finite bounds of every parameter, the lower first.")
    records = Records(predict, y, R=R, cost=cost, full=full)
    history: list[float] = []
    flown = [0]

    def judge(columns: np.ndarray) -> np.ndarray:
        thetas = np.atleast_2d(columns.T)
        flown[0] += len(thetas)
        found = np.full(len(thetas), np.inf)
        margin = np.zeros(len(thetas))
        if constraint is not None:
            margin = np.minimum(np.min(np.reshape(constraint(thetas), (len(thetas), -1)), axis=1), 0.0)
        inside = margin >= 0.0
        if inside.any():
            costs, lost = records.costs(thetas[inside])
            found[inside] = np.where(np.isfinite(costs), np.minimum(costs, _UNFLYABLE), _UNFLYABLE * (1.0 + lost))
        found[~inside] = _FORBIDDEN * (1.0 - np.maximum(margin[~inside], -1e6))
        return found

    def report(intermediate_result: optimize.OptimizeResult) -> None:
        history.append(float(intermediate_result.fun))
        if progress is not None:
            progress(len(history), history[-1])

    with np.errstate(all="ignore"):  # its own measure of spread overflows where all members are forbidden
        result = optimize.differential_evolution(
            judge, limits, vectorized=True, updating="deferred", polish=False, seed=seed, popsize=population,
            maxiter=generations, tol=tolerance, callback=report, x0=start, init="sobol",
        )  # fmt: skip
    least = float(result.fun) if result.fun < _UNFLYABLE else np.inf
    order = np.argsort(result.population_energies, kind="stable")
    members = np.array(result.population)[order[result.population_energies[order] < _UNFLYABLE]]
    return GlobalSearch(np.array(result.x), least, np.array(history), flown[0], str(result.message), members)
