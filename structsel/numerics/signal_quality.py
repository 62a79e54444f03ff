"""Quality of one channel: white noise, repeated samples, spikes. Arrays only."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.errors import DataError, DomainError
from structsel.numerics.arrays import Array

MIN_SAMPLES = 16
"""Fewest readings of a channel whose noise is estimated from its spectrum."""
_OCTAVES = 3  # below the Nyquist frequency, with the noise of a filtered channel; chosen, not critical without a filter
NOISE_LEVEL_ERROR = 1.3
"""Relative standard error of `noise_level`, times the root of the number of samples; measured on white noise."""
_REPEATS = 0.1  # fraction of repeated samples above which a channel is coarse
_SIDE = 4  # samples of the local fit on each side
_LOCAL = 51  # samples of the local median deviation
_CLEAR = 1.35  # least ratio of the steps into and out of a spike to the largest step nearby
STD_OVER_MAD = 1.4826
"""Standard deviation over the median absolute deviation, of a normal distribution."""
MEDIAN_SQUARE = 0.4549
"""Median of the square of a standard normal variable."""
_NARROWEST, _WIDER, _WIDEST = 0.7, 1.6, 0.125
"""Widths of the smoothers, in samples: of the first, of each over the last, and of the widest over the length."""
_LONG = 20.0  # samples, of a filter that is applied by Fourier transform
_AROUND = 3.0  # widths over which the power of a band is averaged
_MODEST = 2.5  # ratio of power to that of the noise up to which a band is noise


def noise_level(x: np.ndarray, dt: float, *, above: float | None = None) -> float:
    """Standard deviation of the white noise on a channel.

    The level is the median power in the upper half of the spectrum (after a Hann window, whose leakage falls
    as the third power). It is robust against narrow lines, and against motion below a quarter of the sampling rate.

    Two kinds of channel have fewer values than samples. Of a *held* channel, whose instrument is slower than the
    recorder, only the samples at which it changes are used. A *coarse* channel has a quantisation error of
    step / sqrt(12), which is the least value reported for it. Only a constant channel is free of noise.

    Parameters
    ----------
    x : (n,) array
        On an even clock; samples that are NaN are left out.
    dt : float [s]
    above : float, optional [Hz]
        Lower edge of the band that is used; half the Nyquist frequency if not given.

    Returns
    -------
    float [unit of x]
        Its relative standard error is about 1.3 / sqrt(n). Noise after an anti-alias filter is underestimated, because
        the level in that band is used.

    Raises
    ------
    DataError
        With fewer than 16 finite samples, or changes of a held channel, or none in the band.
    """
    values, period, quantisation = _distinct_values(x, dt)
    if values.size == 1 and np.isfinite(x).sum() >= MIN_SAMPLES:
        return 0.0
    frequency, power = _spectrum(values, period)
    inside = frequency >= (0.25 / period if above is None else above)
    if inside.sum() < 4:
        raise DataError(f"noise_level finds {int(inside.sum())} spectral lines above {above} Hz; it needs 4.")
    # The median of an exponential distribution is its mean times log(2).
    return max(float(np.sqrt(np.median(power[inside]) / np.log(2.0))), quantisation)


def largest_noise_level(x: np.ndarray, dt: float) -> float:
    """Upper limit of the standard deviation of white noise on a channel.

    Noise has no more power in any band than the channel itself. White noise has the same power in all bands, so its
    level is at most that of each of the three octaves below the Nyquist frequency; vibration and motion are in these
    as well. The recorder's filter reduces it in the highest ones: the limit is that of the octave with the most power,
    two standard errors above its mean power, and at most the standard deviation of the channel.

    Parameters
    ----------
    x : (n,) array
        As for `noise_level`, which is the level of the noise alone.
    dt : float [s]

    Returns
    -------
    float [unit of x]

    Raises
    ------
    DataError
        As `noise_level`.
    """
    values, period, quantisation = _distinct_values(x, dt)
    if values.size == 1 and np.isfinite(x).sum() >= MIN_SAMPLES:
        return 0.0
    frequency, power = _spectrum(values, period)
    nyquist, limit = 0.5 / period, quantisation
    for octave in range(_OCTAVES):
        inside = (frequency >= 0.5 ** (octave + 1) * nyquist) & (frequency < 0.5**octave * nyquist)
        if inside.any():
            # Relative standard error of a root mean power: the window correlates neighbouring lines.
            error = 0.5 * np.sqrt(1.5 / inside.sum())
            limit = max(limit, float(np.sqrt(power[inside].mean())) * (1.0 + 2.0 * error))
    return min(limit, max(float(values.std()), quantisation))


def _distinct_values(x: Array, dt: float) -> tuple[np.ndarray, float, float]:
    """New values of a channel, their period, and the quantisation error of a coarse channel; one if it is constant."""
    values = np.asarray(x, dtype=float)
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    moving = np.abs(steps[steps != 0.0])
    coarse = moving.size and moving.size < (1.0 - _REPEATS) * steps.size
    quantisation = float(moving.min()) / np.sqrt(12.0) if coarse else 0.0
    if not moving.size:
        return values[:1], dt, 0.0
    runs = starts_of_runs(values)
    if is_sample_and_hold(values):
        return values[runs], dt * values.size / runs.size, quantisation
    return values, dt, quantisation


def is_sample_and_hold(x: Array) -> bool:
    """Whether a channel repeats its samples in runs of about equal length, as with an instrument of a lower rate."""
    lengths = np.diff(starts_of_runs(x))[1:]
    if lengths.size < 4:
        return False
    usual = float(np.median(lengths))
    regular = np.abs(lengths - usual) <= max(1.0, 0.1 * usual)
    return bool(np.mean(lengths >= 2) >= 0.95 and np.mean(regular) >= 0.9)


def starts_of_runs(x: Array) -> np.ndarray:
    """Indices at which a channel takes a new value, the first sample included."""
    return np.concatenate(([0], np.flatnonzero(np.diff(x) != 0.0) + 1))


def _spectrum(x: Array, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, and power normalised such that white noise has its variance in every line; without the last line."""
    n = x.size
    if n < MIN_SAMPLES:
        raise DataError(
            f"noise_level needs {MIN_SAMPLES} samples that are finite and not held; there are {n}.\n"
            "Use a longer segment, or give the noise."
        )
    # A linear trend would leak into the spectrum; the window removes the remaining difference of the ends.
    line = np.polynomial.Polynomial.fit(np.arange(n), x, 1)
    window = np.hanning(n + 2)[1:-1]
    power = np.abs(np.fft.rfft((x - line(np.arange(n))) * window)) ** 2 / np.sum(window**2)
    # The last line of an even length is real and has another distribution.
    kept = (n + 1) // 2
    return np.fft.rfftfreq(n, dt)[:kept], power[:kept]


