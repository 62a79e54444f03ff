"""Runs of one value in a channel: stuck and saturated instruments, and readings repeated by a slow instrument.

`repeated_readings` includes channels whose runs differ in length, such as a coarse altitude. The noise level and the
spikes of a channel depend on a narrower criterion, runs of equal length (`structsel.numerics.signal_quality`).
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.signal_quality import STD_OVER_MAD, starts_of_runs

_STUCK_SECONDS, _STUCK_SAMPLES, _STUCK_RATIO = 1.0, 20, 10.0  # shortest interval, the last in median run lengths
_STUCK_JUMP = 5.0  # median steps of the channel, by which it jumps when the instrument works again
_MAX_NOISY_RUN = 12  # samples of one value under noise above the resolution (probability below 1e-6)
_MIN_SATURATED = 4  # samples on the limit
_PEAK_RATIO = 5.0  # samples on the limit over those on the values next to it
_SATURATED_GAP = 10  # samples on the limit that are closer than this are one interval
_MIN_REPEATS, _MAX_RUN_RATIO = 0.3, 4.0  # fraction of repeated samples; long runs (95 %) over the median run
_FEWEST = 20  # finite samples


def run_lengths(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample and length of every run of one value."""
    starts = starts_of_runs(values)
    return starts, np.diff(np.concatenate((starts, [values.size])))


def stuck_intervals(t: np.ndarray, values: np.ndarray) -> list[tuple[int, int]]:
    """Intervals of one value, each as first and last-plus-one sample, in which the instrument did not work.

    There are two criteria. The interval is long, and the channel jumps at its end or the recording ends: a slow
    channel of coarse resolution also repeats one value, but then changes by one of its usual steps. Or the interval is
    longer than noise above the resolution of the channel allows.

    Parameters
    ----------
    t : (n,) array [s]
    values : (n,) array
        NaN belongs to no interval.
    """
    starts, lengths = run_lengths(values)
    if lengths.max(initial=0) < min(_STUCK_SAMPLES, _MAX_NOISY_RUN):
        return []
    usual = float(np.median(lengths))
    steps = np.abs(np.diff(values))
    changes = steps[np.isfinite(steps) & (steps != 0.0)]
    if not changes.size:
        return []
    ends = starts + lengths
    long = (lengths >= max(_STUCK_SAMPLES, _STUCK_RATIO * usual)) & (t[ends - 1] - t[starts] >= _STUCK_SECONDS)
    jump = np.append(steps, np.inf)[ends - 1]  # to the next value; NaN before a missing sample
    stuck = long & ~(jump < _STUCK_JUMP * float(np.median(changes)))
    if is_noisy(values[starts]) and np.percentile(lengths, 95) <= 2.0 * usual:
        stuck |= lengths >= _MAX_NOISY_RUN * usual
    return list(zip(starts[stuck].tolist(), ends[stuck].tolist()))


def is_noisy(values: np.ndarray) -> bool:
    """Whether the noise of a channel is larger than its resolution.

    Fourth differences of white noise change sign in 80 % of samples, those of a smooth motion seldom.
    """
    finite = values[np.isfinite(values)]
    fourth = np.diff(finite, 4)
    fourth = fourth[fourth != 0.0]
    if fourth.size < 40:
        return False
    steps = np.abs(np.diff(finite))
    level = (
        STD_OVER_MAD * float(np.median(np.abs(fourth))) / np.sqrt(70.0)
    )  # variance of fourth differences: 70 sigma^2
    return bool(np.mean(fourth[1:] * fourth[:-1] < 0.0) > 0.65 and level >= steps[steps > 0.0].min())


def saturated_samples(values: np.ndarray) -> np.ndarray:
    """(n,) bool, samples at which the instrument was at the end of its range.

    With noise, one sample or few have the largest or the smallest value, so many samples on it are a limit. A channel
    without noise stays at its extremes at smooth turning points, but arrives and leaves by its smallest step; it
    arrives at a limit, and leaves it, by larger steps.
    """
    saturated = np.zeros(len(values), dtype=bool)
    finite = values[np.isfinite(values)]
    if finite.size < _FEWEST or finite.min() == finite.max():
        return saturated
    if max(np.sum(finite == finite.min()), np.sum(finite == finite.max())) < _MIN_SATURATED:
        return saturated
    starts, lengths = run_lengths(values)
    usual = float(np.median(lengths))
    noisy = is_noisy(values[starts])
    levels, counts = np.unique(finite, return_counts=True)
    for level, count, next_counts in ((levels[0], counts[0], counts[1:4]), (levels[-1], counts[-1], counts[-4:-1])):
        at = np.flatnonzero(values == level)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        if len(runs) == 1 and runs[0].size >= _MAX_NOISY_RUN * usual:
            continue  # one long run: stuck
        if noisy and count >= _MIN_SATURATED * usual and count > _PEAK_RATIO * next_counts.max():
            # Between samples on the limit, and next to them, are samples that only noise kept from it.
            for run in np.split(at, np.flatnonzero(np.diff(at) > _SATURATED_GAP * usual) + 1):
                saturated[max(0, run[0] - 2) : run[-1] + 3] = True
        elif not noisy and usual == 1.0:
            for run in runs:
                if run.size >= _MIN_SATURATED and _has_usual_steps(values, int(run[0]), int(run[-1])):
                    saturated[run] = True
    return saturated


def _has_usual_steps(values: np.ndarray, first: int, last: int) -> bool:
    """Whether the steps into and out of an interval are as large as the channel's usual ones."""
    steps = np.abs(np.diff(values))
    changes = steps[np.isfinite(steps) & (steps > 0.0)]
    smallest = max(float(np.median(changes)), 3.0 * float(changes.min()))
    return all(steps[i] >= smallest for i in (first - 1, last) if 0 <= i < len(steps))


def repeated_readings(values: np.ndarray) -> np.ndarray:
    """Samples that only repeat the reading before them, in a channel that is slower than the recording."""
    finite = np.isfinite(values)
    if finite.sum() < _FEWEST:
        return np.empty(0, dtype=int)
    starts, lengths = run_lengths(values)
    repeats = 1.0 - len(starts) / len(values)
    if repeats < _MIN_REPEATS:
        return np.empty(0, dtype=int)
    usual = float(np.median(lengths))
    # A slow motion recorded at coarse resolution also repeats values, but its longest runs are much longer.
    if usual < 2.0 or np.percentile(lengths, 95) > _MAX_RUN_RATIO * usual:
        return np.empty(0, dtype=int)
    first = np.zeros(len(values), dtype=bool)
    first[starts] = True
    return np.flatnonzero(~first & finite)
