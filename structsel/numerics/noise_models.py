"""Coloured residuals: autoregressive noise models, prewhitening, autocovariance.

Samples of one manoeuvre are not independent: turbulence, smoothing and unmodelled dynamics leave residuals that
are correlated with their neighbours. One remedy is prewhitening (generalised least squares). An AR model of each
manoeuvre's residual::

    e[t] = sum_l ar[l-1] e[t-l] + w[t],    w white with standard deviation sigma

is fitted by least squares, its order chosen by BIC. Several manoeuvres have one autoregression, each with its own
sigma, where BIC prefers that: short manoeuvres alone determine only a low order, and intervals are then too narrow. The
same filter applied to response and regressors keeps the parameters of the regression and makes its residuals white.

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

COMMON_ROUNDS = 3  # of a common autoregression and the levels of the manoeuvres, which start near the solution


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
        # Views begin at zero, because the compiler vectorises only if no index can be negative.
        x, y = rows[i], out[i]
        now = x[start:]
        single = ar.size % 4  # the first pass has these lags and the sample itself
        if single == 0:
            for t in range(n):
                y[t] = weight * now[t]
        elif single == 1:
            a, x1 = weight * ar[0], x[start - 1 :]
            for t in range(n):
                y[t] = weight * now[t] - a * x1[t]
        elif single == 2:
            a, b, x1, x2 = weight * ar[0], weight * ar[1], x[start - 1 :], x[start - 2 :]
            for t in range(n):
                y[t] = weight * now[t] - a * x1[t] - b * x2[t]
        else:
            a, b, c = weight * ar[0], weight * ar[1], weight * ar[2]
            x1, x2, x3 = x[start - 1 :], x[start - 2 :], x[start - 3 :]
            for t in range(n):
                y[t] = weight * now[t] - a * x1[t] - b * x2[t] - c * x3[t]
        for lag in range(single + 1, ar.size + 1, 4):  # several at once, so that y is read and written less often
            a, b, c, d = weight * ar[lag - 1], weight * ar[lag], weight * ar[lag + 1], weight * ar[lag + 2]
            at = start - lag
            x1, x2, x3, x4 = x[at:], x[at - 1 :], x[at - 2 :], x[at - 3 :]
            for t in range(n):
                y[t] -= a * x1[t] + b * x2[t] + c * x3[t] + d * x4[t]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_lag_products(series: Array, products: Array) -> None:  # pragma: no cover - compiled
    """Add ``sum_t z_t z_t'``, z_t = [x[t-1] ... x[t-L], x[t]] for t >= L, to ``products`` (L + 1, L + 1).

    Sums of equal lag differ by the first and the last products only::

        sum_t x[t-i-1] x[t-j-1] = sum_t x[t-i] x[t-j] + x[L-i-1] x[L-j-1] - x[n-i-1] x[n-j-1]
    """
    order, n = products.shape[0] - 1, series.size
    for lag in range(order + 1):
        present, past = series[order:], series[order - lag : n - lag]
        total = 0.0
        for t in range(present.size):
            total += present[t] * past[t]
        # Lag i is in row i - 1, and the present, lag 0, in the last row.
        row, column = order, (lag - 1 if lag else order)
        products[row, column] += total
        if lag:
            products[column, row] += total
        for i in range(order - lag):
            j = i + lag
            total += series[order - i - 1] * series[order - j - 1] - series[n - i - 1] * series[n - j - 1]
            products[i, j] += total
            if lag:
                products[j, i] += total


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
            # The nearest lag is first, the present last, so that every lower order is nested in the triangle.
            add_lag_products(series, self.products)
            self.n += count
        self._past = series[max(0, series.size - self.max_order) :]

    def factor(self) -> Array:
        """Triangular factor of the products, which a small ridge keeps positive definite."""
        ridge = 1e-13 * np.trace(self.products) / (self.max_order + 1)
        return scipy.linalg.cholesky(self.products + ridge * np.eye(self.max_order + 1), lower=False)

    def up_to(self, order: int) -> LagProducts:
        """Products of the same samples for a lower maximum order."""
        kept = [*range(order), self.max_order]
        return LagProducts.of(self.products[np.ix_(kept, kept)], self.n)

    def residual_squares(self, ar: Array) -> float:
        """Sum of squares that this autoregression, of at most the maximum order, leaves."""
        weights = np.zeros(self.max_order + 1)
        weights[: ar.size], weights[-1] = -ar, 1.0
        return float(np.sum((self.factor() @ weights) ** 2))

    @classmethod
    def of(cls, products: Array, n: int) -> LagProducts:
        """From the products of ``n`` samples."""
        lags = cls(len(products) - 1)
        lags.products, lags.n = products, n
        return lags


def weighted_sum(lags: Sequence[LagProducts], weights: Array) -> LagProducts:
    """Sum of products of the same maximum order, each with its weight."""
    products = np.tensordot(weights, np.stack([of.products for of in lags]), 1)
    return LagProducts.of(products, sum(of.n for of in lags))


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
    factor = lags.factor()
    rss = np.cumsum(factor[::-1, -1] ** 2)[::-1]  # rss[k]: residual sum of squares at order k
    bic = n * np.log(rss) + np.arange(top + 1) * np.log(n)
    order = int(np.argmin(bic))
    ar = scipy.linalg.solve_triangular(factor[:order, :order], factor[:order, -1]) if order else np.empty(0)
    return ARNoise(ar, max(float(np.sqrt(rss[order] / (n - order))), floor))


def fit_ar_of_manoeuvres(lags: Sequence[LagProducts], floor: float = 0.0) -> tuple[ARNoise, ...]:
    """Autoregression of each manoeuvre, or one of all with a sigma of each, whichever has the least BIC.

    ::

        sum_k n_k log(rss_k / n_k) + L_k log n_k         one of each manoeuvre
        sum_k n_k log(rss_k / n_k) + L log(sum_k n_k)    one of all

    The common autoregression weights each manoeuvre by 1 / sigma_k^2, and is found in turn with these.

    Parameters
    ----------
    lags : sequence of LagProducts
        Of each manoeuvre's residual.
    floor : float
        As for `fit_ar`.
    """
    own = tuple(fit_ar(of, floor) for of in lags)
    if len(lags) < 2 or any(model.sigma <= floor for model in own):
        return own
    n = np.array([of.n for of in lags])
    nested = [of.up_to(min(of.max_order for of in lags)) for of in lags]
    variance = np.array([model.sigma**2 for model in own])
    for _ in range(COMMON_ROUNDS):
        common = fit_ar(weighted_sum(nested, 1.0 / variance))
        variance = np.array([of.residual_squares(common.ar) for of in nested]) / n
    alone = np.array([of.residual_squares(model.ar) for of, model in zip(lags, own, strict=True)]) / n
    orders = np.array([model.order for model in own])
    if n @ np.log(variance) + common.order * np.log(n.sum()) >= n @ np.log(alone) + orders @ np.log(n):
        return own
    sigma = np.maximum(np.sqrt(variance / (1.0 - common.order / n.sum())), floor)
    return tuple(ARNoise(common.ar, float(of)) for of in sigma)


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