def white_noise_std(x: Array) -> float:
    """Standard deviation of the white noise in a signal, from its third differences, which remove slow motion."""
    return _std_from_differences(np.diff(x, 3))


def _std_from_differences(steps: Array) -> float:
    """Standard deviation of white noise from its third differences."""
    return float(
        np.sqrt(np.median(steps**2) / MEDIAN_SQUARE / 20.0)
    )  # the variance of the differences is 1 + 9 + 9 + 1


def estimate_white_noise(x: Array) -> Array:
    """Estimate of the white noise in a signal, band by band and moment by moment.

    A local Wiener filter. The difference of two smoothers of different widths is a band. It is noise where its power is
    at most that of white noise with the level of the finest band, and signal where it is much more.

    Parameters
    ----------
    x : (n,) array
        On an even clock.

    Returns
    -------
    (n,) array
        Zeros if most samples repeat the one before (a held or a coarse channel).
    """
    steps = np.diff(x, 3)
    if not len(steps) or np.mean(steps != 0.0) < 0.5:
        return np.zeros(len(x))
    sd = _std_from_differences(steps[steps != 0.0])
    noise = np.zeros(len(x))
    above = np.asarray(x, dtype=float)
    for width, of_one in _bands(len(x)):
        below = smoothed(x, width)
        band, expected = above - below, sd**2 * of_one
        power = smoothed(band**2, _AROUND * width)
        fraction = np.minimum(1.0, _MODEST * expected / np.maximum(power, 1e-300)) ** 2
        noise += fraction * band
        above = below
    return noise


