"""Finding manoeuvres in a long recording: steady segments, and segments in which the controls are moved on purpose.

The activity of a channel is its standard deviation about a line fitted in a sliding window of two seconds: a step, a
doublet or a sweep increases it; an offset, a drift or a slow change of trim does not. The activity usual in steady
flight is that of the quietest tenth of the recording, so it includes noise, turbulence and stability augmentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.nomenclature import BODY_RATES, CONTROL_SURFACES
from structsel.recording.checks import GAP, find_gaps, parts_between
from structsel.recording.recording import Recording

_WINDOW = 2.0  # s; half a period of the slowest sweeps, and a doublet's length for most aircraft
_STEADY_FRACTION = 0.10  # of the recording, at least, is steady
_ON_FACTOR, _OFF_FACTOR = 10.0, 5.0  # of the usual activity: an input begins above the first, ends below the second
_MIN_ACTIVITY = 0.05  # of the largest activity of any channel in the same unit; smaller activity is a reaction
_MIN_CONTROL = 0.2  # of the largest activity in a manoeuvre: a control with less only reacts
_MAX_RESOLUTION = 1 / 16  # of a channel's range
_MAX_STEADY = {"rad": 0.01, "rad/s": 0.05}  # activity of surfaces and rates in steady flight, in any atmosphere
_STEP_AND_RETURN = 15.0  # s; a step and its return within this time are one input, as in a steady sideslip
_CONTROLS, _RATES = CONTROL_SURFACES, BODY_RATES
_AXES = {
    **dict.fromkeys(("de", "df", "throttle", "thrust", "q", "alpha", "theta", "ax", "az", "V"), "longitudinal"),
    **dict.fromkeys(("da", "dr", "p", "r", "beta", "phi", "psi", "ay"), "lateral"),
}


@dataclass(frozen=True)
class FlightSegment:
    """One steady or one excited segment of a recording.

    Attributes
    ----------
    name : str
        ``m01``, ``m02``, ... for excited segments, ``s01``, ... for steady ones, in order of time.
    kind : {"steady", "excited"}
    start, end : float [s]
        An excited segment includes steady flight before the input and the free response after it.
    controls : tuple of str
        Channels moved on purpose, the most active first; empty in a steady segment.
    axis : {"", "longitudinal", "lateral", "mixed"}
        Motion that these excite; empty in a steady segment, and for channels that belong to no axis.
    moved : (float, float) or None [s]
        Begin and end of the movement of these channels.
    """

    name: str
    kind: str
    start: float
    end: float
    controls: tuple[str, ...] = ()
    axis: str = ""
    moved: tuple[float, float] | None = None

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.end - self.start

    def __str__(self) -> str:
        text = f"{self.name}: {self.kind}, {self.start:.2f} to {self.end:.2f} s"
        if self.moved is None:
            return text
        axis = f"{self.axis}, " if self.axis else ""
        return f"{text}, {axis}{' '.join(self.controls)} moved from {self.moved[0]:.2f} to {self.moved[1]:.2f} s"


def find_manoeuvres(
    recording: Recording,
    *,
    channels: Sequence[str] | None = None,
    quiet: float = 4.0,
    lead: float = 2.0,
    tail: float = 10.0,
) -> list[FlightSegment]:
    """Segments of steady flight and of manoeuvres, from the activity of the controls.

    An input begins where the activity of a channel exceeds ten times its usual value in steady flight, and ends where
    it falls below five times this value. The usual value is that of the quietest tenth of the recording, and at most
    0.01 rad for a surface or 0.05 rad/s for a rate. The activity of an input is at least one step of the channel's
    resolution, and at least a twentieth of the largest activity of any channel in the same unit. A step and its return
    within 15 s are one input. A sweep that begins below about 0.1 Hz is found with a delay.

    Parameters
    ----------
    recording : Recording
        Gaps in time end a segment. Missing samples of the channels are interpolated for the search.
    channels : sequence of str, optional
        Channels with inputs; if absent, the recorded ones of ``de``, ``da``, ``dr``, or else ``p``, ``q``, ``r``.
    quiet : float [s]
        Inputs separated by less than this are one manoeuvre. At least `lead`.
    lead : float [s]
        Steady flight kept before the first input, for the initial state and the biases.
    tail : float [s]
        Longest free response kept after the last input; shorter if the rates become steady earlier.

    Returns
    -------
    list of FlightSegment
        In order of time, without overlap. Segments between excited ones are steady; those shorter than `lead` are left
        out.

    Raises
    ------
    ChannelError
        If a channel is missing, or the recording has neither controls nor rates.
    DomainError
        If a duration is negative, or `quiet` is less than `lead`.
    """
    if not min(quiet, lead, tail) >= 0.0 or quiet < lead:
        raise DomainError(
            f"find_manoeuvres needs durations of 0 s or more and quiet >= lead; quiet is {quiet:g}, lead {lead:g}, "
            f"tail {tail:g} s."
        )
    names = _input_channels(recording, channels)
    parts = parts_between(find_gaps(recording.t, GAP * recording.dt), len(recording))
    parts = [part for part in parts if part.stop - part.start >= 2]
    half = max(2, round(0.5 * _WINDOW / recording.dt))
    inputs = _activities(recording, names, parts, half)
    rates = _activities(recording, [name for name in _RATES if name in recording], parts, half)
    found: list[FlightSegment] = []
    for part in parts:
        found += _segments_of(recording, part, half, inputs, rates, quiet, lead, tail)
    return _with_names(found)


def split_manoeuvres(
    recording: Recording,
    *,
    channels: Sequence[str] | None = None,
    quiet: float = 4.0,
    lead: float = 2.0,
    tail: float = 10.0,
) -> list[Recording]:
    """Manoeuvres of a recording, each a Recording named ``flight_m01``, ``flight_m02``, ...

    Parameters
    ----------
    recording, channels, quiet, lead, tail
        As for `find_manoeuvres`.

    Returns
    -------
    list of Recording
        In order of time; empty if no manoeuvre is found. The provenance has the controls and their times.

    Raises
    ------
    ChannelError, DomainError
        As `find_manoeuvres`.
    """
    manoeuvres = []
    for segment in find_manoeuvres(recording, channels=channels, quiet=quiet, lead=lead, tail=tail):
        if segment.kind == "excited":
            part = recording.between(segment.start, segment.end).with_channels(note=f"manoeuvre {segment}")
            manoeuvres.append(replace(part, name=f"{recording.name}_{segment.name}"))
    return manoeuvres


def _input_channels(recording: Recording, channels: Sequence[str] | None) -> list[str]:
    """The requested channels, else the recorded controls, else the recorded rates."""
    if channels is not None:
        recording.require(*channels, by="find_manoeuvres")
        return list(dict.fromkeys(channels))
    for group in (_CONTROLS, _RATES):
        recorded = [name for name in group if name in recording and np.isfinite(recording[name]).any()]
        if recorded:
            return recorded
    recording.require(*_CONTROLS, by="find_manoeuvres")
    return []


@dataclass(frozen=True)
class _Activity:
    """Values of one channel without single spikes, its activity at each sample, and the limits of an input."""

    values: np.ndarray
    size: np.ndarray
    on: float
    off: float


def _activities(recording: Recording, names: Iterable[str], parts: list[slice], half: int) -> dict[str, _Activity]:
    """Activity of each channel in windows of 2 half + 1 samples."""
    size: dict[str, np.ndarray] = {}
    values: dict[str, np.ndarray] = {}
    largest: dict[str, float] = {}
    for name in names:
        finite = np.isfinite(recording[name])
        if not finite.any():
            continue
        filled = np.interp(recording.t, recording.t[finite], recording[name][finite])
        values[name], size[name] = np.empty(len(filled)), np.zeros(len(filled))
        for part in parts:
            # The median of three removes single spikes and does not move edges.
            values[name][part] = scipy.ndimage.median_filter(filled[part], 3, mode="nearest")
            size[name][part] = _detrended_std(values[name][part], half)
        unit = recording.unit(name)
        largest[unit] = max(largest.get(unit, 0.0), float(size[name].max()))
    activities = {}
    for name, activity in size.items():
        unit = recording.unit(name)
        changes = np.abs(np.diff(values[name]))
        # The resolution is the smallest change, except in a channel that has only a few large steps.
        digit = float(np.min(changes, initial=_MAX_RESOLUTION * float(np.ptp(values[name])), where=changes > 0.0))
        usual = min(float(np.quantile(activity, _STEADY_FRACTION)), _MAX_STEADY.get(unit, np.inf))
        smallest = _MIN_ACTIVITY * largest[unit]
        # A signal that alternates between two values has a standard deviation of half its step.
        on, off = max(_ON_FACTOR * usual, digit, smallest), max(_OFF_FACTOR * usual, 0.55 * digit, 0.5 * smallest)
        activities[name] = _Activity(values[name], activity, on, off)
    return activities


def _detrended_std(values: np.ndarray, half: int) -> np.ndarray:
    """(n,) standard deviation about the line fitted to the 2 half + 1 samples around each.

    The first and last `half` samples have the value of the nearest complete window.
    """
    half = min(half, (len(values) - 1) // 2)
    if half < 2:
        return np.zeros(len(values))
    y = values - np.median(values)  # an offset costs digits in the sums below
    k, ones = np.arange(-half, half + 1.0), np.ones(2 * half + 1)
    n, kk = len(k), float(k @ k)
    total = np.convolve(y, ones, "valid")
    slope = np.convolve(y, k[::-1], "valid")
    rest = np.convolve(y * y, ones, "valid") - total**2 / n - slope**2 / kk
    return np.pad(np.sqrt(np.maximum(rest, 0.0) / n), half, mode="edge")


def _inputs_of(activity: _Activity, part: slice, half: int, t: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample, counted in the complete recording, of each input of one channel."""
    size, values, t = activity.size[part], activity.values[part], t[part]
    spans: list[tuple[int, int]] = []
    offset, since = 0.0, 0  # offset of the channel after the last inputs, and the span that caused it
    for (region,) in scipy.ndimage.find_objects(scipy.ndimage.label(size > activity.off)[0]):
        if size[region].max() <= activity.on:
            continue
        # The window contains an edge half its length before its centre does.
        middle = (region.start + region.stop - 1) // 2
        first = min(region.start + half, middle) if region.start > half else region.start
        last = max(region.stop - 1 - half, middle) if region.stop < len(size) - half else region.stop - 1
        before, after = values[max(0, first - half) : first + 1], values[last : last + half + 1]
        shift = float(np.median(after) - np.median(before))
        excursion = float(np.ptp(values[max(0, first - half) : last + half + 1]))
        if abs(shift) < max(activity.on, 0.3 * excursion):
            shift = 0.0  # it returned
        returns = offset * shift < 0.0 and abs(shift) > 0.5 * abs(offset)
        if returns and t[first] - t[spans[since][1]] < _STEP_AND_RETURN:
            first, shift = spans[since][0], shift + offset
            if abs(shift) < 0.3 * excursion:
                offset = shift = 0.0
            del spans[since:]
        spans.append((first, last))
        if shift:
            offset, since = shift, len(spans) - 1
    return [(part.start + first, part.start + last) for first, last in spans]


