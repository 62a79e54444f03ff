"""Finding manoeuvres in a long recording: steady stretches, and those in which the controls are moved on purpose.

How it is done. Movement of a channel is the standard deviation about a straight line in a window of two seconds
that slides along it: a step, a doublet or a sweep stands out, while an offset, a drift or a slow change of trim does
not. What is usual in steady flight is taken from the quietest tenth of the recording itself, so noise, turbulence and
an augmentation that works all the time set their own measure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import find_objects, label, median_filter

from structsel.errors import DomainError
from structsel.nomenclature import BODY_RATES, CONTROL_SURFACES
from structsel.recording.checks import GAP
from structsel.recording.recording import Recording

_WINDOW = 2.0  # s; half a period of the slowest sweeps, and a doublet's length for most aircraft
_STEADY_SHARE = 0.10  # of the recording, at least, is steady
_BEGINS, _ENDS = 10.0, 5.0  # times the usual movement: above the first it is an input, as long as above the second
_LEAST = 0.05  # of the largest movement of any channel in the same unit: what is smaller is no input but a reaction
_SHARES = 0.2  # of the largest movement in a manoeuvre: a control that moves less only goes along
_COARSEST = 1 / 16  # of a channel's range: its resolution is finer
_NEVER_STEADY = {"rad": 0.01, "rad/s": 0.05}  # steady flight moves surfaces and rates less, whatever the air
_HELD = 15.0  # s; a step and its return no further apart are one input, as in a steady sideslip
_CONTROLS, _RATES = CONTROL_SURFACES, BODY_RATES
_AXES = {
    **dict.fromkeys(("de", "df", "throttle", "thrust", "q", "alpha", "theta", "ax", "az", "V"), "longitudinal"),
    **dict.fromkeys(("da", "dr", "p", "r", "beta", "phi", "psi", "ay"), "lateral"),
}


@dataclass(frozen=True)
class Stretch:
    """A part of a recording in which one thing happens.

    Attributes
    ----------
    name : str
        ``m01``, ``m02``, ... for excited stretches, ``s01``, ... for steady ones, in order of time.
    kind : {"steady", "excited"}
    start, end : float [s]
        Of an excited stretch with the steady flight before the input and the free response after it.
    controls : tuple of str
        Channels moved on purpose, the most moved first; empty in a steady stretch.
    axis : {"", "longitudinal", "lateral", "mixed"}
        Which motion these excite; empty in a steady stretch, and where channels of no known axis are moved.
    moved : (float, float) or None [s]
        From the first movement of these channels to their last.
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
        said = f"{self.name}: {self.kind}, {self.start:.2f} to {self.end:.2f} s"
        if self.moved is None:
            return said
        axis = f"{self.axis}, " if self.axis else ""
        return f"{said}, {axis}{' '.join(self.controls)} moved from {self.moved[0]:.2f} to {self.moved[1]:.2f} s"


def find_manoeuvres(
    recording: Recording,
    *,
    channels: Sequence[str] | None = None,
    quiet: float = 4.0,
    lead: float = 2.0,
    tail: float = 10.0,
) -> list[Stretch]:
    """Stretches of steady flight and of manoeuvres, from the activity of the controls.

    An input begins where a channel moves more than ten times as much as in the quietest tenth of the
    recording, and lasts as long as it moves more than five times as much. It moves by four steps of the channel's
    resolution at least, and by a twentieth of the largest movement of any channel in the same unit. A step and
    its return within 15 s are one input. Where a recording is short of steady flight, the movement usual there
    is taken as no more than 0.01 rad of a surface or 0.05 rad/s. A sweep that starts below about 0.1 Hz is
    noticed late.

    Parameters
    ----------
    recording : Recording
        Gaps in its clock end a stretch. Missing samples of the channels looked at are bridged for the search.
    channels : sequence of str, optional
        Where to look for inputs; ``de``, ``da``, ``dr`` as recorded if not given, else ``p``, ``q``, ``r``.
    quiet : float [s]
        Inputs less than this apart are one manoeuvre. Not less than `lead`.
    lead : float [s]
        Steady flight kept before the first input, for the initial state and the biases.
    tail : float [s]
        Longest free response kept after the last input; less where the rates settle before.

    Returns
    -------
    list of Stretch
        In order of time, without overlap. What lies between excited stretches is steady; pieces shorter than
        `lead` are left out.

    Raises
    ------
    ChannelError
        When a channel is missing, or the recording has neither controls nor rates.
    DomainError
        When a length is negative, or `quiet` is less than `lead`.
    """
    if not min(quiet, lead, tail) >= 0.0 or quiet < lead:
        raise DomainError(
            f"find_manoeuvres needs lengths of 0 s or more and quiet >= lead; quiet is {quiet:g}, lead {lead:g}, "
            f"tail {tail:g} s."
        )
    looked_at = _choose(recording, channels)
    step = np.diff(recording.t)
    cuts = [0, *(np.flatnonzero(step > GAP * recording.dt) + 1).tolist(), len(recording)]
    parts = [slice(a, b) for a, b in pairwise(cuts) if b - a >= 2]
    half = max(2, round(0.5 * _WINDOW / recording.dt))
    inputs = _movements(recording, looked_at, parts, half)
    rates = _movements(recording, [name for name in _RATES if name in recording], parts, half)
    found: list[Stretch] = []
    for part in parts:
        found += _stretches_of(recording, part, half, inputs, rates, quiet, lead, tail)
    return _named(found)


