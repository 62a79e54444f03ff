"""Files of a saved view: one that opens it again, a page and a picture."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from structsel.errors import DataError
from structsel.exploring.browser_explorer import BrowserExplorer
from structsel.exploring.exploration import Exploration, ViewData, compute_view
from structsel.exploring.view import View, write_view
from structsel.files import write_text
from structsel.formatting import join_names
from structsel.plotting.style import MEASURED, MODEL, SECONDARY, SELECTED, TIME, add_grid, decimate

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


def draw_view(data: ViewData) -> Figure:
    """Figure of a view: residual over time and over the channel, spectrum of the residual."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    time, against, spectrum = figure.subplot_mosaic([["time", "time"], ["against", "spectrum"]]).values()
    added = [("with_it", SELECTED, f"with {data.view.added}", data.means_with, data.density_with)]
    kinds = [("without", SECONDARY, "without it", data.means, data.density), *(added if data.view.kind else [])]
    x = np.concatenate([s.channel for s in data.series])
    y = np.concatenate([s.without for s in data.series])
    against.plot(x[decimate(len(x))], y[decimate(len(y))], ".", ms=2, color=SECONDARY, rasterized=True)
    for name, colour, text, means, density in kinds:
        for i, s in enumerate(data.series):
            some = decimate(len(s.t))
            time.plot(s.t[some], getattr(s, name)[some], color=colour, lw=0.9, label="" if i else text)
        line = MODEL if name == "without" else colour
        against.errorbar(means.at, means.means, np.nan_to_num(means.half), fmt="o-", ms=3, lw=1.0, capsize=2,
                         color=line, label=text)  # fmt: skip
        spectrum.loglog(data.frequency[1:], density[1:], color=line, lw=1.1, label=text)
    against.axhline(0.0, color=MEASURED, lw=0.8)
    time.set(xlabel=TIME, ylabel=data.y_label, xlim=(data.view.start, data.view.end))
    time.set_title(f"{join_names(data.view.recordings)}", fontsize="medium")
    against.set(xlabel=data.x_label, ylabel=data.y_label)
    spectrum.set(xlabel="frequency [Hz]", ylabel=data.density_label)
    for ax in (time, against, spectrum):
        add_grid(ax)
        if data.view.kind:
            ax.legend(fontsize="small")
    return figure
