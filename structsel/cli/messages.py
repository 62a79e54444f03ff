"""What is said besides the result: errors, warnings, notes and progress, all on stderr."""

from __future__ import annotations

import json
import logging
import math
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from structsel.cli.input_files import provenance

PATIENCE = 2.0
"""Seconds of work before a progress bar is shown."""

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}

log = logging.getLogger("structsel")


@dataclass(frozen=True)
class _Manner:
    quiet: bool = False
    verbose: bool = False
    silent: bool = False


_USUAL = _Manner()
_MANNER: ContextVar[_Manner] = ContextVar("manner", default=_USUAL)


@contextmanager
def speaking(quiet: bool, verbose: bool, *, written: bool) -> Iterator[None]:
    """Within, so much is said.

    Parameters
    ----------
    quiet : bool
        No progress and no notes; of a result that is also `written` nothing, else no explanations.
    verbose : bool
        What the loggers of structsel say goes to stderr, with the time of day.
    written : bool
    """
    before = _MANNER.set(_Manner(quiet, verbose, silent=quiet and written))
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
        _MANNER.reset(before)


def quiet() -> bool:
    """Whether explanations are to be left out."""
    return _MANNER.get().quiet


@contextmanager
def timed(what: str) -> Iterator[None]:
    """Log the beginning and the end of a piece of work."""
    start = time.perf_counter()
    log.info("%s", what)
    try:
        yield
    except BaseException:
        log.info("%s: stopped after %.2f s", what, time.perf_counter() - start)
        raise
    log.info("%s: done in %.2f s", what, time.perf_counter() - start)


def stdout() -> Console:
    """Console of results; as wide as the terminal or COLUMNS say, 80 otherwise."""
    return Console(highlight=False, quiet=_MANNER.get().silent)


def explain(console: Console, text: str) -> None:
    """Print what the tables above mean, unless little is to be said."""
    if not quiet():
        console.print(text, style="dim")
        console.print()


def say(kind: str, message: str) -> None:
    """Print an error, warning or note on stderr."""
    if kind == "note" and quiet():
        return
    text = Text.assemble((f"{kind}: ", _STYLES[kind]), message)
    Console(stderr=True, highlight=False).print(text, soft_wrap=True)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Within, a warning is one line on stderr, each said once, without the place in the code."""
    said: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        if str(message) not in said:
            said.add(str(message))
            say("warning", str(message))

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


class Waiting:
    """A progress bar on stderr, if that is a terminal and the work takes a while; a line per stage if that is wanted.

    Called as the library calls its ``progress``: with a stage's name, steps done and steps in all.
    """

    def __init__(self, what: str):
        self._what, self._lock = what, threading.Lock()
        self._bar: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._timer: threading.Timer | None = None
        self._timed = timed(what)

    def __enter__(self) -> Waiting:
        self._timed.__enter__()
        manner = _MANNER.get()
        if Console(stderr=True).is_terminal and not manner.quiet and not manner.verbose:
            self._timer = threading.Timer(PATIENCE, self._show)
            self._timer.daemon = True
            self._timer.start()
        return self

    def _show(self) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with self._lock:
            if self._timer is None:
                return
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._tasks[self._what] = self._bar.add_task(self._what, total=None)
            self._bar.start()

    def __call__(self, stage: str, done: int, of: int) -> None:
        """Show that a stage has come so far."""
        if done >= of:
            log.info("%s: %s, %d of %d", self._what, stage, done, of)
        with self._lock:
            if self._bar is None:
                return
            name = f"{self._what}: {stage}"
            if name not in self._tasks:
                self._tasks[name] = self._bar.add_task(name, total=of)
            self._bar.update(self._tasks[name], completed=done, total=of)
            if done >= of:
                self._bar.remove_task(self._tasks.pop(name))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            self._timer = None
            if self._bar is not None:
                self._bar.stop()
        self._timed.__exit__(kind, error, trace)


def print_json(content: Any) -> None:
    """Write JSON, and nothing else, to stdout; what is not a finite number becomes null."""
    sys.stdout.write(json_text(content))


def json_text(content: Any) -> str:
    """Return a result as JSON, with where it came from; null for what is not a finite number."""
    if isinstance(content, dict) and "schema" in content:
        content = {**content, "provenance": provenance()}
    return json.dumps(_plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
