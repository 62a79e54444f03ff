"""How sure the parameters are: coloured residuals, and a bootstrap that only reweights moments.

The textbook covariance believes that residuals are white; with flight data its 95 % intervals cover a third of the
time. Here are the correction of [KM16] for a fit made as if they were white, and random weights over blocks or
manoeuvres with which a whole selection is repeated at the price of algebra.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from structsel.numerics.arrays import Array
from structsel.numerics.cutting import whole_manoeuvres
from structsel.numerics.least_squares import Fit
from structsel.numerics.moments import MomentSet
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.passes import Part, Passes
from structsel.numerics.rows import RowMaker, Scales, Signals, base_scale, column_scale

PIECE = 1 << 16  # samples correlated at a time; lags across a piece's edge are not counted


def residual_autocorrelation(residual: Array, max_lag: int) -> Array:
    """Biased autocovariance (1/n) sum e[t] e[t + l] for l = 0 .. max_lag, (max_lag + 1,)."""
    n = residual.size
    full = signal.correlate(residual, residual, method="fft")
    return full[n - 1 : n + max_lag] / n


@dataclass(frozen=True)
class Scatter:
    """The job of `coloured_covariance`: sum of x(i) R(i - j) x(j)' over a part, in scaled units.

    Attributes
    ----------
    exponents : (k, s) int array
    theta : (1 + k,) array
    response : int
    max_lag : int or None
    scales : (s,) array, (m,) array
    """

    exponents: NDArray[np.integer]
    theta: Array
    response: int
    max_lag: int | None
    scales: Scales

    def size(self, part: Part) -> int:
        """Entries of the matrix."""
        return int(self.theta.size**2)

    def start(self) -> Callable[[Part], Array]:
        """A stretch of `PIECE` samples at a time."""
        p = len(self.exponents)
        maker = RowMaker(plan_rows(words_of(self.exponents)), p, self.scales)
        scale = column_scale(self.exponents, *self.scales)
        weights = self.theta * scale[: 1 + p] / scale[1 + p + self.response]

        def one(part: Part) -> Array:
            meat = np.zeros((1 + p, 1 + p))
            for piece in part:
                for start in range(piece.start, piece.stop, PIECE):
                    stop = min(start + PIECE, piece.stop)
                    rows = np.concatenate([r.copy() for r, _, _ in maker.chunks(piece.signals, start, stop)], axis=1)
                    X = rows[: 1 + p]
                    e = rows[1 + p + self.response] - weights @ X
                    lags = min(self.max_lag if self.max_lag is not None else e.size // 5, e.size - 1)
                    r = residual_autocorrelation(e, lags)
                    kernel = np.concatenate([r[:0:-1], r])
                    smooth = signal.fftconvolve(X, kernel[None, :], mode="full", axes=1)[:, lags : lags + e.size]
                    meat += X @ smooth.T
            return meat.ravel()

        return one


def coloured_covariance(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    fit: Fit,
    response: int = 0,
    max_lag: int | None = None,
    *,
    scales: Scales | None = None,
    passes: Passes | None = None,
    workers: int = 1,
) -> Array:
    """Covariance of an ordinary least-squares fit whose residuals are coloured.

    With D = inv(X'X) and R(l) the autocovariance of the residuals of each manoeuvre::

        Cov = D [ sum_i sum_j x(i) R(i - j) x(j)' ] D

    Parameters
    ----------
    fit : Fit
        The white fit of these terms to this response.
    max_lag : int, optional
        Longest lag kept; a fifth of each manoeuvre where absent.
    scales, passes, workers
        As for `accumulate`.

    Returns
    -------
    (1 + k, 1 + k) array

    References
    ----------
    [KM16], ch. 5, parameter covariance with coloured residuals.
    """
    scales = scales or base_scale(manoeuvres)
    parts = whole_manoeuvres([m.n for m in manoeuvres]).parts(manoeuvres)
    job = Scatter(exponents, fit.theta, response, max_lag, scales)
    k = fit.theta.size
    meat = (passes or Passes()).over(job, parts, workers).table.sum(axis=0).reshape(k, k)
    scale = column_scale(exponents, *scales)
    meat = 0.5 * (meat + meat.T) * np.outer(scale[:k], scale[:k]) * scale[k + response] ** 2
    bread = fit.unscaled_covariance
    return bread @ meat @ bread * (fit.n / max(fit.dof, 1))


def bootstrap_units(moments: MomentSet, fewest: int = 8) -> NDArray[np.int64]:
    """(B,) unit of each block: its manoeuvre where there are at least ``fewest``, else the block itself."""
    names, unit = np.unique(moments.manoeuvre, return_inverse=True)
    return unit if names.size >= fewest else np.arange(moments.n_blocks)


def bootstrap_weights(units: NDArray[np.int64], replicates: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Random weights (replicates, B) of mean and variance one, the same for all blocks of a unit.

    Exponential weights rather than counts: no unit ever drops out altogether, so a replicate is never singular
    where the data are not.
    """
    n_units = int(units.max()) + 1
    weights = rng.exponential(size=(replicates, n_units))
    weights /= weights.mean(axis=1, keepdims=True)
    return weights[:, units]
