"""Least squares on cross-products: the normal equations of scaled columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit


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
    """Pseudo-inverse of a symmetric matrix whose columns are scaled to unit length for it."""
    root = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    inverse: Array = np.linalg.pinv(A / np.outer(root, root), hermitian=True) / np.outer(root, root)
    return inverse
