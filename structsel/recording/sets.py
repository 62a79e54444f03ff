"""Checks of several recordings together."""

from __future__ import annotations

from collections.abc import Sequence

from structsel.errors import DataError
from structsel.recording.recording import Recording


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
