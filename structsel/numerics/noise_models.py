"""Coloured residuals: autoregressive noise models, prewhitening, autocovariance.

Samples of one manoeuvre are not independent: turbulence, smoothing and unmodelled dynamics leave residuals that
are correlated with their neighbours. One remedy is prewhitening (generalised least squares). An AR model of each
manoeuvre's residual::

    e[t] = sum_l ar[l-1] e[t-l] + w[t],    w white with standard deviation sigma

is fitted by least squares, its order chosen by BIC. The same filter applied to response and regressors keeps the
parameters of the regression and makes its residuals white.

The other remedy keeps the estimates of ordinary least squares and corrects their covariance; see `score_covariance`.

References
----------
[KM16], ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

# ---------------------------------------------------------------- autoregressive noise models


@dataclass(frozen=True)
class ARNoise:
    """Noise model of one manoeuvre's residual: e[t] = sum_l ar[l-1] e[t-l] + w[t], w white.

    Attributes
    ----------
    ar : (L,) array [-]
        Empty for white noise.
    sigma : float
        Standard deviation of w, in units of the response; the manoeuvre is weighted by 1/sigma.
    """

    ar: NDArray[np.float64]
    sigma: float = 1.0

    @property
    def order(self) -> int:
        """Order of the autoregression."""
        return int(self.ar.size)


WHITE_NOISE = ARNoise(np.empty(0), 1.0)


@njit(cache=True, nogil=True, fastmath=True)
def prewhiten(rows: Array, ar: Array, weight: float, start: int, out: Array) -> None:  # pragma: no cover - compiled
    """``out[:, t] = weight (rows[:, start + t] - sum_l ar[l-1] rows[:, start + t - l])``."""
    n = rows.shape[1] - start
    for i in range(rows.shape[0]):
        x, y = rows[i], out[i]
        for t in range(n):
            y[t] = weight * x[start + t]
        single = ar.size % 4
        for lag in range(1, single + 1):  # by lag, so that the inner loop has unit stride
            a = weight * ar[lag - 1]
            for t in range(n):
                y[t] -= a * x[start + t - lag]
        for lag in range(single + 1, ar.size + 1, 4):  # several at once, so that y is read and written less often
            a, b, c, d = weight * ar[lag - 1], weight * ar[lag], weight * ar[lag + 1], weight * ar[lag + 2]
            at = start - lag
            for t in range(n):
                y[t] -= a * x[at + t] + b * x[at + t - 1] + c * x[at + t - 2] + d * x[at + t - 3]


class LagProducts:
    """Products of a residual with its past, accumulated segment by segment.

    Parameters
    ----------
    max_order : int
        The highest order of autoregression that will be fitted.
    """

    def __init__(self, max_order: int):
        self.max_order = max_order
        self.products = np.zeros((max_order + 1, max_order + 1))
        self.n = 0
        self._past = np.empty(0)

    def add(self, residual: NDArray[np.float64]) -> None:
        """Add the next segment (n,) of the same manoeuvre."""
        series = np.concatenate([self._past, residual])
        count = series.size - self.max_order
        if count > 0:
            lags = np.lib.stride_tricks.sliding_window_view(series, self.max_order + 1)
            # Columns: nearest lag first, the present last, so that every lower order is nested in the triangle.
            table = np.concatenate([lags[:, -2::-1], lags[:, -1:]], axis=1)
            self.products += table.T @ table
            self.n += count
        self._past = series[max(0, series.size - self.max_order) :]


def fit_ar(lags: LagProducts, floor: float = 0.0) -> ARNoise:
    """Autoregression of the order with the least BIC, from order zero up.

    One triangular factor holds the residual sum of squares of every order, since orders are nested.

    Parameters
    ----------
    lags : LagProducts
        Of one manoeuvre's residual (mean removed by the regression's constant).
    floor : float
        Least standard deviation of the innovation, in units of the response; a noise-free fit would divide by zero.

    Raises
    ------
    SelectionError
        The manoeuvre is too short for the highest order.
    """
    n, top = lags.n, lags.max_order
    if n <= 3 * (top + 1):
        raise SelectionError(
            f"fit_ar needs more than {3 * (top + 1)} samples for order {top}; this manoeuvre leaves {n}. "
            "Lower max_order, or join short manoeuvres."
        )
    energy = lags.products[-1, -1]
    if not energy > n * floor**2 or energy == 0.0:
        return ARNoise(np.empty(0), max(floor, np.sqrt(energy / n), np.finfo(float).tiny))
    ridge = 1e-13 * np.trace(lags.products) / (top + 1)
    factor = scipy.linalg.cholesky(lags.products + ridge * np.eye(top + 1), lower=False)
    rss = np.cumsum(factor[::-1, -1] ** 2)[::-1]  # rss[k]: residual sum of squares at order k
    bic = n * np.log(rss) + np.arange(top + 1) * np.log(n)
    order = int(np.argmin(bic))
    ar = scipy.linalg.solve_triangular(factor[:order, :order], factor[:order, -1]) if order else np.empty(0)
    return ARNoise(ar, max(float(np.sqrt(rss[order] / (n - order))), floor))


def pooled_innovation_std(models: Sequence[ARNoise], n: Sequence[int]) -> float:
    """Common innovation level of several manoeuvres: the root of the sample-weighted harmonic mean square.

    Weighting manoeuvre k by ``level / sigma_k`` keeps prewhitened residuals in the units of the response.
    """
    weight = np.asarray(n, dtype=float)
    precision = np.array([model.sigma**-2 for model in models])
    return float(np.sqrt(weight.sum() / (weight * precision).sum()))


# ---------------------------------------------------------------- autocovariance


def autocovariance(x: Array, max_lag: int) -> Array:
    """Biased autocovariance of x about zero, (1/n) sum_t x[t] x[t + l] for l = 0 .. max_lag, (max_lag + 1,)."""
    size = scipy.fft.next_fast_len(x.size + max_lag, real=True)
    return scipy.fft.irfft(np.abs(scipy.fft.rfft(x, size)) ** 2, size)[: max_lag + 1] / x.size


def autocorrelation(x: Array, max_lag: int) -> Array:
    """Autocorrelation of x about its mean at lags 0 .. max_lag, (max_lag + 1,); 0 after the first for a constant x."""
    covariance = autocovariance(x - np.mean(x), max_lag)
    return covariance / covariance[0] if covariance[0] > 0.0 else np.eye(1, max_lag + 1)[0]


# ---------------------------------------------------------------- bootstrap


def random_block_weights(units: NDArray[np.int64], replicates: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Bootstrap weights (replicates, B) of mean and variance one, the same for all blocks of a unit.

    Exponential weights instead of counts: no unit has zero weight, so a replicate is singular only if the data are.
    """
    n_units = int(units.max()) + 1
    weights = rng.exponential(size=(replicates, n_units))
    weights /= weights.mean(axis=1, keepdims=True)
    return weights[:, units]
