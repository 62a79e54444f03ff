"""What all figures share: colours, labels with units, and how much of a long line is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from structsel.formatting import display_unit
from structsel.nomenclature import UNKNOWN, latex_of, unit_of
from structsel.numerics.binning import bin_means, split_into_segments
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURED, MODELLED, KEPT, OTHER, DOUBT = "#4d4d4d", "#d1495b", "#00798c", "#b9c4c9", "#edae49"
_MOST_POINTS = 20_000  # per line: more cannot be seen, and take long to draw


def label(name: str, units: Mapping[str, str] | None = None) -> str:
    """Symbol and unit of a channel, for an axis."""
    return symbol(name) + unit_label(name, units)


def symbol(name: str) -> str:
    """Symbol of a channel or a term."""
    return f"${latex_of(name)}$"


def unit_label(name: str, units: Mapping[str, str] | None = None) -> str:
    """Unit of a channel in brackets, after a space; nothing where it is unknown."""
    unit = unit_of(name, units)
    return f" [{unit}]" if unit != UNKNOWN else ""


def as_read(name: str, units: Mapping[str, str] | None = None) -> tuple[float, str]:
    """Factor to the unit that people read, degrees for radians, and symbol and unit for an axis."""
    unit = unit_of(name, units)
    factor, shown = display_unit(unit)
    return factor, f"{symbol(name)} [{shown or '-'}]" if unit != UNKNOWN else symbol(name)


def thin(n: int) -> slice:
    """Every so many of n samples, for a line."""
    return slice(None, None, max(1, n // _MOST_POINTS + 1))


def several(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    """One recording or many as a list."""
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def draw_cloud(
    ax: Axes,
    x: np.ndarray,
    y: np.ndarray,
    recordings: Sequence[Recording],
    bins: int,
    *,
    text: str = "mean of each bin",
) -> None:
    """Draw samples of all recordings end to end as dots, and means over bins; see `draw_means`."""
    keep = thin(len(x))
    ax.plot(x[keep], y[keep], ".", ms=2, color=OTHER, rasterized=True)
    draw_means(ax, x, y, recordings, bins, colour=MODELLED, text=text)
    ax.axhline(0.0, color=MEASURED, lw=0.8)


def draw_means(
    ax: Axes, x: np.ndarray, y: np.ndarray, recordings: Sequence[Recording], bins: int, *, colour: str, text: str
) -> None:
    """Draw means over bins with 95 % intervals, of samples of all recordings end to end.

    The intervals come from the spread between recordings, or between segments of few: neighbours in time are alike.
    """
    found = bin_means(x, y, split_into_segments([len(r) for r in recordings]), bins)
    half = np.nan_to_num(found.half)  # a bin that too few segments fill has no bar
    ax.errorbar(found.at, found.means, half, fmt="o-", ms=3, lw=1.0, capsize=2, color=colour, label=text)


def new_axes(ax: Axes | None) -> Axes:
    """Axes given, or new ones."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=(6.5, 4.5), layout="constrained")[1]
