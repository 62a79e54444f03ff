"""Recordings as a caller passes them: one or several, or data frames; anything else is refused with what to pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from structsel.errors import ArgumentError
from structsel.recording.recording import Recording
from structsel.recording.stored import StoredRecording
from structsel.results import Result


def as_recordings(given: Any, verb: str) -> list[Any]:
    """One or several recordings, or data frames with a column of time, as a list of recordings.

    Parameters
    ----------
    given : Recording, StoredRecording, DataFrame, or iterable of these
    verb : str
        Function that was called, for the message.

    Raises
    ------
    ArgumentError
        It is something else.
    DataError
        A data frame has no time.
    """
    single = as_recording(given, "recording")
    if single is not None:
        return [single]
    if isinstance(given, str | bytes | Mapping | Result) or not isinstance(given, Iterable) or hasattr(given, "dtype"):
        raise _refused(given, verb)
    found = []
    for k, one in enumerate(given):
        recording = as_recording(one, f"recording {k + 1}")
        if recording is None:
            raise _refused(one, verb, ", in its list")
        found.append(recording)
    return found


def as_recording(given: Any, name: str) -> Recording | StoredRecording | None:
    """Return a recording as it is, a data frame as a recording of this name, and None for anything else."""
    if isinstance(given, Recording | StoredRecording):
        return given
    if type(given).__module__.partition(".")[0] == "pandas" and hasattr(given, "columns"):
        return Recording.from_frame(given, name=name)
    return None


def _refused(given: Any, verb: str, where: str = "") -> ArgumentError:
    remedies = {
        "str": "Read the file first: read_recording(path).",
        "PosixPath": "Read the file first: read_recording(path).",
        "WindowsPath": "Read the file first: read_recording(path).",
        "dict": 'Make a recording of it: Recording("name", t, channels).',
        "ndarray": 'Name the columns: Recording("name", t, {"alpha": X[:, 0], ...}). For a matrix of candidate terms '
        "there is StepwiseRegressor().fit(X, y) in structsel.estimators.",
        "AeroModel": "A model is the first argument of validate and simulate.",
    }
    kind = type(given).__name__
    article = "an" if kind[:1].lower() in "aeiou" else "a"
    return ArgumentError(
        f"{verb} needs recordings: a Recording, a DataFrame with a column 't' [s], or a list of these.\n"
        f"It was given {article} {kind}{where}.",
        remedy=remedies.get(kind, ""),
    )
