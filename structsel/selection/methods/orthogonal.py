"""Orthogonal functions, ranked by the reduction of the cost; a criterion decides how many [H17], [M95]."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from structsel.numerics import criteria
from structsel.numerics.orthogonal import OrthogonalPath, orthogonal
from structsel.numerics.stepwise import refine_subset
from structsel.selection.methods.method import PAIRS_UP_TO, SearchProblem, SelectionMethod, VisitedModels, visited_on

RANK_AT_FIRST = 100  # orthogonal functions
ROUNDING = 1e-12  # of the response's sum of squares: a residual below it is rounding
NEARLY_ALL = 0.8  # of those ranked: where the search ends later than this, all are ranked


def search(problem: SearchProblem) -> VisitedModels:
    """Rank as many as a model may have; for PSE on to the last if it is still falling where those end."""
    options, include = problem.options, problem.constraints.include
    size = problem.constraints.degrees.size
    limit = min(size, options.max_terms or size)
    first = limit if options.order == "given" else min(limit, max(RANK_AT_FIRST, len(include)))
    by_pse = options.criterion_used == "PSE"
    for length in (first, limit) if by_pse else (first,):
        path = orthogonal(
            problem.products,
            problem.dof,
            sigma_max2=problem.sigma_max2 if by_pse else 0.0,  # without a price of terms the path goes to its end
            order=options.order,
            include=include,
            max_terms=length,
            hierarchy=problem.constraints.hierarchy,
        )
        if len(path.selected) < NEARLY_ALL * length:
            break
    refined = options.criterion_used == "EBIC" and options.order == "greedy"
    return _refined(path, problem) if refined else visited_on(path)


def _refined(path: OrthogonalPath, problem: SearchProblem) -> VisitedModels:
    """The path to its least extended BIC, and then one or two terms in, out or exchanged while that falls.

    A function that is ranked early stays on the path when later ones explain what it stood for.
    """
    n, p = problem.dof + 1.0, problem.n_candidates
    visited = visited_on(path)
    rss = np.maximum([rss for _, rss in visited.models], ROUNDING * problem.tss)
    best = int(np.argmin(criteria.ebic(rss, n, np.arange(rss.size), p)))
    price = (np.log(n) + np.log(p)) * problem.dof / n
    begin = visited.models[best][0]
    better = refine_subset(
        problem.products,
        problem.dof,
        begin,
        price,
        include=problem.constraints.include,
        max_terms=problem.options.max_terms,
        depth=2 if len(begin) <= PAIRS_UP_TO else 1,
        hierarchy=problem.constraints.hierarchy,
    )
    steps = (*path.steps[:best], *better.steps[len(begin) :])
    return visited_on(replace(path, steps=steps, selected=better.selected, rss=better.rss))


ORTHOGONAL = SelectionMethod("orthogonal", "Orthogonal functions, ranked", search, "EBIC", options=("order",))
