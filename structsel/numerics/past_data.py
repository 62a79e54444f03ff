"""Base signals of a manoeuvre with their own past and that of residuals: the instruments of `instrumental`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.regressors import DataSource

SIGNAL_LAGS = (5, 8, 13)
"""Lags of the instruments, in samples. The least lies beyond the reach of a fourth-order central difference (2 samples
on either side) of two samples; the others spread over a quarter of a second at 50 Hz."""
RESIDUAL_LAGS = (3, 5, 8, 13, 21)
"""Lags of the other responses' residuals, in samples; the least lies beyond the reach of the difference."""


@dataclass(frozen=True)
class PastData:
    """A manoeuvre whose base signals include their own past and that of residuals.

    The base signals are those of the source, then those of each of `SIGNAL_LAGS` earlier, then the residuals of each of
    `RESIDUAL_LAGS` earlier. Before the first sample a signal has its first value.

    Attributes
    ----------
    source : DataSource
    exponents : tuple of (k, s) int array
        Terms of each response of the source.
    theta : tuple of (1 + k,) array
        Their parameters, the constant first.
    rows : tuple of int
        Responses of the source that are responses here.
    residuals : tuple of int
        Responses of the source whose residuals are base signals here.
    """

    source: DataSource
    exponents: tuple[NDArray[np.integer], ...]
    theta: tuple[Array, ...]
    rows: tuple[int, ...]
    residuals: tuple[int, ...]

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.source.n

    def base(self, start: int, stop: int) -> Array:
        """(s (1 + lags) + m lags, stop - start) base signals."""
        first = max(0, start - max(*SIGNAL_LAGS, *RESIDUAL_LAGS))
        signals, responses = self.source.base(first, stop), self.source.responses(first, stop)
        residuals = np.empty((len(self.residuals), stop - first))
        for row, r in zip(residuals, self.residuals, strict=True):
            row[:] = responses[r] - self.theta[r][0]
            for value, powers in zip(self.theta[r][1:], self.exponents[r], strict=True):
                row -= _monomial(value, signals, powers)
        s, m, width = len(signals), len(residuals), stop - start
        found = np.empty((s * (1 + len(SIGNAL_LAGS)) + m * len(RESIDUAL_LAGS), width))
        found[:s] = signals[:, start - first :]
        for values, lags, at in ((signals, SIGNAL_LAGS, s), (residuals, RESIDUAL_LAGS, s * (1 + len(SIGNAL_LAGS)))):
            for i, lag in enumerate(lags):
                into, before = found[at + i * len(values) : at + (i + 1) * len(values)], min(max(lag - start, 0), width)
                into[:, :before] = values[:, :1]
                into[:, before:] = values[:, start + before - lag - first : stop - lag - first]
        return found

    def responses(self, start: int, stop: int) -> Array:
        """(rows, stop - start) responses."""
        return self.source.responses(start, stop)[list(self.rows)]


def _monomial(value: float, signals: Array, powers: NDArray[np.integer]) -> Array:
    """(n,) value times the product of powers of the signals (s, n), of which one at least is above zero."""
    first, *others = np.repeat(np.arange(powers.size), powers).tolist()
    product = value * signals[first]
    for i in others:
        product *= signals[i]
    return product


def past_exponents(
    candidates: NDArray[np.integer], products: Sequence[int], n_responses: int
) -> tuple[NDArray[np.int64], int, int]:
    """Exponents in the base signals of `PastData`: candidates, instruments, and residuals.

    Parameters
    ----------
    candidates : (p, s) int array
    products : sequence of int
        Candidates whose value at the first lag is an instrument as well.
    n_responses : int

    Returns
    -------
    (p + z + w, s') int array, z, w
        Rows of candidates, instruments and residuals (response by response within each lag).
    """
    p, s = candidates.shape
    z, w = s * len(SIGNAL_LAGS), n_responses * len(RESIDUAL_LAGS)
    table = np.zeros((p + z + len(products) + w, s + z + w), dtype=np.int64)
    table[:p, :s] = candidates
    table[p : p + z, s : s + z] = np.eye(z, dtype=np.int64)
    table[p + z : p + z + len(products), s : 2 * s] = candidates[list(products)]
    table[p + z + len(products) :, s + z :] = np.eye(w, dtype=np.int64)
    return table, z + len(products), w
