"""Resampling of a log, in which each topic has its own sample times, to one time axis.

Between two samples of a topic, signals are interpolated linearly and commands are held. This is done only between
neighbours: in a dropout of the topic, and before its first and after its last sample, the value is missing. The
provenance has what was done; what is missing is a finding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from structsel.errors import DataError
from structsel.recording.checks import DROPPED, GAP
from structsel.recording.finding import Finding

FULL_TURN = {"phi": 2.0 * np.pi, "psi": 2.0 * np.pi}
"""Channels that wrap, and by how much: they are unwrapped before the interpolation. [rad]"""
_NOT_LATER = "{} samples of '{}' are not later than those before them, and are left out"


@dataclass(frozen=True)
class Topic:
    """Sample times of one topic, strictly increasing.

    Attributes
    ----------
    name : str
        Name of the column with the times.
    times : (n,) array [s]
    kept : (m,) array of bool
        Which of the topic's m samples these are: those later than all before them.
    step : float [s]
        Median time step; infinite for fewer than two samples.
    """

    name: str
    times: np.ndarray
    kept: np.ndarray
    step: float

    @classmethod
    def from_times(cls, name: str, times: np.ndarray) -> Topic:
        """Topic with the times of the file, [s]."""
        finite = np.where(np.isfinite(times), times, -np.inf)
        earlier = np.concatenate([[-np.inf], np.maximum.accumulate(finite)[:-1]]) if len(finite) else finite
        kept = finite > earlier
        times = times[kept]
        return cls(name, times, kept, float(np.median(np.diff(times))) if len(times) > 1 else np.inf)

    @property
    def rate(self) -> str:
        """Sampling rate, as text."""
        return f"{1.0 / self.step:.3g} Hz"

    def dropouts(self, start: float, end: float) -> list[tuple[float, float]]:
        """Intervals between `start` and `end` [s] without a sample that are longer than `GAP` median time steps."""
        longest = GAP * self.step
        inside = self.times[(self.times >= start) & (self.times <= end)]
        edges = np.concatenate([[start], inside, [end]])
        long = np.flatnonzero(np.diff(edges) > longest)
        return list(zip(edges[long].tolist(), edges[long + 1].tolist()))


def resample(topic: Topic, values: np.ndarray, t: np.ndarray, *, hold: bool = False, turn: float = 0.0) -> np.ndarray:
    """Values of a topic at other times.

    Parameters
    ----------
    topic : Topic
        With at least two samples.
    values : (m,) array
        One for each of the topic's samples in the file.
    t : (n,) array [s]
        Increasing.
    hold : bool
        Zero-order hold, for at most `GAP` median time steps. Otherwise linear interpolation between neighbours that
        are not farther apart than that.
    turn : float
        Period of a signal that wraps; the result is unwrapped.

    Returns
    -------
    (n,) array
        NaN where the value is missing.
    """
    times, values = topic.times, np.asarray(values, dtype=np.float64)[topic.kept]
    longest = GAP * topic.step
    before = np.clip(np.searchsorted(times, t, side="right") - 1, 0, None)
    known = (t >= times[0]) & ((t - times[before] <= longest) if hold else (t <= times[-1]))
    if hold:
        return np.where(known, values[before], np.nan)
    if turn:
        finite = np.isfinite(values)
        values = values.copy()
        values[finite] = np.unwrap(values[finite], period=turn)
    after = np.minimum(before + 1, len(times) - 1)
    known &= (times[after] - times[before] <= longest) | (t == times[before])
    return np.where(known, np.interp(t, times, values), np.nan)


def resample_all(
    reference: Topic, topics: Mapping[str, tuple[Topic, bool]], values: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray], list[Finding], list[str]]:
    """Resample channels to the times of one topic.

    Parameters
    ----------
    reference : Topic
        With at least two samples.
    topics : mapping of str to (Topic, hold)
        Topic of each channel, and whether the channel is a command that is held.
    values : mapping of str to (m,) array
        Channels, each as long as its topic in the file; those not in `topics` are returned unchanged.

    Returns
    -------
    samples : (n,) array of int
        Which samples of the reference in the file these are.
    values : dict of str to (n,) array
    findings : list of Finding
        Methods used, and dropouts of the topics.
    notes : list of str
        The method for each channel, for the provenance.

    Raises
    ------
    DataError
        The topics have no time in common.
    """
    common = _common_interval([topic for topic, _ in topics.values()], reference.times)
    samples, times = np.flatnonzero(reference.kept)[common], reference.times[common]
    if not len(times):
        raise DataError(
            f"'{reference.name}' has no time in common with the other topics.\n"
            "The log is damaged, or the map has channels of different flights."
        )
    resampled = dict(values)
    others = {name: (topic, hold) for name, (topic, hold) in topics.items() if topic is not reference}
    for name in topics:
        if name in others:
            topic, hold = others[name]
            resampled[name] = resample(topic, values[name], times, hold=hold, turn=FULL_TURN.get(name, 0.0))
        else:
            resampled[name] = values[name][samples]
    notes = [
        f"{name}: {'zero-order hold' if hold else 'linear interpolation'} from '{topic.name}' ({topic.rate})"
        for name, (topic, hold) in others.items()
    ]
    return samples, resampled, _method_findings(reference, others) + _dropout_findings(reference, times, others), notes


def _common_interval(topics: list[Topic], t: np.ndarray) -> slice:
    """Samples between the first and the last sample of every topic that covers the recording.

    Topics begin and end a few samples after and before the reference, and these samples are cut off. A topic that
    begins or ends more than `GAP` of its steps inside does not cover the recording, and cuts nothing.
    """
    start, end = t[0], t[-1]
    for topic in topics:
        slack = GAP * topic.step
        if t[0] < topic.times[0] <= t[0] + slack:
            start = max(start, topic.times[0])
        if t[-1] - slack <= topic.times[-1] < t[-1]:
            end = min(end, topic.times[-1])
    return slice(int(np.searchsorted(t, start)), int(np.searchsorted(t, end, side="right")))


def _method_findings(reference: Topic, others: Mapping[str, tuple[Topic, bool]]) -> list[Finding]:
    """One note with the method of resampling of every channel."""
    methods: dict[str, list[str]] = {}
    for channel, (topic, hold) in others.items():
        method = "zero-order hold" if hold else "linear interpolation"
        if not hold and topic.step * DROPPED < reference.step:
            method = "linear interpolation without an anti-alias filter (faster components are aliased)"
        methods.setdefault(method, []).append(f"{channel} ({topic.rate})")
    if not methods:
        return []
    listed = "; ".join(f"{method}: {', '.join(channels)}" for method, channels in methods.items())
    message = f"channels were resampled to the times of '{reference.name}', {reference.rate}. By {listed}"
    return [Finding("clock", "t", message, severity="note")]


def _dropout_findings(reference: Topic, times: np.ndarray, others: Mapping[str, tuple[Topic, bool]]) -> list[Finding]:
    """Dropouts of every topic, and samples that were left out because their times do not increase."""
    found: list[Finding] = []
    if dropped := int((~reference.kept).sum()):
        found.append(Finding("file", "t", _NOT_LATER.format(dropped, reference.name), count=dropped))
    channels: dict[str, list[str]] = {}
    for channel, (topic, _) in others.items():
        channels.setdefault(topic.name, []).append(channel)
    for topic in {topic.name: topic for topic, _ in others.values()}.values():
        dropouts = topic.dropouts(float(times[0]), float(times[-1]))
        first = channels[topic.name][0]
        if dropouts:
            (a, b), total = dropouts[0], sum(end - start for start, end in dropouts)
            message = (
                f"'{topic.name}' has no samples for {total:.4g} s in all, first from {a:.6g} to {b:.6g} s; these "
                f"dropouts are not interpolated: {', '.join(channels[topic.name])}"
            )
            remedy = "take a part without them with [file] rows or recording.between()"
            found.append(Finding("silent", first, message, remedy=remedy, count=len(dropouts)))
        if dropped := int((~topic.kept).sum()):
            found.append(Finding("file", first, _NOT_LATER.format(dropped, topic.name), count=dropped))
    return found