def split_manoeuvres(
    recording: Recording,
    *,
    channels: Sequence[str] | None = None,
    quiet: float = 4.0,
    lead: float = 2.0,
    tail: float = 10.0,
) -> list[Recording]:
    """Cut the excited stretches out of a recording, each a Recording named ``flight_m01``, ``flight_m02``, ...

    Parameters
    ----------
    recording, channels, quiet, lead, tail
        As for `find_manoeuvres`.

    Returns
    -------
    list of Recording
        In order of time; empty where no manoeuvre is found. The provenance says what was moved and when.

    Raises
    ------
    ChannelError, DomainError
        As `find_manoeuvres`.
    """
    made = []
    for stretch in find_manoeuvres(recording, channels=channels, quiet=quiet, lead=lead, tail=tail):
        if stretch.kind == "excited":
            cut = recording.between(stretch.start, stretch.end).with_channels(note=f"manoeuvre {stretch}")
            made.append(replace(cut, name=f"{recording.name}_{stretch.name}"))
    return made


def _choose(recording: Recording, channels: Sequence[str] | None) -> list[str]:
    if channels is not None:
        recording.require(*channels, by="find_manoeuvres")
        return list(dict.fromkeys(channels))
    for group in (_CONTROLS, _RATES):
        there = [name for name in group if name in recording and np.isfinite(recording[name]).any()]
        if there:
            return there
    recording.require(*_CONTROLS, by="find_manoeuvres")
    return []


@dataclass(frozen=True)
class _Movement:
    """How much one channel moves, sample by sample, and where that begins and ends to be an input."""

    values: np.ndarray
    size: np.ndarray
    begins: float
    ends: float


def _movements(recording: Recording, names: Iterable[str], parts: list[slice], half: int) -> dict[str, _Movement]:
    size: dict[str, np.ndarray] = {}
    values: dict[str, np.ndarray] = {}
    largest: dict[str, float] = {}
    for name in names:
        finite = np.isfinite(recording[name])
        if not finite.any():
            continue
        whole = np.interp(recording.t, recording.t[finite], recording[name][finite])
        values[name], size[name] = np.empty(len(whole)), np.zeros(len(whole))
        for part in parts:
            # The median of three takes single spikes out and leaves edges where they are.
            values[name][part] = median_filter(whole[part], 3, mode="nearest")
            size[name][part] = _scatter_about_a_line(values[name][part], half)
        unit = recording.unit(name)
        largest[unit] = max(largest.get(unit, 0.0), float(size[name].max()))
    made = {}
    for name, moves in size.items():
        unit = recording.unit(name)
        changes = np.abs(np.diff(values[name]))
        # The last digit is the smallest change there is; in a channel of a few clean steps that is no digit.
        digit = float(np.min(changes, initial=_COARSEST * float(np.ptp(values[name])), where=changes > 0.0))
        usual = min(float(np.quantile(moves, _STEADY_SHARE)), _NEVER_STEADY.get(unit, np.inf))
        least = _LEAST * largest[unit]
        # A last digit that flickers scatters by half its step.
        begins, ends = max(_BEGINS * usual, digit, least), max(_ENDS * usual, 0.55 * digit, 0.5 * least)
        made[name] = _Movement(values[name], moves, begins, ends)
    return made


