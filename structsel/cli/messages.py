"""Errors, warnings, notes and progress on stderr, and JSON on stdout."""

from __future__ import annotations

import json
import logging
import re
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from structsel.cli.input_files import provenance
from structsel.formatting import finite_or_none, printable
from structsel.numerics.compiling import compilation

PROGRESS_DELAY = 2.0
"""Seconds of work before a progress bar is shown."""
COMPILING = "compiling numerical code, once on this computer, up to half a minute"
"""Shown while numba compiles; it keeps the result in its cache."""

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}

log = logging.getLogger("structsel")


@dataclass(frozen=True)
class _Verbosity:
    quiet: bool = False
    verbose: bool = False
    silent: bool = False


_NORMAL = _Verbosity()
_VERBOSITY: ContextVar[_Verbosity] = ContextVar("verbosity", default=_NORMAL)


@contextmanager
def set_verbosity(quiet: bool, verbose: bool, *, written: bool) -> Iterator[None]:
    """Context that sets how much is printed.

    Parameters
    ----------
    quiet : bool
        No progress, notes or explanations; no result if it is also `written` to files.
    verbose : bool
        The log of structsel is printed on stderr, with the time of day.
    written : bool
    """
    before = _VERBOSITY.set(_Verbosity(quiet, verbose, silent=quiet and written))
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s.%(msecs)03d %(message)s", "%H:%M:%S"))
    level = log.level
    if verbose:
        log.addHandler(handler)
        log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        _VERBOSITY.reset(before)


def is_quiet() -> bool:
    """Whether explanations are left out."""
    return _VERBOSITY.get().quiet


@contextmanager
def log_duration(what: str) -> Iterator[None]:
    """Log the begin, the end and the duration of a step."""
    start = time.perf_counter()
    log.info("%s", what)
    try:
        yield
    except BaseException:
        log.info("%s: stopped after %.2f s", what, time.perf_counter() - start)
        raise
    log.info("%s: done in %.2f s", what, time.perf_counter() - start)


def stdout() -> Console:
    """Console of results, of the width of the terminal or of COLUMNS, else 80."""
    return Console(highlight=False, quiet=_VERBOSITY.get().silent)


def explain(console: Console, text: str) -> None:
    """Print the meaning of the columns above, unless --quiet is given."""
    if not is_quiet():
        console.print(text, style="dim")
        console.print()


def say(kind: str, message: str) -> None:
    """Print an error, warning or note on stderr."""
    if kind == "note" and is_quiet():
        return
    text = Text.assemble((f"{kind}: ", _STYLES[kind]), printable(message))
    Console(stderr=True, highlight=False).print(text, soft_wrap=True)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Context in which each warning is printed once, as one line on stderr without its place in the code."""
    printed: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        if str(message) not in printed:
            printed.add(str(message))
            say("warning", str(message))

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


class ProgressBar:
    """Progress bar on a terminal, for work that takes more than PROGRESS_DELAY; a log line for each stage.

    An instance is a ``progress`` of the library: it is called with a stage, its finished steps and all its steps.
    """

    def __init__(self, task: str):
        self._task, self._lock = task, threading.Lock()
        self._bar: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._timer: threading.Timer | None = None
        self._timed = log_duration(task)
        self._compiling = 0  # kernels that are being compiled; one may wait for others that it calls
        self._listening = ExitStack()

    def __enter__(self) -> ProgressBar:
        self._timed.__enter__()
        verbosity = _VERBOSITY.get()
        if Console(stderr=True).is_terminal and not verbosity.quiet and not verbosity.verbose:
            self._timer = threading.Timer(PROGRESS_DELAY, self._show)
            self._timer.daemon = True
            self._timer.start()
            self._listening.enter_context(compilation(self._note_compilation))
        return self

    def _show(self) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with self._lock:
            if self._timer is None:
                return
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._tasks[self._task] = self._bar.add_task(self._task, total=None)
            self._show_compilation()
            self._bar.start()

    def _note_compilation(self, begun: bool) -> None:
        """Count the kernels that are being compiled."""
        with self._lock:
            self._compiling += 1 if begun else -1
            self._show_compilation()

    def _show_compilation(self) -> None:
        if self._bar is None or bool(self._compiling) == (COMPILING in self._tasks):
            return
        if self._compiling:
            self._tasks[COMPILING] = self._bar.add_task(COMPILING, total=None)
        else:
            self._bar.remove_task(self._tasks.pop(COMPILING))

    def __call__(self, stage: str, done: int, of: int) -> None:
        """Show the finished steps of a stage."""
        if done >= of:
            log.info("%s: %s, %d of %d", self._task, stage, done, of)
        with self._lock:
            if self._bar is None:
                return
            name = f"{self._task}: {stage}"
            if name not in self._tasks:
                self._tasks[name] = self._bar.add_task(name, total=of)
            self._bar.update(self._tasks[name], completed=done, total=of)
            if done >= of:
                self._bar.remove_task(self._tasks.pop(name))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._listening.close()
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._timer = None
            if self._bar is not None:
                self._bar.stop()
        self._timed.__exit__(kind, error, trace)


def print_json(content: Any) -> None:
    """Write JSON, and nothing else, to stdout; numbers that are not finite become null."""
    sys.stdout.write(json_text(content))


def by_method(results: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """JSON content of one method's result, or of the results of several methods by name."""
    if len(results) == 1:
        return next(iter(results.values()))
    return {"schema": "structsel.comparison/1", "methods": results}


def json_text(content: Any) -> str:
    """Return a result as JSON with its provenance; numbers that are not finite become null."""
    if isinstance(content, dict) and "schema" in content:
        content = {**content, "provenance": provenance()}
    text = json.dumps(finite_or_none(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    # JSON itself escapes the control characters below 32 only; a terminal obeys these too.
    return re.sub("[\x7f-\x9f]", lambda found: f"\\u{ord(found[0]):04x}", text)
