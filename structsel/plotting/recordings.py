"""Figures of recordings: time histories, flight conditions, spectra and coherence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from matplotlib.patches import Rectangle

from structsel.comparison import Mismatch
from structsel.deprecation import renamed_arguments
from structsel.formatting import format_percent
from structsel.model import AeroModel
from structsel.nomenclature import UNKNOWN, unit_of
from structsel.numerics.spectra import coherence, power_spectrum
from structsel.plotting.style import (
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SELECTED,
    TIME,
    add_grid,
    as_list,
    decimate,
    display_values,
    get_axes,
    label,
    line_colour,
    plot_channel,
    scale,
    show_text_only,
    symbol,
)
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MEASURED = ("measured", "recorded")
_WIDTH = 2.2  # of the first line; later ones are thinner, so that lines that coincide are both visible
_ROLES = {**dict.fromkeys(_MEASURED, MEASURED), "reconstructed": SELECTED, "simulated": MODEL}


def plot_histories(flights: Mapping[str, Recording], channel: str, *, ax: Axes | None = None) -> Axes:
    """Draw one channel of several recordings of the same flight over time: measured, reconstructed, simulated.

    Parameters
    ----------
    flights : mapping of str to Recording
        Recordings by their name in the legend. ``"measured"`` and ``"recorded"`` are drawn as dots, others as lines,
        later ones thinner. Recordings without the channel are left out.
    channel : str
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees.

    Raises
    ------
    ChannelError
        No recording has the channel.
    """
    ax = get_axes(ax)
    shown = {name: one for name, one in flights.items() if channel in one}
    if not shown:
        next(iter(flights.values())).require(channel, by="plot_histories")
    lines = [name for name in shown if name not in _MEASURED]
    for i, (name, one) in enumerate(shown.items()):
        dots: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.5, "alpha": 0.6}
        style = dots if name in _MEASURED else {"lw": _WIDTH / (1 + lines.index(name))}
        plot_channel(ax, one, channel, color=_ROLES.get(name, line_colour(i)), label=name, **style)
    ax.set_xlabel(TIME)
    ax.set_ylabel(label(channel, next(iter(shown.values())).units))
    add_grid(ax)
    ax.margins(x=0.0)
    ax.legend(fontsize="small", markerscale=2)
    return ax


def plot_coverage(
    recordings: Recording | Sequence[Recording],
    x: str = "alpha",
    y: str = "beta",
    *,
    held_out: Sequence[Recording] = (),
    model: AeroModel | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the flight conditions of recordings: angle of attack and sideslip, or any two channels.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
    x, y : str
        ``"alpha"`` and ``"beta"``; ``"V"`` and ``"h"``.
    held_out : sequence of Recording, optional
        Validation recordings, in another colour.
    model : AeroModel, optional
        Model whose channel ranges are drawn as a box, if it states them for both channels.
    ax : Axes, optional

    Returns
    -------
    Axes
        The line around the points is their convex hull: a model interpolates inside it and extrapolates outside.
        Angles are in degrees.
    """
    ax = get_axes(ax)
    flights = as_list(recordings)
    units = flights[0].units
    for group, colour, text in ((flights, SELECTED, "recordings"), (held_out, HIGHLIGHT, "validation")):
        for i, one in enumerate(group):
            some = decimate(10 * len(one))
            ax.plot(display_values(one, x)[some], display_values(one, y)[some], ".", ms=2, color=colour, alpha=0.5,
                    mew=0, rasterized=True, label=None if i else text)  # fmt: skip
    points = np.concatenate([np.column_stack([display_values(r, x), display_values(r, y)]) for r in flights])
    points = points[np.isfinite(points).all(axis=1)]
    try:
        edge = points[scipy.spatial.ConvexHull(points).vertices]
        ax.fill(*edge.T, facecolor="none", edgecolor=SELECTED, lw=1.0, label="convex hull")
    except scipy.spatial.QhullError:  # all points on one line: no area
        pass
    ranges = {} if model is None else model.ranges
    if x in ranges and y in ranges:
        (left, right), (low, high) = scale(x, units) * np.array(ranges[x]), scale(y, units) * np.array(ranges[y])
        style: dict[str, Any] = {"fill": False, "ec": MODEL, "ls": "--", "lw": 0.9, "label": "ranges of the model"}
        ax.add_patch(Rectangle((left, low), right - left, high - low, **style))
    ax.set_xlabel(label(x, units))
    ax.set_ylabel(label(y, units))
    add_grid(ax)
    ax.autoscale_view()
    # Above the axes, because the points may be anywhere inside.
    ax.legend(fontsize="small", markerscale=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    return ax


def plot_spectrum(
    recordings: Recording | Sequence[Recording],
    channels: str | Sequence[str],
    *,
    segment: float = 8.0,
    ax: Axes | None = None,
) -> Axes:
    """Draw power spectral densities of channels by Welch's method, averaged over all recordings.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Recordings with the same sampling interval.
    channels : str or sequence of str
        Channels with the same unit.
    segment : float [s], optional
        Length of a segment. Longer segments have a finer frequency resolution and a larger variance.
    ax : Axes, optional

    Returns
    -------
    Axes
        Densities of angles and rates are in degrees.

    Raises
    ------
    DomainError
        No recording is as long as a segment.
    """
    ax = get_axes(ax)
    flights = as_list(recordings)
    names = [channels] if isinstance(channels, str) else list(channels)
    for i, name in enumerate(names):
        parts = [display_values(r, name) for r in flights]
        f, density, segments = power_spectrum(parts, flights[0].dt, segment)
        ax.loglog(f, density, lw=1.1, color=line_colour(i), label=symbol(name))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel(_density_label(names, flights[0].units))
    ax.set_title(f"{segments} segments of {segment:g} s", fontsize="small", loc="right")
    add_grid(ax, minor=True)
    ax.legend(fontsize="small")
    return ax


def plot_coherence(
    recordings: Recording | Sequence[Recording],
    x: str | Sequence[str],
    y: str,
    *,
    segment: float = 8.0,
    ax: Axes | None = None,
) -> Axes:
    """Draw the coherence of a channel with others, and its 99 % limit for independent signals.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Recordings with the same sampling interval.
    x : str or sequence of str
        Inputs; one line for each.
    y : str
        An output, or a residual.
    segment : float [s], optional
    ax : Axes, optional

    Returns
    -------
    Axes
        The coherence of independent signals exceeds the dotted line, at any frequency, with a probability of 1 %.

    Raises
    ------
    DomainError
        No recording is as long as a segment.
    """
    ax = get_axes(ax)
    flights = as_list(recordings)
    threshold = 1.0
    for i, name in enumerate([x] if isinstance(x, str) else x):
        inputs, outputs = ([r[c] for r in flights] for c in (name, y))
        f, squared, threshold = coherence(inputs, outputs, flights[0].dt, segment)
        ax.semilogx(f, squared, lw=1.1, color=line_colour(i), label=f"{symbol(y)} with {symbol(name)}")
    return _finish_coherence(ax, threshold)


@renamed_arguments(most="max_channels")
def plot_mismatch_coherence(
    mismatch: Mismatch, response: str, *, max_channels: int = 4, ax: Axes | None = None
) -> Axes:
    """Draw the coherence of the residual of one response with the channels of highest coherence.

    Parameters
    ----------
    mismatch : Mismatch
    response : str
    max_channels : int, optional
    ax : Axes, optional
    """
    ax = get_axes(ax)
    found = [one for one in mismatch.coherences if one.response == response][:max_channels]
    if not found:
        return show_text_only(ax, f"no coherence of {symbol(response)} was computed")
    for i, one in enumerate(found):
        text = f"{symbol(one.channel)}: {format_percent(one.fraction)} of the power"
        ax.semilogx(one.f, one.squared, lw=1.1, color=line_colour(i), label=text)
    ax.set_title(f"{symbol(response)}: residual with each channel", fontsize="medium")
    return _finish_coherence(ax, found[0].threshold)


def _finish_coherence(ax: Axes, threshold: float) -> Axes:
    ax.axhline(threshold, color=MEASURED, lw=1.0, ls=":", label="99 % of independent signals")
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("squared coherence [-]")
    add_grid(ax, minor=True)
    ax.legend(fontsize="small")
    return ax


def _density_label(names: Sequence[str], units: Mapping[str, str]) -> str:
    """Label of a spectral density; without a unit if units are unknown or differ."""
    found = {unit_of(name, units) for name in names}
    text = "power spectral density"
    if len(found) != 1 or UNKNOWN in found:
        return text
    unit = label(names[0], units, text="unit").partition("[")[2].rstrip("]")
    return f"{text} [1/Hz]" if unit == "-" else f"{text} [({unit})$^2$/Hz]"
