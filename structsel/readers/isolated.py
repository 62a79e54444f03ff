"""A first reading of files in a separate process.

Compiled readers (SciPy's of MATLAB files, HDF5) trust what they read: a damaged file can crash them, keep them busy for
ever or fill the memory, and no Python code could stop that. So another process reads such a file first, within limits;
one process serves for all files of a run, and what it survives is then read here.
"""

from __future__ import annotations

import atexit
import json
import logging
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Literal

from structsel.errors import DataError

log = logging.getLogger(__name__)

SECONDS, SECONDS_PER_MIB = 10.0, 2.0
"""Processor time that a file may take."""
MEMORY, GROWTH = 2 << 30, 40
"""Bytes of memory that a file may take: so many, and so many times its size besides."""

_READY = "ready"
_KINDS = {"mat": "MATLAB", "h5": "HDF5"}

_lock = threading.Lock()
_running: tuple[int, subprocess.Popen[str]] | None = None  # who started it, and the process


def read_apart_first(path: Path, kind: Literal["mat", "h5"]) -> None:
    """Let another process read a file first, and refuse what it does not read to its end.

    Raises
    ------
    DataError
        The file crashes its reader, keeps it busy, takes too much memory, or is none of its kind.
    """
    size = path.stat().st_size
    seconds, memory = SECONDS + SECONDS_PER_MIB * size / 2**20, MEMORY + GROWTH * size
    with _lock:
        process = _start()
        if process is None:
            return
        told, ended = _ask(process, json.dumps([kind, str(path.resolve()), seconds, memory]))
    if told == "read":
        return
    if told == "memory":
        raise DataError(
            f"'{path}' would take more than {memory / 2**30:.1f} GiB of memory, for a file of {size} bytes: it is "
            "damaged, or made to do harm.\nWrite it again."
        )
    if ended:
        busy = ended == -getattr(signal, "SIGXCPU", 0)
        why = f"keeps its reader busy for more than {seconds:.0f} s" if busy else "makes its reader crash"
        raise DataError(f"'{path}' {why}: it is damaged.\nWrite it again.")
    # Not tried again here: what has only raised an error there may do worse the next time.
    raise DataError(f"'{path}' is no {_KINDS[kind]} file that can be read: {told}")


def _start() -> subprocess.Popen[str] | None:
    """The process, started if there is none of our own; None where none can be."""
    global _running
    if _running is not None and _running[0] == os.getpid() and _running[1].poll() is None:
        return _running[1]
    try:
        process = subprocess.Popen(
            # Not from this folder (-P), whose modules have the names of others.
            [sys.executable, "-P", str(Path(__file__).with_name("isolated_worker.py"))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
        )  # fmt: skip
        told, ended = _listen(process)
        if told != _READY:
            raise OSError(f"it ended with {ended}")
    except OSError as error:
        log.info("files are read without a separate process: %s", error)
        return None
    _running = os.getpid(), process
    return process


def _ask(process: subprocess.Popen[str], question: str) -> tuple[str, int]:
    """What the process says, and its exit code if it did not live to say it."""
    assert process.stdin is not None
    try:
        process.stdin.write(question + "\n")
        process.stdin.flush()
        return _listen(process)
    except BaseException:  # Ctrl-C: its answer would be taken for that to the next question
        process.kill()
        _end(process)
        raise


def _listen(process: subprocess.Popen[str]) -> tuple[str, int]:
    assert process.stdout is not None
    told = process.stdout.readline().strip()
    if told:
        return told, 0
    _end(process)
    return "", process.returncode


def _end(process: subprocess.Popen[str]) -> None:
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
    process.wait()


@atexit.register
def _stop() -> None:
    if _running is not None and _running[0] == os.getpid():
        _end(_running[1])
