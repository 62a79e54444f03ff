"""Least squares on cross-products: the normal equations of scaled columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

WELL_DETERMINED = 1e-4  # of a column's length that the columns before it leave; rounding is then below 1e-8


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
    theta: Array = _inverse(product[np.ix_(rows, rows)]) @ product[rows, -1]
    return theta


def _inverse(A: Array) -> Array:
    """Pseudo-inverse of a symmetric matrix whose columns are scaled to unit length for it.

    Of a matrix that is clearly positive definite it is the inverse, from Cholesky's factor.
    """
    root = np.sqrt(np.maximum(A.diagonal(), np.finfo(float).tiny))
    units = root[:, None] * root
    scaled = A / units
    factor, failed = scipy.linalg.lapack.dpotrf(scaled, lower=1)
    if A.size and not failed and factor.diagonal().min() > WELL_DETERMINED:
        lower: Array = np.tril(scipy.linalg.lapack.dpotri(factor, lower=1)[0])
        inverse: Array = lower + np.tril(lower, -1).T
    else:
        inverse = np.linalg.pinv(scaled, hermitian=True)
    return inverse / units