def _scatter_about_a_line(values: np.ndarray, half: int) -> np.ndarray:
    """(n,) standard deviation about the straight line through the 2 half + 1 samples around each.

    The first and last `half` samples take the value of the nearest whole window.
    """
    half = min(half, (len(values) - 1) // 2)
    if half < 2:
        return np.zeros(len(values))
    y = values - np.median(values)  # the sums below lose digits to an offset
    k, ones = np.arange(-half, half + 1.0), np.ones(2 * half + 1)
    n, kk = len(k), float(k @ k)
    total = np.convolve(y, ones, "valid")
    slope = np.convolve(y, k[::-1], "valid")
    rest = np.convolve(y * y, ones, "valid") - total**2 / n - slope**2 / kk
    return np.pad(np.sqrt(np.maximum(rest, 0.0) / n), half, mode="edge")


def _inputs_of(move: _Movement, part: slice, half: int, t: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample, counted in the whole recording, of each input of one channel."""
    size, values, t = move.size[part], move.values[part], t[part]
    spans: list[tuple[int, int]] = []
    left, since = 0.0, 0  # what the channel is left at, and by which span
    for (region,) in find_objects(label(size > move.ends)[0]):
        if size[region].max() <= move.begins:
            continue
        # The window reaches an edge half its length before its centre does.
        middle = (region.start + region.stop - 1) // 2
        first = min(region.start + half, middle) if region.start > half else region.start
        last = max(region.stop - 1 - half, middle) if region.stop < len(size) - half else region.stop - 1
        before, after = values[max(0, first - half) : first + 1], values[last : last + half + 1]
        shift = float(np.median(after) - np.median(before))
        excursion = float(np.ptp(values[max(0, first - half) : last + half + 1]))
        if abs(shift) < max(move.begins, 0.3 * excursion):
            shift = 0.0  # it came back
        if left * shift < 0.0 and abs(shift) > 0.5 * abs(left) and t[first] - t[spans[since][1]] < _HELD:
            first, shift = spans[since][0], shift + left
            if abs(shift) < 0.3 * excursion:
                left = shift = 0.0
            del spans[since:]
        spans.append((first, last))
        if shift:
            left, since = shift, len(spans) - 1
    return [(part.start + first, part.start + last) for first, last in spans]


def _stretches_of(
    recording: Recording,
    part: slice,
    half: int,
    inputs: dict[str, _Movement],
    rates: dict[str, _Movement],
    quiet: float,
    lead: float,
    tail: float,
) -> list[Stretch]:
    t = recording.t
    spans = sorted(span for move in inputs.values() for span in _inputs_of(move, part, half, t))
    together: list[tuple[int, int]] = []
    for first, last in spans:
        if together and t[first] - t[together[-1][1]] < quiet:
            together[-1] = (together[-1][0], max(last, together[-1][1]))
        else:
            together.append((first, last))
    begin, finish = float(t[part.start]), float(t[part.stop - 1])
    found, since = [], begin
    for k, (first, last) in enumerate(together):
        start = max(begin, float(t[first]) - lead)
        latest = finish if k + 1 == len(together) else float(t[together[k + 1][0]]) - lead
        end = min(_settled(t, part, last, half, rates, tail), latest)
        if start - since >= max(lead, recording.dt):
            found.append(Stretch("", "steady", since, start))
        # Half a window more on either side, for windows that held the edges.
        controls = _moved(recording, inputs, slice(max(part.start, first - half), min(part.stop, last + half + 1)))
        axes = {_AXES.get(name, "") for name in controls}
        axis = axes.pop() if len(axes) == 1 else "" if "" in axes else "mixed"
        found.append(Stretch("", "excited", start, end, controls, axis, (float(t[first]), float(t[last]))))
        since = end
    if finish - since >= max(lead, recording.dt):
        found.append(Stretch("", "steady", since, finish))
    return found


def _settled(t: np.ndarray, part: slice, last: int, half: int, rates: dict[str, _Movement], tail: float) -> float:
    """Time at which the free response is over: no rate moves more than in steady flight, or `tail` is."""
    stop = min(int(np.searchsorted(t, t[last] + tail, side="right")), part.stop)
    moving = [last + half]  # until then the windows hold the input itself
    for move in rates.values():
        still = np.flatnonzero(move.size[last:stop] > move.ends)
        if still.size:
            moving.append(last + int(still[-1]))
    if not rates:
        moving.append(stop)
    return float(t[min(max(moving), stop - 1)])


def _moved(recording: Recording, inputs: dict[str, _Movement], span: slice) -> tuple[str, ...]:
    """Channels moved within a span in which one of them has begun an input, the most moved first."""
    size = {name: float(move.size[span].max()) for name, move in inputs.items()}
    # One that does not stand out from its own steady flight says nothing about the others.
    size = {name: moves for name, moves in size.items() if moves > inputs[name].ends}
    most: dict[str, float] = {}
    for name, moves in size.items():
        most[recording.unit(name)] = max(most.get(recording.unit(name), 0.0), moves)
    moved = [name for name, moves in size.items() if moves >= _SHARES * most[recording.unit(name)]]
    return tuple(sorted(moved, key=lambda name: -size[name] / inputs[name].begins))


def _named(stretches: list[Stretch]) -> list[Stretch]:
    counts = {"excited": 0, "steady": 0}
    made = []
    for stretch in stretches:
        counts[stretch.kind] += 1
        letter = "m" if stretch.kind == "excited" else "s"
        made.append(replace(stretch, name=f"{letter}{counts[stretch.kind]:02d}"))
    return made
