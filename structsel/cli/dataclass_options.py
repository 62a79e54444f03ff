"""The options of a command, generated from the fields of options dataclasses.

A field made by `structsel.options.option` with a help text becomes the option ``--its-name``, in its group. The type of
the field decides how the text is read. Options of the command line only are fields of dataclasses too: a parameter of a
command whose type is a dataclass is replaced by the options that its fields declare.
"""

from __future__ import annotations

import dataclasses
import inspect
import typing
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import wraps
from types import UnionType
from typing import Annotated, Any

import typer

from structsel.cli.messages import say
from structsel.cli.parsing import read_numbers, read_pair, read_pairs, split_names
from structsel.options import choices_of

_PLAIN = (bool, int, float, str)


@dataclasses.dataclass(frozen=True)
class _Reader:
    """Declaration of an option, and the conversion of its text to the value of the field."""

    annotation: Any
    read: Callable[[str, Any], Any]
    show: Callable[[Any], Any] = lambda value: value


def takes_dataclass(
    options_class: type | None = None, *, without: Collection[str] = (), renamed: Mapping[str, str] | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of a dataclass in place of its parameter ``options``.

    A parameter whose type is a dataclass is replaced by the fields of that dataclass. The annotations of their types
    declare the options, as for the other parameters of the command.

    Parameters
    ----------
    options_class : type, optional
        A dataclass whose fields are made by `structsel.options.option`.
    without : collection of str
        Fields that the command sets itself.
    renamed : mapping of str to str, optional
        Old names of fields; their options work for one release, hidden and with a warning.

    Returns
    -------
    callable
        Decorator. The command is called with ``options``, a dict of the fields that the command line has.
    """

    def decorate(run: Callable[..., None]) -> Callable[..., None]:
        kinds = {} if options_class is None else typing.get_type_hints(options_class)
        declared = () if options_class is None else dataclasses.fields(options_class)
        fields = {f.name: f for f in declared if f.metadata.get("help")}
        shown = {name: field for name, field in fields.items() if name not in without}
        readers = {name: _reader_of(kinds[name]) for name in shown}
        old_names = {old: new for old, new in (renamed or {}).items() if new in shown}
        types = typing.get_type_hints(run, include_extras=True)
        grouped: dict[str, Any] = {name: kind for name, kind in types.items() if dataclasses.is_dataclass(kind)}

        @wraps(run)
        def command(**given: Any) -> None:
            for old, new in old_names.items():
                value = given.pop(old.lower())
                if value not in (None, []):
                    say("warning", f"{_option_of(old)} is deprecated: use {_option_of(new)}.")
                    given[new.lower()] = value
            options = {name: reader.read(_option_of(name), given.pop(name.lower())) for name, reader in readers.items()}
            groups = {
                name: kind(**{f.name: given.pop(f.name) for f in dataclasses.fields(kind)})
                for name, kind in grouped.items()
            }
            run(**given, **groups, **({} if options_class is None else {"options": options}))

        generated = [
            _parameter(name, field, readers[name], hidden=False) for name, field in shown.items()
        ] + [_parameter(old, shown[new], readers[new], hidden=True) for old, new in old_names.items()]  # fmt: skip
        parameters: list[inspect.Parameter] = []
        for one in inspect.signature(run).parameters.values():
            if one.name in grouped:
                parameters += _parameters_of(grouped[one.name])
            elif one.name == "options":
                parameters += generated
            else:
                kind = inspect.Parameter.KEYWORD_ONLY
                parameters.append(one.replace(annotation=types[one.name], kind=kind))
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {one.name: one.annotation for one in parameters}
        return command

    return decorate


def _parameters_of(kind: Any) -> list[inspect.Parameter]:
    """Parameters of the command for the fields of a dataclass of the command line."""
    types = typing.get_type_hints(kind, include_extras=True)
    return [
        inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=types[f.name])
        for f in dataclasses.fields(kind)
    ]


def _option_of(name: str) -> str:
    return f"--{name.lower().replace('_', '-')}"


def _parameter(name: str, field: Any, reader: _Reader, *, hidden: bool) -> inspect.Parameter:
    """Parameter of the command for a field; a hidden one, for an old name, has no default of its own."""
    declared = typer.Option(
        _option_of(name),
        help=field.metadata["help"],
        rich_help_panel=field.metadata["group"] or None,
        metavar=field.metadata["metavar"] or None,
        hidden=hidden,
    )
    annotation = reader.annotation
    if hidden and annotation is not bool and typing.get_origin(annotation) not in (UnionType, typing.Union):
        annotation = annotation | None
    default = (False if annotation is bool else None) if hidden else reader.show(field.default)
    return inspect.Parameter(
        name.lower(), inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[annotation, declared]
    )


def _reader_of(kind: Any) -> _Reader:
    """Declaration and conversion for a field of this type.

    Raises
    ------
    TypeError
        The command line cannot give a value of this type.
    """
    parts = _parts_of(kind)
    required = [part for part in parts if part is not type(None)]
    if len(required) == 1 and (required[0] in _PLAIN or choices_of(required[0])):
        return _Reader(kind, lambda _, value: value)
    if any(part in (int, float) for part in required):
        choices = tuple(choice for part in required for choice in choices_of(part))
        number = float if float in required else int
        return _Reader(str, lambda name, text: _number_or(name, text, number, choices), _text_of_number)
    if typing.get_origin(required[0]) is tuple:
        return _Reader(str | None, lambda name, text: None if text is None else read_pair(name, text))
    mapped = [part for part in required if typing.get_origin(part) is Mapping]
    if mapped:
        if typing.get_origin(typing.get_args(mapped[0])[1]) is tuple:
            return _Reader(list[str] | None, lambda name, texts: read_pairs(name, texts or ()), lambda _: None)
        choices = tuple(choice for part in required for choice in choices_of(part))
        if choices:
            return _Reader(str, lambda name, text: text if text in choices else _numbers_or(name, text, choices))
        return _Reader(str, lambda name, text: read_numbers(name, text) or None, lambda _: "")
    if any(typing.get_origin(part) in (Iterable, Sequence) for part in required):
        if bool in required:
            return _Reader(str, lambda _, text: text == "all" or split_names(text), lambda _: "")
        empty: Any = None if type(None) in parts else []
        takes_all = any("all" in choices_of(part) for part in required)
        return _Reader(
            str,
            lambda _, text: "all" if takes_all and text.strip() == "all" else split_names(text) or empty,
            lambda default: default if isinstance(default, str) else "",
        )
    raise TypeError(f"a field of type {kind} cannot be an option of the command line")


def _parts_of(kind: Any) -> tuple[Any, ...]:
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, UnionType) else (kind,)


def _text_of_number(default: Any) -> str:
    return f"{default:g}" if isinstance(default, int | float) else str(default)


def _numbers_or(name: str, text: str, choices: tuple[str, ...]) -> dict[str, float]:
    try:
        found = read_numbers(name, text)
    except typer.BadParameter:
        found = {}
    if not found:
        raise typer.BadParameter(
            f"{name} '{text}' is neither {' nor '.join(choices)} nor NAME=NUMBER,... as alpha=0.12."
        )
    return found


def _number_or(name: str, text: str, number: type, choices: tuple[str, ...]) -> Any:
    if text in choices:
        return text
    try:
        return number(text)
    except ValueError:
        raise typer.BadParameter(f"{name} '{text}' is neither a number nor one of {', '.join(choices)}.") from None
