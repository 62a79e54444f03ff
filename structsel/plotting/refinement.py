"""Figures of refinements: estimates side by side, and over the conditions flown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.nomenclature import unit_of
from structsel.plotting.style import DOUBT, KEPT, MEASURED, MODELLED, OTHER
from structsel.refinement import Derivatives, EstimateComparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = (KEPT, MODELLED, DOUBT, OTHER)
_APART = 0.16  # of one row, between methods


def plot_comparison(comparison: EstimateComparison, *, axes: Any = None) -> tuple[Axes, ...]:
    """Draw every parameter's estimates by method with their intervals, one small Axes per parameter.

    Parameters
    ----------
    comparison : EstimateComparison
    axes : sequence of Axes, optional
        One for each parameter.

    Returns
    -------
    tuple of Axes
        The truth, where it is known, is a line across.
    """
    drawn = _each(len(comparison.parameters), axes)
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


def plot_derivatives(
    derivatives: Derivatives, *, truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None, axes: Any = None
) -> tuple[Axes, ...]:
    """Draw every parameter over the condition it was flown from, with intervals, one Axes per parameter.

    Parameters
    ----------
    derivatives : Derivatives
    truth : mapping of parameter to function, optional
        Of the condition [SI]; a line.
    axes : sequence of Axes, optional
        One for each parameter.

    Returns
    -------
    tuple of Axes
        Angles in degrees. Methods stand a little apart; an interval without an end is not drawn.
    """
    drawn = _each(len(derivatives.parameters), axes)
    unit = unit_of(derivatives.against)
    factor, shown = (np.rad2deg(1.0), "deg") if unit == "rad" else (1.0, unit)
    at = derivatives.conditions
    gaps = np.diff(np.unique(at))
    apart = _APART * (float(gaps.min()) if gaps.size else 1.0)
    half = np.where(np.isfinite(derivatives.half), derivatives.half, 0.0)
    for i, (ax, name) in enumerate(zip(drawn, derivatives.parameters)):
        for j, method in enumerate(derivatives.methods):
            where = factor * (at + apart * (j - 0.5 * (len(derivatives.methods) - 1)))
            ax.errorbar(where, derivatives.values[:, i, j], yerr=half[:, i, j], fmt="o", ms=4, capsize=2,
                        color=_COLOURS[j % len(_COLOURS)], label=method)  # fmt: skip
        if truth is not None and name in truth:
            line = np.linspace(at.min(), at.max(), 50)
            ax.plot(
                factor * line, np.broadcast_to(truth[name](line), line.shape), color=MEASURED, lw=0.8, label="truth"
            )
        ax.set_xlabel(f"{derivatives.against} [{shown}]")
        ax.set_title(name, fontsize="small")
    drawn[0].legend(fontsize="x-small")
    return drawn


def _each(count: int, axes: Any) -> tuple[Axes, ...]:
    """The Axes given, or so many small ones of a new figure."""
    if axes is None:
        import matplotlib.pyplot as plt

        columns = min(count, 4)
        rows = -(-count // columns)
        _, grid = plt.subplots(rows, columns, figsize=(2.6 * columns, 2.1 * rows), layout="constrained", squeeze=False)
        for spare in grid.ravel()[count:]:
            spare.set_visible(False)
        axes = grid.ravel()[:count]
    return tuple(np.ravel(axes))
