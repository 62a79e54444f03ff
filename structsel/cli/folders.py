"""Folders of results, written completely or not at all, and by one run only."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from structsel.cli.messages import ProgressBar
from structsel.errors import DataError

log = logging.getLogger(__name__)

_LOCKS: ContextVar[ExitStack] = ContextVar("locks")


@contextmanager
def folder_locks() -> Iterator[None]:
    """Context in which a command may call `lock_folder`; the locks are released at its end."""
    with ExitStack() as locks:
        before = _LOCKS.set(locks)
        try:
            yield
        finally:
            _LOCKS.reset(before)


def lock_folder(folder: Path) -> None:
    """Lock a folder, so that no other run writes to it until the command ends.

    The operating system releases the lock of a run that was killed, so that no lock is ever stale.

    Raises
    ------
    DataError
        Another run has the lock, or the folder cannot be written to.
    """
    _LOCKS.get().enter_context(_locked(folder))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    from filelock import FileLock, Timeout

    path = _sibling(folder, "lock")
    with _created_parents(path.parent, folder), ExitStack() as locks:
        lock = FileLock(path, timeout=0)
        try:
            lock.acquire()
        except Timeout as error:
            raise DataError(
                f"--out '{folder}' is being written to by another run{_lock_owner(path)}. "
                "Wait until it has ended, or choose another folder."
            ) from error
        except OSError as error:
            raise _unwritable(folder, error) from error
        locks.callback(lock.release)
        locks.callback(_remove, path)
        with suppress(OSError):  # only for the message of the next run
            path.write_text(str(os.getpid()), encoding="utf-8")
        yield


def _lock_owner(path: Path) -> str:
    """The process that has a lock, for the message; empty if unknown."""
    with suppress(OSError, UnicodeDecodeError):
        text = path.read_text(encoding="utf-8")
        if text.isdecimal():
            return f", process {text}"
    return ""


def _remove(path: Path) -> None:
    with suppress(OSError):  # some systems keep a file that is open, which does no harm
        path.unlink(missing_ok=True)


@contextmanager
def _created_parents(place: Path, folder: Path) -> Iterator[None]:
    """Create the parents of a folder; those that are empty at the end are removed."""
    made = [p for p in (place, *place.parents) if not p.exists()]
    try:
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(folder, error) from error
        yield
    finally:
        for parent in made:
            with suppress(OSError):  # not empty
                parent.rmdir()


def _sibling(folder: Path, what: str) -> Path:
    """Hidden path on the file system of the folder: in it if it exists, else in its parent."""
    folder = folder.resolve()
    return (folder if folder.is_dir() else folder.parent) / f".{folder.name}.{what}"


def _unwritable(folder: Path, error: OSError) -> DataError:
    return DataError(f"--out '{folder}' cannot be written: {error.strerror or error}.")


def refuse_existing(folder: Path | None, overwrite: bool) -> None:
    """Refuse an output folder that has files or that another run writes to, before any work; else lock it.

    Raises
    ------
    DataError
        The folder has files and `overwrite` is False, it is a file, or it cannot be locked.
    """
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise DataError(f"--out '{folder}' is a file; give a folder.")
    lock_folder(folder)
    own = {_sibling(folder, what).name for what in ("lock", "partial")}
    if not overwrite and folder.exists() and any(p.name not in own for p in folder.iterdir()):
        raise DataError(f"--out '{folder}' is not empty. Choose another folder, or pass --overwrite.")


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Yield an empty temporary folder, whose files move to `folder` when all are written.

    If writing or moving fails or is interrupted, the files that were in `folder` before remain.

    Raises
    ------
    DataError
        The folder cannot be written to.
    """
    partial = _sibling(folder, "partial")
    with _created_parents(partial.parent, folder):
        try:
            shutil.rmtree(partial, ignore_errors=True)  # left by a run that was killed
            partial.mkdir()
            yield partial
            names = ", ".join(p.name for p in sorted(partial.iterdir()))
            if folder.exists():
                _move(partial, folder)
            else:
                os.replace(partial, folder)  # all files at once
            log.info("written '%s': %s", folder, names)
        except OSError as error:
            raise _unwritable(folder, error) from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def names_in(folder: Path) -> list[str]:
    """Names of the files of a folder, and of its folders with a slash, in order."""
    return [p.name + "/" * p.is_dir() for p in sorted(folder.iterdir())]


def save_figures(folder: Path, drawn: Iterable[tuple[str, Any]], suffix: str, count: int | None = None) -> None:
    """Write figures to a new folder, each as ``name.suffix``; `count` is their number for the progress bar."""
    from structsel.plotting import save_figure  # matplotlib takes a while to load

    folder.mkdir()
    with ProgressBar("drawing") as progress:
        for i, (name, figure) in enumerate(drawn, 1):
            save_figure(figure, folder / f"{name}.{suffix}")
            if count:
                progress("plots", i, count)


def _move(partial: Path, folder: Path) -> None:
    """Move files to a folder that exists; if one cannot be moved, restore the files that were there."""
    targets = {p: folder / p.relative_to(partial) for p in sorted(partial.rglob("*")) if p.is_file()}
    kept = {target: partial / f".{i}" for i, target in enumerate(targets.values()) if target.is_file()}
    for target, copy in kept.items():
        shutil.copy2(target, copy)
    begun: list[Path] = []
    try:
        for path, target in targets.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            begun.append(target)
            os.replace(path, target)
    except BaseException:
        for target in begun:
            if target in kept:
                os.replace(kept[target], target)
            elif target.is_file():
                target.unlink()
        raise
