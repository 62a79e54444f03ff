"""What is wrong, or looks wrong, in a recording: found and reported, never mended.

A finding has one of three severities:

- ``error``: the samples concerned cannot be used (NaN, infinity);
- ``warning``: something is very likely a mistake (a unit, a sign, a dead instrument);
- ``note``: something to know (a channel that never moves, a sample that is missing).

Samples are counted from 0, as arrays are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from structsel.errors import DataError
from structsel.nomenclature import find_channel, is_known
from structsel.numerics.signal_quality import starts_of_runs

GAP = 3.0
"""Steps of time longer than this many median steps are gaps: the manoeuvre ends there."""
DROPPED = 1.5
"""Steps longer than this, and not gaps, are single samples that went missing."""
FROM_SAMPLES = ("gap", "dropped", "jitter", "not-finite", "constant", "stuck", "implausible", "unit", "sign")
"""Kinds of findings that `check_recording` makes, and makes anew."""
_STUCK_SECONDS, _STUCK_SAMPLES, _STUCK_RATIO = 1.0, 20, 10.0
_MOVING = ("air data", "attitude", "rates", "motion")


@dataclass(frozen=True)
class Finding:
    """One thing found in a recording.

    Attributes
    ----------
    kind : str
        From the samples: gap, dropped, jitter, not-finite, constant, stuck, implausible, unit, sign.
        From the file: header, text, file; of a log: clock (how it was brought to one), silent, assumed. From a
        treatment: spike. Stations add kinds of their own.
    channel : str
    message : str
    severity : {"note", "warning", "error"}
    remedy : str
    sample : int or None
        First sample concerned, counted from 0; None when it is the whole channel.
    time : float or None [s]
    count : int
        Samples, or places, concerned.
    """

    kind: str
    channel: str
    message: str
    severity: str = "warning"
    remedy: str = ""
    sample: int | None = None
    time: float | None = None
    count: int = 1

    def __str__(self) -> str:
        at = ""
        if self.sample is not None:
            at = f" at sample {self.sample}"
            if self.time is not None:
                at += f" (t = {self.time:g} s)"
        remedy = f" {self.remedy[0].upper()}{self.remedy[1:]}." if self.remedy else ""
        return f"{self.severity}: {self.channel}: {self.message}{at}.{remedy}"

    def to_dict(self) -> dict[str, Any]:
        """Fields by name, for machines."""
        return asdict(self)


def require_clock(t: np.ndarray, name: str) -> None:
    """Refuse a clock on which nothing can be differentiated or integrated.

    Parameters
    ----------
    t : (n,) array [s]
    name : str
        The recording, for the message.

    Raises
    ------
    DataError
        Fewer than two samples, or time not finite or not strictly increasing.
    """
    if len(t) < 2:
        raise DataError(
            f"'{name}' has {len(t)} sample{'s' if len(t) != 1 else ''}; a recording needs at least 2 "
            "on its clock 't'.\nCheck that the file is whole and that the rows wanted are in it."
        )
    lost = np.flatnonzero(~np.isfinite(t))
    if lost.size:
        raise DataError(
            f"'{name}': channel 't' is {t[lost[0]]} at sample {lost[0]} ({lost.size} in all).\n"
            "Take these rows out of the file, or give [file] dt in a channel map if the sampling is even."
        )
    step = np.diff(t)
    wrong = np.flatnonzero(step <= 0.0)
    if not wrong.size:
        return
    i = int(wrong[0]) + 1
    if step[i - 1] == 0.0:
        what = f"repeats {t[i]:g} s at sample {i}"
        remedy = "Take the repeated rows out of the file"
    else:
        what = f"runs backward from {t[i - 1]:g} to {t[i]:g} s at sample {i}"
        remedy = "Put the rows in order of time, or read the manoeuvres one by one with [file] rows"
    raise DataError(
        f"'{name}': channel 't' {what} ({wrong.size} such places); time must increase strictly.\n"
        f"{remedy}, or give [file] dt in a channel map if the sampling is even."
    )


def check_recording(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> tuple[Finding, ...]:
    """Everything found in a recording, the clock first, then channel by channel.

    Parameters
    ----------
    t : (n,) array [s]
        Finite and strictly increasing.
    channels : mapping of str to (n,) array
    """
    found = check_clock(t)
    for name, values in channels.items():
        found += check_channel(name, t, values)
    return tuple(found + check_relations(t, channels))


def check_clock(t: np.ndarray) -> list[Finding]:
    """Gaps, missing samples and an uneven clock."""
    step = np.diff(t)
    dt = float(np.median(step))
    found = []
    gaps = np.flatnonzero(step > GAP * dt)
    if gaps.size:
        i = int(gaps[0]) + 1
        found.append(
            Finding(
                "gap",
                "t",
                f"{gaps.size} gap{'s' if gaps.size > 1 else ''}, the longest {step[gaps].max():g} s "
                f"against a step of {dt:g} s; the first ends",
                "warning",
                "use recording.split(), which gives the manoeuvres between gaps",
                i,
                float(t[i]),
                int(gaps.size),
            )
        )
    dropped = np.flatnonzero((step > DROPPED * dt) & (step <= GAP * dt))
    if dropped.size:
        i = int(dropped[0]) + 1
        found.append(
            Finding(
                "dropped",
                "t",
                f"{dropped.size} step{'s' if dropped.size > 1 else ''} of {DROPPED:g} to {GAP:g} times "
                f"{dt:g} s: samples are missing, first",
                "note",
                "",
                i,
                float(t[i]),
                int(dropped.size),
            )
        )
    even = step[step <= DROPPED * dt]
    if even.size and np.abs(even - dt).max() > 0.05 * dt:
        found.append(
            Finding(
                "jitter",
                "t",
                f"the step varies from {even.min():g} to {even.max():g} s",
                "note",
                count=int(np.sum(np.abs(even - dt) > 0.05 * dt)),
            )
        )
    return found


def check_channel(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    """What one channel shows by itself: not finite, constant, stuck, implausible."""
    found = []
    finite = np.isfinite(values)
    if not finite.all():
        lost = np.flatnonzero(~finite)
        i = int(lost[0])
        found.append(
            Finding(
                "not-finite",
                name,
                f"{lost.size} of {values.size} samples are NaN or infinite, first",
                "error",
                "take a part without them with recording.between() or [file] rows in a channel map",
                i,
                float(t[i]),
                int(lost.size),
            )
        )
        values, t = values[finite], t[finite]
    else:
        lost = np.empty(0, dtype=int)
    if values.size < 2:
        return found
    low, high = float(values.min()), float(values.max())
    moving = is_known(name) and find_channel(name).group in _MOVING
    if low == high:
        severity = "warning" if moving else "note"
        remedy = "an instrument that never moves is dead or was not recorded" if moving else ""
        found.append(Finding("constant", name, f"is {low:g} throughout", severity, remedy, count=values.size))
    elif moving and not lost.size:
        found += _check_stuck(name, t, values)
    if is_known(name):
        found += _check_range(name, t, values)
    return found


def _check_stuck(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    """The longest stretch on which the channel is stuck."""
    stretches = stuck_stretches(t, values)
    if not stretches:
        return []
    i, end = max(stretches, key=lambda stretch: stretch[1] - stretch[0])
    usual = float(np.median(run_lengths(values)[1]))
    message = (
        f"stands still at {values[i]:g} for {end - i} samples ({t[end - 1] - t[i]:.3g} s), where it usually moves "
        f"every {usual:g}; it stops"
    )
    remedy = "look whether the instrument or the recorder hung"
    return [Finding("stuck", name, message, "warning", remedy, i, float(t[i]), end - i)]


def stuck_stretches(t: np.ndarray, values: np.ndarray) -> list[tuple[int, int]]:
    """First and last-plus-one samples of stretches on one value that jump when they come free, or never do.

    A slow channel of coarse resolution also rests on one value, but then moves on by one of its
    usual steps.

    Parameters
    ----------
    t : (n,) array [s]
    values : (n,) array
        NaN is no value, and no stretch.
    """
    starts, lengths = run_lengths(values)
    usual = float(np.median(lengths))
    steps = np.abs(np.diff(values))
    moves = steps[np.isfinite(steps) & (steps != 0.0)]
    if not moves.size:
        return []
    found = []
    for i, length in zip(starts.tolist(), lengths.tolist()):
        end = i + length
        if length < max(_STUCK_SAMPLES, _STUCK_RATIO * usual) or t[end - 1] - t[i] < _STUCK_SECONDS:
            continue
        if end < values.size and steps[end - 1] < 5.0 * float(np.median(moves)):
            continue
        found.append((i, end))
    return found


def run_lengths(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First sample and length of every run of one value."""
    starts = starts_of_runs(values)
    return starts, np.diff(np.concatenate((starts, [values.size])))


