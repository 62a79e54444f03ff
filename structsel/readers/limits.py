"""An end to readings that would go on for ever, or fill the memory, because a file is damaged."""

from __future__ import annotations

import contextlib
import ctypes
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from structsel.errors import DataError

SECONDS, SECONDS_PER_MIB = 20.0, 4.0
"""Processor time that a file may take."""
MEMORY, GROWTH = 3 << 30, 40
"""Bytes of memory that a file may take: so many, and so many times its size besides."""
_PERIOD = 0.2  # s between two looks
_AGAIN = 0.5  # s until a reader that caught the exception gets another

_Read = TypeVar("_Read")


class _TooMuchError(BaseException):
    """Raised within the reader's own loop, past every ``except Exception`` of it."""


def within_limits(path: Path, read: Callable[[], _Read]) -> _Read:
    """Read a file, unless that takes far more time or memory than its size explains.

    Another thread looks on, and raises an exception in this one, which ends any loop of Python; compiled code is not
    reached (see `structsel.readers.isolated`).

    Parameters
    ----------
    path : Path
    read : callable
        Returns what is read.

    Raises
    ------
    DataError
        It took too much; the message says of what.
    """
    size = path.stat().st_size
    seconds, memory = SECONDS + SECONDS_PER_MIB * size / 2**20, MEMORY + GROWTH * size
    reader, over, lock = threading.get_ident(), threading.Event(), threading.Lock()
    start, before = time.process_time(), _peak()
    why: list[str] = []

    def look_on() -> None:
        while not over.wait(_AGAIN if why else _PERIOD):
            if time.process_time() - start > seconds:
                why.append(f"is not read after {seconds:.0f} s")
            elif _peak() - before > memory:
                why.append(f"takes more than {memory / 2**30:.1f} GiB of memory")
            else:
                continue
            with lock:
                if not over.is_set():
                    _raise_in(reader, _TooMuchError)

    watcher = threading.Thread(target=look_on, daemon=True)
    watcher.start()
    try:
        try:
            found = read()
        finally:
            with lock:
                over.set()
                _raise_in(reader, None)  # what was raised and has not arrived is called back
    except _TooMuchError:
        over.set()
    if why:  # also of a reader that caught the exception: what it returns is not the whole
        raise DataError(
            f"'{path}', of {size} bytes, {why[0]}: it is damaged, or made to do harm.\nWrite or fetch it again."
        )
    return found


def _raise_in(thread: int, error: type[BaseException] | None) -> None:
    held = ctypes.py_object(error) if error is not None else None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), held)


def _peak() -> int:
    """Most memory this process has had, in bytes; 0 on systems that do not say."""
    with contextlib.suppress(ImportError):
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return 0
