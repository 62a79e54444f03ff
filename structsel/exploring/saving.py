"""Files of a saved view: one that opens it again, a page and a picture."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.exploring.browser_explorer import BrowserExplorer
from structsel.exploring.exploration import Exploration, compute_view
from structsel.exploring.view import View, write_view
from structsel.files import write_text
from structsel.plotting.explorer_view import draw_view

_NAME = re.compile(r"[\w.+ -]{1,80}")
_DPI = 130


def save_view(exploration: Exploration, view: View, source: Mapping[str, Any], folder: Path, name: str) -> list[Path]:
    """Write ``NAME.json``, which opens the view again, ``NAME.html`` and ``NAME.png``; existing files are replaced.

    Raises
    ------
    DataError
        The name is not one of a file.
    """
    name = name.strip()
    if not _NAME.fullmatch(name) or name.startswith("."):
        raise DataError(f"'{name:.40}' is not a name for a view.\nUse letters, digits, spaces, '-', '_', '+' and '.'.")
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}{ending}" for ending in (".json", ".html", ".png")]
    write_view(view, source, paths[0])
    write_text(paths[1], BrowserExplorer(exploration, view).static_page())
    draw_view(compute_view(exploration, view)).savefig(paths[2], dpi=_DPI)
    return paths
