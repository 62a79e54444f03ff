"""What a selection method is, what it is given to search, and what it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics import criteria
from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.search_path import SearchPath, SearchStep

PAIRS_UP_TO = 40  # terms; exchanges of pairs in a larger model cost more than they have ever brought

Model = tuple[tuple[int, ...], float]
"""Candidates in a model, and its residual sum of squares."""


@dataclass(frozen=True)
class SearchConstraints:
    """Constraints on the candidates of the search.

    Attributes
    ----------
    degrees : (p,) int array
        Of two aliased terms the one of lower degree is kept.
    include, initial : tuple of int
        Always in the model; in it at the start.
    hierarchy : Hierarchy, optional
        Parents that a term needs; None: any model may be chosen.
    """

    degrees: NDArray[np.integer]
    include: tuple[int, ...] = ()
    initial: tuple[int, ...] = ()
    hierarchy: Hierarchy | None = None

    def allow(self, model: Iterable[int]) -> bool:
        """Whether the search may choose a model."""
        return self.hierarchy is None or self.hierarchy.allows(model)

    def of_candidates(self, numbers: NDArray[np.integer]) -> SearchConstraints:
        """The same among some of the candidates, in their order."""
        place = {int(j): i for i, j in enumerate(numbers)}
        return SearchConstraints(
            self.degrees[numbers],
            tuple(place[j] for j in self.include),
            tuple(place[j] for j in self.initial if j in place),
            None if self.hierarchy is None else self.hierarchy.of_candidates(numbers),
        )


@dataclass(frozen=True)
class SearchProblem:
    """Cross-products to be searched, and how.

    Attributes
    ----------
    products : (p + 1, p + 1) array
        Centred, of candidates and response.
    dof : float
        Samples less one.
    options : SelectOptions
    constraints : SearchConstraints
    n_candidates : int
        Candidates among which those of the products were found, on which thresholds depend.
    sigma_max2 : float, optional
        Bound of the squared prediction error, where the criterion or the stopping rule is PSE.
    blocks : (CrossProducts, weights), optional
        The blocks behind the products, where F-tests take the scatter between them.
    """

    products: Array
    dof: float
    options: Any
    constraints: SearchConstraints
    n_candidates: int
    sigma_max2: float | None = None
    blocks: tuple[CrossProducts, Array | None] | None = None

    @property
    def tss(self) -> float:
        """Sum of squares of the response about its mean."""
        return float(self.products[-1, -1])


@dataclass(frozen=True)
class VisitedModels:
    """Models that a method visited.

    Attributes
    ----------
    models : sequence of (candidates, rss)
    last : (candidates, rss)
        Where the search ended: the selection, if no criterion chooses among the models.
    steps : tuple of SearchStep
        Moves of the search.
    stop_reason : str
    """

    models: Sequence[Model]
    last: Model
    steps: tuple[SearchStep, ...]
    stop_reason: str


@dataclass(frozen=True)
class SelectionMethod:
    """A way to search for the terms of a model.

    Attributes
    ----------
    name : str
        Value of the option ``method``.
    heading : str
        What reports and help call it.
    search : callable
        From a `SearchProblem` to `VisitedModels`.
    default_criterion : str, optional
        Chooses among the models visited, where no criterion is given; None: the search itself decides.
    options : tuple of str
        Fields of `SelectOptions` that this method reads and others need not.
    cluster_robust : bool
        Whether the search can take F-tests from the scatter between blocks. Other methods then choose by
        cross-validation.
    """

    name: str
    heading: str
    search: Callable[[SearchProblem], VisitedModels]
    default_criterion: str | None = None
    options: tuple[str, ...] = ()
    cluster_robust: bool = False


def visited_on(path: SearchPath) -> VisitedModels:
    """Every model along a path of moves, from the constant alone."""
    inside: list[int] = []
    models: list[Model] = [((), path.tss)]
    for step in path.steps:
        if step.action in ("enter", "swap"):
            inside.append(step.index)
        if step.action in ("leave", "swap"):
            inside.remove(step.index if step.action == "leave" else step.other)
        if step.action != "refuse":
            models.append((tuple(inside), step.rss))
    return VisitedModels(models, (path.selected, path.rss), path.steps, path.stopped)


def automatic_F_in(p: int, dof: float) -> float:
    """The larger of two thresholds.

    The first keeps the probability of a false term at 5 % however long the record. The second, of the extended BIC,
    lets it vanish with the length; with 164 candidates it is larger from 2,800 samples on.
    """
    return max(criteria.familywise_F_in(p, dof), criteria.ebic_F_in(p, dof))


def thresholds(
    options: Any, p: int, dof: float, *, by_blocks: bool = False
) -> tuple[float, float, NDArray[np.float64] | None]:
    """F_in, F_out and, for controlled false discovery, the threshold of each entry.

    Tests between blocks do not grow with the samples of a block, and their threshold does not either.
    """
    if options.F_in == "fdr":
        steps = criteria.fdr_F_in(p, dof, 0.05)
        return float(steps[0]), options.F_out if options.F_out is not None else float(steps[0]), steps
    automatic = criteria.familywise_F_in if by_blocks else automatic_F_in
    F_in = automatic(p, dof) if options.F_in == "auto" else float(options.F_in)
    F_out = F_in if options.F_out is None else options.F_out
    if F_out > F_in:
        raise SelectionError(
            f"select: F_out={F_out:g} is above the F_in of {F_in:.3g} that {p} candidates give: a term between the "
            "two would enter and leave for ever. Lower F_out, or leave it out."
        )
    return F_in, F_out, None
