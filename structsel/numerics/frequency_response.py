"""Frequency responses of several inputs and outputs, from the spectral densities of `spectra`. Arrays only.

References
----------
[TR12], [BP10].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.spectra import SpectralMatrix, coherence_squared

OVERLAP = 0.8
"""Fraction of a segment that overlaps the next one [TR12]; with a Hann window every sample then has the same weight."""
_TINY = np.finfo(float).tiny


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
        return coherence_squared(self.cross, self.input_density, self.output_density)

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
