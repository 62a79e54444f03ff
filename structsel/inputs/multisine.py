"""Orthogonal multisines: several inputs at once, each a sum of harmonics of its own, phased for a low peak.

Harmonics of one period T are orthogonal over it, in time and in frequency. Assigned in turn, one to each input, they
excite all inputs over the band without correlation between any two [KM16]. The phases of the sum of cosines with the
lowest peak are found by minimising L_p norms of increasing p from Schroeder's phases [S70] and seeded random ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.inputs.signals import clock
from structsel.recording import Recording

_NORMS = (4, 8, 16, 32, 64)
_STARTS = 4


def peak_factor(u: np.ndarray) -> float:
    """Range over that of a sine of the same root mean square: 1 for a sine, 0.71 for a square wave.

    ::

        (max u - min u) / (2 sqrt(2) rms(u))

    References
    ----------
    [KM16], relative peak factor.
    """
    rms = float(np.sqrt(np.mean(np.square(u))))
    if rms == 0.0:
        raise DomainError("the peak factor of a signal that is zero throughout does not exist.")
    return float((u.max() - u.min()) / (2.0 * np.sqrt(2.0) * rms))


def multisine(
    channels: str | Sequence[str],
    amplitude: float | Sequence[float],
    *,
    low: float,
    high: float,
    period: float = 20.0,
    dt: float = 0.02,
    powers: Sequence[float] | None = None,
    periods: int = 1,
    seed: int = 0,
) -> Recording:
    """Phase-optimised multisines on interleaved harmonics.

    Parameters
    ----------
    channels : str or sequence of str
        Inputs that move at once.
    amplitude : float or sequence of float
        Largest change of each input.
    low, high : float [Hz]
        Band; the harmonics of 1 / period within it are assigned to the inputs in turn.
    period, dt : float [s]
        The period is an integer number of steps.
    powers : sequence of float, optional
        Relative power of each harmonic, lowest first; equal where absent.
    periods : int
        Repetitions.
    seed : int
        Of the starts of the phase search.

    Returns
    -------
    Recording
        Every input begins and ends at zero. The provenance gives each one's harmonics and peak factor.

    Raises
    ------
    DomainError
        Fewer harmonics in the band than inputs, a band beyond half the sampling rate, or powers that do not fit.
    """
    names = (channels,) if isinstance(channels, str) else tuple(channels)
    peaks = np.broadcast_to(np.asarray(amplitude, dtype=float), (len(names),))
    t = clock(period * periods, dt)
    n = round(period / dt)
    if abs(n * dt - period) > 1e-6 * dt:
        raise DomainError(
            f"a multisine's period is a whole number of steps; {period:g} s is {period / dt:g} of {dt:g} s."
        )
    harmonics = np.arange(max(int(np.ceil(low * period - 1e-9)), 1), int(np.floor(high * period + 1e-9)) + 1)
    if len(harmonics) < len(names) or high >= 0.5 / dt:
        raise DomainError(
            f"multisine: {len(harmonics)} harmonics of {1 / period:g} Hz lie between {low:g} and {high:g} Hz for "
            f"{len(names)} inputs, below half the sampling rate of {0.5 / dt:g} Hz. Widen the band, lengthen the "
            "period, or sample faster."
        )
    power = np.ones(len(harmonics)) if powers is None else np.asarray(powers, dtype=float)
    if power.shape != harmonics.shape or (power < 0.0).any() or not np.isfinite(power).all():
        raise DomainError(f"multisine needs {len(harmonics)} powers, none below zero; found {power.size}.")
    made, notes = {}, []
    for i, (name, peak) in enumerate(zip(names, peaks)):
        own, weight = harmonics[i :: len(names)], power[i :: len(names)]
        if not weight.any():
            raise DomainError(f"multisine: every harmonic of '{name}' has power zero. Give it some.")
        wave = phased(own[weight > 0.0], weight[weight > 0.0], n, seed=seed)
        made[name] = peak / np.abs(wave).max() * np.append(np.tile(wave, periods), wave[0])
        listed = ", ".join(map(str, own[weight > 0.0]))
        notes.append(
            f"multisine on {name}: harmonics {listed} of {1 / period:g} Hz, peak factor {peak_factor(wave):.3f}"
        )
    return Recording("multisine", t, made, provenance=tuple(notes))


def phased(harmonics: np.ndarray, powers: np.ndarray, n: int, *, seed: int = 0) -> np.ndarray:
    """One period (n,) of a sum of harmonics with given powers and the phases of the lowest peak found, from zero.

    Parameters
    ----------
    harmonics : (k,) int array
        Cycles per period.
    powers : (k,) array
        Above zero; the wave's mean square is their sum.
    n : int
        Samples in the period.
    seed : int
        Of the random starts, in addition to Schroeder's.
    """
    amplitudes = np.sqrt(2.0 * powers)
    finest = max(n, 16 * int(harmonics.max()))
    angles = 2.0 * np.pi * np.outer(harmonics, np.arange(finest) / finest)
    rms = float(np.sqrt(powers.sum()))
    in_phase, ahead = np.cos(angles), -np.sin(angles)

    def cost(phases: np.ndarray, p: int) -> tuple[float, np.ndarray]:
        real, imaginary = amplitudes * np.cos(phases), amplitudes * np.sin(phases)
        wave = (real @ in_phase + imaginary @ ahead) / rms
        top = np.abs(wave).max()
        level = (np.abs(wave) / top) ** p
        value = top * float(np.mean(level)) ** (1.0 / p)
        slope = value / level.sum() * (np.abs(wave) / top) ** (p - 1) * np.sign(wave) / top
        return value, (real * (ahead @ slope) - imaginary * (in_phase @ slope)) / rms

    rng = np.random.default_rng(seed)
    level = np.cumsum(powers) / powers.sum()
    schroeder = -2.0 * np.pi * np.concatenate([[0.0], np.cumsum(level[:-1])])
    starts = [schroeder, *rng.uniform(-np.pi, np.pi, (_STARTS, len(harmonics)))]
    best, lowest = schroeder, np.inf
    for start in starts if len(harmonics) > 1 else ():
        phases = start
        for p in _NORMS:
            phases = scipy.optimize.minimize(cost, phases, (p,), jac=True, method="L-BFGS-B").x
        if (height := peak_factor(amplitudes @ np.cos(angles + phases[:, None]))) < lowest:
            best, lowest = phases, height

    # Turned in time to where it crosses zero upwards: an input begins at trim.
    def wave_at(x: float) -> float:
        return float(amplitudes @ np.cos(2.0 * np.pi * harmonics * x + best))

    wave = amplitudes @ np.cos(angles + best[:, None])
    up = np.flatnonzero((wave < 0.0) & (np.roll(wave, -1) >= 0.0))
    at = up[0] / finest
    shift = scipy.optimize.brentq(wave_at, at, at + 1.0 / finest, xtol=1e-15)
    return amplitudes @ np.cos(2.0 * np.pi * np.outer(harmonics, np.arange(n) / n + shift) + best[:, None])
