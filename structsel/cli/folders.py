"""Folders of results, written whole or not at all, and by one run at a time."""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from filelock import FileLock, Timeout

from structsel.errors import DataError

log = logging.getLogger(__name__)

_CLAIMS: ContextVar[ExitStack] = ContextVar("claims")


@contextmanager
def claims() -> Iterator[None]:
    """Within, a command may `claim` folders; at its end they are given back."""
    with ExitStack() as held:
        before = _CLAIMS.set(held)
        try:
            yield
        finally:
            _CLAIMS.reset(before)


def claim(folder: Path) -> None:
    """Keep other runs from writing to a folder until the command ends.

    The operating system gives up the lock of a run that was killed, so that none is ever stale.

    Raises
    ------
    DataError
        Another run writes there, or nothing can be written there.
    """
    _CLAIMS.get().enter_context(_locked(folder))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    path = _hidden(folder, "lock")
    with _made(path.parent, folder), ExitStack() as held:
        lock = FileLock(path, timeout=0)
        try:
            lock.acquire()
        except Timeout as error:
            raise DataError(
                f"--out '{folder}' is being written to by another run{_told(path)}. "
                "Wait until it has ended, or choose another folder."
            ) from error
        except OSError as error:
            raise _unwritable(folder, error) from error
        held.callback(lock.release)
        held.callback(_remove, path)
        with suppress(OSError):  # only a help to whoever comes next
            path.write_text(str(os.getpid()), encoding="utf-8")
        yield


def _told(path: Path) -> str:
    """Which process holds a lock, as far as it says so."""
    with suppress(OSError, UnicodeDecodeError):
        said = path.read_text(encoding="utf-8")
        if said.isdecimal():
            return f", process {said}"
    return ""


def _remove(path: Path) -> None:
    with suppress(OSError):  # some systems keep a file that is open; it is no harm
        path.unlink(missing_ok=True)


@contextmanager
def _made(place: Path, folder: Path) -> Iterator[None]:
    """Make the folders above the one wanted; those still empty at the end go again."""
    made = [p for p in (place, *place.parents) if not p.exists()]
    try:
        try:
            place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(folder, error) from error
        yield
    finally:
        for parent in made:
            with suppress(OSError):  # what holds something stays
                parent.rmdir()


def _hidden(folder: Path, what: str) -> Path:
    """A name on the folder's own file system: within it if it is there, else beside it."""
    folder = folder.resolve()
    return (folder if folder.is_dir() else folder.parent) / f".{folder.name}.{what}"


def _unwritable(folder: Path, error: OSError) -> DataError:
    return DataError(f"--out '{folder}' cannot be written: {error.strerror or error}.")


def refuse_existing(folder: Path | None, overwrite: bool) -> None:
    """Refuse, before any work, to write where something stands already or another run writes; else `claim` it.

    Raises
    ------
    DataError
        The folder holds files and `overwrite` is False, it is a file, or it cannot be claimed.
    """
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise DataError(f"--out '{folder}' is a file; give a folder.")
    claim(folder)
    own = {_hidden(folder, what).name for what in ("lock", "partial")}
    if not overwrite and folder.exists() and any(p.name not in own for p in folder.iterdir()):
        raise DataError(f"--out '{folder}' holds files already. Choose another folder, or pass --overwrite.")


@contextmanager
def output_folder(folder: Path) -> Iterator[Path]:
    """Yield an empty folder; its files move to the one wanted when all are written.

    Whatever stops the writing or the moving, Ctrl-C too, leaves the files that stood there.

    Raises
    ------
    DataError
        The folder cannot be written to.
    """
    partial = _hidden(folder, "partial")
    with _made(partial.parent, folder):
        try:
            shutil.rmtree(partial, ignore_errors=True)  # of a run that was killed
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


def _move(partial: Path, folder: Path) -> None:
    """Move files to a folder that is there; where one cannot be moved, put back what it held."""
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
