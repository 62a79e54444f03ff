"""The model of least residual of every size, by branch and bound [FW74]."""

from __future__ import annotations

from structsel.numerics.best_subset import best_subset
from structsel.selection.methods.method import SearchProblem, SelectionMethod, VisitedModels


def search(problem: SearchProblem) -> VisitedModels:
    """All sizes, exactly."""
    options, constraints = problem.options, problem.constraints
    best = best_subset(
        problem.products,
        problem.dof,
        include=constraints.include,
        max_terms=options.max_terms,
        hierarchy=constraints.hierarchy,
    )
    models = [(subset.selected, subset.rss) for subset in best]
    return VisitedModels(models, models[-1], (), "every size searched")


BEST_SUBSET = SelectionMethod("best_subset", "Best subset of each size", search, "EBIC")
