"""Figures of recordings: over time, where in the envelope, and over frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Rectangle
from scipy.spatial import ConvexHull, QhullError

from structsel.comparison import Mismatch
from structsel.model import AeroModel
from structsel.nomenclature import UNKNOWN, unit_of
from structsel.numerics.spectra import coherence, cross_spectrum
from structsel.plotting.style import DOUBT, KEPT, MEASURED, MODELLED, as_read, new_axes, several, symbol, thin
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = (KEPT, MODELLED, DOUBT, "#7b5ea7", "#6b8e23", MEASURED)
_MEASURED = ("measured", "recorded")
_BROAD = 2.2  # of the first line, so that one beneath another shows
_ROLES = {**dict.fromkeys(_MEASURED, MEASURED), "reconstructed": KEPT, "simulated": MODELLED}


def plot_histories(flights: Mapping[str, Recording], channel: str, *, ax: Axes | None = None) -> Axes:
    """One channel of several accounts of the same flight over time: measured, reconstructed, simulated.

    Parameters
    ----------
    flights : mapping of str to Recording
        What each is. Those called measured or recorded are dots, the others lines, later ones thinner. Those without
        the channel are left out.
    channel : str
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles in degrees.

    Raises
    ------
    ChannelError
        None has the channel.
    """
    ax = new_axes(ax)
    shown = {name: one for name, one in flights.items() if channel in one}
    if not shown:
        next(iter(flights.values())).require(channel, by="plot_histories")
    factor, text = as_read(channel, next(iter(shown.values())).units)
    lines = [name for name in shown if name not in _MEASURED]
    for i, (name, one) in enumerate(shown.items()):
        colour, keep = _ROLES.get(name, _COLOURS[i % len(_COLOURS)]), thin(len(one))
        dots: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.5, "alpha": 0.6}
        style = dots if name in _MEASURED else {"lw": _BROAD / (1 + lines.index(name))}
        ax.plot(one.t[keep], factor * one[channel][keep], color=colour, label=name, **style)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(text)
    ax.grid(alpha=0.25)
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
    """Where in the envelope was flown: angle of attack and sideslip, airspeed and height, or any two channels.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
    x, y : str
        ``"alpha"`` and ``"beta"``; ``"V"`` and ``"h"``.
    held_out : sequence of Recording, optional
        In another colour, to see whether they lie inside.
    model : AeroModel, optional
        The box of the region it was identified in, as far as it states one for both channels.
    ax : Axes, optional

    Returns
    -------
    Axes
        The line around all points is their convex hull: within it models interpolate, outside they do not.
    """
    ax = new_axes(ax)
    flown = several(recordings)
    (across, xlabel), (up, ylabel) = as_read(x, flown[0].units), as_read(y, flown[0].units)
    for group, colour, text in ((flown, KEPT, "recordings"), (held_out, DOUBT, "held out")):
        for i, one in enumerate(group):
            keep = thin(10 * len(one))
            ax.plot(across * one[x][keep], up * one[y][keep], ".", ms=2, color=colour, alpha=0.5, mew=0,
                    rasterized=True, label=None if i else text)  # fmt: skip
    points = np.concatenate([np.column_stack([across * r[x], up * r[y]]) for r in flown])
    points = points[np.isfinite(points).all(axis=1)]
    try:
        edge = points[ConvexHull(points).vertices]
        ax.fill(*edge.T, facecolor="none", edgecolor=KEPT, lw=1.0, label="around them")
    except QhullError:  # all on one line: nothing is enclosed
        pass
    region = {} if model is None else model.ranges
    if x in region and y in region:
        (left, right), (low, high) = region[x], region[y]
        corner, size = (across * left, up * low), (across * (right - left), up * (high - low))
        ax.add_patch(Rectangle(corner, *size, fill=False, ec=MODELLED, ls="--", lw=0.9, label="region of the model"))
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.grid(alpha=0.25)
    ax.autoscale_view()
    # Beside the points, which may lie anywhere.
    ax.legend(fontsize="small", markerscale=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    return ax


def plot_spectrum(
    recordings: Recording | Sequence[Recording],
    channels: str | Sequence[str],
    *,
    segment: float = 8.0,
    ax: Axes | None = None,
) -> Axes:
    """Power spectra of channels by Welch's method, all recordings together.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Of one sampling interval.
    channels : str or sequence of str
        Of one unit, so that they share an axis.
    segment : float [s], optional
        Longer ones tell frequencies apart, shorter ones are steadier.
    ax : Axes, optional

    Raises
    ------
    DomainError
        No recording is as long as a segment.
    """
    ax = new_axes(ax)
    flown = several(recordings)
    names = [channels] if isinstance(channels, str) else list(channels)
    for i, name in enumerate(names):
        parts = [r[name] for r in flown]
        f, density, segments = cross_spectrum(parts, parts, flown[0].dt, segment)
        ax.loglog(f, density.real, lw=1.1, color=_COLOURS[i % len(_COLOURS)], label=symbol(name))
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel(f"power density{_density_unit(names, flown[0].units)}")
    ax.set_title(f"{segments} segments of {segment:g} s", fontsize="small", loc="right")
    ax.grid(alpha=0.25, which="both")
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
    """Coherence of a channel with others, and what chance would give.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        Of one sampling interval.
    x : str or sequence of str
        Inputs, each on its own.
    y : str
        An output, or a residual.
    segment : float [s], optional
    ax : Axes, optional

    Returns
    -------
    Axes
        The dotted line is passed once in a hundred times, anywhere, by signals without relation.

    Raises
    ------
    DomainError
        No recording is as long as a segment.
    """
    ax = new_axes(ax)
    flown = several(recordings)
    threshold = 1.0
    for i, name in enumerate([x] if isinstance(x, str) else x):
        inputs, outputs = ([r[c] for r in flown] for c in (name, y))
        f, squared, threshold = coherence(inputs, outputs, flown[0].dt, segment)
        ax.semilogx(f, squared, lw=1.1, color=_COLOURS[i % len(_COLOURS)], label=f"{symbol(y)} with {symbol(name)}")
    return _coherence_axes(ax, threshold)


def plot_mismatch_coherence(mismatch: Mismatch, response: str, *, most: int = 4, ax: Axes | None = None) -> Axes:
    """Coherence of what a comparison leaves of one response with the channels it goes with most.

    Parameters
    ----------
    mismatch : Mismatch
    response : str
    most : int, optional
        Channels shown.
    ax : Axes, optional
    """
    ax = new_axes(ax)
    found = [one for one in mismatch.coherences if one.response == response][:most]
    if not found:
        ax.text(0.5, 0.5, f"no coherence of {symbol(response)} was looked for", ha="center")
        ax.set_axis_off()
        return ax
    for i, one in enumerate(found):
        text = f"{symbol(one.channel)}: {100 * one.share:.0f} % of the power"
        ax.semilogx(one.f, one.squared, lw=1.1, color=_COLOURS[i % len(_COLOURS)], label=text)
    ax.set_title(f"{symbol(response)}: what is left, with each channel", fontsize="medium")
    return _coherence_axes(ax, found[0].threshold)


def _coherence_axes(ax: Axes, threshold: float) -> Axes:
    ax.axhline(threshold, color=MEASURED, lw=1.0, ls=":", label="by chance, once in 100")
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("squared coherence [-]")
    ax.grid(alpha=0.25, which="both")
    ax.legend(fontsize="small")
    return ax


def _density_unit(names: Sequence[str], units: Mapping[str, str]) -> str:
    """Of a spectrum, in brackets; nothing where units are unknown or differ."""
    held = {unit_of(name, units) for name in names}
    if len(held) != 1 or UNKNOWN in held:
        return ""
    (unit,) = held
    return " [1/Hz]" if unit == "-" else f" [({unit})$^2$/Hz]"
