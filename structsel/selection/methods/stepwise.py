"""Modified stepwise regression by partial F [C89], [TP1916]."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from structsel.numerics.cluster_stepwise import cluster_stepwise, samples_per_independent_sample
from structsel.numerics.search_path import SearchPath
from structsel.numerics.stepwise import refine_subset, stepwise
from structsel.selection.methods.method import (
    PAIRS_UP_TO,
    SearchProblem,
    SelectionMethod,
    VisitedModels,
    thresholds,
    visited_on,
)

ROUNDING = 1e-12  # of the response's sum of squares: a residual below it is rounding, and no model is better for it


def search(problem: SearchProblem) -> VisitedModels:
    """Moves of single terms, then exchanges of pairs."""
    return visited_on(_between_blocks(problem) if problem.blocks else _between_samples(problem))


def _between_samples(problem: SearchProblem) -> SearchPath:
    """F-tests take samples as independent."""
    options, constraints = problem.options, problem.constraints
    F_in, F_out, entry = thresholds(options, problem.n_candidates, problem.dof)
    path = stepwise(
        problem.products,
        problem.dof,
        F_in=F_in,
        F_out=F_out,
        include=constraints.include,
        initial=constraints.initial,
        max_terms=options.max_terms,
        min_gain=_least_gain(problem),
        entry_thresholds=entry,
        hierarchy=constraints.hierarchy,
    )
    if constraints.hierarchy is not None:
        return path
    return _refined(path, problem, F_in) if options.stopping_rule == "F" and entry is None else path


def _least_gain(problem: SearchProblem) -> float:
    """Fraction of the sum of squares that an entering term must explain, besides its F."""
    if problem.options.stopping_rule == "R2":
        return float(problem.options.min_r2_gain)
    if problem.options.stopping_rule == "PSE" and problem.sigma_max2 is not None:
        return problem.sigma_max2 / problem.tss
    return 0.0


def _refined(path: SearchPath, problem: SearchProblem, F_in: float) -> SearchPath:
    """Escape where one term replaces two, or two replace one, which exchanges of single terms cannot."""
    if len(path.selected) > PAIRS_UP_TO:
        return path
    include, limit = problem.constraints.include, problem.options.max_terms
    better = refine_subset(problem.products, path.dof, path.selected, F_in, include=include, max_terms=limit)
    moves = better.steps[len(path.selected) :]
    return replace(better, steps=(*path.steps, *moves), stopped=path.stopped) if moves else path


def _between_blocks(problem: SearchProblem) -> SearchPath:
    """F-tests take the scatter between blocks; from no term and from the linear terms, the better of the two.

    Early on, when most of the response is unexplained, a product can pass for the linear term it resembles, and no
    single move undoes several of those.
    """
    assert problem.blocks is not None
    products, weights = problem.blocks
    options, constraints, dof = problem.options, problem.constraints, problem.dof
    F_in, F_out, _ = thresholds(options, products.n_candidates, dof, by_blocks=True)
    linear = tuple(int(j) for j in np.flatnonzero(constraints.degrees == 1))
    starts = [constraints.initial] if constraints.initial else list(dict.fromkeys([(), linear]))
    paths = [
        cluster_stepwise(
            products,
            weights,
            dof,
            F_in=F_in,
            F_out=F_out,
            include=constraints.include,
            initial=initial,
            max_terms=options.max_terms,
            hierarchy=constraints.hierarchy,
        )
        for initial in starts
    ]
    n = dof / max(samples_per_independent_sample(products, weights, path.selected, dof) for path in paths)
    distinct = {frozenset(path.selected): path for path in reversed(paths)}  # of the same terms the first, not rounding
    return min(
        distinct.values(),
        key=lambda p: n * np.log(max(p.rss, ROUNDING * p.tss)) + len(p.selected) * np.log(max(n, 2.0)),
    )


STEPWISE = SelectionMethod(
    "stepwise",
    "Modified stepwise regression",
    search,
    options=("F_in", "F_out", "initial_terms", "stopping_rule", "min_r2_gain"),
    cluster_robust=True,
)
