"""Coloured residuals: autoregressive noise models, prewhitening, autocovariance, and covariances that allow for them.

Samples of one manoeuvre are not independent: turbulence, smoothing and unmodelled dynamics leave residuals that
are correlated with their neighbours. There are two remedies.

**Prewhitening** (generalised least squares). An AR model of each manoeuvre's residual::

    e[t] = sum_l ar[l-1] e[t-l] + w[t],    w white with standard deviation sigma

is fitted by least squares, its order chosen by BIC. The same filter applied to response and regressors keeps the
parameters of the regression and makes its residuals white.

**The sandwich covariance.** The estimates of ordinary least squares or output error stay; their covariance is::

    D = [sum_i S_i' S_i]^-1                          white residuals: the Cramer-Rao bound
    D [sum_ij S_i' w(i - j) R(i - j) S_j] D          coloured residuals, R their autocovariance

with S_i the sensitivities at sample i (the regressors, for a regression). The middle, `score_covariance`, is the
covariance of the score sum_i S_i' v_i. The lag window w is Parzen's, to six times the lag M after which the residuals
are no longer correlated, at most to a fifth of the manoeuvre::

    w(l) = 1 - 6 u^2 + 6 u^3,  u = |l| / (6 M) <= 1/2;    2 (1 - u)^3,  1/2 < u <= 1;    0 beyond

M is Politis's: the first lag from which five autocorrelations in a row are below 2 sqrt(log10(n) / n).

One window serves all standard errors of the package. It was chosen by the coverage of 95 % intervals, for regressors
of a flight and for slow sensitivities such as those of flight-path reconstruction (``benchmarks/lag_windows.py``):

- All lags to n/5, without a window [KM16] or with Bartlett's or Parzen's, cover 85 to 89 % with slow sensitivities and
  white residuals, and 93 to 94 % with Politis's lag: the fit removes the slow part from its residuals.
- Bartlett's window to four times the first lag within 2 sigma of zero covers 2 to 4 percentage points less where a slow
  disturbance and a 3 Hz mode add up: there the autocorrelation crosses zero early.
- Andrews' automatic bandwidth uses one lag only. It covers 52 to 77 % where white noise conceals a slow disturbance;
  Politis's lag covers 69 to 94 %, a fixed fifth 77 to 94 %.

If a record is short compared with the correlation time of its residuals, the intervals are too narrow with any window.

References
----------
[KM16], parameter covariance with coloured residuals, for regression (ch. 5) and output error. [P03], adaptive
bandwidth choice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

LONGEST_SEGMENT = 1 << 16
"""Maximum number of samples of a segment, which bounds the memory; lags across the ends of segments are not counted."""
_IN_A_ROW = 5
FEW_LAGS = 24  # each side; as fast as transforms of 20,000 samples, and faster for fewer


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


# ---------------------------------------------------------------- covariance with coloured residuals


def coloured_covariance(X: Sequence[Array], residuals: Sequence[Array]) -> Array:
    """Covariance of ordinary least squares whose residuals are coloured.

    ::

        Cov = n / (n - k)  D [sum_ij x(i) w(i - j) R(i - j) x(j)'] D,    D = (X'X)^-1

    Parameters
    ----------
    X : sequence of (n_k, k) array
        Regressors of each manoeuvre; together of full rank.
    residuals : sequence of (n_k,) array
        Of the fit to all manoeuvres.

    Returns
    -------
    (k, k) array
    """
    size = np.sqrt(sum(np.sum(x**2, axis=0) for x in X))
    scaled = [x / size for x in X]
    bread = scipy.linalg.inv(sum(x.T @ x for x in scaled))
    meat = sum(score_covariance(x.T[:, :, None], e[:, None]) for x, e in zip(scaled, residuals, strict=True))
    n = sum(e.size for e in residuals)
    return bread @ meat @ bread * (n / max(n - size.size, 1)) / np.outer(size, size)


def score_covariance(S: Array, residuals: Array) -> Array:
    """Covariance of the score: the middle of the sandwich, for one manoeuvre.

    Parameters
    ----------
    S : (k, n, c) array
        Sensitivities of the c outputs; 0 where not sampled.
    residuals : (n, c) array
        NaN where not sampled. In output error both are divided by the standard deviation of their channel.

    Returns
    -------
    (k, k) array
        Symmetric, positive semidefinite.
    """
    segments = split_for_correlation(residuals.shape[0])
    total = np.sum([_score_covariance(S[:, a:b], residuals[a:b]) for a, b in segments], axis=0)
    # With missing samples the number of pairs varies with the lag, and small negative eigenvalues are possible.
    values, vectors = scipy.linalg.eigh(0.5 * (total + total.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def split_for_correlation(n: int) -> Iterator[tuple[int, int]]:
    """Start and stop of segments of about equal length, at most `LONGEST_SEGMENT`, of n samples."""
    edges = np.linspace(0, n, -(-n // LONGEST_SEGMENT) + 1).astype(int).tolist()
    yield from pairwise(edges)


def _score_covariance(S: Array, residuals: Array) -> Array:
    """The double sum of `score_covariance` over one segment, by transforms."""
    k, n, _ = S.shape
    channels = np.flatnonzero(np.isfinite(residuals).any(axis=0))
    if not channels.size:
        return np.zeros((k, k))
    longest = n // 5 + 1
    size = scipy.fft.next_fast_len(n + longest, real=True)  # lags beyond the window, which wrap around, have no weight
    sampled = np.isfinite(residuals[:, channels])
    v = scipy.fft.rfft(np.where(sampled, residuals[:, channels], 0.0), size, axis=0)
    complete = bool(sampled.all())
    mask = scipy.fft.rfft(sampled.astype(float), size, axis=0) if not complete else np.empty((0, 0))
    distance = np.minimum(np.arange(size), size - np.arange(size))

    def covariance(a: int, b: int) -> tuple[Array, Array]:
        """Mean of v_a[i + l] v_b[i] over its pairs of samples, negative lags at the end, and the pairs."""
        if complete:
            pairs = np.maximum(n - distance, 0).astype(float)
        else:
            pairs = np.round(scipy.fft.irfft(mask[:, a] * mask[:, b].conj(), size))
        return scipy.fft.irfft(v[:, a] * v[:, b].conj(), size) / np.maximum(pairs, 1.0), pairs

    own = [covariance(c, c) for c in range(channels.size)]
    reach = min(max(6 * last_correlated_lag(*(x[:longest] for x in of)) for of in own), longest)
    window = parzen_window(distance / reach)
    if channels.size == 1 and complete and reach <= FEW_LAGS:
        # R(l) w(l) x(i - l) directly: few lags cost less than transforms of all sensitivities.
        lags = np.arange(-reach, reach + 1)
        filtered = scipy.ndimage.correlate1d(S[:, :, 0], (window * own[0][0])[lags], axis=1, mode="constant")
        return S[:, :, 0] @ filtered.T
    # Parseval: the sum over samples is one over the frequencies of a real transform, which holds one of each pair.
    weight = np.full(v.shape[0], 2.0 / size)
    weight[0] = 1.0 / size
    if size % 2 == 0:
        weight[-1] = 1.0 / size
    total = np.zeros((k, k))
    transformed = [scipy.fft.rfft(S[:, :, c], size, axis=1) for c in channels]
    for a in range(channels.size):
        pairs = [own[a][0] if a == b else covariance(a, b)[0] for b in range(channels.size)]
        filtered = sum(of * scipy.fft.rfft(window * R) for of, R in zip(transformed, pairs, strict=True))
        total += ((transformed[a].conj() * weight) @ filtered.T).real
    return total


def last_correlated_lag(autocovariance: Array, pairs: Array) -> int:
    """Politis's lag: the first from which five autocorrelations in a row are within 2 sqrt(log10(n) / n) of zero.

    Parameters
    ----------
    autocovariance, pairs : (m,) array
        By lag from 0, and the pairs of samples behind each; lags without a pair are passed over.
    """
    lags = np.flatnonzero(pairs[1:] > 0.0) + 1
    n = max(pairs[0], 2.0)
    small = np.abs(autocovariance[lags]) <= 2.0 * np.sqrt(np.log10(n) / n) * autocovariance[0]
    if small.size < _IN_A_ROW:
        return int(autocovariance.size)
    row = np.lib.stride_tricks.sliding_window_view(small, _IN_A_ROW).all(axis=1)
    return int(lags[np.argmax(row)]) if row.any() else int(autocovariance.size)


def parzen_window(u: Array) -> Array:
    """Parzen's lag window at u >= 0 of its length; its spectrum is not negative, so no variance is."""
    u = np.minimum(u, 1.0)
    return np.where(u < 0.5, 1.0 - 6.0 * u**2 + 6.0 * u**3, 2.0 * (1.0 - u) ** 3)


