"""Folders of results, written whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from structsel.errors import DataError


def refuse_existing(folder: Path | None, overwrite: bool) -> None:
    """Refuse, before any work, to write where something stands already.

    Raises
    ------
    DataError
        The folder holds files and `overwrite` is False, or it is a file.
    """
    if folder is None or not folder.exists():
        return
    if not folder.is_dir():
        raise DataError(f"--out '{folder}' is a file; give a folder.")
    if not overwrite and any(folder.iterdir()):
        raise DataError(f"--out '{folder}' holds files already. Choose another folder, or pass --overwrite.")


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Yield a folder beside the one wanted; its files move there when all are written.

    Raises
    ------
    DataError
        The folder cannot be written to.
    """
    partial = folder.with_name(f".{folder.name}.{os.getpid()}.partial")
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    done = False
    try:
        partial.mkdir(parents=True)
        yield partial
        if not folder.exists() or not any(folder.iterdir()):
            os.replace(partial, folder)  # all files at once
            done = True
            return
        for path in sorted(p for p in partial.rglob("*") if p.is_file()):
            target = folder / path.relative_to(partial)
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, target)
        done = True
    except OSError as error:
        raise DataError(f"--out '{folder}' cannot be written: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if not done:
            for parent in made:
                if parent.is_dir() and not any(parent.iterdir()):
                    parent.rmdir()
