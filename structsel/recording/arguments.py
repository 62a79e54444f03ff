"""Arguments as a caller passes them: recordings or data frames; what has a wrong type is refused with what to pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

from structsel.errors import ArgumentError
from structsel.recording.recording import Recording
from structsel.recording.stored import StoredRecording

_NOT_RECORDINGS = {
    "str": "Read the file first: read_recording(path).",
    "PosixPath": "Read the file first: read_recording(path).",
    "WindowsPath": "Read the file first: read_recording(path).",
    "dict": 'Make a recording of it: Recording("name", t, channels).',
    "ndarray": 'Name the columns: Recording("name", t, {"alpha": X[:, 0], ...}). For a matrix of candidate terms '
    "there is StepwiseRegressor().fit(X, y) in structsel.estimators.",
    "AeroModel": "A model is the first argument of validate, simulate, compare and diagnose.",
    "Reconstruction": "Pass its .recording.",
    "Reconstructions": "Pass its .recordings.",
    "Series": "Pass the DataFrame with all channels, not one column of it.",
}
_NOT_OF_KIND = {
    "Aircraft": dict.fromkeys(("str", "PosixPath", "WindowsPath"), "Read the file first: Aircraft.from_toml(path)."),
    "AeroModel": {
        **dict.fromkeys(("str", "PosixPath", "WindowsPath"), "Read the file first: AeroModel.from_json(path)."),
        **dict.fromkeys(("Selection", "Selections", "Refinement", "Diagnosis"), "Pass its .model."),
        "dict": "Make a model of it: AeroModel.from_terms(terms).",
    },
    "Trim": dict.fromkeys(("dict", "int", "float", "Recording"), "Find one first: trim(model, aircraft, V, h)."),
    "LinearModel": {
        "AeroModel": "Linearise it first: linearise(model, aircraft, trim(model, aircraft, V, h)).",
        **dict.fromkeys(("str", "PosixPath", "WindowsPath"), "Make one: linearise(model, aircraft, trim)."),
    },
    "Instruments": {"dict": "Make them of it: Instruments(noise={...})."},
    "FrequencyResponse": dict.fromkeys(
        ("Recording", "list", "DataFrame"), "Compute it first: frequency_response(recordings, outputs, inputs)."
    ),
    "Recording": _NOT_RECORDINGS | {"DataFrame": "Make one of it: Recording.from_frame(frame)."},
}


def as_recordings(given: Any, call: str) -> list[Any]:
    """One or several recordings, or data frames with a column of time, as a list of recordings.

    Parameters
    ----------
    given : Recording, StoredRecording, DataFrame, or iterable of these
    call : str
        Function that was called, for the message; ``"validate"`` or ``"validate(model, recordings)"``.

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
    ours = type(given).__module__.partition(".")[0] == "structsel"
    if ours or isinstance(given, str | bytes | Mapping) or not isinstance(given, Iterable) or hasattr(given, "dtype"):
        raise _no_recordings(given, call)
    found = []
    for k, one in enumerate(given):
        recording = as_recording(one, f"recording {k + 1}")
        if recording is None:
            raise _no_recordings(one, call, ", in its list")
        found.append(recording)
    return found


def as_recording(given: Any, name: str) -> Recording | StoredRecording | None:
    """Return a recording as it is, a data frame as a recording of this name, and None for anything else."""
    if isinstance(given, Recording | StoredRecording):
        return given
    if type(given).__module__.partition(".")[0] == "pandas" and hasattr(given, "columns"):
        return Recording.from_frame(given, name=str(given.attrs.get("name", name)))
    return None


def as_one_recording(given: Any, call: str, several: str = "") -> Recording:
    """One recording, or a data frame with a column of time, as a recording.

    Parameters
    ----------
    given : Recording, StoredRecording or DataFrame
    call : str
        Function that was called, with its arguments, for the message.
    several : str
        The same for several recordings.

    Raises
    ------
    ArgumentError
        It is something else.
    DataError
        A data frame has no time.
    """
    found = as_recording(given, "recording")
    if found is not None:
        return found.read() if isinstance(found, StoredRecording) else found
    remedy = f"For several recordings call {several}." if several and isinstance(given, list | tuple) else ""
    raise _refused(
        given,
        f"{_verb(call)} needs one recording: a Recording, or a DataFrame with a column 't' [s].",
        remedy or _recording_remedy(given, call),
    )


def require_kind(given: Any, kind: type, call: str, name: str = "") -> None:
    """Refuse an argument that is not of a type of structsel, such as Aircraft or AeroModel.

    Parameters
    ----------
    given : object
    kind : type
    call : str
        Function that was called, with its arguments: ``"simulate(model, aircraft, inputs)"``.
    name : str
        Of an argument that `call` does not show.

    Raises
    ------
    ArgumentError
        It is something else.
    """
    if not isinstance(given, kind):
        remedy = _NOT_OF_KIND.get(kind.__name__, {}).get(type(given).__name__, f"The order is {call}.")
        text = f" as {name}" if name else ""
        raise _refused(given, f"{_verb(call)} needs {_with_article(kind.__name__)}{text}.", remedy)


def require_number(given: Any, name: str, unit: str, call: str) -> None:
    """Refuse an argument that is not one number.

    Raises
    ------
    ArgumentError
        It is something else.
    """
    if not isinstance(given, Real) and getattr(given, "ndim", None) != 0:
        raise _refused(given, f"{_verb(call)} needs {name} as a number [{unit}].", f"The order is {call}.")


def require_names(given: Any, call: str) -> list[str]:
    """Names of responses, given as one text or a sequence of texts, as a list.

    Raises
    ------
    ArgumentError
        It is something else.
    """
    names: list[Any] = [given] if isinstance(given, str) else list(given) if isinstance(given, Iterable) else [None]
    if not all(isinstance(name, str) for name in names):
        needs = f'{_verb(call)} needs the name of a response, such as "Cm", or a list of names.'
        raise _refused(given, needs, f"The order is {call}.")
    return names


def _no_recordings(given: Any, call: str, where: str = "") -> ArgumentError:
    needs = f"{_verb(call)} needs recordings: a Recording, a DataFrame with a column 't' [s], or a list of these."
    return _refused(given, needs, _recording_remedy(given, call), where)


def _recording_remedy(given: Any, call: str) -> str:
    kind = type(given).__name__
    return f"The order is {call}." if kind == "Aircraft" and "(" in call else _NOT_RECORDINGS.get(kind, "")


def _refused(given: Any, needs: str, remedy: str, where: str = "") -> ArgumentError:
    return ArgumentError(f"{needs}\nIt was given {_with_article(type(given).__name__)}{where}.", remedy=remedy)


def _with_article(kind: str) -> str:
    if kind.endswith("s") and kind != "Series":  # Instruments, Selections, Reconstructions
        return kind
    return f"{'an' if kind[:1].lower() in 'aeiou' else 'a'} {kind}"


def _verb(call: str) -> str:
    return call.partition("(")[0]