def spectral_score_covariance(S: Array, residuals: Array) -> Array:
    """Covariance of the score for Fourier transforms, which are uncorrelated but have different variances.

    Parameters
    ----------
    S : (k, 2 f, c) array
        Whitened sensitivities, real parts before imaginary parts.
    residuals : (2 f, c) array
        Whitened.

    Returns
    -------
    (k, k) array
        With the spectrum of the residuals, averaged over neighbouring frequencies.
    """
    half = residuals.shape[0] // 2
    v = residuals[:half] + 1j * residuals[half:]
    products = np.einsum("fa,fb->fab", v, v.conj()).real / 2.0
    neighbours = max(int(np.sqrt(half)), 1)
    power = scipy.ndimage.uniform_filter1d(products, 2 * neighbours + 1, axis=0, mode="nearest")
    parts = (S[:, :half], S[:, half:])
    return np.sum([np.einsum("kfa,fab,lfb->kl", part, power, part, optimize=True) for part in parts], axis=0)


def random_block_weights(units: NDArray[np.int64], replicates: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Bootstrap weights (replicates, B) of mean and variance one, the same for all blocks of a unit.

    Exponential weights instead of counts: no unit has zero weight, so a replicate is singular only if the data are.
    """
    n_units = int(units.max()) + 1
    weights = rng.exponential(size=(replicates, n_units))
    weights /= weights.mean(axis=1, keepdims=True)
    return weights[:, units]
