"""Reading TOML files, with messages for faults in them, and writing."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from structsel.errors import StructselError

_LONGEST = 10_000  # characters of a line; the parser takes minutes over a key of a hundred thousand
_LARGEST = 2**63  # what TOML promises; hexadecimal ones can be so long that Python does not write them out


def load_toml(path: Path, what: str, error: type[StructselError]) -> dict[str, Any]:
    """Content of a TOML file.

    Parameters
    ----------
    path : Path
    what : str
        What the file is, for the message.
    error : type of StructselError

    Raises
    ------
    StructselError
        Of the type `error`: the file cannot be read, is no TOML, is nested too deeply, or holds a whole number of more
        than 64 bits.
    """
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "a pipe or a device"
        raise error(f"{what} '{path}' is {kind}, not a file.")
    try:
        text = path.read_text(encoding="utf-8")
        if (longest := max(map(len, text.splitlines()), default=0)) > _LONGEST:
            raise error(f"{what} '{path}' has a line of {longest} characters: it is no file of this kind.")
        content = tomllib.loads(text)
    except OSError as fault:
        raise error(f"{what} '{path}' cannot be read: {fault.strerror or fault}.") from fault
    except RecursionError as fault:
        raise error(f"{what} '{path}' is nested too deeply. No such file needs more than a few levels.") from fault
    except ValueError as fault:  # of syntax, of UTF-8, of a number of thousands of digits
        raise error(f"{what} '{path}' is not TOML: {fault}.") from fault
    waiting: list[tuple[str, Any]] = list(content.items())
    while waiting:
        key, value = waiting.pop()
        if isinstance(value, int) and not -_LARGEST <= value < _LARGEST:
            raise error(f"{what} '{path}': {key}: a whole number of more than 64 bits.")
        if isinstance(value, dict):
            waiting += value.items()
        elif isinstance(value, list):
            waiting += [(key, member) for member in value]
    return content


def toml_text(content: Mapping[str, Any], table: str = "") -> str:
    """Nested mappings of texts, numbers, booleans and lists as TOML, values before tables.

    Parameters
    ----------
    content : mapping
    table : str
        Name of the table that holds it; none is the file.

    Returns
    -------
    str
        `load_toml` reads the same content from it.
    """
    values = {key: value for key, value in content.items() if not isinstance(value, Mapping)}
    lines = [f"[{table}]"] if table and values else []
    lines += [f"{_key(key)} = {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]
    tables = [toml_text(v, f"{table}.{_key(k)}".lstrip(".")) for k, v in content.items() if isinstance(v, Mapping)]
    return "\n".join([*lines, *filter(None, tables)])


def _key(name: str) -> str:
    """A key, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)
