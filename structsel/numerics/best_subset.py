"""The best subset of every size, exactly, by branch and bound on the centred cross-products.

Arrays only. The tree is that of leaps and bounds [FW74]. A node keeps some candidates, has dropped others and is
undecided on the rest; S has the products of the undecided ones and, last, the response, after regression on the kept.
No model below a node fits better than its kept and undecided candidates together. So the branch that keeps the first
undecided candidates and drops candidate a has the bound::

    rss(all undecided) + theta_a^2 / (S^-1)_aa

the residual without a. The branch is cut if its bound is not below the best known model of its smallest size.
Undecided candidates are sorted at every node by the loss without them, so that the largest branches are cut first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.best_subset_kernel import leaps
from structsel.numerics.criteria import candidate_numbers, check_products, check_size
from structsel.numerics.group_moves import GroupRules
from structsel.numerics.hierarchical_search import hierarchical_search, needs_of
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.stepwise_kernel import StepwiseRules, stepwise_search

MAX_CANDIDATES = 40


@dataclass(frozen=True)
class Subset:
    """The best model of one size.

    Attributes
    ----------
    selected : tuple of int
        Its candidates, ascending.
    theta : (k,) array [response per candidate]
        Their least-squares coefficients, in that order.
    rss : float [response^2]
        Least residual sum of squares of any model of this size (with the included terms).
    """

    selected: tuple[int, ...]
    theta: Array
    rss: float

    @property
    def n_terms(self) -> int:
        """Terms, the constant not counted."""
        return len(self.selected)


def best_subset(
    C: ArrayLike,
    dof: float,
    *,
    max_terms: int | None = None,
    include: Sequence[int] = (),
    min_tolerance: float = 1e-9,
    hierarchy: Hierarchy | None = None,
) -> list[Subset]:
    """Find the model of least residual sum of squares for every number of terms.

    Parameters
    ----------
    C : (p+1, p+1) array [products]
        Centred cross-products of the candidates and, last, the response.
    dof : float [-]
        Samples less those swept out for the constant (N - 1), or the effective number.
    max_terms : int, optional
        Largest size wanted, the constant not counted.
    include : sequence of int
        Candidates in every model.
    min_tolerance : float [-]
        Refuse models with a candidate if at most this fraction of its centred variance is not explained by the
        others.
    hierarchy : Hierarchy, optional
        Only models that are hierarchical; included terms need no parent. The bounds are those of all models.

    Returns
    -------
    subsets : list of Subset
        One for each size, ascending, from the number of included terms. Sizes without a permitted model are missing.

    Raises
    ------
    SelectionError
        More than 40 candidates besides the included ones; included ones that depend on one another; and as
        :func:`structsel.numerics.stepwise.stepwise`.

    References
    ----------
    [FW74]
    """
    C = check_products(C, dof, "best_subset")
    p = C.shape[0] - 1
    included = np.sort(candidate_numbers(include, p, "best_subset", "include"))
    max_size = min(p if max_terms is None else int(max_terms), int(np.ceil(dof)) - 1)
    check_size(included, np.empty(0, np.int64), dof, max_size, "best_subset")
    varying = np.diag(C)[:p] > 0.0
    free = np.setdiff1d(np.flatnonzero(varying), included)
    if free.size > MAX_CANDIDATES:
        raise SelectionError(
            f"best_subset is practical up to {MAX_CANDIDATES} candidates besides the included ones; found "
            f"{free.size}. Choose terms by stepwise or orthogonal first and search among those, or improve "
            "their answer with refine_subset."
        )
    R = C / np.outer(*(2 * (np.sqrt(np.where(np.diag(C) > 0.0, np.diag(C), 1.0)),)))
    for i, j in enumerate(included):  # sweep the included ones out
        if not varying[j] or R[j, j] <= min_tolerance:
            raise SelectionError(
                f"best_subset needs independent included terms; candidate {int(j)} is constant or depends on "
                f"{[int(v) for v in included[:i]]}. Do not include it."
            )
        R = R - np.outer(R[:, j], R[j]) / R[j, j]
    columns = np.append(free, p)
    max_size = min(max_size - included.size, free.size)
    best = np.full(max_size + 1, np.inf)
    sets = np.zeros((max_size + 1, free.size), dtype=np.bool_)
    best[0] = max(R[p, p], 0.0)
    parents, strong = np.empty((free.size, 0), dtype=np.int64), False
    if hierarchy is not None:
        hierarchy = hierarchy.without(included).without_constants(C)
        parents, strong = _among(hierarchy, included, free), hierarchy.strong
    _good_start(C, dof, included, free, best, sets, min_tolerance, hierarchy)
    if free.size and max_size:
        products = np.ascontiguousarray(R[np.ix_(columns, columns)])
        leaps(products, max_size, best, sets, float(min_tolerance), parents, strong)
    return [_fit(C, np.union1d(included, free[sets[k]])) for k in range(max_size + 1) if np.isfinite(best[k])]


def _among(hierarchy: Hierarchy, included: NDArray[np.int64], free: NDArray[np.int64]) -> NDArray[np.int64]:
    """Parents of the free candidates among one another; those that an included parent satisfies need none."""
    parents = hierarchy.parents.copy()
    there = np.isin(parents, included)
    if hierarchy.strong:
        parents[there] = -1
    else:
        parents[there.any(axis=1)] = -1
    return Hierarchy(parents, hierarchy.strong).of_candidates(free).parents


def _good_start(
    C: Array,
    dof: float,
    included: NDArray[np.int64],
    free: NDArray[np.int64],
    best: Array,
    sets: NDArray[np.bool_],
    tol: float,
    hierarchy: Hierarchy | None,
) -> None:
    """Models by forward selection with exchanges, which cut most branches."""
    p = C.shape[0] - 1
    begin = np.empty(0, np.int64)
    for k in range(1, best.size):
        if hierarchy is None:
            rules = StepwiseRules(np.zeros(p), -1.0, included.size + k, 0.0, np.ones(p), True, float(tol))
            chosen, _, rss, *_ = stepwise_search(C, float(dof), rules, included, begin, np.empty((0, 7)))
        else:
            groups = GroupRules(np.zeros(p), -1.0, included.size + k, 0.0, True, float(tol))
            needs = needs_of(hierarchy)
            chosen, _, rss, *_ = hierarchical_search(C, float(dof), groups, needs, included, begin, np.empty((0, 7)))
        if chosen.size != included.size + k:
            break
        # Slightly above, so that the exact search finds the same model itself and no rounding hides it.
        best[k] = rss / C[p, p] * (1.0 + 1e-9) + 1e-15
        sets[k] = np.isin(free, chosen)
        begin = chosen


def _fit(C: Array, chosen: NDArray[np.int64]) -> Subset:
    scale = np.sqrt(np.diag(C)[chosen])
    if not chosen.size:
        return Subset((), np.empty(0), float(C[-1, -1]))
    b = C[chosen, -1]
    theta = (
        scipy.linalg.cho_solve(scipy.linalg.cho_factor(C[np.ix_(chosen, chosen)] / np.outer(scale, scale)), b / scale)
        / scale
    )
    theta.setflags(write=False)
    return Subset(tuple(int(j) for j in chosen), theta, max(float(C[-1, -1] - theta @ b), 0.0))
