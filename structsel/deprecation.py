"""Old public names that still work for one release, with a warning that states the new name.

Four cases: a keyword argument, an attribute or method of a class, a name in a module, a value of an option::

    @renamed_arguments(pool="candidates")
    def select(recordings, response, candidates): ...

    @dataclass(frozen=True)
    class Selection:
        standard_errors: Array
        std_errors = renamed_attribute("standard_errors")

    __getattr__ = renamed_names(__name__, {"ready": "builtin_aircraft", "Flight": "structsel.simulation:Motion"})

    residuals = renamed_value("residuals", residuals, {"colour": "coloured"})
"""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from types import FrameType
from typing import Any, TypeVar

_Decorated = TypeVar("_Decorated", bound=Callable[..., Any])


def renamed_arguments(**new_names: str) -> Callable[[_Decorated], _Decorated]:
    """Decorate a function, or a class, whose keyword arguments have new names.

    Parameters
    ----------
    **new_names : str
        ``old="new"`` for each argument. The decorated function declares the new names only.

    Returns
    -------
    callable
        Decorator. A call with an old name warns (`DeprecationWarning`) and passes the value under the new name; a call
        with both raises `TypeError`.
    """

    def decorate(decorated: _Decorated) -> _Decorated:
        if isinstance(decorated, type):
            decorated.__init__ = _translating(decorated.__init__, decorated.__name__, new_names)  # type: ignore[misc]
            return decorated
        return _translating(decorated, decorated.__name__, new_names)

    return decorate


def _translating(function: Any, name: str, new_names: Mapping[str, str]) -> Any:
    @functools.wraps(function)
    def translating(*args: Any, **keywords: Any) -> Any:
        for old in new_names.keys() & keywords.keys():
            new = new_names[old]
            if new in keywords:
                raise TypeError(f"{name}() got {new!r} twice: {old!r} is its old name.")
            warn_deprecated(f"argument {old!r} of {name}()", new)
            keywords[new] = keywords.pop(old)
        return function(*args, **keywords)

    return translating


class renamed_attribute:
    """Descriptor for an attribute, property or method that has a new name.

    Parameters
    ----------
    new : str
        Name of the attribute that holds the value now.
    """

    def __init__(self, new: str):
        self._new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self._old = name

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        warn_deprecated(f"{owner.__name__}.{self._old}", self._new)
        return getattr(instance, self._new)


def renamed_names(module: str, new_names: Mapping[str, str]) -> Callable[[str], Any]:
    """Make a module's ``__getattr__`` that finds what was renamed or moved.

    Parameters
    ----------
    module : str
        The module's ``__name__``.
    new_names : mapping of str to str
        Old name to the new name in this module, or to ``"package.module:name"`` for what moved to another one.

    Returns
    -------
    callable
        To be assigned to ``__getattr__`` in the module.
    """

    def getattr_(name: str) -> Any:
        if name not in new_names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}", name=name)
        place, _, new = new_names[name].rpartition(":")
        warn_deprecated(f"{module}.{name}", f"{place}.{new}" if place else new)
        return getattr(import_module(place or module), new)

    return getattr_


def renamed_value(option: str, value: Any, new_values: Mapping[str, str]) -> Any:
    """Value of an option under its new name, with a warning where the old name was given.

    Parameters
    ----------
    option : str
        Name of the option, for the warning.
    value : object
        Anything that is not an old name is returned as it is.
    new_values : mapping of str to str
        Old value to new value.
    """
    if not isinstance(value, str) or value not in new_values:
        return value
    warn_deprecated(
        f"{option}={value!r}", f"{option}={new_values[value]!r}", levels=4
    )  # one more: the function with the option
    return new_values[value]


def warn_deprecated(old: str, new: str, levels: int = 3) -> None:
    """Warn at the user's line that `old` is replaced by `new`."""
    # Levels up to the user's line: this function, the one above that translates the name, the user's; further up
    # where the caller is a function of this package.
    frame: FrameType | None = sys._getframe(levels - 1)
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "structsel":
        frame, levels = frame.f_back, levels + 1
    message = f"{old} is deprecated: use {new} instead. The next release removes the old name."
    warnings.warn(message, DeprecationWarning, stacklevel=levels)
