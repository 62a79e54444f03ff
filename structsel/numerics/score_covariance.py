"""Covariance of estimates with coloured residuals: the sandwich formula.

The estimates of ordinary least squares or output error stay; their covariance is::

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
from itertools import pairwise

import numpy as np
import scipy

from structsel.numerics.arrays import Array
from structsel.numerics.noise_models import prewhiten
from structsel.numerics.regressors import SLAB

LONGEST_SEGMENT = 1 << 16
"""Maximum number of samples of a segment, which bounds the memory; lags across the ends of segments are not counted."""
_IN_A_ROW = 5
_WINDOW = 6  # length of the lag window, in lags that are correlated
FEW_LAGS = 150  # each side; half the time of transforms for 20,000 and 60,000 samples, and less for fewer lags


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
    """The double sum of `score_covariance` over one segment."""
    if residuals.shape[1] == 1 and np.isfinite(residuals).all():
        lags = _few_lags(residuals[:, 0])
        if lags.size:
            return _sum_over_lags(S[:, :, 0], lags)
    return _sum_over_frequencies(S, residuals)


def _few_lags(residual: Array) -> Array:
    """Autocovariance times the lag window, by lag from 0; empty if there are more than `FEW_LAGS`."""
    n = residual.size
    longest, pairs = n // 5 + 1, n - np.arange(FEW_LAGS, dtype=np.float64)

    def covariance(count: int) -> Array:
        return np.correlate(np.append(residual, np.zeros(count - 1)), residual) / pairs[:count]

    for count in (2 * _IN_A_ROW, FEW_LAGS // _WINDOW + _IN_A_ROW + 1):  # white residuals need only the first
        found = covariance(min(count, longest))
        correlated = last_correlated_lag(found, pairs[: found.size])
        if correlated + _IN_A_ROW <= found.size:
            break
    reach = min(_WINDOW * correlated, longest)
    if reach > FEW_LAGS:
        return np.empty(0)
    if reach > found.size:
        found = covariance(reach)
    return found[:reach] * parzen_window(np.arange(reach) / reach)


def _sum_over_lags(S: Array, lags: Array) -> Array:
    """Sum of x(i) R(i - j) x(j)' for columns x(i) of S (k, n) and R by lag: half of it, and its transpose."""
    k, n = S.shape
    total = np.zeros((k, k))
    if not lags[0]:
        return total  # no residual
    past, filtered = lags.size - 1, np.empty((k, SLAB))
    for start in range(0, n, SLAB):  # a slab stays in the cache
        stop, first = min(start + SLAB, n), max(start - past, 0)
        rows = np.zeros((k, past + stop - start))
        rows[:, first - stop :] = S[:, first:stop]
        prewhiten(rows, -2.0 * lags[1:] / lags[0], 0.5 * lags[0], past, filtered)
        total += S[:, start:stop] @ filtered[:, : stop - start].T
    return total + total.T


def _sum_over_frequencies(S: Array, residuals: Array) -> Array:
    """The double sum by transforms, for any number of channels and of lags."""
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
    reach = min(max(_WINDOW * last_correlated_lag(*(x[:longest] for x in of)) for of in own), longest)
    window = parzen_window(distance / reach)
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
        # The real part of conj(x) y is a product of real and imaginary parts, which are neighbours in memory.
        total += transformed[a].view(float) @ (weight * filtered).view(float).T
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
