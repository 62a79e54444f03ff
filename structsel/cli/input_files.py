"""Input files of a command, for the provenance of its results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

from structsel.files import path_text
from structsel.provenance import provenance_of
from structsel.recording.reading import files_read

_WRITTEN = ("out", "guess_map_file", "checkpoint")
_MODEL_OPTIONS = ("model", "simulation")  # texts that may be the name of a file
_READ_AGAIN = ("channel_map", "aircraft", "v0", "reconstruct", "simulation")
_PROVENANCE: ContextVar[Callable[[], dict[str, Any]]] = ContextVar("provenance", default=provenance_of)


@contextmanager
def record_inputs(options: Mapping[str, Any], config: Path | None, cuts: Sequence[str] = ()) -> Iterator[None]:
    """Context in which `provenance` has the files among the options of a command, and how recordings were read."""
    paths = [] if config is None else [config]
    for name, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Path) and name not in _WRITTEN:
                paths.append(one)
            elif isinstance(one, str) and name in _MODEL_OPTIONS:
                paths.append(Path(one.removeprefix("jsbsim:")))
    request = _request(options, cuts)
    # Hashes of large files are computed once.
    before = _PROVENANCE.set(cache(lambda: {**provenance_of(_files(paths)), **request}))
    try:
        yield
    finally:
        _PROVENANCE.reset(before)


def _request(options: Mapping[str, Any], cuts: Sequence[str]) -> dict[str, Any]:
    """Options from which structsel explore reads the same recordings again; nothing without recordings."""
    recordings = [
        *(options.get("files") or ()),
        *(options.get("recordings") or ()),
        *(options.get("more_recordings") or ()),
    ]
    if not recordings:
        return {}
    found = {name: options[name] for name in _READ_AGAIN if options.get(name)}
    request = {name: path_text(value) if isinstance(value, Path) else value for name, value in found.items()}
    return {"request": {"recordings": [path_text(one) for one in recordings], **request, "cut": list(cuts)}}


def provenance() -> dict[str, Any]:
    """Versions, and the input files of the command with their hashes."""
    return _PROVENANCE.get()()


def _files(paths: Iterable[Path]) -> list[Path]:
    """Files among these paths, and recordings in the folders among them."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += files_read(path)
        elif path.is_file():
            files.append(path)
    return files