def _segments_of(
    recording: Recording,
    part: slice,
    half: int,
    inputs: dict[str, _Activity],
    rates: dict[str, _Activity],
    quiet: float,
    lead: float,
    tail: float,
) -> list[FlightSegment]:
    """Steady and excited segments of a part without gaps."""
    t = recording.t
    spans = sorted(span for activity in inputs.values() for span in _inputs_of(activity, part, half, t))
    merged: list[tuple[int, int]] = []
    for first, last in spans:
        if merged and t[first] - t[merged[-1][1]] < quiet:
            merged[-1] = (merged[-1][0], max(last, merged[-1][1]))
        else:
            merged.append((first, last))
    begin, finish = float(t[part.start]), float(t[part.stop - 1])
    found, since = [], begin
    for k, (first, last) in enumerate(merged):
        start = max(begin, float(t[first]) - lead)
        latest = finish if k + 1 == len(merged) else float(t[merged[k + 1][0]]) - lead
        end = min(_end_of_response(t, part, last, half, rates, tail), latest)
        if start - since >= max(lead, recording.dt):
            found.append(FlightSegment("", "steady", since, start))
        # Half a window more on either side, for the windows that contain the edges.
        controls = _moved_controls(
            recording, inputs, slice(max(part.start, first - half), min(part.stop, last + half + 1))
        )
        axes = {_AXES.get(name, "") for name in controls}
        axis = axes.pop() if len(axes) == 1 else "" if "" in axes else "mixed"
        found.append(FlightSegment("", "excited", start, end, controls, axis, (float(t[first]), float(t[last]))))
        since = end
    if finish - since >= max(lead, recording.dt):
        found.append(FlightSegment("", "steady", since, finish))
    return found


