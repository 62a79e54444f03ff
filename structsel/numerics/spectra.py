"""Spectra by Welch's method, coherence, and finite Fourier transforms of recorded signals. Arrays only.

Welch's method averages products of the transforms of segments. Each segment has a Hann window, after removal of its
linear trend. The transform may be evaluated at any frequencies, so that segments of different lengths have one grid::

    S_ab(w) = 2 dt / sum w_k^2  mean over segments of  conj(A(w)) B(w)

as `scipy.signal.csd` has it where the frequencies coincide. The finite Fourier transform of a signal over its record,
by the trapezoidal rule, is::

    x~(w) = int_0^T x(t) exp(-i w t) dt

Its derivative's is ``i w x~ + x(T) exp(-i w T) - x(0)``. Only the chosen frequencies take part, so noise, drift and
structural modes elsewhere have no effect; nothing is differentiated.

References
----------
[W67], [CKN73], [BP10]; [KM16], frequency-domain methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from structsel.errors import DataError, DomainError
from structsel.numerics.arrays import Array

OVERLAP = 0.5
"""Fraction of a segment that overlaps the next one."""
FEWER = 0.75
"""Number of independent segments for each overlapping one, with a Hann window."""
LONG = 1 << 22
"""Products in an explicit transform; above it the chirp-z transform is used."""
_FEWEST = 16  # samples of a segment
_FALSE_ALARM = 0.01  # probability of a coherence above the threshold at any frequency, for independent signals
_TRIM = 50  # fraction of a window over which trim is a mean; chosen, not critical


def segment_transforms(piece: Array, per: int, overlap: float, phasors: Array | None = None) -> Array:
    """Transforms of the windowed segments of a piece.

    Parameters
    ----------
    piece : (n, s) array
        Signals; n at least `per`.
    per : int
        Samples of a segment.
    overlap : float
        Fraction of a segment that overlaps the next one, from 0 to below 1.
    phasors : (per, f) complex array, optional
        exp(-i w t) at the samples of a segment; by default w are the harmonics of the segment below the Nyquist
        frequency.

    Returns
    -------
    (K, s, f) complex array
        The phase of each is that of its first sample.
    """
    segments = sliding_window_view(piece, per, axis=0)[:: _hop(per, overlap)]
    windowed = scipy.signal.detrend(segments, axis=-1) * _window(per)
    return windowed @ phasors if phasors is not None else scipy.fft.rfft(windowed)[..., 1 : (per + 1) // 2]


def harmonics(per: int, dt: float) -> Array:
    """Frequencies [Hz] of the transforms of segments of `per` samples: above zero, below the Nyquist frequency."""
    return np.arange(1, (per + 1) // 2) / (per * dt)


def _window(per: int) -> Array:
    return scipy.signal.get_window("hann", per)


def _hop(per: int, overlap: float) -> int:
    """Samples from the start of a segment to that of the next."""
    return max(1, per - int(per * overlap))


@dataclass(frozen=True)
class SpectralMatrix:
    """Spectral densities of s signals with each other.

    Attributes
    ----------
    density : (f, s, s) complex array [unit a times unit b times s]
        One-sided: the integral over the frequencies in Hz is the variance of the signal.
    overlapping : (f, s, s) complex array
        The same, with the products of segments that overlap added, weighted with the correlation of their noise.
    segments : float
        Less the fraction of the samples that were appended.
    window : float [s]
    """

    density: np.ndarray
    overlapping: np.ndarray
    segments: float
    window: float


def spectral_matrix(
    pieces: Sequence[np.ndarray],
    dt: float,
    window: float,
    omega: np.ndarray | None = None,
    overlap: float = OVERLAP,
    hold_ends: bool = False,
) -> SpectralMatrix:
    """Spectral densities by Welch's method, averaged over the segments of all pieces; Hann window.

    The noise of segments k and k + j that overlap is correlated, rho_j = sum w_m w_(m + j hop) / sum w_m^2. With X_k
    the transform of an input, the variance of its response is the noise density over S_xx, times::

        1 / n = 1 / K  (1 + 2 sum_j rho_j Re(sum_k X_k* X_(k+j)) / sum_k |X_k|^2)

    For a random input the expectation is Welch's 1 + 2 sum rho_j^2 [W67]; a sweep has fewer independent segments.

    Parameters
    ----------
    pieces : sequence of (n_i, s) arrays
        Finite; pieces shorter than a window are not used. The linear trend of each segment is removed.
    dt : float [s]
    window : float [s]
    omega : (f,) array [rad/s], optional
        Above zero, below the Nyquist frequency; by default those of `harmonics`.
    overlap : float
        From 0 to below 1.
    hold_ends : bool
        Append to both ends of each piece its trim, so that first and last samples have the weight of the others.
        Without it a sweep that begins at the first samples has a phase error at its lowest frequencies.

    Raises
    ------
    DomainError
        No piece is as long as a window, a window has fewer than 16 samples, or a frequency is not usable.
    """
    per = round(window / dt)
    if per < _FEWEST:
        raise DomainError(f"a window of {window:g} s holds {per} samples; it needs {_FEWEST} or more.")
    if omega is not None and not (omega.min() > 0.0 and omega.max() < np.pi / dt):
        raise DomainError(
            f"frequencies must lie above zero and below the Nyquist frequency, {np.pi / dt:.4g} rad/s; they are "
            f"{omega.min():.4g} to {omega.max():.4g} rad/s."
        )
    hop, shape = _hop(per, overlap), _window(per)
    phasors = None if omega is None else np.exp(-1j * dt * np.outer(np.arange(per), omega))
    omega = 2.0 * np.pi * harmonics(per, dt) if omega is None else omega
    s = pieces[0].shape[1] if pieces else 0
    total, lagged = (np.zeros((omega.size, s, s), dtype=complex) for _ in range(2))
    count, recorded, used = 0, 0, 0
    for piece in pieces:
        if len(piece) < per:
            continue
        recorded += len(piece)
        piece = _with_held_ends(piece, per - hop, per) if hold_ends else piece
        used += len(piece)
        X = segment_transforms(piece, per, overlap, phasors)
        X = X * np.exp(-1j * np.outer(dt * hop * np.arange(len(X)), omega))[:, None, :]
        total += np.einsum("ksf,ktf->fst", X.conj(), X, optimize=True)
        count += len(X)
        for j in range(1, min(len(X), -(-per // hop))):
            rho = shape[j * hop :] @ shape[: -j * hop] / (shape @ shape)
            next_ones = np.einsum("ksf,ktf->fst", X[:-j].conj(), X[j:], optimize=True)
            lagged += rho * (next_ones + np.swapaxes(next_ones, 1, 2).conj())
    if not count:
        longest = max((len(piece) for piece in pieces), default=0) * dt
        raise DomainError(f"no piece is as long as a window of {window:g} s; the longest has {longest:.4g} s.")
    scale = 2.0 * dt / np.sum(shape**2) / count
    return SpectralMatrix(scale * total, scale * (total + lagged), count * recorded / used, per * dt)


def _with_held_ends(piece: np.ndarray, count: int, per: int) -> np.ndarray:
    """Piece with `count` samples of its trim at both ends: means over a fiftieth of a window."""
    some = max(1, per // _TRIM)
    first, last = piece[:some].mean(axis=0), piece[-some:].mean(axis=0)
    return np.vstack([np.tile(first, (count, 1)), piece, np.tile(last, (count, 1))])


def power_spectrum(x: Sequence[Array], dt: float, window: float) -> tuple[Array, Array, int]:
    """One-sided power spectral density by Welch's method, averaged over the segments of all pieces.

    Parameters
    ----------
    x : sequence of (n_i,) arrays
        One array for each piece; pieces shorter than a window are not used.
    dt : float [s]
        Of all pieces.
    window : float [s]

    Returns
    -------
    f : (m,) array [Hz]
        As `harmonics`.
    density : (m,) array [square of the unit of x / Hz]
        Its integral over the frequencies is the variance.
    segments : int
        Number of segments.

    Raises
    ------
    DomainError
        As `spectral_matrix`.
    """
    found = spectral_matrix([one[:, None] for one in x], dt, window)
    return harmonics(round(window / dt), dt), found.density[:, 0, 0].real, round(found.segments)


def coherence(x: Sequence[Array], y: Sequence[Array], dt: float, window: float) -> tuple[Array, Array, float]:
    """Magnitude squared coherence, and its significance threshold.

    With K independent segments the coherence of two independent signals exceeds 1 - a^(1/(K - 1)) at one frequency
    with probability a. Here a is 0.01 over the number of frequencies, and K is three quarters of the number
    of overlapping segments.

    Parameters
    ----------
    x, y : sequence of (n_i,) arrays
    dt, window
        As for `power_spectrum`, which has the exceptions as well.

    Returns
    -------
    f : (m,) array [Hz]
    squared : (m,) array [-]
    threshold : float [-]
        1 if there are too few segments.

    References
    ----------
    [CKN73]
    """
    found = spectral_matrix([np.column_stack(pair) for pair in zip(x, y)], dt, window)
    f, free = harmonics(round(window / dt), dt), FEWER * found.segments
    squared = coherence_squared(found.density[:, 0, 1], found.density[:, 0, 0].real, found.density[:, 1, 1].real)
    return f, squared, coherence_threshold(free, len(f), _FALSE_ALARM) if free > 1.0 else 1.0


def coherence_squared(cross: Array, own: Array, other: Array) -> Array:
    """Squared coherence of two signals from their cross-spectrum and their power spectra; zero without power."""
    return np.clip(np.abs(cross) ** 2 / np.maximum(own * other, np.finfo(float).tiny), 0.0, 1.0)


def coherence_threshold(free: float, frequencies: int, probability: float) -> float:
    """Squared coherence that independent signals exceed at any frequency with a probability, of `free` segments."""
    return float(1.0 - (probability / frequencies) ** (1.0 / (free - 1.0)))


def choose_frequencies(duration: float, low: float, high: float) -> np.ndarray:
    """Integer multiples of 1/T between two frequencies [Hz], at which the transforms of white noise are uncorrelated.

    Raises
    ------
    DomainError
        There is no multiple between them.
    """
    first, last = int(np.ceil(low * duration - 1e-9)), int(np.floor(high * duration + 1e-9))
    if not (first >= 0 and last >= first):
        raise DomainError(
            f"a record of {duration:g} s has no frequency of its own between {low:g} and {high:g} Hz; they are "
            f"{1.0 / duration:.3g} Hz apart. Widen the band, or record longer."
        )
    return np.arange(first, last + 1) / duration


def transform(x: np.ndarray, dt: float, frequencies: np.ndarray, detrend: bool = True) -> np.ndarray:
    """Finite Fourier transform by the trapezoidal rule.

    Parameters
    ----------
    x : (n, ...) array
        Time along the first axis.
    dt : float [s]
    frequencies : (f,) array [Hz]
        Below half the sampling frequency.
    detrend : bool
        Remove the linear trend of the samples first, which would leak into every frequency.

    Returns
    -------
    (f, ...) complex array [unit s]

    Raises
    ------
    DataError
        Samples that are not finite.
    DomainError
        A frequency above half the sampling frequency.
    """
    x, f = np.asarray(x, dtype=float), np.asarray(frequencies, dtype=float)
    n = len(x)
    if not np.isfinite(x).all():
        raise DataError("a Fourier transform needs finite samples throughout; use a segment without gaps.")
    if f.size and not (np.abs(f).max() <= 0.5 / dt * (1.0 + 1e-9)):
        raise DomainError(f"{f.max():g} Hz is above half the sampling frequency, {0.5 / dt:g} Hz.")
    flat = x.reshape(n, -1)
    flat = scipy.signal.detrend(flat, axis=0) if detrend else flat
    weights = np.full(n, dt)
    weights[[0, -1]] *= 0.5
    even = f.size > 2 and np.allclose(np.diff(f), f[1] - f[0], rtol=1e-9)
    if even and f.size * n > LONG:
        step = np.exp(-2j * np.pi * (f[1] - f[0]) * dt)
        start = np.exp(2j * np.pi * f[0] * dt)
        found = scipy.signal.czt(weights[:, None] * flat, f.size, step, start, axis=0)
    else:
        found = np.exp(-2j * np.pi * np.outer(f, dt * np.arange(n))) @ (weights[:, None] * flat)
    return found.reshape(f.size, *x.shape[1:])
