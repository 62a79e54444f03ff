"""The picture of a view of the residual explorer."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from structsel.formatting import join_names
from structsel.plotting.style import MEASURED, MODEL, SECONDARY, SELECTED, TIME, add_grid, decimate


def draw_view(data: Any) -> Figure:
    """Figure of a view: residual over time and over the channel, spectrum of the residual.

    Parameters
    ----------
    data : structsel.exploring.exploration.ViewData
    """
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
