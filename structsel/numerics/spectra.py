"""Spectra and coherence of signals recorded in several pieces. Arrays only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import csd

from structsel.errors import DomainError
from structsel.numerics.arrays import Array

OVERLAP = 0.5
"""Share of a segment that the next one has too."""
FEWER = 0.75
"""Independent segments for each overlapping one, Hann window."""
_FEWEST = 16  # samples of a segment


def cross_spectrum(x: Sequence[Array], y: Sequence[Array], dt: float, segment: float) -> tuple[Array, Array, int]:
    """One-sided cross-spectral density by Welch's method, the segments of all pieces together.

    Segments overlap by half, under a Hann window, each less its own straight line. The density of a signal with
    itself is its power spectrum: real, and its integral over the frequencies is the signal's variance.

    Parameters
    ----------
    x, y : sequence of (n_i,) arrays
        Piece by piece; those shorter than a segment are left out.
    dt : float [s]
        Of all pieces.
    segment : float [s]

    Returns
    -------
    f : (m,) array [Hz]
        Above zero.
    density : (m,) complex array [unit of x times unit of y / Hz]
    segments : int
        How many went into it.

    Raises
    ------
    DomainError
        No piece is as long as a segment, or a segment has fewer than 16 samples.
    """
    per = round(segment / dt)
    if per < _FEWEST:
        raise DomainError(f"a segment of {segment:g} s holds {per} samples; it needs {_FEWEST} or more.")
    total, segments, f = np.zeros(per // 2, dtype=complex), 0, np.zeros(0)
    for one, other in zip(x, y):
        if len(one) < per:
            continue
        count = (len(one) - per) // (per - int(per * OVERLAP)) + 1
        f, density = csd(one, other, 1.0 / dt, nperseg=per, noverlap=int(per * OVERLAP), detrend="linear")
        total = total + count * density[1 : per // 2 + 1]
        segments += count
    if not segments:
        longest = max((len(one) for one in x), default=0) * dt
        raise DomainError(f"no piece is as long as a segment of {segment:g} s; the longest has {longest:.4g} s.")
    return f[1 : per // 2 + 1], total / segments, segments


def coherence(
    x: Sequence[Array], y: Sequence[Array], dt: float, segment: float, chance: float = 0.01
) -> tuple[Array, Array, float]:
    """Magnitude squared coherence, and what signals without relation pass by chance.

    With K independent segments two signals without relation pass 1 - a^(1/(K - 1)) at one frequency with
    probability a; here a is `chance` over the number of frequencies. Overlapping segments count three quarters.

    Parameters
    ----------
    x, y, dt, segment
        As `cross_spectrum` takes them.
    chance : float
        That it is passed anywhere.

    Returns
    -------
    f : (m,) array [Hz]
    squared : (m,) array [-]
    threshold : float [-]
        1 where there are too few segments to tell.

    Raises
    ------
    DomainError
        As `cross_spectrum`.

    References
    ----------
    [CKN73]
    """
    f, cross, segments = cross_spectrum(x, y, dt, segment)
    own, other = (cross_spectrum(each, each, dt, segment)[1].real for each in (x, y))
    squared = np.abs(cross) ** 2 / np.maximum(own * other, np.finfo(float).tiny)
    free = FEWER * segments
    return f, squared, passed_by_chance(free, len(f), chance) if free > 1.0 else 1.0


def passed_by_chance(free: float, frequencies: int, chance: float) -> float:
    """Squared coherence that signals without relation pass, anywhere, with a given probability.

    Parameters
    ----------
    free : float
        Independent segments, more than one.
    frequencies : int
    chance : float

    References
    ----------
    [CKN73]
    """
    return float(1.0 - (chance / frequencies) ** (1.0 / (free - 1.0)))
