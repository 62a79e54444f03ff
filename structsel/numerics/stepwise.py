"""Structure search on the centred cross-products of candidates and response: modified stepwise regression.

Arrays only. Every search takes C = Z'Z of the centred columns Z = [x_1 ... x_p, y] and ``dof``, the samples less those
swept out for the constant (N - 1), so its cost does not depend on the number of samples. It works on the correlation
form, so scaling a candidate changes its coefficient only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.criteria import candidate_numbers, check_products, check_size
from structsel.numerics.group_moves import GroupRules
from structsel.numerics.hierarchical_search import hierarchical_search, needs_of
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.penalised_search import penalised_search
from structsel.numerics.search_path import SearchPath, run_kernel, search_path
from structsel.numerics.stepwise_kernel import StepwiseRules, stepwise_search


def stepwise(
    C: ArrayLike,
    dof: float,
    *,
    F_in: float = 4.0,
    F_out: float = 4.0,
    include: Sequence[int] = (),
    initial: Sequence[int] = (),
    max_terms: int | None = None,
    swap: bool = True,
    min_gain: float = 0.0,
    weights: ArrayLike | None = None,
    min_tolerance: float = 1e-9,
    entry_thresholds: ArrayLike | None = None,
    hierarchy: Hierarchy | None = None,
) -> SearchPath:
    """Choose terms by modified stepwise regression.

    The candidate with the largest partial correlation enters if its partial F reaches F_in; after
    each entry the kept term with the smallest partial F leaves if it is below F_out; when nothing enters
    or leaves, exchanges of one kept term for one outside are tried, and the search continues if one lowers
    the residual sum of squares. With b_j and d_j the candidate's product with the response and its sum of
    squares, both after regression on the kept terms::

        inside   F_j = theta_j^2 / s^2(theta_j),           s^2 = rss / (dof - k)
        outside  F_j = g_j / ((rss - g_j) / (dof - k - 1)),  g_j = b_j^2 / d_j

    Parameters
    ----------
    C : (p+1, p+1) array [products]
        Centred cross-products of the candidates and, last, the response.
    dof : float [-]
        Samples less those swept out for the constant (N - 1), or the effective number.
    F_in, F_out : float [-]
        Partial F to enter and to stay. The sources use 12.
    include : sequence of int
        Candidates that enter first and never leave.
    initial : sequence of int
        Terms of the first model, which may leave: the linear terms [TP1916], or all [C89]. Of dependent ones
        the later is refused.
    max_terms : int, optional
        Maximum number of terms, the constant not counted.
    swap : bool
    min_gain : float [-]
        Fraction of tss that a term must explain to enter, besides F_in: a rise of R^2, or sigma_max2 / tss where
        PSE = rss / N + sigma_max2 n / N must fall.
    weights : (p,) array [-], optional
        The candidate to enter is the one whose weight times what it explains is largest; min_gain is compared with
        that product. Prior preference of some candidates; all 1 by default.
    min_tolerance : float [-]
        Refuse a candidate if at most this fraction of its centred variance is not explained by the kept terms.
    entry_thresholds : (p,) array [-], optional
        In place of F_in: partial F that the first, second, ... term needs (:func:`fdr_F_in`). With k terms,
        F_out is at most the k-th of them.
    hierarchy : Hierarchy, optional
        Only hierarchical models: a candidate enters with the parents that it lacks, and leaves with the terms that
        need it, by the rules of `hierarchical_search`. Included terms need no parent. Not with ``weights``.

    Returns
    -------
    SearchPath

    Raises
    ------
    SelectionError
        F_out above F_in; products not finite; a constant response; more starting terms than degrees of
        freedom.

    Notes
    -----
    The search ends, because log rss + sum_{i<=k} log(1 + F_in / (dof - i)) does not increase on entry and decreases
    when a term leaves or is exchanged, so no model recurs. A fit with 1 - R^2 within rounding error (about 1e-14
    times the squared size of the standardised coefficients) is perfect.

    References
    ----------
    [TP1916], [C89]
    """
    C = check_products(C, dof, "stepwise")
    p = C.shape[0] - 1
    if entry_thresholds is None:
        thresholds = np.full(p, float(F_in))
        if F_out > F_in:
            raise SelectionError(
                f"stepwise needs F_out no larger than F_in; found F_in = {F_in:g}, F_out = {F_out:g}. A term "
                "whose partial F lies between would enter and leave for ever. Lower F_out or raise F_in."
            )
    else:
        thresholds = np.require(entry_thresholds, np.float64, ["C", "A", "W"])
        if thresholds.shape != (p,):
            raise SelectionError(
                f"stepwise needs one entry threshold per candidate ({p}); found shape {thresholds.shape}. "
                "fdr_F_in(p, dof, q) makes them."
            )
    if np.isnan(thresholds).any() or np.isnan(F_out):
        raise SelectionError("stepwise needs numbers for F_in and F_out; found NaN. The usual values are 4 to 12.")
    included = candidate_numbers(include, p, "stepwise", "include")
    begin = candidate_numbers(initial, p, "stepwise", "initial")
    max_size = p if max_terms is None else int(max_terms)
    check_size(included, begin, dof, max_size, "stepwise")
    if hierarchy is not None:
        groups = GroupRules(thresholds, float(F_out), max_size, float(min_gain), bool(swap), float(min_tolerance))
        return _hierarchical(C, float(dof), groups, hierarchy, included, begin)
    preference = np.ones(p) if weights is None else np.ascontiguousarray(weights, dtype=np.float64)
    rules = StepwiseRules(
        thresholds, float(F_out), max_size, float(min_gain), preference, bool(swap), float(min_tolerance)
    )
    answer, trace = run_kernel(stepwise_search, C, float(dof), rules, included, begin)
    return search_path(answer, trace, float(C[-1, -1]), float(dof))


def _hierarchical(
    C: Array,
    dof: float,
    rules: GroupRules,
    hierarchy: Hierarchy,
    include: NDArray[np.int64],
    initial: NDArray[np.int64],
) -> SearchPath:
    """Search by moves of groups; included terms need no parent, and constants are none."""
    needs = needs_of(hierarchy.without(include).without_constants(C))
    answer, trace = run_kernel(hierarchical_search, C, dof, rules, needs, include, initial)
    return search_path(answer, trace, float(C[-1, -1]), dof)


def forward_selection(
    C: ArrayLike,
    dof: float,
    min_fraction: float,
    *,
    include: Sequence[int] = (),
    max_terms: int | None = None,
    min_gain: float = 0.0,
    weights: ArrayLike | None = None,
    min_tolerance: float = 1e-9,
) -> SearchPath:
    """Add the best candidate while it reduces the residual sum of squares by at least a fraction; no term leaves.

    Parameters
    ----------
    C, include, max_terms, min_gain, weights, min_tolerance
        As in :func:`stepwise`.
    dof : float [-]
        As in :func:`stepwise`; it does not affect the choice while it exceeds the number of terms.
    min_fraction : float [-]
        g_j / rss that a term needs to enter, from 0 to below 1.

    Returns
    -------
    SearchPath

    Raises
    ------
    SelectionError
        As :func:`stepwise`.
    """
    left = np.maximum(float(dof) - np.arange(np.shape(C)[0] - 1) - 1.0, 0.0)
    # g / (rss - g) >= f / (1 - f) is g >= f rss; no term reaches a fraction of 1.
    thresholds = min_fraction / (1.0 - min_fraction) * left if min_fraction < 1.0 else np.full(left.size, np.inf)
    return stepwise(
        C, dof, F_out=0.0, include=include, max_terms=max_terms, swap=False, min_gain=min_gain, weights=weights,
        min_tolerance=min_tolerance, entry_thresholds=thresholds,
    )  # fmt: skip


def refine_subset(
    C: ArrayLike,
    dof: float,
    selected: Sequence[int],
    penalty: float,
    *,
    include: Sequence[int] = (),
    max_terms: int | None = None,
    depth: int = 2,
    min_tolerance: float = 1e-9,
    hierarchy: Hierarchy | None = None,
) -> SearchPath:
    """Improve a selection by small moves while dof log(rss) + penalty k decreases.

    Parameters
    ----------
    C, dof, include, max_terms, min_tolerance
        As in :func:`stepwise`.
    selected : sequence of int
        Terms to start from.
    penalty : float [-]
        Penalty of one term: (dof / N) log(N) is exactly BIC, 2 is about AIC.
    depth : {1, 2, 3}
        1: one term in, out or exchanged. 2: also two in, two out, two for one, one for two. 3: also two for two.
    hierarchy : Hierarchy, optional
        As for :func:`stepwise`; the moves are then groups in, out or exchanged.

    Returns
    -------
    SearchPath
        Its steps begin with ``selected`` entering.

    Raises
    ------
    SelectionError
        As :func:`stepwise`, or depth is none of the three.
    """
    C = check_products(C, dof, "refine_subset")
    p = C.shape[0] - 1
    if depth not in (1, 2, 3):
        raise SelectionError(f"refine_subset needs depth 1, 2 or 3; found {depth!r}. 2 is the usual choice.")
    included = candidate_numbers(include, p, "refine_subset", "include")
    begin = candidate_numbers(selected, p, "refine_subset", "selected")
    max_size = p if max_terms is None else int(max_terms)
    check_size(included, begin, dof, max_size, "refine_subset")
    if hierarchy is not None:
        prices = np.maximum(dof - np.arange(p) - 1.0, 1e-9) * np.expm1(penalty / dof)
        groups = GroupRules(prices, np.inf, max_size, 0.0, True, float(min_tolerance))
        return _hierarchical(C, float(dof), groups, hierarchy, included, begin)
    answer, trace = run_kernel(
        *(penalised_search, C, float(dof), float(penalty), included, begin, max_size, int(depth), float(min_tolerance))
    )
    return search_path(answer, trace, float(C[-1, -1]), float(dof))


def partial_f(C: ArrayLike, dof: float, selected: Sequence[int]) -> tuple[Array, Array, float]:
    """Least squares with the given terms, and each one's partial F given the others.

    Parameters
    ----------
    C, dof
        As in :func:`stepwise`.
    selected : sequence of int

    Returns
    -------
    theta : (k,) array [response per candidate]
    F : (k,) array [-]
        theta_j^2 / s^2(theta_j): the square of the t statistic.
    rss : float [response^2]

    Raises
    ------
    SelectionError
        As :func:`stepwise`, or the terms depend on one another.
    """
    C = check_products(C, dof, "partial_f")
    p = C.shape[0] - 1
    begin = candidate_numbers(selected, p, "partial_f", "selected")
    none = np.empty(0, np.int64)
    check_size(none, begin, dof, p, "partial_f")
    # No candidate reaches these thresholds: the search enters the given terms and estimates.
    rules = StepwiseRules(np.full(p, np.inf), -1.0, begin.size, 0.0, np.ones(p), False, 1e-12)
    chosen, theta, rss, *_ = stepwise_search(C, float(dof), rules, begin, none, np.empty((0, 7)))
    if chosen.size < begin.size:
        lost = sorted(set(begin.tolist()) - set(chosen.tolist()))
        raise SelectionError(
            f"partial_f needs independent terms; candidates {lost} are constant or depend on the others. "
            "Leave them out."
        )
    root = np.sqrt(np.diag(C)[chosen])
    inverse = np.linalg.inv(C[np.ix_(chosen, chosen)] / np.outer(root, root))
    loss = (theta * root) ** 2 / np.diag(inverse)
    with np.errstate(divide="ignore"):
        F = loss * (dof - chosen.size) / rss
    return theta, F, float(rss)
