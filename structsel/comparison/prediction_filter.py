"""Prediction of a residual from its own past, by one autoregression for all flights.

References
----------
[Lju99], chapters 3 and 7, for prediction errors of a linear model with coloured noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.numerics.arrays import Array

_BLOCK = 64  # rows that are filtered together
_RIDGE = 1e-9  # of the mean square of a residual: precision of the coefficients of the autoregression
_DEGREES = 8.0  # of freedom, of the prior of the variances of single flights about their common value


@dataclass(frozen=True, eq=False)
class Filter:
    """Prediction of one response from past residuals.

    Attributes
    ----------
    own : (p,) array
        Coefficients of its past.
    variance : (flights,) array
        Of the prediction errors of each flight.
    common : float
        About which the variances of the flights are distributed.
    """

    own: Array
    variance: Array
    common: float

    def __call__(self, x: Array) -> Array:
        """Columns (n, k) or (n,) less what their own past predicts, from sample p on."""
        columns = np.ascontiguousarray(x if x.ndim == 2 else x[:, None])
        p, rows = len(self.own), len(x) - len(self.own)
        # Blocks of rows are multiplied by a band matrix, which is several times faster than a filter along each column.
        one = np.pad(np.append(-self.own[::-1], 1.0), _BLOCK - 1)
        band = np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(one, _BLOCK + p)[::-1])
        made = np.empty((rows, columns.shape[1]))
        for first in range(0, rows, _BLOCK):
            some = min(_BLOCK, rows - first)
            np.matmul(band[:some, : some + p], columns[first : first + some + p], out=made[first : first + some])
        return made if x.ndim == 2 else made[:, 0]

    def white(self, columns: Array, i: int) -> Array:
        """White rows of flight i."""
        return np.asarray(self(columns) / np.sqrt(self.variance[i]))

    def products(self, columns: Sequence[Array]) -> list[Array]:
        """Products of the white rows of each flight, from its columns (n, k)."""
        return [W.T @ W / variance for W, variance in zip(map(self, columns), self.variance)]

    @classmethod
    def of(cls, left: Sequence[Array], order: int) -> Filter:
        """Autoregression of residuals (n,) by least squares over all flights, and the variances that it leaves."""
        p = order
        past = [np.column_stack([x[p - k : len(x) - k] for k in range(1, p + 1)]) for x in left]
        products, with_y = [x.T @ x for x in past], [x.T @ y[p:] for x, y in zip(past, left)]
        rows = np.array([len(x) for x in past], dtype=float)
        own, common = np.zeros(p), 1.0
        variance: Array = np.ones(len(left))
        for _ in range(2):
            M = sum(G / w for G, w in zip(products, variance))
            v = sum(b / w for b, w in zip(with_y, variance))
            own = np.linalg.solve(M + max(_RIDGE * float(np.trace(M)) / p, 1e-30) * np.eye(p), v)
            squares = np.array([float(np.sum((y[p:] - x @ own) ** 2)) + 1e-30 for x, y in zip(past, left)])
            variance, common = _variances(squares, rows)
        return cls(own, variance, common)

    def log_density(self, rows: Array) -> float:
        """Log prior density of the variances, and the constants of the likelihood of (flights,) numbers of rows."""
        k = 0.5 * _DEGREES
        each = k * np.log(k * self.common) - (k + 0.5 * rows) * np.log(self.variance) - k * self.common / self.variance
        return float(each.sum())


def _variances(squares: Array, rows: Array) -> tuple[Array, float]:
    """Most probable variance of each flight, and the value that they have in common."""
    common = float(np.exp(np.mean(np.log(squares / rows))))
    variance = squares / rows
    for _ in range(20):
        variance = (_DEGREES * common + squares) / (_DEGREES + rows)
        common = float(1.0 / np.mean(1.0 / variance))
    return variance, common
