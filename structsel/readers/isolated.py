"""Reading of files in a separate process with limits on time and memory.

The readers of MATLAB, HDF5, ULog, DataFlash and MDF files belong to other packages. A damaged file can crash them, keep
them busy without end, or fill the memory. They run in a second process, which the operating system limits, and which
passes the content of the file on. One process serves for all files of a run.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.readers.isolated_worker import answer, receive, send

log = logging.getLogger(__name__)

SECONDS, SECONDS_PER_MIB = 20.0, 4.0
"""Processor time for a file; twenty times that of an intact ULog, the slowest format."""
MEMORY, GROWTH = 3 << 30, 40
"""Bytes of memory for a file: a constant, and a multiple of its size."""
_WALL = 5.0  # wall time over processor time after which the process is killed, where the system has no limits

FORMATS = {
    "mat": ("MATLAB file", "Write it again."),
    "h5": ("HDF5 file", "Write it again."),
    "ulg": ("ULog", "Fetch it from the vehicle again."),
    "bin": ("DataFlash log", "Fetch it from the vehicle again."),
    "mdf": ("MDF file", "Write it again."),
}
"""Name of each format, and the remedy for a damaged file."""
WORKER = Path(__file__).with_name("isolated_worker.py")

_Process = subprocess.Popen[bytes]
_lock = threading.Lock()
_running: tuple[int, _Process] | None = None  # the id of the process that started it, and the process


def read_isolated(path: Path, kind: str) -> Any:
    """Content of a file, read in a separate process; what it is depends on the format (`isolated_worker`).

    Raises
    ------
    DataError
        The file crashes its reader, exceeds the limits, or is not of its format.
    """
    size = path.stat().st_size
    seconds, memory = SECONDS + SECONDS_PER_MIB * size / 2**20, MEMORY + GROWTH * size
    start = time.monotonic()
    with _lock:
        process = _start()
        if process is None:
            status, content, ended = *_read_here(kind, path), 0
        else:
            status, content, ended = _ask(process, (kind, str(path.resolve()), seconds, memory), _WALL * seconds)
    if status == "read":
        return content
    name, remedy = FORMATS[kind]
    if status == "memory":
        raise DataError(
            f"'{path}' would take more than {memory / 2**30:.1f} GiB of memory, for a file of {size} bytes: it is "
            f"damaged, or made to do harm.\n{remedy}"
        )
    if status == "error":
        raise DataError(f"'{path}' is no {name} that can be read: {content}\n{remedy}")
    busy = ended == -getattr(signal, "SIGXCPU", 0) or time.monotonic() - start > _WALL * seconds
    why = f"keeps its reader busy for more than {seconds:.0f} s" if busy else "makes its reader crash"
    raise DataError(f"'{path}' {why}: it is damaged.\n{remedy}")


def _read_here(kind: str, path: Path) -> tuple[str, Any]:
    """Status and content without a separate process and without limits."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return answer(kind, str(path))


def _start() -> _Process | None:
    """The process, started if there is none of this process; None if none can be started."""
    global _running
    if _running is not None and _running[0] == os.getpid() and _running[1].poll() is None:
        return _running[1]
    try:
        process = subprocess.Popen(
            # -P: not from this folder, whose modules have the names of others.
            [sys.executable, "-P", str(WORKER)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        if _listen(process) != "ready":
            raise OSError(f"it ended with {process.returncode}")
    except OSError as error:
        log.info("files are read without a separate process: %s", error)
        return None
    _running = os.getpid(), process
    return process


def _ask(process: _Process, request: tuple[Any, ...], wall: float) -> tuple[str, Any, int]:
    """Status and content, or an empty status and the exit code of a process that ended."""
    assert process.stdin is not None
    timer = threading.Timer(wall, process.kill)
    timer.daemon = True
    timer.start()
    try:
        send(process.stdin, request)
        answered = _listen(process)
    except BrokenPipeError:
        _end(process)
        answered = None
    except BaseException:  # Ctrl-C: this answer would be taken for that to the next request
        process.kill()
        _end(process)
        raise
    finally:
        timer.cancel()
    return ("", None, process.returncode) if answered is None else (*answered, 0)


def _listen(process: _Process) -> Any:
    """An answer of the process; None if it ended before."""
    assert process.stdout is not None
    try:
        return receive(process.stdout)
    except (EOFError, ValueError):
        _end(process)
        return None


def _end(process: _Process) -> None:
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
    process.wait()


@atexit.register
def _stop() -> None:
    if _running is not None and _running[0] == os.getpid():
        _end(_running[1])
