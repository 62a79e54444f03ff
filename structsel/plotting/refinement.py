"""Figures of refinements: estimates side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.plotting.axes import DOUBT, KEPT, MEASURED, MODELLED, OTHER
from structsel.refinement import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = (KEPT, MODELLED, DOUBT, OTHER)
_APART = 0.16  # of one row, between methods


def plot_comparison(comparison: Comparison, *, axes: Any = None) -> tuple[Axes, ...]:
    """Draw every parameter's estimates by method with their intervals, one small Axes per parameter.

    Parameters
    ----------
    comparison : Comparison
    axes : sequence of Axes, optional
        One for each parameter.

    Returns
    -------
    tuple of Axes
        The truth, where it is known, is a line across.
    """
    count = len(comparison.parameters)
    if axes is None:
        import matplotlib.pyplot as plt

        columns = min(count, 4)
        rows = -(-count // columns)
        _, grid = plt.subplots(rows, columns, figsize=(2.6 * columns, 2.1 * rows), layout="constrained", squeeze=False)
        for spare in grid.ravel()[count:]:
            spare.set_visible(False)
        axes = grid.ravel()[:count]
    drawn = tuple(np.ravel(axes))
    bounds = comparison.intervals
    for i, (ax, name) in enumerate(zip(drawn, comparison.parameters)):
        for j, method in enumerate(comparison.methods):
            value = comparison.values[i, j]
            if np.isfinite(value):
                half = max(value - bounds[i, j, 0], 0.0) if np.isfinite(bounds[i, j, 0]) else 0.0
                colour = _COLOURS[j % len(_COLOURS)]
                ax.errorbar(_APART * j, value, yerr=half, fmt="o", ms=4, capsize=3, color=colour, label=method)
        if np.isfinite(comparison.truth[i]):
            ax.axhline(comparison.truth[i], color=MEASURED, lw=0.8, label="truth")
        ax.set_xlim(-_APART, _APART * len(comparison.methods))
        ax.set_xticks([])
        ax.set_title(name, fontsize="small")
    drawn[0].legend(fontsize="x-small")
    return drawn
