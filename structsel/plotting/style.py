"""Shared parts of all figures: palette, axis labels in display units, grids of axes, samples with bin means."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator

from structsel.formatting import display_unit, format_decimals, format_number
from structsel.nomenclature import UNKNOWN, latex_of, unit_of
from structsel.numerics.binning import bin_means, split_into_segments
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURED, MODEL, SELECTED, SECONDARY, HIGHLIGHT = "#4d4d4d", "#d1495b", "#00798c", "#b9c4c9", "#edae49"
VIOLET, OLIVE, GREY = "#7b5ea7", "#6b8e23", "#858585"
LINES = (SELECTED, MODEL, HIGHLIGHT, VIOLET, OLIVE, MEASURED, SECONDARY)
"""Colours of lines that have no meaning of their own, in order."""
FINDINGS = (SELECTED, HIGHLIGHT, VIOLET, OLIVE)
"""Colours of the findings of a diagnosis, in order."""
TIME = "time [s]"
MAX_NAMES = 20  # of manoeuvres under an axis; more would overlap
_PLAIN = (-2, 5)  # powers of ten between which a tick is written out
_EXPONENT = re.compile(r"\^(-?\d+)")
_MAX_POINTS = 20_000  # per line: more cannot be seen, and take long to draw


def line_colour(place: int) -> str:
    """Colour of the line at a place among several."""
    return LINES[place % len(LINES)]


def symbol(name: str) -> str:
    """Symbol of a channel or a term."""
    return f"${latex_of(name)}$"


def label(name: str, units: Mapping[str, str] | None = None, *, text: str = "") -> str:
    """Axis label of a channel: symbol, or `text`, and the unit in which it is drawn; angles are in degrees."""
    unit = unit_of(name, units)
    named = text or symbol(name)
    return f"{named} [{unit_text(display_unit(unit)[1])}]" if unit != UNKNOWN else named


def unit_text(unit: str) -> str:
    """Unit on an axis: exponents are raised, no unit is a dash."""
    return _EXPONENT.sub(r"$^{\1}$", unit) or "-"


def scale(name: str, units: Mapping[str, str] | None = None) -> float:
    """Factor from the SI unit of a channel to the unit of its label."""
    return display_unit(unit_of(name, units))[0]


def display_values(recording: Recording, channel: str) -> np.ndarray:
    """Samples of a channel in the unit of its label."""
    return scale(channel, recording.units) * recording[channel]


def decimate(n: int) -> slice:
    """Evenly spaced samples of n, as many as a line needs."""
    return slice(None, None, max(1, n // _MAX_POINTS + 1))


def as_list(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    """One recording or several as a list."""
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def plot_channel(ax: Axes, recording: Recording, channel: str, **style: Any) -> None:
    """Draw one channel of a recording over time, in the unit of its label."""
    some = decimate(len(recording))
    ax.plot(recording.t[some], display_values(recording, channel)[some], **style)


def r2_text(value: float) -> str:
    """R2 with three decimals; a large negative one without."""
    return format_decimals(value, 3) if abs(value) < 10.0 else format_number(value, 2)


def scatter_with_bin_means(
    ax: Axes,
    x: np.ndarray,
    y: np.ndarray,
    recordings: Sequence[Recording],
    bins: int,
    *,
    text: str = "mean of each bin",
) -> None:
    """Draw the samples of all recordings, concatenated, as dots, and bin means; see `bin_mean_errorbars`."""
    some = decimate(len(x))
    ax.plot(x[some], y[some], ".", ms=2, color=SECONDARY, rasterized=True)
    bin_mean_errorbars(ax, x, y, recordings, bins, colour=MODEL, text=text)
    ax.axhline(0.0, color=MEASURED, lw=0.8)


def bin_mean_errorbars(
    ax: Axes, x: np.ndarray, y: np.ndarray, recordings: Sequence[Recording], bins: int, *, colour: str, text: str
) -> None:
    """Draw bin means with 95 % intervals, of the samples of all recordings, concatenated.

    The intervals come from the scatter between recordings, or between segments if there are few recordings, because
    neighbouring samples are correlated.
    """
    found = bin_means(x, y, split_into_segments([len(r) for r in recordings]), bins)
    half = np.nan_to_num(found.half)  # no bar where too few segments reach a bin
    ax.errorbar(found.at, found.means, half, fmt="o-", ms=3, lw=1.0, capsize=2, color=colour, label=text)


def get_axes(ax: Axes | None) -> Axes:
    """Axes that were given, or those of a new figure."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return shorten_ticks(plt.subplots(figsize=(6.5, 4.5), layout="constrained")[1])[0]


def get_several_axes(
    ax: Any, rows: int, columns: int, *, figsize: tuple[float, float], **options: Any
) -> tuple[Axes, ...]:
    """Axes that were given, or those of a figure that was given, or of a new figure; row by row."""
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.figure(figsize=figsize, layout="constrained")
    if isinstance(ax, FigureBase):
        ax = shorten_ticks(*np.ravel(ax.subplots(rows, columns, squeeze=False, **options)))
    return tuple(np.ravel(ax))


def shorten_ticks(*axes: Axes) -> list[Axes]:
    """Axes whose labels of small or large numbers have a common power of ten, so that they do not touch."""
    for ax in axes:
        ax.ticklabel_format(style="sci", scilimits=_PLAIN, useMathText=True)
    return list(axes)


def grid_shape(count: int, columns: int = 3) -> tuple[int, int]:
    """Rows and columns of a grid with this many axes."""
    columns = max(min(columns, count), 1)
    return -(-count // columns), columns


def grid_figure(count: int, *, height: float, width: float = 4.2, sharex: bool = False) -> tuple[Figure, list[Axes]]:
    """Figure with a grid of axes, `height` and `width` [in] each; those that are not needed are hidden."""
    rows, columns = grid_shape(count)
    figure = Figure(figsize=(width * columns, height * rows + 0.4), layout="constrained")
    places = shorten_ticks(*np.ravel(figure.subplots(rows, columns, squeeze=False, sharex=sharex)))
    hide(places[count:])
    return figure, places[:count]


def label_outer(axes: Sequence[Axes]) -> None:
    """Keep one legend, that of the first axes of a grid, and the x label of the last axes of each column."""
    _, columns = grid_shape(len(axes))
    for i, ax in enumerate(axes):
        if i + columns < len(axes):
            ax.set_xlabel("")
        else:
            ax.tick_params(labelbottom=True)
        if i and (legend := ax.get_legend()) is not None:
            legend.remove()


def hide(axes: Sequence[Axes]) -> None:
    """Hide axes that are not needed."""
    for ax in axes:
        ax.set_axis_off()


def add_grid(ax: Axes, *, axis: Any = "both", minor: bool = False) -> None:
    """Draw the grid lines of a figure."""
    ax.grid(axis=axis, which="both" if minor else "major", alpha=0.25)


def name_manoeuvres(ax: Axes, names: Sequence[str]) -> None:
    """Name the manoeuvres at 0, 1, 2, ... under an axis; many are only numbered."""
    ax.set_xlim(-0.6, len(names) - 0.4)
    if len(names) <= MAX_NAMES:
        size = "small" if len(names) <= 8 else "xx-small"
        ax.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=size)
    else:
        ax.set_xlabel("manoeuvre, in order")
    ax.yaxis.set_major_locator(MaxNLocator(5))
    add_grid(ax, axis="y")


def show_text_only(ax: Axes, text: str) -> Axes:
    """Write the reason why there is nothing to draw."""
    ax.text(0.5, 0.5, text, ha="center", va="center")
    ax.set_axis_off()
    return ax
