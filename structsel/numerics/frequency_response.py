"""Frequency responses of several inputs and outputs, from windowed segments of recorded signals. Arrays only.

The transform of each segment is evaluated at any frequencies, so that windows of different lengths have one grid. The
spectral densities are those of `scipy.signal.csd` where its frequencies coincide::

    S_ab(w) = 2 dt / sum w_k^2  mean over segments of  conj(A(w)) B(w)

References
----------
[TR12], [BP10], [W67].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from structsel.errors import DomainError

OVERLAP = 0.8
"""Fraction of a segment that overlaps the next one [TR12]; with a Hann window every sample then has the same weight."""
_FEWEST = 16  # samples of a segment
_TRIM = 50  # fraction of a window over which trim is a mean; chosen, not critical
_TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class SpectralMatrix:
    """Spectral densities of s signals with each other.

    Attributes
    ----------
    density : (f, s, s) complex array [unit a times unit b times s]
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
    omega: np.ndarray,
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
    omega : (f,) array [rad/s]
        Above zero, below the Nyquist frequency.
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
    if not (omega.min() > 0.0 and omega.max() < np.pi / dt):
        raise DomainError(
            f"frequencies must lie above zero and below the Nyquist frequency, {np.pi / dt:.4g} rad/s; they are "
            f"{omega.min():.4g} to {omega.max():.4g} rad/s."
        )
    hop = max(1, per - int(per * overlap))
    shape = scipy.signal.get_window("hann", per)
    phasors = shape[:, None] * np.exp(-1j * dt * np.outer(np.arange(per), omega))
    s = pieces[0].shape[1]
    total, lagged = (np.zeros((omega.size, s, s), dtype=complex) for _ in range(2))
    count, recorded, used = 0, 0, 0
    for piece in pieces:
        if len(piece) < per:
            continue
        recorded += len(piece)
        piece = _with_held_ends(piece, per - hop, per) if hold_ends else piece
        used += len(piece)
        segments = sliding_window_view(piece, per, axis=0)[::hop]  # (K, s, per)
        starts = dt * hop * np.arange(len(segments))
        X = (scipy.signal.detrend(segments, axis=-1) @ phasors) * np.exp(-1j * np.outer(starts, omega))[:, None, :]
        total += np.einsum("ksf,ktf->fst", X.conj(), X, optimize=True)
        count += len(segments)
        for j in range(1, min(len(segments), -(-per // hop))):
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


@dataclass(frozen=True)
class ConditionedSpectra:
    """Spectra of o outputs with each of i inputs, after removing what the other inputs explain.

    Attributes
    ----------
    input_density : (f, o, i) array
    output_density : (f, o, i) array
    cross : (f, o, i) complex array
        From the input to the output.
    independent : (f, o, i) array
        Number of independent segments, less one for each other input.
    window : (f, o, i) array [s]
    """

    input_density: np.ndarray
    output_density: np.ndarray
    cross: np.ndarray
    independent: np.ndarray
    window: np.ndarray

    @property
    def response(self) -> np.ndarray:
        """(f, o, i) complex frequency response."""
        return self.cross / np.maximum(self.input_density, _TINY)

    @property
    def coherence(self) -> np.ndarray:
        """(f, o, i) partial coherence, squared magnitude."""
        power = np.maximum(self.input_density * self.output_density, _TINY)
        return np.clip(np.abs(self.cross) ** 2 / power, 0.0, 1.0)

    @property
    def random_error(self) -> np.ndarray:
        """(f, o, i) standard deviation of the magnitude over the magnitude, and of the phase in rad.

        ::

            sqrt(1 - g^2) / (g sqrt(2 n)),     g^2 the partial coherence, n the independent segments     [BP10], [TR12]

        Infinite where there are no independent segments.
        """
        g2, n = self.coherence, self.independent
        with np.errstate(divide="ignore"):
            return np.where(n > 0.0, np.sqrt((1.0 - g2) / np.maximum(2.0 * g2 * np.maximum(n, 0.0), _TINY)), np.inf)


def condition(spectra: SpectralMatrix, inputs: int) -> ConditionedSpectra:
    """Spectra between each input and each output with the other inputs removed; the inputs are the first signals.

    With a and b an input and an output, and R the other inputs::

        S_ab.R = S_ab - S_aR S_RR^-1 S_Rb

    Then H = S_ab.R / S_aa.R equals the solution of S_xx H = S_xy for all inputs at once.

    Raises
    ------
    DomainError
        Inputs that are proportional to each other at some frequency.
    """
    S = spectra.density
    f, s = S.shape[:2]
    outputs = s - inputs
    auto, power, count = (np.empty((f, outputs, inputs)) for _ in range(3))
    cross = np.empty((f, outputs, inputs), dtype=complex)
    for i in range(inputs):
        kept, rest = [i, *range(inputs, s)], [j for j in range(inputs) if j != i]
        try:
            gain = np.linalg.solve(S[np.ix_(range(f), rest, rest)], S[np.ix_(range(f), rest, kept)])
        except np.linalg.LinAlgError as error:
            raise DomainError("inputs are proportional to each other, so their responses cannot differ.") from error
        left = S[np.ix_(range(f), kept, kept)] - S[np.ix_(range(f), kept, rest)] @ gain
        diagonal = np.maximum(np.einsum("fss->fs", left).real, 0.0)
        auto[:, :, i], power[:, :, i], cross[:, :, i] = diagonal[:, :1], diagonal[:, 1:], left[:, 0, 1:]
        c = np.zeros((f, s), dtype=complex)  # the input less what the others explain of it
        c[:, i], c[:, rest] = 1.0, -gain[:, :, 0]
        own, lagged = (np.einsum("fs,fst,ft->f", c.conj(), M, c).real for M in (S, spectra.overlapping))
        count[:, :, i] = (spectra.segments * own / np.maximum(lagged, _TINY))[:, None] - (inputs - 1)
    return ConditionedSpectra(auto, power, cross, count, np.full(auto.shape, spectra.window))


def multiple_coherence(spectra: SpectralMatrix, inputs: int) -> np.ndarray:
    """(f, o) fraction of each output's power that all inputs together explain linearly."""
    S = spectra.density
    explained = np.linalg.solve(S[:, :inputs, :inputs], S[:, :inputs, inputs:])
    shared = np.einsum("fio,fio->fo", S[:, :inputs, inputs:].conj(), explained).real
    return np.clip(shared / np.maximum(np.einsum("foo->fo", S[:, inputs:, inputs:]).real, _TINY), 0.0, 1.0)


def combine_windows(each: Sequence[ConditionedSpectra], cycles: float, omega: np.ndarray) -> ConditionedSpectra:
    """Composite of several windows: averages of their spectra, weighted by the random errors e_i.

    ::

        W_i = (e_i / e_least)^-4,      S = sum W_i^2 S_i / sum W_i^2       [TR12], start values of COMPOSITE

    The search that follows there, which also fits the coherences, is left out: the averages of spectra are themselves
    consistent, with a coherence between zero and one. A window takes part at a frequency if it holds `cycles`
    periods of it or more; the longest window always does.
    """
    windows = np.array([one.window.flat[0] for one in each])
    usable = (windows[:, None] * omega >= 2.0 * np.pi * cycles * (1.0 - 1e-9)) | (windows == windows.max())[:, None]
    errors = np.array([one.random_error for one in each])
    errors = np.where(usable[:, :, None, None], errors, np.inf)
    least = errors.min(axis=0)
    ratio = np.where(np.isfinite(errors), least / np.maximum(errors, _TINY), 0.0)
    ratio = np.where(np.isfinite(least), ratio, usable[:, :, None, None])  # no window has an error: equal weights
    ratio = np.where(least == 0.0, errors == 0.0, ratio)  # perfect coherence
    weight = ratio**8
    weight = weight / weight.sum(axis=0)

    def mean(name: str) -> np.ndarray:
        return np.asarray(np.sum(weight * np.array([getattr(one, name) for one in each]), axis=0))

    names = ("input_density", "output_density", "cross", "independent", "window")
    return ConditionedSpectra(*(mean(name) for name in names))


def error_correlation(omega: np.ndarray, window: np.ndarray) -> np.ndarray:
    """(f, f) correlation between the random errors at two frequencies, from the width of the Hann window.

    Neighbouring errors have samples in common. The correlation of two transforms is the transform of the squared
    window, with y = (w1 - w2) T / 2 pi and sinc(y) = sin(pi y) / pi y::

        c = sinc(y) + 2/3 (sinc(y - 1) + sinc(y + 1)) + 1/6 (sinc(y - 2) + sinc(y + 2))

    and that of their cross-spectra, input and output being independent, c^2.
    """
    y = (omega[:, None] - omega) * 0.5 * (window[:, None] + window) / (2.0 * np.pi)
    c = np.sinc(y) + 2.0 / 3.0 * (np.sinc(y - 1) + np.sinc(y + 1)) + (np.sinc(y - 2) + np.sinc(y + 2)) / 6.0
    return np.asarray(c**2)
