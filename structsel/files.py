"""Files written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a name beside a file's; what is written there becomes the file when all of it is on the disk.

    Whatever stops the writing, Ctrl-C too, leaves the file that stood there, and nothing else.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError
        The file cannot be written; a full disk may show only as the last of it is brought there.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        with partial.open("rb+") as stream:
            os.fsync(stream.fileno())  # or a loss of power could leave the new name on an empty file
        os.replace(partial, path)
    finally:
        with suppress(OSError):  # the first error is the one to tell
            partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, lines ended as in the text; as `replacing`."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
