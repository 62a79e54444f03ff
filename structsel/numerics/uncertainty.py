"""How sure the parameters are: coloured residuals, and a bootstrap that only reweights moments.

The textbook covariance believes that residuals are white; with flight data its 95 % intervals cover a third of the
time. Here are the correction of [KM16] for a fit made as if they were white, and random weights over blocks or
manoeuvres with which a whole selection is repeated at the price of algebra.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from structsel.numerics.least_squares import Fit
from structsel.numerics.moments import MomentSet
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.rows import Array, RowMaker, Signals, base_scale, column_scale

PIECE = 1 << 16  # samples correlated at a time; lags across a piece's edge are not counted


def residual_autocorrelation(residual: Array, max_lag: int) -> Array:
    """Biased autocovariance (1/n) sum e[t] e[t + l] for l = 0 .. max_lag, (max_lag + 1,)."""
    n = residual.size
    full = signal.correlate(residual, residual, method="fft")
    return full[n - 1 : n + max_lag] / n


def coloured_covariance(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    fit: Fit,
    response: int = 0,
    max_lag: int | None = None,
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

    Returns
    -------
    (1 + k, 1 + k) array

    References
    ----------
    [KM16], ch. 5, parameter covariance with coloured residuals.
    """
    scales = base_scale(manoeuvres)
    words = words_of(exponents)
    p = len(words)
    maker = RowMaker(plan_rows(words), p, scales)
    scale = column_scale(exponents, *scales)
    out = scale[1 + p + response]
    weights = fit.theta * scale[: 1 + p] / out
    meat = np.zeros((1 + p, 1 + p))
    for signals in manoeuvres:
        for start in range(0, signals.n, PIECE):
            stop = min(start + PIECE, signals.n)
            rows = np.concatenate([r.copy() for r, _, _ in maker.chunks(signals, start, stop)], axis=1)
            X = rows[: 1 + p]
            e = rows[1 + p + response] - weights @ X
            lags = min(max_lag if max_lag is not None else e.size // 5, e.size - 1)
            r = residual_autocorrelation(e, lags)
            kernel = np.concatenate([r[:0:-1], r])
            smooth = signal.fftconvolve(X, kernel[None, :], mode="full", axes=1)[:, lags : lags + e.size]
            meat += X @ smooth.T
    meat = 0.5 * (meat + meat.T) * np.outer(scale[: 1 + p], scale[: 1 + p]) * out**2
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
