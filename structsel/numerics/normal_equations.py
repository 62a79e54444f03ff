"""Least squares on cross-products: the normal equations of scaled columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

WELL_DETERMINED = 1e-4  # of a column's length that the columns before it leave; rounding is then below 1e-8
ROUNDING = 1e-12  # of a column's sum of squares: residual of a column that others explain, by rounding
_TILE = 32  # rows and columns of a tile that is transposed


@njit(cache=True, nogil=True, error_model="numpy")
def centre(product: Array) -> Array:  # pragma: no cover - compiled
    """Products with the constant (column 0) regressed out, (q - 1, q - 1)."""
    centred = product[1:, 1:].copy()
    if product[0, 0] > 0.0:
        for i in range(centred.shape[0]):
            mean = product[i + 1, 0] / product[0, 0]
            for j in range(centred.shape[1]):
                centred[i, j] -= mean * product[0, j + 1]
    return centred


@njit(cache=True, nogil=True, error_model="numpy")
def centre_triangle(packed: Array, q: int) -> Array:  # pragma: no cover - compiled
    """`centre` of the products whose upper triangle is ``packed``, row by row."""
    p, n = q - 1, packed[0]
    means, sums = packed[1:q] / n if n > 0.0 else np.zeros(p), packed[1:q]
    centred = np.empty((p, p))
    at = q
    for i in range(p):
        row, values, mean, others = centred[i, i:], packed[at : at + p - i], means[i], sums[i:]
        for j in range(row.size):
            row[j] = values[j] - mean * others[j]
        at += p - i
    for first in range(0, p, _TILE):  # the lower triangle by tiles, whose rows and columns fit in the cache
        for second in range(first, p, _TILE):
            for i in range(first, min(first + _TILE, p)):
                for j in range(max(second, i + 1), min(second + _TILE, p)):
                    centred[j, i] = centred[i, j]
    return centred


@dataclass(frozen=True)
class Projection:
    """Least squares of every column on k of them, from their cross-products.

    Attributes
    ----------
    inverse : (k, k) array
        Of the products of the k columns.
    coefficients : (k, q) array
        Of each column on the k.
    remaining : (q,) array
        Residual sum of squares of each column.
    """

    inverse: Array
    coefficients: Array
    remaining: Array

    @property
    def rss(self) -> float:
        """Residual sum of squares of the last column."""
        return float(self.remaining[-1])


def project(product: Array, columns: Sequence[int]) -> Projection:
    """Least squares of every column on some of them, by the normal equations.

    Parameters
    ----------
    product : (q, q) array
        Cross-products, centred or not.
    columns : sequence of int
        Where they are dependent, the solution of least length.
    """
    rows = np.asarray(columns, dtype=int)
    inverse = _inverse(product[np.ix_(rows, rows)])
    coefficients = inverse @ product[rows]
    remaining = np.diag(product) - np.einsum("ij,ij->j", product[rows], coefficients)
    return Projection(inverse, coefficients, np.maximum(remaining, 0.0))


def solve_normal_equations(product: Array, columns: Sequence[int]) -> Array:
    """Parameters (k,) of the last column on some of the others; as `project`, without the other columns."""
    rows = np.asarray(columns, dtype=int)
    theta: Array = _inverse(product[rows[:, None], rows]) @ product[rows, -1]
    return theta


def least_rss(product: Array) -> float:
    """Residual sum of squares of the last column on all others but those that depend on them: no model has less."""
    root = np.sqrt(np.diag(product))
    scaled = product / np.outer(*[np.where(root > 0.0, root, 1.0)] * 2)
    factor, pivot, rank, _ = scipy.linalg.lapack.dpstrf(scaled[:-1, :-1], tol=ROUNDING, lower=1)
    first = pivot[:rank] - 1
    explained = scipy.linalg.solve_triangular(factor[:rank, :rank], scaled[first, -1], lower=True)
    return float(product[-1, -1] * max(1.0 - explained @ explained, 0.0))


def _inverse(A: Array) -> Array:
    """Pseudo-inverse of a symmetric matrix whose columns are scaled to unit length for it.

    Of a matrix that is clearly positive definite it is the inverse, from Cholesky's factor.
    """
    root = np.sqrt(np.maximum(A.diagonal(), np.finfo(float).tiny))
    units = root[:, None] * root
    scaled = A / units
    return inverse_of_scaled(scaled) / units


def inverse_of_scaled(R: Array) -> Array:
    """Inverse of a symmetric matrix of columns of unit length; the pseudo-inverse where they are nearly dependent."""
    inverse: Array
    inverse, determined = cholesky_inverse(R)
    if not determined:
        inverse = np.asarray(np.linalg.pinv(R, hermitian=True), dtype=np.float64)
    return inverse


@njit(cache=True, nogil=True, error_model="numpy")
def cholesky_inverse(R: Array) -> tuple[Array, bool]:  # pragma: no cover - compiled
    """Inverse of a small symmetric matrix by its factor, and whether every pivot is above `WELL_DETERMINED`."""
    k = R.shape[0]
    lower, inverse = np.zeros((k, k)), np.zeros((k, k))
    for i in range(k):
        for j in range(i + 1):
            value = R[i, j]
            for m in range(j):
                value -= lower[i, m] * lower[j, m]
            if j < i:
                lower[i, j] = value / lower[j, j]
            elif value > WELL_DETERMINED**2:
                lower[i, i] = np.sqrt(value)
            else:
                return inverse, False
    for j in range(k):  # columns of the factor's inverse, in place of the factor's rows below them
        inverse[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, k):
            value = 0.0
            for m in range(j, i):
                value -= lower[i, m] * inverse[m, j]
            inverse[i, j] = value / lower[i, i]
    for i in range(k):  # the product of the transpose with itself, whose row i needs rows i and below
        for j in range(i + 1):
            value = 0.0
            for m in range(i, k):
                value += inverse[m, i] * inverse[m, j]
            lower[i, j] = value
    for i in range(k):
        for j in range(i + 1):
            inverse[i, j] = lower[i, j]
            inverse[j, i] = lower[i, j]
    return inverse, True


class Unexplained(NamedTuple):
    """What the kept columns leave of the others, in units of every column's length; see `leave_unexplained`.

    Attributes
    ----------
    theta : (k,) array
        Of the response on the kept columns.
    alone : (k,) array
        Diagonal of the inverse of their correlations: theta^2 / alone is the loss without one of them.
    rss : float
        1 - R^2 of the response.
    explained : (k, m) array
        Coefficients of each other column on the kept ones.
    d, b : (m,) array
        What is left of each other column's length, and of its product with the response.
    """

    theta: Array
    alone: Array
    rss: float
    explained: Array
    d: Array
    b: Array


def leave_unexplained(C: Array, kept: NDArray[np.integer], others: NDArray[np.integer]) -> Unexplained:
    """Regression of the response, the last column of centred products, and of other columns on the kept ones."""
    kept, others = np.asarray(kept, dtype=np.int64), np.asarray(others, dtype=np.int64)
    among, with_others, own = _of_unit_length(C, kept, others)
    inverse = inverse_of_scaled(among)
    theta, rss, explained, d, b = _regress(inverse, with_others, own)
    return Unexplained(theta, inverse.diagonal(), rss, explained, d, b)


@njit(cache=True, nogil=True, error_model="numpy")
def _of_unit_length(
    C: Array, kept: NDArray[np.int64], others: NDArray[np.int64]
) -> tuple[Array, Array, Array]:  # pragma: no cover - compiled
    """Correlations of the kept columns, (k, k), with the others and the response, (k, m + 1), and of these, (m + 1,).

    The last are those with the response; its own is zero where it is constant.
    """
    k, m, y = kept.size, others.size, C.shape[0] - 1
    columns = np.append(others, y)
    size = np.array([np.sqrt(C[j, j]) if C[j, j] > 0.0 else 1.0 for j in np.append(columns, kept)])
    among, with_others, own = np.empty((k, k)), np.empty((k, m + 1)), np.empty(m + 1)
    for i in range(k):
        row, unit = C[kept[i]], size[m + 1 + i]
        for j in range(k):
            among[i, j] = row[kept[j]] / (unit * size[m + 1 + j])
        for c in range(m + 1):
            with_others[i, c] = row[columns[c]] / (unit * size[c])
    for c in range(m + 1):
        own[c] = C[y, columns[c]] / (size[c] * size[m])
    return among, with_others, own


@njit(cache=True, nogil=True, error_model="numpy")
def _regress(
    inverse: Array, with_others: Array, own: Array
) -> tuple[Array, float, Array, Array, Array]:  # pragma: no cover - compiled
    """Coefficients of the response and of the others, and what is left of lengths and products with the response."""
    k, m = with_others.shape[0], with_others.shape[1] - 1
    explained, d, b = np.zeros((k, m + 1)), np.ones(m), own[:m].copy()
    rss = own[m]
    for i in range(k):
        row, with_row = explained[i], with_others[i]
        for j in range(k):
            f, other = inverse[i, j], with_others[j]
            for c in range(m + 1):
                row[c] += f * other[c]
        for c in range(m):
            d[c] -= with_row[c] * row[c]
            b[c] -= with_row[m] * row[c]
        rss -= with_row[m] * row[m]
    return explained[:, m].copy(), rss, explained[:, :m].copy(), d, b
