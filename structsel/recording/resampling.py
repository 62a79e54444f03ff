"""One clock for a log whose topics each have their own.

Between two samples of a topic a signal passes in a straight line and a command stays as it was, but only where the two
are neighbours: across a longer silence, and outside the topic's own span, there is no value. What was done is said in
the provenance, what is missing is a finding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from structsel.errors import DataError
from structsel.recording.checks import DROPPED, GAP, Finding

FULL_TURN = {"phi": 2.0 * np.pi, "psi": 2.0 * np.pi}
"""Channels that jump by a turn where they wrap, which no straight line may cross. [rad]"""
_NOT_LATER = "{} samples of '{}' are not later than those before them, and are left out"


@dataclass(frozen=True)
class Topic:
    """Sample times of one topic, made strictly increasing.

    Attributes
    ----------
    name : str
        Of the column that holds them.
    times : (n,) array [s]
    kept : (m,) array of bool
        Which of the topic's m samples these are: those later than every one before.
    step : float [s]
        Median step; infinite for fewer than two samples.
    """

    name: str
    times: np.ndarray
    kept: np.ndarray
    step: float

    @classmethod
    def of(cls, name: str, times: np.ndarray) -> Topic:
        """Topic of the times as the file holds them, [s]."""
        finite = np.where(np.isfinite(times), times, -np.inf)
        earlier = np.concatenate([[-np.inf], np.maximum.accumulate(finite)[:-1]]) if len(finite) else finite
        kept = finite > earlier
        times = times[kept]
        return cls(name, times, kept, float(np.median(np.diff(times))) if len(times) > 1 else np.inf)

    @property
    def rate(self) -> str:
        """Samples per second, as text."""
        return f"{1.0 / self.step:.3g} Hz"

    def silences(self, start: float, end: float) -> list[tuple[float, float]]:
        """Where between `start` and `end` [s] the topic says nothing for longer than `GAP` median steps."""
        longest = GAP * self.step
        inside = self.times[(self.times >= start) & (self.times <= end)]
        edges = np.concatenate([[start], inside, [end]])
        long = np.flatnonzero(np.diff(edges) > longest)
        return list(zip(edges[long].tolist(), edges[long + 1].tolist()))


def sample(topic: Topic, values: np.ndarray, clock: np.ndarray, *, hold: bool = False, turn: float = 0.0) -> np.ndarray:
    """Values of a topic at the times of another clock.

    Parameters
    ----------
    topic : Topic
        Of at least two samples.
    values : (m,) array
        As many as the topic has samples in the file.
    clock : (n,) array [s]
        Increasing.
    hold : bool
        The last value stays, for at most `GAP` median steps; else straight lines between neighbours that are no
        further apart than that.
    turn : float
        What the values jump by where they wrap; the result runs on across.

    Returns
    -------
    (n,) array
        NaN where there is none.
    """
    times, values = topic.times, np.asarray(values, dtype=np.float64)[topic.kept]
    longest = GAP * topic.step
    before = np.clip(np.searchsorted(times, clock, side="right") - 1, 0, None)
    there = (clock >= times[0]) & ((clock - times[before] <= longest) if hold else (clock <= times[-1]))
    if hold:
        return np.where(there, values[before], np.nan)
    if turn:
        seen = np.isfinite(values)
        values = values.copy()
        values[seen] = np.unwrap(values[seen], period=turn)
    after = np.minimum(before + 1, len(times) - 1)
    there &= (times[after] - times[before] <= longest) | (clock == times[before])
    return np.where(there, np.interp(clock, times, values), np.nan)


def resample_all(
    clock: Topic, met: Mapping[str, tuple[Topic, bool]], values: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray], list[Finding], list[str]]:
    """Bring channels to one clock.

    Parameters
    ----------
    clock : Topic
        Of at least two samples.
    met : mapping of str to (Topic, hold)
        Topic of each channel, and whether it is a command that is held.
    values : mapping of str to (m,) array
        Channels, each as long as its topic is in the file; those not in `met` are passed on.

    Returns
    -------
    samples : (n,) array of int
        Which of the clock's own samples in the file these are.
    values : dict of str to (n,) array
    findings : list of Finding
        What was done, and where a topic says nothing.
    notes : list of str
        The same channel by channel, for the provenance.

    Raises
    ------
    DataError
        No time that all topics have in common.
    """
    span = _common_span([topic for topic, _ in met.values()], clock.times)
    samples, times = np.flatnonzero(clock.kept)[span], clock.times[span]
    if not len(times):
        raise DataError(
            f"'{clock.name}' shares no time with the other topics.\n"
            "The log is damaged, or the map takes channels of different flights."
        )
    made = dict(values)
    others = {name: (topic, hold) for name, (topic, hold) in met.items() if topic is not clock}
    for name in met:
        if name in others:
            topic, hold = others[name]
            made[name] = sample(topic, values[name], times, hold=hold, turn=FULL_TURN.get(name, 0.0))
        else:
            made[name] = values[name][samples]
    notes = [
        f"{name}: {'held' if hold else 'in straight lines'} from '{topic.name}' ({topic.rate}) to the clock"
        for name, (topic, hold) in others.items()
    ]
    return samples, made, _say_how(clock, others) + _say_where_not(clock, times, others), notes


def _common_span(topics: list[Topic], clock: np.ndarray) -> slice:
    """Samples of a clock between the first and last of every topic that runs throughout.

    Topics never begin and end with the clock's own first and last sample, so these few are cut off. A topic that
    begins or ends more than `GAP` of its steps inside does not run throughout, and cuts nothing.
    """
    start, end = clock[0], clock[-1]
    for topic in topics:
        slack = GAP * topic.step
        if clock[0] < topic.times[0] <= clock[0] + slack:
            start = max(start, topic.times[0])
        if clock[-1] - slack <= topic.times[-1] < clock[-1]:
            end = min(end, topic.times[-1])
    return slice(int(np.searchsorted(clock, start)), int(np.searchsorted(clock, end, side="right")))


def _say_how(clock: Topic, others: Mapping[str, tuple[Topic, bool]]) -> list[Finding]:
    ways: dict[str, list[str]] = {}
    for channel, (topic, hold) in others.items():
        way = "commands held until the next" if hold else "straight lines between neighbouring samples"
        if not hold and topic.step * DROPPED < clock.step:
            way = "straight lines, thinned without a filter, so that what is faster than the clock folds back"
        ways.setdefault(way, []).append(f"{channel} ({topic.rate})")
    if not ways:
        return []
    said = "; ".join(f"{way}: {', '.join(channels)}" for way, channels in ways.items())
    return [Finding("clock", "t", f"'{clock.name}', {clock.rate}. Brought to it: {said}", severity="note")]


def _say_where_not(clock: Topic, times: np.ndarray, others: Mapping[str, tuple[Topic, bool]]) -> list[Finding]:
    found: list[Finding] = []
    if dropped := int((~clock.kept).sum()):
        found.append(Finding("file", "t", _NOT_LATER.format(dropped, clock.name), count=dropped))
    channels: dict[str, list[str]] = {}
    for channel, (topic, _) in others.items():
        channels.setdefault(topic.name, []).append(channel)
    for topic in {topic.name: topic for topic, _ in others.values()}.values():
        silences = topic.silences(float(times[0]), float(times[-1]))
        first = channels[topic.name][0]
        if silences:
            (a, b), count = silences[0], len(silences)
            lost = sum(end - start for start, end in silences)
            message = (
                f"'{topic.name}' is silent for {lost:.4g} s in all, first from {a:.6g} to {b:.6g} s, and that is not "
                f"bridged: {', '.join(channels[topic.name])}"
            )
            remedy = "take a stretch without, by [file] rows or recording.between()"
            found.append(Finding("silent", first, message, remedy=remedy, count=count))
        if dropped := int((~topic.kept).sum()):
            found.append(Finding("file", first, _NOT_LATER.format(dropped, topic.name), count=dropped))
    return found