def smoothed(x: Array, width: float) -> Array:
    """`gaussian_filter1d` of a signal that is held beyond its ends; by Fourier transform where the filter is long."""
    if width < _LONG:
        return np.asarray(scipy.ndimage.gaussian_filter1d(x, width, mode="nearest"))
    reach = int(4.0 * width + 0.5)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    return np.asarray(scipy.signal.fftconvolve(np.pad(x, reach, mode="edge"), weight / weight.sum(), mode="valid"))


@lru_cache(maxsize=64)
def _bands(n: int) -> tuple[tuple[float, float], ...]:
    """Width of each smoother [samples], and the power in its band of one sample of a signal of n samples."""
    above = np.zeros(2 * n + 1)
    above[n] = 1.0
    one, made, width = above, [], _NARROWEST
    while width < _WIDEST * n:
        below = smoothed(one, width)
        made.append((width, float(((above - below) ** 2).sum())))
        above, width = below, _WIDER * width
    return tuple(made)


def find_spikes(x: np.ndarray, *, threshold: float = 5.0, longest: int = 3) -> tuple[NDArray[np.intp], Array]:
    """Spikes of one to three samples, and the values of a local fit to replace them.

    A group of up to `longest` samples is a spike when

    - each sample differs by more than `threshold` noise standard deviations from a parabola through four samples
      on each side,
    - each sample differs from both neighbours of the group, in the same direction, by more than half of that, and
    - the steps into the group and out of it exceed 1.35 times the largest step among those neighbours.

    The last two are tested after subtraction of the local slope. The noise is the median absolute deviation from such
    fits, in the 51 samples around or in the complete record, whichever is more.

    A step agrees with one of its neighbours, a doublet has further edges of the same size, a pulse of more than
    `longest` samples is no group, and the peak of a fast motion has neighbouring steps of its own size: none of
    them is a spike. Of spikes of 8 standard deviations on white noise nine in ten are found, of 12 all; there is less
    than one false alarm in 10,000 samples. If the motion itself is rough, smaller spikes are not found.
    Groups are tested in rounds, the largest first, so that one does not conceal the next.

    Parameters
    ----------
    x : (n,) array
        NaN samples are missing, and never spikes. Of a held channel the samples at which it changes are tested.
    threshold : float [-]
        In standard deviations of the noise.
    longest : {1, 2, 3}
        Samples (changes of a held channel) of the longest spike.

    Returns
    -------
    samples : (k,) int array
        Ascending. The first and last four samples are not tested.
    values : (k,) array [unit of x]
        Of the local fit, as a replacement.

    Raises
    ------
    DomainError
        When `threshold` is not above zero, or `longest` not 1, 2 or 3.
    """
    if not threshold > 0.0 or longest not in (1, 2, 3):
        raise DomainError(
            f"find_spikes needs threshold above 0 and longest 1, 2 or 3; it was given {threshold:g} and {longest}."
        )
    values = np.asarray(x, dtype=float)
    there = np.flatnonzero(np.isfinite(values))
    starts = starts_of_runs(values[there]) if is_sample_and_hold(values[there]) else np.arange(there.size)
    found, instead = _judge(values[there[starts]], _coarseness(values[there]), threshold, longest)
    ends = np.append(starts, there.size)
    counts = ends[found + 1] - ends[found]
    rows = np.concatenate([there[ends[i] : ends[i + 1]] for i in found]) if found.size else np.empty(0, dtype=np.intp)
    return rows, np.repeat(instead, counts)


def _coarseness(x: Array) -> float:
    """Least noise of a channel that repeats samples, so that its smallest step is no spike."""
    steps = np.abs(np.diff(x))
    moving = steps[steps > 0.0]
    return 0.25 * float(moving.min()) if 0 < moving.size < 0.9 * steps.size else 0.0


