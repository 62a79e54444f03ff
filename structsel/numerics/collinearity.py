"""Collinear candidates: how well they can be separated, and which to leave out.

Arrays only. ``C`` is, as everywhere in the search, the (p+1, p+1) centred cross-product matrix of
[x_1 ... x_p, y] and ``dof`` the samples less those swept out for the constant (N - 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array, read_only
from structsel.numerics.criteria import candidate_numbers, check_products
from structsel.numerics.stepwise import partial_f


def correlation(C: ArrayLike) -> Array:
    """Correlation matrix of the columns whose centred cross-products are C.

    Parameters
    ----------
    C : (m, m) array

    Returns
    -------
    R : (m, m) array [-]
        nan in the rows and columns of a constant.
    """
    C = np.asarray(C, dtype=float)
    root = np.sqrt(np.where(np.diag(C) > 0.0, np.diag(C), np.nan))
    R = C / np.outer(root, root)
    np.fill_diagonal(R, np.where(np.isfinite(root), 1.0, np.nan))
    return R


def vif(C: ArrayLike) -> Array:
    """Variance inflation factor of every candidate, 1 / (1 - R_j^2).

    R_j^2 is that of candidate j explained by the others and a constant.

    Parameters
    ----------
    C : (p, p) array
        Centred cross-products of the candidates alone (leave the response's row and column out).

    Returns
    -------
    vif : (p,) array [-]
        inf for every candidate of a dependent group (to rounding) and for a constant.
    """
    C = np.asarray(C, dtype=float)
    value = np.full(C.shape[0], np.inf)
    varying = np.flatnonzero(np.diag(C) > 0.0)
    if not varying.size:
        return value
    size, vectors = scipy.linalg.eigh(correlation(C[np.ix_(varying, varying)]))
    dead = size <= varying.size * 1e-15
    # A candidate is in a dependent group if it has a component in a direction without variance.
    alone = (vectors[:, dead] ** 2).sum(axis=1) < 1e-12
    inverse = (vectors[:, ~dead] ** 2 / size[~dead]).sum(axis=1)
    value[varying[alone]] = inverse[alone]
    return value


@dataclass(frozen=True)
class ConditionIndices:
    """Condition indices and the contribution of each dimension to the variance of each coefficient.

    Attributes
    ----------
    indices : (m,) array [-]
        Largest singular value of the scaled columns over each one, ascending; above about 30 a
        dependence does harm.
    proportions : (m, m) array [-]
        Row i: fraction of each coefficient's variance that belongs to index i; columns sum to 1. Values above
        0.5 in a row with a high index identify the columns that depend on one another.
    """

    indices: Array
    proportions: Array


def condition_indices(products: ArrayLike) -> ConditionIndices:
    """Condition indices and variance-decomposition proportions.

    The columns are scaled to unit length; with Z'Z = V diag(mu^2) V' the indices are mu_max / mu_i and
    the proportions (v_ji / mu_i)^2 / sum_i (v_ji / mu_i)^2.

    Parameters
    ----------
    products : (m, m) array
        Z'Z of the columns: [1, x_1 ... x_p] without the response, or the centred candidates alone, which leaves
        their dependence without their means.

    Returns
    -------
    ConditionIndices
        Computed from products, an index beyond 3e7 (1 / sqrt(eps)) cannot be distinguished from an exact dependence
        and is inf.

    Raises
    ------
    SelectionError
        A column is zero.

    References
    ----------
    [B80]
    """
    A = np.asarray(products, dtype=float)
    length = np.diag(A)
    if not (length > 0.0).all():
        bad = np.flatnonzero(~(length > 0.0)).tolist()
        raise SelectionError(
            f"condition_indices needs columns that are not zero; found {bad} that are. Leave them out."
        )
    size, V = scipy.linalg.eigh(A / np.outer(np.sqrt(length), np.sqrt(length)))
    size, V = size[::-1], V[:, ::-1]
    # Rounding can push the smallest eigenvalue below zero; such a direction has no variance.
    tiny = size[0] * np.finfo(float).eps
    dead = size <= tiny
    parts = V**2 / np.maximum(size, tiny)
    indices = np.where(dead, np.inf, np.sqrt(size[0] / np.maximum(size, tiny)))
    return ConditionIndices(read_only(indices), read_only((parts / parts.sum(axis=1, keepdims=True)).T))


def parameter_correlation(C: ArrayLike, selected: Sequence[int]) -> Array:
    """Correlation matrix (k, k) of the least-squares coefficients of the given terms; C (p+1, p+1)."""
    chosen = np.asarray(list(selected), dtype=int)
    C = np.asarray(C, dtype=float)
    inverse = _inverse(correlation(C[np.ix_(chosen, chosen)]), "parameter_correlation")
    return correlation(inverse)


@dataclass(frozen=True)
class DroppedTerm:
    """A term left out because its coefficient correlates with another's.

    Attributes
    ----------
    index : int
        The term left out: of the pair, the one with the smaller partial F (never an included one).
    other : int
        The other of the pair, which stays.
    correlation : float [-]
        Of their two coefficients.
    """

    index: int
    other: int
    correlation: float


def drop_correlated(
    C: ArrayLike, dof: float, selected: Sequence[int], limit: float = 0.9, *, include: Sequence[int] = ()
) -> tuple[tuple[int, ...], tuple[DroppedTerm, ...]]:
    """Leave out terms until no two coefficients correlate above a limit.

    While the largest correlation between two coefficients exceeds the limit, the one of the pair with the
    smaller partial F goes and the rest are estimated again. (In [H17] alpha^2 leaves CX, which has alpha.)

    Parameters
    ----------
    selected : sequence of int
    limit : float [-]
    include : sequence of int
        Terms that stay; two included ones that correlate are left as they are.

    Returns
    -------
    kept : tuple of int
        In the order given.
    dropped : tuple of DroppedTerm
        In the order in which they were left out.

    Raises
    ------
    SelectionError
        limit not between 0 and 1, or selected terms that depend on one another.

    References
    ----------
    [H17]
    """
    C = check_products(C, dof, "drop_correlated")
    if not 0.0 < limit <= 1.0:
        raise SelectionError(f"drop_correlated needs a limit between 0 and 1; found {limit:g}. 0.9 is usual.")
    kept = [int(j) for j in candidate_numbers(selected, C.shape[0] - 1, "drop_correlated", "selected")]
    forced = {int(j) for j in include}
    dropped = []
    while len(kept) > 1:
        R = np.triu(np.abs(parameter_correlation(C, kept)), 1)
        must = np.array([j in forced for j in kept])
        R[np.outer(must, must)] = 0.0
        a, b = np.unravel_index(int(np.argmax(R)), R.shape)
        if not R[a, b] > limit:
            break
        _, F, _ = partial_f(C, dof, kept)
        out, stays = (a, b) if must[b] or (not must[a] and F[a] < F[b]) else (b, a)
        value = float(parameter_correlation(C, kept)[a, b])
        dropped.append(DroppedTerm(kept[out], kept[stays], value))
        del kept[int(out)]
    return tuple(kept), tuple(dropped)


def _inverse(R: Array, who: str) -> Array:
    try:
        factor = scipy.linalg.cholesky(R)
    except (np.linalg.LinAlgError, ValueError):
        factor = np.zeros((1, 1))
    if factor.size and np.diag(factor).min() ** 2 < 1e-12:
        raise SelectionError(
            f"{who} needs terms that vary and do not depend on one another. Leave out the dependent ones "
            "(vif is infinite, or beyond 1e12, for them)."
        )
    U, _ = scipy.linalg.lapack.dtrtri(factor)
    return U @ U.T
