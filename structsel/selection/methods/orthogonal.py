"""Orthogonal functions, ranked by the reduction of the cost; a criterion decides how many [H17], [M95]."""

from __future__ import annotations

from structsel.numerics.orthogonal import orthogonal
from structsel.selection.methods.method import SearchProblem, SelectionMethod, VisitedModels, visited_on

RANK_AT_FIRST = 100  # orthogonal functions
NEARLY_ALL = 0.8  # of those ranked: where the search ends later than this, all are ranked


def search(problem: SearchProblem) -> VisitedModels:
    """Rank as many as a model may have; for PSE on to the last if it is still falling where those end."""
    options, include = problem.options, problem.constraints.include
    most = min(problem.n_candidates, options.max_terms or problem.n_candidates)
    first = most if options.order == "given" else min(most, max(RANK_AT_FIRST, len(include)))
    by_pse = options.criterion_used == "PSE"
    for limit in (first, most) if by_pse else (first,):
        path = orthogonal(
            problem.products,
            problem.dof,
            sigma_max2=problem.sigma_max2 if by_pse else 0.0,  # without a price of terms the path goes to its end
            order=options.order,
            include=include,
            max_terms=limit,
            hierarchy=problem.constraints.hierarchy,
        )
        if len(path.selected) < NEARLY_ALL * limit:
            break
    return visited_on(path)


ORTHOGONAL = SelectionMethod("orthogonal", "Orthogonal functions, ranked", search, "EBIC", options=("order",))
