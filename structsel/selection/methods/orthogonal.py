"""Orthogonal functions, ranked by the reduction of the cost; PSE decides how many [H17], [M95]."""

from __future__ import annotations

from structsel.numerics.orthogonal import orthogonal
from structsel.selection.methods.method import SearchProblem, SelectionMethod, VisitedModels, visited_on

RANK_AT_FIRST = 100  # orthogonal functions
NEARLY_ALL = 0.8  # of those ranked: where the search ends later than this, all are ranked


def search(problem: SearchProblem) -> VisitedModels:
    """Rank far enough: on to the last only if PSE is still falling where the ranked ones end."""
    options, include = problem.options, problem.constraints.include
    most = min(problem.n_candidates, options.max_terms or problem.n_candidates)
    first = most if options.order == "given" else min(most, max(RANK_AT_FIRST, len(include)))
    for limit in (first, most):
        path = orthogonal(
            problem.products,
            problem.dof,
            sigma_max2=problem.sigma_max2,
            order=options.order,
            include=include,
            max_terms=limit,
        )
        if len(path.selected) < NEARLY_ALL * limit:
            break
    return visited_on(path)


ORTHOGONAL = SelectionMethod("orthogonal", "Orthogonal functions, ranked", search, "PSE", options=("order",))
