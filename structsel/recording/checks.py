"""Checks of a recording: its time axis, and each channel. Findings are reported; the data are not changed."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from structsel.errors import DataError
from structsel.formatting import count_of
from structsel.nomenclature import find_channel, is_known
from structsel.recording.finding import Finding
from structsel.recording.kinematic_checks import find_kinematic_errors
from structsel.recording.repeated_values import run_lengths, stuck_intervals
from structsel.recording.unit_checks import find_unit_errors

GAP = 3.0
"""A time step longer than this many median steps is a gap: the manoeuvre ends there."""
DROPPED = 1.5
"""In a time step longer than this many median steps, and not a gap, single samples are missing."""
RECOMPUTED_KINDS = (
    "gap", "dropped", "jitter", "not-finite", "constant", "stuck", "implausible", "unit", "sign", "swap", "scale"
)  # fmt: skip
"""Kinds of findings that `check_recording` computes from the samples, each time anew."""
_JITTER = 0.05  # of the median step; chosen, not critical
_INSTRUMENTS = ("air data", "attitude", "rates", "motion")  # groups of channels that are never constant in flight


def require_time(t: np.ndarray, name: str) -> None:
    """Refuse a time axis on which nothing can be differentiated or integrated.

    Parameters
    ----------
    t : (n,) array [s]
    name : str
        Name of the recording, for the message.

    Raises
    ------
    DataError
        Fewer than two samples, or time not finite or not strictly increasing.
    """
    if len(t) < 2:
        raise DataError(
            f"'{name}' has {count_of(len(t), 'sample')}; a recording needs at least 2 on its time axis 't'.\n"
            "Check that the file is complete and that it contains the requested rows."
        )
    bad = np.flatnonzero(~np.isfinite(t))
    if bad.size:
        raise DataError(
            f"'{name}': channel 't' is {t[bad[0]]} at sample {bad[0]} ({bad.size} in all).\n"
            "Remove these rows from the file, or give [file] dt in a channel map if the sampling is uniform."
        )
    step = np.diff(t)
    wrong = np.flatnonzero(step <= 0.0)
    if not wrong.size:
        return
    i = int(wrong[0]) + 1
    if step[i - 1] == 0.0:
        fault = f"repeats {t[i]:g} s at sample {i}"
        remedy = "Remove the repeated rows from the file"
    else:
        fault = f"runs backward from {t[i - 1]:g} to {t[i]:g} s at sample {i}"
        remedy = "Sort the rows by time, or read the manoeuvres one by one with [file] rows"
    raise DataError(
        f"'{name}': channel 't' {fault} ({wrong.size} such samples); time must increase strictly.\n"
        f"{remedy}, or give [file] dt in a channel map if the sampling is uniform."
    )


def find_gaps(t: np.ndarray, shortest: float) -> np.ndarray:
    """Last sample before each time step that is longer than `shortest` [s]."""
    return np.flatnonzero(np.diff(t) > shortest)


def parts_between(gaps: np.ndarray, samples: int) -> list[slice]:
    """Parts of a time axis of so many samples that are separated by `gaps`, as `find_gaps` returns them."""
    return [slice(a, b) for a, b in pairwise([0, *(gaps + 1).tolist(), samples])]


def check_recording(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> tuple[Finding, ...]:
    """All findings about a recording: time axis, single channels, relations between channels.

    Parameters
    ----------
    t : (n,) array [s]
        Finite and strictly increasing.
    channels : mapping of str to (n,) array
    """
    found = check_time(t)
    for name, values in channels.items():
        found += check_channel(name, t, values)
    return (*found, *find_unit_and_sign_errors(t, channels))


def find_unit_and_sign_errors(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """Findings from relations between channels: units, signs, exchanged channels, and the clock."""
    kinematic = find_kinematic_errors(t, channels)
    known = {(f.kind, f.channel) for f in kinematic}
    return [*(f for f in find_unit_errors(channels) if (f.kind, f.channel) not in known), *kinematic]


def check_time(t: np.ndarray) -> list[Finding]:
    """Gaps, missing samples and varying time steps."""
    step = np.diff(t)
    dt = float(np.median(step))
    found = []
    gaps = find_gaps(t, GAP * dt)
    if gaps.size:
        message = (
            f"{count_of(gaps.size, 'gap')}, the longest {step[gaps].max():g} s compared with a time step of {dt:g} s; "
            "the first ends"
        )
        remedy = "use recording.split(), which returns the manoeuvres between gaps"
        found.append(Finding.of_samples("gap", "t", message, "warning", remedy, t, gaps + 1))
    dropped = np.flatnonzero((step > DROPPED * dt) & (step <= GAP * dt))
    if dropped.size:
        message = (
            f"{count_of(dropped.size, 'step')} of {DROPPED:g} to {GAP:g} times {dt:g} s: samples are missing, first"
        )
        found.append(Finding.of_samples("dropped", "t", message, "note", "", t, dropped + 1))
    regular = step[step <= DROPPED * dt]
    varying = np.abs(regular - dt) > _JITTER * dt
    if varying.any():
        message = f"the time step varies from {regular.min():g} to {regular.max():g} s"
        found.append(Finding("jitter", "t", message, "note", count=int(varying.sum())))
    return found


def check_channel(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    """Findings about one channel: not finite, constant, stuck, implausible."""
    found = []
    finite = np.isfinite(values)
    bad = np.flatnonzero(~finite)
    if bad.size:
        message = f"{bad.size} of {values.size} samples are NaN or infinite, first"
        remedy = "take a part without them with recording.between() or [file] rows in a channel map"
        found.append(Finding.of_samples("not-finite", name, message, "error", remedy, t, bad))
        values, t = values[finite], t[finite]
    if values.size < 2:
        return found
    moving = is_known(name) and find_channel(name).group in _INSTRUMENTS
    if values.min() == values.max():
        severity = "warning" if moving else "note"
        remedy = "an instrument that never changes is dead or was not recorded" if moving else ""
        message = f"is constant at {values[0]:g} in all samples"
        found.append(Finding("constant", name, message, severity, remedy, count=values.size))
    elif moving and not bad.size:
        found += _check_stuck(name, t, values)
    if is_known(name):
        found += _check_range(name, t, values)
    return found


def _check_stuck(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    """The longest interval on which the channel is stuck."""
    intervals = stuck_intervals(t, values)
    if not intervals:
        return []
    i, end = max(intervals, key=lambda interval: interval[1] - interval[0])
    usual = float(np.median(run_lengths(values)[1]))
    message = (
        f"is constant at {values[i]:g} for {end - i} samples ({t[end - 1] - t[i]:.3g} s), but elsewhere it changes "
        f"every {count_of(round(usual), 'sample')}; it stops"
    )
    remedy = "check whether the instrument or the recorder failed"
    return [Finding.of_samples("stuck", name, message, "warning", remedy, t, np.arange(i, end))]


def _check_range(name: str, t: np.ndarray, values: np.ndarray) -> list[Finding]:
    """Samples outside the plausible range of the nomenclature."""
    row = find_channel(name)
    outside = np.flatnonzero((values < row.low) | (values > row.high))
    if not outside.size:
        return []
    message = (
        f"{count_of(outside.size, 'sample')} outside {row.low:g} to {row.high:g} {row.unit}, as far as "
        f"{values[np.argmax(np.abs(values))]:g}; first"
    )
    remedy = f"it looks like {row.hint}: state the unit in the channel map" if row.hint else "check unit and sign"
    return [Finding.of_samples("implausible", name, message, "warning", remedy, t, outside)]
