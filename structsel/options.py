"""Options of a function as one frozen dataclass, from which the command line's options are generated.

A field made by `option` carries in its metadata

- ``help``: one line for the terminal,
- ``group``: heading under which the terminal shows it,
- ``metavar``: placeholder of its value there, such as ``NAME=LOW,HIGH``.

A field without help text is set from Python only. Allowed values are those of the field's Literal type.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import typing
from collections.abc import Callable
from types import UnionType
from typing import Any, TypeVar

from structsel.errors import ModelError
from structsel.nomenclature import suggest

_Result = TypeVar("_Result")


def option(default: Any = dataclasses.MISSING, *, help: str = "", group: str = "", metavar: str = "") -> Any:
    """Field of an options dataclass, with its help text for the command line."""
    return dataclasses.field(default=default, metadata={"help": help, "group": group, "metavar": metavar})


def takes_options(options_class: type) -> Callable[[Callable[..., _Result]], Callable[..., _Result]]:
    """Let a function with a parameter ``options`` take the fields of a dataclass as keywords too.

    The function is called with complete options. Keywords replace the fields of `options`, if both are given. The
    signature that `help` shows has one keyword for each field.
    """

    def decorate(verb: Callable[..., _Result]) -> Callable[..., _Result]:
        fields = {f.name: f for f in dataclasses.fields(options_class)}
        signature = inspect.signature(verb)
        own = [name for name in signature.parameters if name != "options"]

        @functools.wraps(verb)
        def call(*args: Any, options: Any = None, **keywords: Any) -> _Result:
            changes = {name: keywords.pop(name) for name in list(keywords) if name in fields}
            if unknown := [name for name in keywords if name not in own]:
                near = suggest(unknown[0], [*fields, *own])
                raise TypeError(f"{verb.__name__}() got an unexpected keyword argument '{unknown[0]}'.{near}")
            chosen = options_class(**changes) if options is None else dataclasses.replace(options, **changes)
            check_choices(chosen, verb.__name__)
            return verb(*args, options=chosen, **keywords)

        flat = [
            inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, annotation=f.type,
                              default=inspect.Parameter.empty if f.default is dataclasses.MISSING else f.default)
            for f in fields.values()
        ]  # fmt: skip
        given = list(signature.parameters.values())
        ordered = sorted([*given, *flat], key=lambda p: p.kind)  # stable, in the order that Python requires
        call.__signature__ = signature.replace(parameters=ordered)  # type: ignore[attr-defined]
        return call

    return decorate


def check_choices(options: Any, verb: str) -> None:
    """Refuse a value that the Literal type of its field does not allow.

    Raises
    ------
    ModelError
        The message names the option and the allowed values.
    """
    types = typing.get_type_hints(type(options))
    for field in dataclasses.fields(options):
        value, choices = getattr(options, field.name), choices_of(types[field.name])
        if choices and isinstance(value, str) and value not in choices:
            raise ModelError(
                f"{verb} was given {field.name}={value!r}; it is {' or '.join(repr(c) for c in choices)}."
                f"{suggest(value, choices)}"
            )


def choices_of(annotation: Any) -> tuple[str, ...]:
    """Strings that a Literal type allows, with or without None; empty if other values are possible too."""
    origin = typing.get_origin(annotation)
    if origin is typing.Literal:
        return typing.get_args(annotation)
    if origin in (typing.Union, UnionType):
        parts = [part for part in typing.get_args(annotation) if part is not type(None)]
        return choices_of(parts[0]) if len(parts) == 1 else ()
    return ()
