"""How sure output error is of its parameters when the residuals have a colour.

With v whitened residuals (each divided by the standard deviation the fit gave its channel) and S_i = dz_i/dtheta
divided alike, the least-squares estimate has::

    D = [sum_i S_i' S_i]^-1                                   residuals white: the Cramer-Rao bound
    D [sum_ij S_i' C(i - j) S_j] D                            residuals coloured, C their autocovariance

References
----------
[KM16], output error, covariance with coloured residuals.
"""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

_TAPER = 4  # times the lag at which the residuals are no longer alike


def coloured_information(S: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """The middle of the sandwich, sum_ij S_i' C(i - j) S_j, for one manoeuvre.

    The autocovariance is tapered to nothing at a few times the lag at which it is first within two standard
    errors of zero in every channel, at most a fifth of the manoeuvre: summed over all lags it would vanish, as the
    residuals of a fit are orthogonal to its sensitivities.

    Parameters
    ----------
    S : (k, n, c) array
        Whitened sensitivities; 0 where not sampled.
    residuals : (n, c) array
        Whitened; NaN where not sampled.

    Returns
    -------
    (k, k) array
        Symmetric, not negative.
    """
    k, n, _ = S.shape
    channels = np.flatnonzero(np.isfinite(residuals).any(axis=0))
    size = fft.next_fast_len(2 * n, real=True)
    seen = np.isfinite(residuals[:, channels])
    v = fft.rfft(np.where(seen, residuals[:, channels], 0.0), size, axis=0)
    mask = fft.rfft(seen.astype(float), size, axis=0)

    def correlate(a: int, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean of v_a[i + l] v_b[i] by lag, both signs, and the pairs in it."""
        pairs = np.round(fft.irfft(mask[:, a] * mask[:, b].conj(), size))
        return fft.irfft(v[:, a] * v[:, b].conj(), size) / np.maximum(pairs, 1.0), pairs

    longest = max(n // 5, 1)
    reach = 1
    for c in range(channels.size):
        rho, pairs = correlate(c, c)
        alike = (np.abs(rho) > 2.0 * rho[0] / np.sqrt(np.maximum(pairs, 1.0))) | (pairs < 1)
        reach = max(reach, 1 + int(np.argmin(np.append(alike[1 : longest + 1], False))))
    reach = min(_TAPER * reach, longest)
    lag = np.arange(size)
    taper = np.maximum(1.0 - np.minimum(lag, size - lag) / reach, 0.0)
    meat = np.zeros((k, k))
    forward = [fft.rfft(S[:, :, c], size, axis=1) for c in channels]
    weight = np.full(v.shape[0], 2.0 / size)  # a real transform holds one of each pair of frequencies
    weight[0] = 1.0 / size
    if size % 2 == 0:
        weight[-1] = 1.0 / size
    for a in range(channels.size):
        smooth = sum(forward[b] * fft.rfft(correlate(a, b)[0] * taper) for b in range(channels.size))
        meat += ((forward[a].conj() * weight) @ smooth.T).real
    # Channels sampled at different rates may leave it a little short of positive.
    values, vectors = np.linalg.eigh(0.5 * (meat + meat.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def spectral_information(S: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """The middle of the sandwich where samples are transforms: unrelated, but not equally strong.

    Parameters
    ----------
    S : (k, 2 f, c) array
        Whitened sensitivities, real parts before imaginary parts.
    residuals : (2 f, c) array
        Whitened.

    Returns
    -------
    (k, k) array
        With the spectrum of the residuals, averaged over neighbours, in place of one level for all frequencies.
    """
    half = residuals.shape[0] // 2
    v = residuals[:half] + 1j * residuals[half:]
    products = np.einsum("fa,fb->fab", v, v.conj()).real / 2.0
    reach = max(int(np.sqrt(half)), 1)
    power = ndimage.uniform_filter1d(products, 2 * reach + 1, axis=0, mode="nearest")
    parts = (S[:, :half], S[:, half:])
    return np.sum([np.einsum("kfa,fab,lfb->kl", part, power, part, optimize=True) for part in parts], axis=0)
