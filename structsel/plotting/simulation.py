"""Figures of simulated flights: outputs over time, with the recording that was simulated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from structsel.plotting.style import (
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SELECTED,
    TIME,
    decimate,
    display_values,
    get_axes,
    grid_figure,
    label,
    label_outer,
    plot_channel,
    r2_text,
    scale,
)
from structsel.recording import Recording
from structsel.validation import Resimulation
from structsel.validation.resimulate import window_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOTION = ("V", "alpha", "beta", "q", "p", "r", "theta", "phi", "h", "az", "ax", "ay")
_CONTROLS = ("de", "da", "dr", "df", "throttle", "thrust", "dlon")
_MAX_OTHER = 12  # channels of a flight that has none of the motion
_AXIS_MARGIN = 1.5  # measured ranges above and below the recording, beyond which a diverging simulation is not shown


def plot_flight(flight: Recording, channel: str, *, recorded: Recording | None = None, ax: Axes | None = None) -> Axes:
    """Draw one channel of a simulated flight over time, with the recording whose inputs were simulated.

    Parameters
    ----------
    flight : Recording
    channel : str
    recorded : Recording, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees.
    """
    ax = get_axes(ax)
    if recorded is not None and channel in recorded:
        plot_channel(ax, recorded, channel, color=MEASURED, lw=0.9, label="recorded")
        plot_channel(ax, flight, channel, color=MODEL, lw=0.9, label="simulated")
        _limit_to_recorded(ax, display_values(recorded, channel))
    else:
        plot_channel(ax, flight, channel, color=SELECTED, lw=0.9, label="simulated")
    return _finish(ax, channel, flight)


def plot_resimulation(result: Resimulation, recording: str, output: str, *, ax: Axes | None = None) -> Axes:
    """Draw one output as recorded, simulated over the complete recording, and simulated in windows.

    Parameters
    ----------
    result : Resimulation
    recording : str
        Name of the recording.
    output : str
    ax : Axes, optional

    Returns
    -------
    Axes
        The band is the proof-of-match band of the output; a dotted line is the time of divergence. Angles are in
        degrees.
    """
    ax = get_axes(ax)
    place = [r.name for r in result.recordings].index(recording)
    measured, whole, windows = (part[place] for part in (result.recordings, result.whole, result.windows))
    y = display_values(measured, output)
    if output in result.bands:
        band, some = scale(output, measured.units) * result.bands[output], decimate(len(y))
        low, high = (y - band)[some], (y + band)[some]
        ax.fill_between(measured.t[some], low, high, color=MEASURED, alpha=0.15, lw=0, label="band")
    plot_channel(ax, measured, output, color=MEASURED, lw=2.2, label="recorded")
    in_windows = display_values(windows, output)
    for rows in window_rows(windows, result.window):
        ax.plot(windows.t[rows], in_windows[rows], color=HIGHLIGHT, lw=1.4)
    ax.plot([], [], color=HIGHLIGHT, lw=1.4, label=f"windows of {result.window:g} s")
    plot_channel(ax, whole, output, color=MODEL, lw=0.8, label="complete")
    _limit_to_recorded(ax, y)
    for one in result.divergences:
        if one.recording == recording and one.kind == "whole":
            ax.axvline(one.at, color=MODEL, lw=0.8, ls=":")
    return _finish(ax, output, measured)


def draw_flight(flight: Recording, recorded: Recording | None = None) -> Figure:
    """Figure of a simulated flight: its motion and its controls."""
    names = [name for name in _MOTION if name in flight]
    moving = [name for name in _CONTROLS if name in flight and np.ptp(flight[name]) > 0.0]
    names = names or [name for name in flight.names if name not in moving][:_MAX_OTHER]
    figure, axes = grid_figure(len(names) + len(moving), height=2.0, sharex=True)
    for name, ax in zip((*names, *moving), axes):
        plot_flight(flight, name, recorded=recorded if name in names else None, ax=ax)
    label_outer(axes)
    figure.suptitle(flight.name, fontsize="medium")
    if recorded is None and (legend := axes[0].get_legend()) is not None:
        legend.remove()
    return figure


def draw_resimulation(result: Resimulation) -> Iterator[tuple[str, Figure]]:
    """Figures of a re-simulation, one for each recording.

    Yields
    ------
    name : str
        Name of the recording.
    figure : Figure
    """
    for recording in result.recordings:
        figure, axes = grid_figure(len(result.outputs), height=2.0, sharex=True)
        for output, ax in zip(result.outputs, axes):
            plot_resimulation(result, recording.name, output, ax=ax)
            whole, windows = (result.score(output, recording.name, kind).r2 for kind in ("whole", "windows"))
            ax.set_title(f"R2: complete {r2_text(whole)}, windows {r2_text(windows)}", fontsize="x-small")
        label_outer(axes)
        figure.suptitle(f"{result.model or 'model'} with the inputs of {recording.name}", fontsize="medium")
        yield recording.name, figure


def _finish(ax: Axes, channel: str, recording: Recording) -> Axes:
    ax.set_ylabel(label(channel, recording.units))
    ax.set_xlabel(TIME)
    ax.legend(fontsize="x-small")
    return ax


def _limit_to_recorded(ax: Axes, measured: np.ndarray) -> None:
    """Limit the y axis to the neighbourhood of the recording, so that a diverging simulation does not hide it."""
    finite = measured[np.isfinite(measured)]
    if len(finite) and (extent := float(np.ptp(finite))) > 0.0:
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, finite.min() - _AXIS_MARGIN * extent), min(high, finite.max() + _AXIS_MARGIN * extent))
