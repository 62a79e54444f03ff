"""Input files of a command, for the provenance of its results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

from structsel.provenance import provenance_of
from structsel.recording.reading import files_read

_WRITTEN = ("out", "guess_map_file", "checkpoint")
_MODEL_OPTIONS = ("model", "simulation")  # texts that may be the name of a file
_PROVENANCE: ContextVar[Callable[[], dict[str, Any]]] = ContextVar("provenance", default=provenance_of)


@contextmanager
def record_inputs(options: Mapping[str, Any], config: Path | None) -> Iterator[None]:
    """Context in which `provenance` lists the files among the options of a command."""
    paths = [] if config is None else [config]
    for name, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Path) and name not in _WRITTEN:
                paths.append(one)
            elif isinstance(one, str) and name in _MODEL_OPTIONS:
                paths.append(Path(one.removeprefix("jsbsim:")))
    before = _PROVENANCE.set(cache(lambda: provenance_of(_files(paths))))  # hashes of large files are computed once
    try:
        yield
    finally:
        _PROVENANCE.reset(before)


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
