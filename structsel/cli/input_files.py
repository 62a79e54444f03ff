"""Which files a command was given, for its results to say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

from structsel.provenance import provenance_of
from structsel.recording.reading import files_read

_WRITTEN = ("out", "guess", "checkpoint")
_PERHAPS_FILES = ("model", "simulation")  # texts that may name a file
_TOLD: ContextVar[Callable[[], dict[str, Any]]] = ContextVar("told", default=provenance_of)


@contextmanager
def reading(asked: Mapping[str, Any], config: Path | None) -> Iterator[None]:
    """Within, `provenance` is of the files among a command's options."""
    paths = [] if config is None else [config]
    for name, value in asked.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, Path) and name not in _WRITTEN:
                paths.append(one)
            elif isinstance(one, str) and name in _PERHAPS_FILES:
                paths.append(Path(one.removeprefix("jsbsim:")))
    before = _TOLD.set(cache(lambda: provenance_of(_files(paths))))  # large files are read for it once
    try:
        yield
    finally:
        _TOLD.reset(before)


def provenance() -> dict[str, Any]:
    """Versions, and the files that the command was given, with their hashes."""
    return _TOLD.get()()


def _files(paths: Iterable[Path]) -> list[Path]:
    """The files among these, and those in folders that hold recordings."""
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += files_read(path)
        elif path.is_file():
            files.append(path)
    return files
