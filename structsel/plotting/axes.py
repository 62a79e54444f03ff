"""What all figures share: colours, labels with units, and how much of a long line is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from structsel.nomenclature import UNKNOWN, latex_of, unit_of

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


def thin(n: int) -> slice:
    """Every so many of n samples, for a line."""
    return slice(None, None, max(1, n // _MOST_POINTS + 1))


def new_axes(ax: Axes | None) -> Axes:
    """Axes given, or new ones."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=(6.5, 4.5), layout="constrained")[1]
