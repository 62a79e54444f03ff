"""What a page of the explorer shows, as a file that opens the same view again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.files import write_text

SCHEMA = "structsel.view/1"


@dataclass(frozen=True)
class View:
    """What is shown.

    Attributes
    ----------
    recordings : tuple of str
        Empty for all.
    response, channel : str
        Empty for the first ones.
    kind : {"", "term", "effect"}
        Of what is added to the model; empty for nothing.
    added : str
        Its name.
    bins : int
    start, end : float or None [s]
        Part of the time axis; None for all.
    """

    recordings: tuple[str, ...] = ()
    response: str = ""
    channel: str = ""
    kind: str = ""
    added: str = ""
    bins: int = 15
    start: float | None = None
    end: float | None = None


def write_view(view: View, source: Mapping[str, Any], path: Path) -> None:
    """Write a view, and where its model and recordings are from."""
    content = {"schema": SCHEMA, "source": dict(source), "view": asdict(view)}
    write_text(path, json.dumps(content, indent=1) + "\n")


def read_view(path: Path) -> tuple[View, dict[str, Any]]:
    """Return a view, and where its model and recordings are from.

    Raises
    ------
    DataError
        The file is not a view.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA:
            raise KeyError("schema")
        known = {field.name for field in fields(View)}
        view = View(**{name: value for name, value in content["view"].items() if name in known})
        return replace(view, recordings=tuple(map(str, view.recordings))), dict(content["source"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"'{path}' is not a saved view of structsel explore: {error}.\nOpen a result folder, and save a view there."
        ) from error
