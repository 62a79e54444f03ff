"""Compiled kernels whose compiler is imported at the first call.

Numba takes longer to import than the rest of a command that does not compute. `njit` here is `numba.njit` for functions
of a module: until one of them is called, each is an ordinary function that waits. The first call imports numba and
replaces all of them, wherever a module of the package holds one, by numba's own, so that kernels find each other.
"""

from __future__ import annotations

import functools
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

_WAITING: dict[Callable[..., Any], dict[str, Any]] = {}  # kernels that are not numba's yet, and their options
_replaced: dict[Callable[..., Any], Any] = {}  # numba's kernels by those that waited
_LOCK = threading.RLock()
_numba: Any = None


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Return `numba.njit` of a function of a module, which imports numba when it is first called.

    Parameters
    ----------
    function : callable
        A kernel. Without one, a decorator with these options is returned.
    **options
        Those of `numba.njit`.
    """
    if function is None:
        return functools.partial(njit, **options)
    if _numba is not None:
        return _numba.njit(**options)(function)

    @functools.wraps(function)
    def kernel(*args: Any, **named: Any) -> Any:
        if kernel not in _replaced:
            load_compiler()
        return _replaced[kernel](*args, **named)

    _WAITING[kernel] = options
    return kernel


def load_compiler() -> None:
    """Import numba, and give it the kernels that wait."""
    global _numba
    with _LOCK:
        if _numba is None:
            import numba

            _compile_what_cannot_be_read()
            _numba = numba
        while _WAITING:
            kernel, options = next(iter(_WAITING.items()))
            _replaced[kernel] = _numba.njit(**options)(kernel.__wrapped__)  # type: ignore[attr-defined]
            del _WAITING[kernel]
        package = __name__.partition(".")[0]
        own = [vars(module) for name, module in list(sys.modules.items()) if name.partition(".")[0] == package]
        for names in (*own, *(kernel.__wrapped__.__globals__ for kernel in _replaced)):  # type: ignore[attr-defined]
            _replace_kernels(names)


def _compile_what_cannot_be_read() -> None:
    """Ignore a cache of numba that names types of an earlier version, which have moved or are gone."""
    from numba.core.caching import IndexDataCacheFile

    read = IndexDataCacheFile._load_index

    def read_or_ignore(self: Any) -> Any:
        try:
            return read(self)
        except (AttributeError, ImportError):
            return {}

    IndexDataCacheFile._load_index = read_or_ignore  # type: ignore[method-assign]


def _replace_kernels(names: dict[str, Any]) -> None:
    for name, value in list(names.items()):
        if isinstance(value, FunctionType) and value in _replaced:
            names[name] = _replaced[value]


@contextmanager
def compilation(tell: Callable[[bool], None]) -> Iterator[None]:
    """Context in which `tell` is called with True when numba begins to compile, and with False when it has ended.

    A kernel that is read from numba's cache is not compiled.
    """
    load_compiler()
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            tell(True)

        def on_end(self, event: Any) -> None:
            tell(False)

    with event.install_listener("numba:compile", Listener()):
        yield
