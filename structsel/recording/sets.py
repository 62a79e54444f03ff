"""Checks of several recordings together."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from structsel.errors import DataError, StructselWarning
from structsel.nomenclature import find_channel, is_known
from structsel.recording.checks import find_unit_and_sign_errors
from structsel.recording.finding import Finding
from structsel.recording.recording import Recording
from structsel.recording.stored import StoredRecording, channel_digests

RELATIONS = ("unit", "sign", "swap", "scale")
"""Kinds of findings from relations between channels."""
FEW_SAMPLES = 16  # of a channel, compared before all of them are


class DataWarning(StructselWarning):
    """The recordings given to a function contradict themselves, or contain one flight twice."""


def require_recordings(recordings: Sequence[Recording], *, samples: int = 1, by: str) -> None:
    """Refuse an empty list, two recordings of one name, and recordings of fewer than `samples` samples.

    Raises
    ------
    DataError
        The message names the function `by`.
    """
    if not recordings:
        raise DataError(f"{by} needs at least one recording; it was given none.")
    names = [recording.name for recording in recordings]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise DataError(f"{by} was given {', '.join(twice)} more than once. Give the recordings different names.")
    if short := [r for r in recordings if len(r) < samples]:
        raise DataError(f"{by} needs {samples} samples or more; '{short[0].name}' has {len(short[0])}.")


def find_entry_errors(recording: Recording | StoredRecording) -> list[Finding]:
    """Findings of a recording about units, signs and the clock; computed if it has not been checked.

    They include channels whose typical value is outside the plausible range.
    """
    known = [f for f in recording.findings if f.kind in (*RELATIONS, "implausible") and f.severity == "warning"]
    if known or isinstance(recording, StoredRecording) or recording.is_checked:
        return [f for f in known if f.kind in RELATIONS or 2 * f.count > len(recording)]
    outside = [
        Finding("implausible", name, f"its median is {median:.4g} {row.unit}", remedy=f"it looks like {row.hint}")
        for name, values in recording.channels.items()
        if values.size and is_known(name) and (row := find_channel(name)).hint
        # Where every sample is plausible the median is; a comparison with NaN is false.
        if not (row.low <= values.min() and values.max() <= row.high) and np.isfinite(values).any()
        if not row.low <= (median := float(np.nanmedian(values))) <= row.high
    ]
    return [*outside, *find_unit_and_sign_errors(recording.t, recording.channels)]


def with_entry_findings(recording: Recording) -> Recording:
    """The recording with findings about units, signs and the clock, which those from `read_recording` have."""
    new = [f for f in find_entry_errors(recording) if f not in recording.findings]
    return replace(recording, findings=(*recording.findings, *new)) if new else recording


def warn_of_entry_errors(recordings: Sequence[Recording | StoredRecording], stacklevel: int = 3) -> None:
    """Warn of units, signs and clocks that are probably wrong, and of flights that were given twice.

    Warns
    -----
    DataWarning
        One for each kind and channel, with the first recording and the number of others; one for all flights given
        twice.
    """
    alike: dict[tuple[str, str], list[tuple[str, Finding]]] = {}
    for recording in recordings:
        for finding in find_entry_errors(recording):
            alike.setdefault((finding.kind, finding.channel), []).append((recording.name, finding))
    texts = []
    for found in alike.values():
        name, first = found[0]
        more = f" (and in {len(found) - 1} more)" if len(found) > 1 else ""
        texts.append(f"{name}{more}: {str(first).removeprefix('warning: ')}")
    for text in (*texts, *same_flights(recordings)):
        warnings.warn(DataWarning(text), stacklevel=stacklevel)


def same_flights(recordings: Sequence[Recording | StoredRecording]) -> list[str]:
    """One text on all recordings whose samples are those of one before, whatever name and time of day; else nothing."""
    if not _have_a_channel_in_common(recordings):
        return []
    seen: dict[tuple[int, str, str], list[tuple[str, Mapping[str, str]]]] = {}
    copies = []
    for recording in recordings:
        digests = recording.digests if isinstance(recording, StoredRecording) else channel_digests(recording)
        for other, theirs in _candidates(seen, len(recording), digests):
            if all(theirs[name] == digest for name, digest in digests.items() if name in theirs):
                copies.append((recording.name, other))
                break
        for name, digest in digests.items():
            seen.setdefault((len(recording), name, digest), []).append((recording.name, digests))
    if not copies:
        return []
    name, other = copies[0]
    more = f" (and {len(copies) - 1} more copies)" if len(copies) > 1 else ""
    return [
        f"'{name}' and '{other}' contain the same samples{more}: one flight under two names. Leave "
        f"{'them' if more else 'one'} out: cross-validation does not test a model with it, and standard errors are too "
        "small."
    ]


def _have_a_channel_in_common(recordings: Sequence[Recording | StoredRecording]) -> bool:
    """Whether two recordings of equal length may have a channel that varies in common, by a few of its samples."""
    seen: set[tuple[int, str, bytes]] = set()
    for recording in recordings:
        if isinstance(recording, StoredRecording):
            return True  # its samples are not read for this
        step = max(len(recording) // FEW_SAMPLES, 1)
        for name, values in recording.channels.items():
            key = len(recording), name, values[::step].tobytes()
            if key in seen and np.any(values != values[:1]):
                return True
            seen.add(key)
    return False


def _candidates(
    seen: Mapping[tuple[int, str, str], list[tuple[str, Mapping[str, str]]]], samples: int, digests: Mapping[str, str]
) -> list[tuple[str, Mapping[str, str]]]:
    """Recordings of this length with at least one equal channel."""
    found = {name: theirs for key, d in digests.items() for name, theirs in seen.get((samples, key, d), ())}
    return list(found.items())
