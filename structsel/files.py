"""Files written completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to a file; it replaces the file when it is completely on the disk.

    If writing fails or is interrupted, the previous file remains, and the temporary one is removed.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError
        The file cannot be written; a full disk may be noticed only at the end of writing.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        with partial.open("rb+") as stream:
            os.fsync(stream.fileno())  # else a loss of power could leave an empty file
        os.replace(partial, path)
    finally:
        with suppress(OSError):  # the first error is the one to raise
            partial.unlink(missing_ok=True)


def path_text(path: str | os.PathLike[str]) -> str:
    r"""A path as text that can be written: bytes that are not UTF-8 as ``\xff``."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, lines ended as in the text; as `replacing`."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