def _check_range(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    row = find_channel(name)
    outside = np.flatnonzero((values < row.low) | (values > row.high))
    if not outside.size:
        return []
    i = int(outside[0])
    hint = f"it looks like {row.hint}: state the unit in the channel map" if row.hint else "check unit and sign"
    return [
        Finding(
            "implausible",
            name,
            f"{outside.size} samples outside {row.low:g} to {row.high:g} {row.unit}, as far as "
            f"{values[np.argmax(np.abs(values))]:g}; first",
            "warning",
            hint,
            i,
            float(t[i]),
            int(outside.size),
        )
    ]


def check_relations(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """Units and signs that channels betray together: rates against attitudes, qbar against V, ..."""
    usable = {name: values for name, values in channels.items() if np.isfinite(values).all()}
    found: list[Finding] = []
    for rate, angle in (("p", "phi"), ("q", "theta")):
        if rate in usable and angle in usable:
            found += _check_rate(rate, angle, t, usable)
    if "az" in usable:
        found += _check_gravity(usable["az"])
    for channel, needs, ratio, slips, says in _RATIOS:
        if not all(name in usable for name in needs):
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = ratio(*(usable[name] for name in needs))
        telling = ratios[np.isfinite(ratios)]
        for factor, slip in slips.items():
            if telling.size and abs(float(np.median(telling)) / factor - 1.0) < 0.1:
                message, remedy = f"{says}, as if {slip}", "state the unit in the channel map"
                found.append(Finding("unit", channel, message, "warning", remedy))
    return found


def _check_gravity(az: np.ndarray) -> list[Finding]:
    """A flight is mostly near 1 g upward, so the mean of az is near -9.8."""
    mean, peak = float(az.mean()), float(np.abs(az).max())
    if -2.0 < mean < -0.5 and peak < 9.0 and np.mean(az < 0.0) > 0.9:
        message, remedy = (
            f"its mean is {mean:.3g} m/s^2, as if g were fed as m/s^2",
            'state unit = "g" in the map',
        )
        return [Finding("unit", "az", message, "warning", remedy)]
    if 0.8 < mean < 1.2 or 8.0 < mean < 12.0:
        message = f"its mean is {mean:+.3g}; body z is down, so it should be negative"
        return [Finding("sign", "az", message, "warning", "give it sign = -1 in the channel map")]
    return []


def _check_rate(rate: str, angle: str, t: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """Compare a body rate with the slope of its attitude; a factor of 57.3 is a unit."""
    if len(t) < 20:
        return []
    # Over steps of several samples, because the difference of noisy neighbours is mostly noise.
    k = max(1, min(len(t) // 10, round(0.5 / max(float(np.median(np.diff(t))), 1e-9))))
    slope = (channels[angle][k:] - channels[angle][:-k]) / (t[k:] - t[:-k])
    turned = cumulative_trapezoid(channels[rate], t, initial=0.0)
    mean_rate = (turned[k:] - turned[:-k]) / (t[k:] - t[:-k])
    slope, mean_rate = slope - slope.mean(), mean_rate - mean_rate.mean()
    spread, agree = (
        float(np.sqrt(np.mean(slope**2) * np.mean(mean_rate**2))),
        float(np.mean(slope * mean_rate)),
    )
    if spread == 0.0 or agree < 0.8 * spread:
        return []
    ratio = float(np.mean(mean_rate**2)) / agree
    for factor, wrong in ((180.0 / np.pi, rate), (np.pi / 180.0, angle)):
        if 0.67 < ratio / factor < 1.5:
            other = angle if wrong == rate else rate
            message = f"is {180 / np.pi:.3g} times what '{other}' says, as if degrees were fed as radians"
            remedy = 'state unit = "deg/s" or "deg" in the channel map'
            return [Finding("unit", wrong, message, "warning", remedy)]
    return []


def _standard_height(rho: np.ndarray) -> np.ndarray:
    """Altitude [m] at which the standard atmosphere's troposphere has density `rho`."""
    return (1.0 - (rho / 1.225) ** (1.0 / 4.25588)) / 2.25577e-5


# Channel blamed; channels needed; their ratio, 1 where units agree; ratios that a slip gives; words.
_RATIOS: tuple[tuple[str, tuple[str, ...], Callable[..., np.ndarray], dict[float, str], str], ...] = (
    (
        "V",
        ("V", "rho", "qbar"),
        lambda V, rho, qbar: V / np.sqrt(2.0 * qbar / rho),
        {1.94384: "knots were fed as m/s", 3.28084: "ft/s were fed as m/s", 3.6: "km/h were fed as m/s"},
        "does not match qbar and rho",
    ),
    (
        "V",
        ("V", "mach"),
        lambda V, mach: V / mach / 318.0,
        {1.94384: "knots were fed as m/s", 3.28084: "ft/s were fed as m/s"},
        "V / mach is no speed of sound",
    ),
    (
        "h",
        ("h", "rho"),
        lambda h, rho: h / np.where(rho < 1.15, _standard_height(rho), np.nan),
        {3.28084: "feet were fed as metres"},
        "does not match the air density",
    ),
)