def _end_of_response(
    t: np.ndarray, part: slice, last: int, half: int, rates: dict[str, _Activity], tail: float
) -> float:
    """Time [s] at which all rates are as steady as in steady flight, at most `tail` after the input."""
    stop = min(int(np.searchsorted(t, t[last] + tail, side="right")), part.stop)
    moving = [last + half]  # until then the windows contain the input
    for activity in rates.values():
        active = np.flatnonzero(activity.size[last:stop] > activity.off)
        if active.size:
            moving.append(last + int(active[-1]))
    if not rates:
        moving.append(stop)
    return float(t[min(max(moving), stop - 1)])


def _moved_controls(recording: Recording, inputs: dict[str, _Activity], span: slice) -> tuple[str, ...]:
    """Channels that are moved on purpose in the span of an input, the most active first."""
    size = {name: float(activity.size[span].max()) for name, activity in inputs.items()}
    # The limit for the other channels is relative to those that are more active than in steady flight.
    size = {name: activity for name, activity in size.items() if activity > inputs[name].off}
    largest: dict[str, float] = {}
    for name, activity in size.items():
        largest[recording.unit(name)] = max(largest.get(recording.unit(name), 0.0), activity)
    moved = [name for name, activity in size.items() if activity >= _MIN_CONTROL * largest[recording.unit(name)]]
    return tuple(sorted(moved, key=lambda name: -size[name] / inputs[name].on))


def _with_names(segments: list[FlightSegment]) -> list[FlightSegment]:
    """Segments with their names, ``m01`` or ``s01``."""
    counts = {"excited": 0, "steady": 0}
    named = []
    for segment in segments:
        counts[segment.kind] += 1
        letter = "m" if segment.kind == "excited" else "s"
        named.append(replace(segment, name=f"{letter}{counts[segment.kind]:02d}"))
    return named
