"""Standard deviation of the white part of one channel, from the floor of its spectrum."""

from __future__ import annotations

import numpy as np

from structsel.errors import DataError
from structsel.numerics.arrays import Array

_LEAST_SAMPLES = 16
_REPEATS = 0.1  # share of repeated samples from which a channel counts as coarse


def noise_level(x: np.ndarray, dt: float, *, above: float | None = None) -> float:
    """Standard deviation of the white noise on a channel.

    The level is the median power in the upper half of the spectrum (after a Hann window, whose leakage falls
    as the third power), so it stands against narrow lines, and against motion that stays below a quarter of the
    sampling rate.

    Two kinds of channel have fewer values than samples. One that is *held*, because its instrument is slower than the
    recorder, is judged by the samples at which it changes: between them it says nothing about noise. One that is
    *coarse* has an error of step / sqrt(12) even where it stands still, and no less is reported. Neither is thus
    called noise-free; a constant channel is.

    Parameters
    ----------
    x : (n,) array
        On an even clock; samples that are NaN are left out.
    dt : float [s]
    above : float, optional [Hz]
        Lower edge of the band to judge by; half the Nyquist frequency if not given.

    Returns
    -------
    float [unit of x]
        Its own scatter is about 1.3 / sqrt(n) of it. Noise that an anti-alias filter has shaped is understated: it
        is the level in that band that counts.

    Raises
    ------
    DataError
        With fewer than 16 finite samples, or changes of a held channel, or none in the band.
    """
    values = np.asarray(x, dtype=float)
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    moving = np.abs(steps[steps != 0.0])
    if values.size >= _LEAST_SAMPLES and not moving.size:
        return 0.0
    runs = starts_of_runs(values)
    period = dt
    if is_held(values):
        period *= values.size / runs.size
        values = values[runs]
    if values.size < _LEAST_SAMPLES:
        raise DataError(
            f"noise_level needs {_LEAST_SAMPLES} samples that are finite and not held; there are {values.size}.\n"
            "Take a longer stretch, or give the noise."
        )
    coarse = float(moving.min()) / np.sqrt(12.0) if moving.size < (1.0 - _REPEATS) * steps.size else 0.0
    return max(_floor(values, period, above), coarse)


def is_held(x: Array) -> bool:
    """Whether a channel repeats its samples in runs of about equal length, as one does whose instrument is slow."""
    lengths = np.diff(starts_of_runs(x))[1:]
    if lengths.size < 4:
        return False
    usual = float(np.median(lengths))
    regular = np.abs(lengths - usual) <= max(1.0, 0.1 * usual)
    return bool(np.mean(lengths >= 2) >= 0.95 and np.mean(regular) >= 0.9)


def starts_of_runs(x: Array) -> np.ndarray:
    """Indices at which a channel takes a new value, the first sample included."""
    return np.concatenate(([0], np.flatnonzero(np.diff(x) != 0.0) + 1))


def _floor(x: Array, dt: float, above: float | None) -> float:
    n = x.size
    # A straight line has a spectrum of its own; what is left at the ends goes with the window.
    line = np.polynomial.Polynomial.fit(np.arange(n), x, 1)
    window = np.hanning(n + 2)[1:-1]
    power = np.abs(np.fft.rfft((x - line(np.arange(n))) * window)) ** 2 / np.sum(window**2)
    frequency = np.fft.rfftfreq(n, dt)
    # The last bin of an even length is real: another distribution.
    inside = (frequency >= (0.25 / dt if above is None else above)) & (frequency < 0.5 / dt * (1.0 - 1e-9))
    if inside.sum() < 4:
        raise DataError(f"noise_level finds {int(inside.sum())} spectral lines above {above} Hz; it needs 4.")
    return float(np.sqrt(np.median(power[inside]) / np.log(2.0)))
