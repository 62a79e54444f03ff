"""Global search for the least output error: differential evolution, a generation simulated as one batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.numerics.output_error_problem import OutputErrorProblem

_DIVERGED = 1e12  # cost of a simulation that diverges; larger if it diverges earlier
_FORBIDDEN = 1e15  # cost of a set that violates the constraint; it increases with the violation


@dataclass(frozen=True)
class GlobalSearch:
    """Best parameters of a differential evolution.

    Attributes
    ----------
    theta : (k,) array
    cost : float
        Infinite if the simulation diverges with every parameter set.
    costs : (g,) array
        Least cost of each generation.
    evaluations : int
        Parameter sets simulated.
    message : str
        How the search ended.
    members : (p, k) array
        Last generation without sets that diverge, the best first.
    """

    theta: np.ndarray
    cost: float
    costs: np.ndarray
    evaluations: int
    message: str
    members: np.ndarray


def search_globally(
    problem: OutputErrorProblem,
    *,
    start: np.ndarray | None = None,
    seed: int = 0,
    population: int = 8,
    generations: int = 200,
    tolerance: float = 1e-3,
    progress: Callable[[int, float], None] | None = None,
) -> GlobalSearch:
    """Parameters with about the least output error between bounds.

    Parameter sets that diverge are ranked by the time of divergence, and those that violate the constraint by the
    size of the violation. So the search can start from a population of such sets.

    Parameters
    ----------
    problem : OutputErrorProblem
        With finite bounds.
    start : (k,) array, optional
        A member of the first generation.
    seed : int
    population : int
        Members per parameter.
    generations : int
        Maximum number.
    tolerance : float
        Converged if the standard deviation of the costs is below this fraction of their mean.
    progress : callable, optional
        Called with the number of the generation and its least cost.

    Raises
    ------
    DomainError
        Bounds that are infinite, or a lower bound not below the upper one.

    References
    ----------
    [A10], where a genetic algorithm does this.
    """
    bounds = np.empty(0) if problem.bounds is None else problem.bounds
    if bounds.ndim != 2 or bounds.shape[1] != 2 or not np.isfinite(bounds).all() or (np.diff(bounds) <= 0.0).any():
        raise DomainError("a global search needs finite bounds of every parameter, the lower first.")
    history: list[float] = []
    simulated = [0]

    def cost_of(columns: np.ndarray) -> np.ndarray:
        thetas = np.atleast_2d(columns.T)
        simulated[0] += len(thetas)
        cost = np.full(len(thetas), np.inf)
        margin = np.zeros(len(thetas))
        if problem.constraint is not None:
            margin = np.minimum(np.min(np.reshape(problem.constraint(thetas), (len(thetas), -1)), axis=1), 0.0)
        inside = margin >= 0.0
        if inside.any():
            finite, lost = problem.costs(thetas[inside])
            cost[inside] = np.where(np.isfinite(finite), np.minimum(finite, _DIVERGED), _DIVERGED * (1.0 + lost))
        cost[~inside] = _FORBIDDEN * (1.0 - np.maximum(margin[~inside], -1e6))
        return cost

    def report(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        history.append(float(intermediate_result.fun))
        if progress is not None:
            progress(len(history), history[-1])

    with np.errstate(all="ignore"):  # scipy's convergence measure overflows where all members are forbidden
        result = scipy.optimize.differential_evolution(
            cost_of, bounds, vectorized=True, updating="deferred", polish=False, seed=seed, popsize=population,
            maxiter=generations, tol=tolerance, callback=report, x0=start, init="sobol",
        )  # fmt: skip
    least = float(result.fun) if result.fun < _DIVERGED else np.inf
    order = np.argsort(result.population_energies, kind="stable")
    members = np.array(result.population)[order[result.population_energies[order] < _DIVERGED]]
    return GlobalSearch(np.array(result.x), least, np.array(history), simulated[0], str(result.message), members)
