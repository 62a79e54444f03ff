"""The colour of residuals: autoregressive models of each manoeuvre, and the filter that whitens.

Samples of one manoeuvre are not independent: turbulence, smoothing and unmodelled dynamics leave residuals that
resemble their neighbours. An AR model of each manoeuvre's residual, fitted by least squares with its order chosen by
BIC, turns them white; the same filter applied to response and candidates alike keeps the regression's parameters
and makes its F-tests and intervals true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import linalg

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array


@dataclass(frozen=True)
class Colour:
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

    def correlation_time(self, dt: float) -> float:
        """Time the noise remembers, dt (1 + 2 sum_l rho_l), from its spectrum at zero frequency [s]."""
        h = np.concatenate([[1.0], -self.ar])
        spectrum = 1.0 / np.abs(np.fft.fft(h, 1 << 14)) ** 2
        return float(dt * spectrum[0] / spectrum.mean())


WHITE = Colour(np.empty(0), 1.0)


@njit(cache=True, nogil=True, fastmath=True)
def whiten_rows(rows: Array, ar: Array, weight: float, start: int, out: Array) -> None:  # pragma: no cover - compiled
    """``out[:, t] = weight (rows[:, start + t] - sum_l ar[l-1] rows[:, start + t - l])``."""
    n = rows.shape[1] - start
    order = ar.size
    for i in range(rows.shape[0]):
        x = rows[i]
        y = out[i]
        for t in range(n):
            y[t] = weight * x[start + t]
        lag = 0
        while lag + 8 <= order:  # eight lags to one pass over the row: loads from cache are what it costs
            a, b, c, d = weight * ar[lag], weight * ar[lag + 1], weight * ar[lag + 2], weight * ar[lag + 3]
            e, f, g, h = weight * ar[lag + 4], weight * ar[lag + 5], weight * ar[lag + 6], weight * ar[lag + 7]
            s = start - lag
            for t in range(n):
                near = a * x[s + t - 1] + b * x[s + t - 2] + c * x[s + t - 3] + d * x[s + t - 4]
                y[t] -= near + e * x[s + t - 5] + f * x[s + t - 6] + g * x[s + t - 7] + h * x[s + t - 8]
            lag += 8
        while lag + 4 <= order:
            a, b, c, d = weight * ar[lag], weight * ar[lag + 1], weight * ar[lag + 2], weight * ar[lag + 3]
            s = start - lag
            for t in range(n):
                y[t] -= a * x[s + t - 1] + b * x[s + t - 2] + c * x[s + t - 3] + d * x[s + t - 4]
            lag += 4
        while lag < order:
            a = weight * ar[lag]
            s = start - lag - 1
            for t in range(n):
                y[t] -= a * x[s + t]
            lag += 1


class LagMoments:
    """Products of a residual with its own past, added up chunk by chunk.

    Parameters
    ----------
    max_order : int
        The highest order of autoregression that will be asked for.
    """

    def __init__(self, max_order: int):
        self.max_order = max_order
        self.products = np.zeros((max_order + 1, max_order + 1))
        self.n = 0
        self._past = np.empty(0)

    def add(self, residual: NDArray[np.float64]) -> None:
        """Add the next stretch (n,) of the same manoeuvre."""
        series = np.concatenate([self._past, residual])
        count = series.size - self.max_order
        if count > 0:
            lags = np.lib.stride_tricks.sliding_window_view(series, self.max_order + 1)
            # Columns: nearest lag first, the present last, so that every lower order is nested in the triangle.
            table = np.concatenate([lags[:, -2::-1], lags[:, -1:]], axis=1)
            self.products += table.T @ table
            self.n += count
        self._past = series[max(0, series.size - self.max_order) :]


def fit_ar(moments: LagMoments, floor: float = 0.0) -> Colour:
    """Autoregression of the order with the least BIC, from order zero up.

    One triangular factor holds the residual sum of squares of every order, since orders are nested.

    Parameters
    ----------
    moments : LagMoments
        Of one manoeuvre's residual (mean removed by the regression's constant).
    floor : float
        Least innovation standard deviation, response units; keeps a noise-free fit from dividing by nothing.

    Raises
    ------
    SelectionError
        Where the manoeuvre is too short for the orders asked for.
    """
    n, top = moments.n, moments.max_order
    if n <= 3 * (top + 1):
        raise SelectionError(
            f"fit_ar needs more than {3 * (top + 1)} samples for order {top}; this manoeuvre leaves {n}. "
            "Lower max_order, or join short manoeuvres."
        )
    energy = moments.products[-1, -1]
    if not energy > n * floor**2 or energy == 0.0:
        return Colour(np.empty(0), max(floor, np.sqrt(energy / n), np.finfo(float).tiny))
    ridge = 1e-13 * np.trace(moments.products) / (top + 1)
    factor = linalg.cholesky(moments.products + ridge * np.eye(top + 1), lower=False)
    tails = np.cumsum(factor[::-1, -1] ** 2)[::-1]  # tails[k]: residual sum of squares at order k
    score = n * np.log(tails) + np.arange(top + 1) * np.log(n)
    order = int(np.argmin(score))
    ar = linalg.solve_triangular(factor[:order, :order], factor[:order, -1]) if order else np.empty(0)
    return Colour(ar, max(float(np.sqrt(tails[order] / (n - order))), floor))


def reference_sigma(colours: Sequence[Colour], n: Sequence[int]) -> float:
    """Common innovation level of several manoeuvres: the root of the sample-weighted harmonic mean square.

    Weighting manoeuvre k by ``reference / sigma_k`` keeps whitened residuals in the units of the response.
    """
    weight = np.asarray(n, dtype=float)
    precision = np.array([c.sigma**-2 for c in colours])
    return float(np.sqrt(weight.sum() / (weight * precision).sum()))
