"""structsel.toml: defaults of the options of the command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.nomenclature import suggest
from structsel.readers.toml import load_toml

DEFAULTS = Path("structsel.toml")
"""File in the working folder that is read if ``--config`` is not given."""

_NEVER = ("config", "help")


def load_defaults(path: Path, commands: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the options of each command that a file states, by the names of their parameters.

    A key outside a table applies to every command that has such an option; a table ``[select]`` applies to one command.
    Keys are options without their dashes.

    Parameters
    ----------
    path : Path
    commands : mapping of command to click.Command
        All commands.

    Raises
    ------
    DataError
        The file cannot be read, names an unknown command or option, or gives an option a value of a wrong type. The
        message suggests the nearest name.
    """
    content = load_toml(path, "file of defaults", DataError)
    options = {name: _options(command) for name, command in commands.items()}
    every = {option for known in options.values() for option in known}
    found: dict[str, dict[str, Any]] = {name: {} for name in commands}
    for key, value in content.items():
        if isinstance(value, dict):
            if key not in options:
                raise DataError(f"'{path}': there is no command '{key}' for [{key}].{suggest(key, options)}")
        elif key not in every:
            raise DataError(f"'{path}': no command has an option '{key}'.{suggest(key, every)}")
        else:
            for name, known in options.items():
                if key in known:
                    found[name][known[key].name] = _given(path, key, value, known[key])
    for name in (key for key, value in content.items() if isinstance(value, dict)):
        for key, value in content[name].items():
            if key not in options[name]:
                raise DataError(f"'{path}': {name} has no option '{key}' for [{name}].{suggest(key, options[name])}")
            option = options[name][key]
            found[name][option.name] = _given(path, f"[{name}] {key}", value, option)
    return found


def _options(command: Any) -> dict[str, Any]:
    """Options of a command by their names without dashes."""
    return {
        name.removeprefix("--"): option
        for option in command.params
        if option.param_type_name == "option"
        for name in option.opts
        if name.startswith("--") and name.removeprefix("--") not in _NEVER
    }


def _given(path: Path, key: str, value: Any, option: Any) -> Any:
    """Return a value as the command line would give it; a list is joined by commas, or repeats the option.

    Raises
    ------
    DataError
        The value of a switch is neither true nor false, or that of an option neither text nor a number.
    """
    if option.is_flag:
        if not isinstance(value, bool):
            raise DataError(f"'{path}': {key} is a switch: true or false, not {value!r}.")
        return value
    several = value if isinstance(value, list) else [value]
    if not several or any(isinstance(one, bool) or not isinstance(one, str | int | float) for one in several):
        raise DataError(f"'{path}': {key} takes text, a number, or a list of these; not {value!r}.")
    texts = [str(one) for one in several]
    return texts if option.multiple else ",".join(texts)