def _judge(x: Array, least: float, threshold: float, longest: int) -> tuple[NDArray[np.intp], Array]:
    repaired = x.copy()
    marked = np.zeros(x.size, dtype=bool)
    # Every round marks at least one more sample, so the loop ends.
    while True:
        # The rounding of the values is not a spike.
        rounding = 2.0 * np.finfo(float).eps * np.abs(repaired).max(initial=0.0)
        scale = np.maximum(_scale(repaired), max(least, rounding)) if x.size > 2 * _SIDE else np.zeros(0)
        groups = [group for width in range(1, longest + 1) for group in _groups(repaired, scale, width, threshold)]
        taken = np.zeros(x.size, dtype=bool)
        for _, first, width, fit in sorted(groups, key=lambda group: -group[0]):
            near = slice(max(0, first - _SIDE), first + width + _SIDE)
            if taken[near].any() or marked[first : first + width].any():
                continue
            repaired[first : first + width] = fit
            taken[first : first + width] = True
        if not taken.any():
            break
        marked |= taken
    found = np.flatnonzero(marked)
    return found, repaired[found]


def _groups(x: Array, scale: Array, width: int, threshold: float) -> list[tuple[float, int, int, Array]]:
    """(deviation in noise standard deviations, first sample, width, fitted values) of every spike of one width."""
    size = 2 * _SIDE + width
    if x.size < size:
        return []
    inside = np.arange(_SIDE, _SIDE + width)
    outside = np.setdiff1d(np.arange(size), inside)
    weights, gain = _parabola(outside, inside)
    bar = threshold * scale[_SIDE : _SIDE + x.size - size + 1]
    # Few samples deviate so far; only their neighbours are compared.
    far = np.ones(bar.size, dtype=bool)
    for one, row in zip(inside, weights):
        kernel = np.zeros(size)
        kernel[outside], kernel[one] = -row, 1.0
        far &= np.abs(np.correlate(x, kernel, "valid")) > (1.0 - 1e-9) * bar
    at = np.flatnonzero(far)
    windows, bar = np.lib.stride_tricks.sliding_window_view(x, size)[at], bar[at]
    fit = windows[:, outside] @ weights.T
    deviation = windows[:, inside] - fit
    # Steps minus the local slope: on a steep slope those of a spike would not be the largest.
    steps = np.diff(windows, axis=1)
    others = np.concatenate([steps[:, : _SIDE - 1], steps[:, _SIDE + width :]], axis=1)
    steps = steps - np.median(others, axis=1)[:, None]
    others = np.concatenate([steps[:, : _SIDE - 1], steps[:, _SIDE + width :]], axis=1)
    jump = np.minimum(np.abs(steps[:, _SIDE - 1]), np.abs(steps[:, _SIDE + width - 1]))
    # Difference from both neighbours in the direction of the deviation; a step agrees with one of them.
    rise = np.cumsum(steps[:, _SIDE - 1 : _SIDE + width], axis=1)
    sign = np.sign(deviation)
    separation = np.minimum(sign * rise[:, :-1], sign * (rise[:, :-1] - rise[:, -1:])).min(axis=1)
    size_of = np.abs(deviation).min(axis=1)
    spikes = np.flatnonzero((size_of > bar) & (separation > 0.5 * bar) & (jump > _CLEAR * np.abs(others).max(axis=1)))
    return [(float(size_of[i] * threshold / (gain * bar[i])), int(at[i]) + _SIDE, width, fit[i]) for i in spikes]


def _parabola(outside: NDArray[np.intp], inside: NDArray[np.intp]) -> tuple[Array, float]:
    """Weights of the parabola through `outside` at `inside`, and the standard deviation from it under unit noise."""
    basis = np.vander(outside.astype(float), 3)
    weights = np.vander(inside.astype(float), 3) @ np.linalg.pinv(basis)
    return weights, float(np.sqrt(1.0 + np.mean(np.sum(weights**2, axis=1))))


def _scale(x: Array) -> Array:
    """Noise standard deviation about each sample, from deviations of single samples."""
    size = 2 * _SIDE + 1
    outside = np.delete(np.arange(size), _SIDE)
    weights, gain = _parabola(outside, np.array([_SIDE]))
    windows = np.lib.stride_tricks.sliding_window_view(x, size)
    deviation = np.abs(windows[:, _SIDE] - windows[:, outside] @ weights[0])
    local = scipy.ndimage.median_filter(deviation, size=min(_LOCAL, deviation.size), mode="nearest")
    scale = np.maximum(local, np.median(deviation)) * STD_OVER_MAD / gain
    return np.pad(scale, _SIDE, mode="edge")
