"""Orthogonal functions of the candidates, ranked by the reduction of the cost.

Arrays only, on the centred cross-products; the constant is p_0 and is already swept out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.criteria import candidate_numbers, check_products, check_size, pse
from structsel.numerics.group_moves import GroupRules
from structsel.numerics.hierarchical_search import hierarchical_search, needs_of
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.search_model import ACTION, ENTER, INDEX, PARTIAL_R, UNEXPLAINED
from structsel.numerics.search_path import SearchPath, SearchStep, run_kernel
from structsel.numerics.stepwise_kernel import StepwiseRules, stepwise_search


@dataclass(frozen=True)
class OrthogonalPath(SearchPath):
    """A :class:`SearchPath` with the models of all sizes.

    Attributes
    ----------
    order : tuple of int
        All ranked candidates, best first (included ones before them).
    cost_reduction : (m,) array [response^2]
        (p_j'y)^2 / (p_j'p_j) of each.
    rss_path : (m+1,) array [response^2]
        Least-squares residual of the first 0, 1, ... m ranked terms.
    pse_path : (m+1,) array [response^2]
        Their predicted squared error; ``len(selected)`` is its minimum.
    sigma_max2 : float [response^2]
    factor : (m, m) array
        Upper triangular U of the ranked terms, Z'Z = U'U.
    products : (m,) array
        U'^-1 Z'y: each orthonormal function's product with the response.
    """

    order: tuple[int, ...]
    cost_reduction: Array
    rss_path: Array
    pse_path: Array
    sigma_max2: float
    factor: Array
    products: Array

    def coefficients(self, n: int) -> Array:
        """Physical coefficients of the model of the first n ranked terms.

        Parameters
        ----------
        n : int

        Returns
        -------
        theta : (n,) array [response per candidate]
        """
        if not 0 <= n <= len(self.order):
            raise SelectionError(
                f"coefficients needs a number of terms from 0 to {len(self.order)}; found {n}. The path ends there."
            )
        return scipy.linalg.solve_triangular(self.factor[:n, :n], self.products[:n])


def orthogonal(
    C: ArrayLike,
    dof: float,
    *,
    sigma_max2: float | None = None,
    order: str = "greedy",
    include: Sequence[int] = (),
    max_terms: int | None = None,
    min_tolerance: float = 1e-9,
    hierarchy: Hierarchy | None = None,
) -> OrthogonalPath:
    """Choose terms by orthogonal functions and the least predicted squared error.

    Each candidate is made orthogonal to those before it, and reduces the cost by (p_j'y)^2 / (p_j'p_j)::

        p_j = x_j - sum_{k<j} gamma_kj p_k,   gamma_kj = p_k'x_j / (p_k'p_k)
        PSE(n) = rss(n) / N + sigma_max2 (n + 1) / N,   N = dof + 1

    Parameters
    ----------
    C : (p+1, p+1) array [products]
        Centred cross-products of the candidates and, last, the response.
    dof : float [-]
        Samples less those swept out for the constant (N - 1), or the effective number.
    sigma_max2 : float [response^2], optional
        Default tss / N, as in [H17].
    order : {"greedy", "given"}
        "greedy": the next function is always the one that reduces the cost most [M95]. "given":
        orthogonalise in the order of the candidates, then rank by cost reduction [H17]. The ranking depends on
        that order, since the common part of two candidates is attributed to the first.
    include : sequence of int
        Candidates that are first and always stay.
    max_terms : int, optional
    min_tolerance : float [-]
        Refuse a candidate if at most this fraction of its centred variance is not explained by the earlier ones.
    hierarchy : Hierarchy, optional
        Parents are ranked before what needs them: the candidate that comes next is, with the parents that it lacks, the
        one that reduces the cost most for each of these terms. So every model of the path is hierarchical. "Greedy"
        takes the logarithm of the cost.

    Returns
    -------
    OrthogonalPath
        Its coefficients are the exact decomposition of the kept functions into the kept terms, that is
        their least-squares fit; rss_path and pse_path are those of the physical models. Where a perfect
        fit is reached, terms that explain nothing are left out of the path.

    Raises
    ------
    SelectionError
        As :func:`structsel.numerics.stepwise.stepwise`; an unknown order; more candidates than degrees of
        freedom with order="given".

    References
    ----------
    [H17], [M95]
    """
    C = check_products(C, dof, "orthogonal")
    p = C.shape[0] - 1
    tss, n = float(C[-1, -1]), dof + 1.0
    bound = tss / n if sigma_max2 is None else float(sigma_max2)
    included = candidate_numbers(include, p, "orthogonal", "include")
    max_size = p if max_terms is None else int(max_terms)
    none = np.empty(0, np.int64)
    check_size(included, none, dof, max_size, "orthogonal")
    if order == "greedy":
        F_in, begin = np.zeros(p), none
    elif order == "given":
        F_in, begin = np.full(p, np.inf), np.arange(p, dtype=np.int64)
        check_size(included, begin, dof, p, "orthogonal")
    else:
        raise SelectionError(f'orthogonal takes order "greedy" or "given"; found {order!r}. Choose one of them.')

    rules = StepwiseRules(F_in, -1.0, max_size, 0.0, np.ones(p), False, float(min_tolerance))
    if hierarchy is not None:
        hierarchy = hierarchy.without(included).without_constants(C)

    def rank(first: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
        """Candidates in order of entry, the cost reduction of each candidate, and those refused."""
        if hierarchy is not None and order == "greedy":
            groups = GroupRules(F_in, -1.0, max_size, 0.0, False, float(min_tolerance))
            answer = run_kernel(hierarchical_search, C, float(dof), groups, needs_of(hierarchy), included, first)
        else:
            answer = run_kernel(stepwise_search, C, float(dof), rules, included, first)
        (chosen, _, _, refused, _, moves), trace = answer
        entries = trace[:moves][trace[:moves, ACTION] == ENTER]
        before = np.concatenate([[1.0], entries[:-1, UNEXPLAINED]])
        gains = np.zeros(p)
        gains[entries[:, INDEX].astype(int)] = entries[:, PARTIAL_R] ** 2 * before * tss
        return chosen, gains, refused

    ranked, gains, refused = rank(begin)
    if order == "given":
        # A stable sort of the entered ones; the included ones stay in front.
        free = ranked[included.size :]
        free = free[np.argsort(-gains[free], kind="stable")]
        if hierarchy is not None:
            free = _parents_first(free, gains, hierarchy)
        ranked, _, _ = rank(free[: max(0, max_size - included.size)].astype(np.int64))
    return _assemble(C, dof, ranked, gains, refused, bound, included)


def _parents_first(ranked: NDArray[np.int64], gains: Array, hierarchy: Hierarchy) -> NDArray[np.int64]:
    """The ranked candidates with parents before what needs them: next is the group of largest mean cost reduction."""
    inside: list[int] = []
    left = dict.fromkeys(ranked.tolist())
    while left:
        groups = [group for j in left if (group := hierarchy.group_of(j, inside, gains)) and set(group) <= set(left)]
        if not groups:
            break
        inside += max(groups, key=lambda group: float(gains[np.array(group)].mean()))
        left = dict.fromkeys(j for j in left if j not in set(inside))
    return np.array(inside, dtype=np.int64)


def _assemble(
    C: Array,
    dof: float,
    ranked: NDArray[np.int64],
    gains: Array,
    refused: NDArray[np.bool_],
    bound: float,
    included: NDArray[np.int64],
) -> OrthogonalPath:
    tss = float(C[-1, -1])
    m = ranked.size
    scale = np.sqrt(np.diag(C)[ranked])
    factor = scipy.linalg.cholesky(C[np.ix_(ranked, ranked)] / np.outer(scale, scale)) if m else np.empty((0, 0))
    z = scipy.linalg.solve_triangular(factor, C[ranked, -1] / scale, trans="T") if m else np.empty(0)
    rss_path = np.maximum(tss - np.concatenate([[0.0], np.cumsum(z * z)]), 0.0)
    pse_path = pse(rss_path, tss, dof + 1.0, np.arange(m + 1), bound)
    least = int(np.isin(ranked, included).sum())
    n = least + int(np.argmin(pse_path[least:]))
    factor = factor * scale
    kept = tuple(int(j) for j in ranked)
    steps = []
    for i in range(m):
        partial_r2 = min(float(z[i] ** 2 / rss_path[i]), 1.0) if rss_path[i] > 0.0 else 1.0
        F = partial_r2 * (dof - i - 1) / (1.0 - partial_r2) if partial_r2 < 1.0 else float("inf")
        r = float(np.sign(z[i]) * np.sqrt(partial_r2))
        steps.append(SearchStep("enter", kept[i], -1, F, r, float(rss_path[i + 1]), i + 1))
    theta = scipy.linalg.solve_triangular(factor[:n, :n], z[:n]) if n else np.empty(0)
    reductions = gains[ranked]
    for array in (theta, reductions, rss_path, pse_path, factor, z):
        array.setflags(write=False)
    return OrthogonalPath(
        selected=kept[:n],
        theta=theta,
        rss=float(rss_path[n]),
        steps=tuple(steps[:n]),
        refused=tuple(int(j) for j in np.flatnonzero(refused)),
        stopped="least PSE" if n < m else "end of the path",
        tss=tss,
        dof=float(dof),
        order=kept,
        cost_reduction=reductions,
        rss_path=rss_path,
        pse_path=pse_path,
        sigma_max2=bound,
        factor=factor,
        products=z,
    )
