"""Figures of refinements: outputs, the search, and estimates of several methods and flight conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from structsel.deprecation import renamed_arguments
from structsel.errors import DataError
from structsel.plotting.style import (
    MEASURED,
    MODEL,
    SELECTED,
    TIME,
    decimate,
    get_axes,
    get_several_axes,
    grid_figure,
    grid_shape,
    hide,
    label,
    label_outer,
    line_colour,
    plot_channel,
    r2_text,
    scale,
)
from structsel.recording import Recording
from structsel.refinement import Derivatives, EstimateComparison, Refinement

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SPACING = 0.16  # of one row, between methods
_MAX_NAMED = 10  # lines of a legend


@renamed_arguments(axes="ax")
def plot_comparison(comparison: EstimateComparison, *, ax: Any = None) -> tuple[Axes, ...]:
    """Draw the estimates of every parameter by method with their intervals, one small Axes for each parameter.

    Parameters
    ----------
    comparison : EstimateComparison
    ax : sequence of Axes, Figure or SubFigure, optional
        One Axes for each parameter, or the figure that receives them.

    Returns
    -------
    tuple of Axes
        A horizontal line is the true value, if it is known.
    """
    axes = _parameter_axes(len(comparison.parameters), ax)
    bounds = comparison.intervals
    for i, (one, name) in enumerate(zip(axes, comparison.parameters)):
        for j, method in enumerate(comparison.methods):
            value = comparison.values[i, j]
            if np.isfinite(value):
                half = max(value - bounds[i, j, 0], 0.0) if np.isfinite(bounds[i, j, 0]) else 0.0
                style: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 3, "color": line_colour(j), "label": method}
                one.errorbar(_SPACING * j, value, yerr=half, **style)
        if np.isfinite(comparison.truth[i]):
            one.axhline(comparison.truth[i], color=MEASURED, lw=0.8, label="truth")
        one.set_xlim(-_SPACING, _SPACING * len(comparison.methods))
        one.set_xticks([])
        one.set_title(name, fontsize="small")
    axes[0].legend(fontsize="x-small")
    return axes


@renamed_arguments(axes="ax")
def plot_derivatives(
    derivatives: Derivatives, *, truth: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None, ax: Any = None
) -> tuple[Axes, ...]:
    """Draw every parameter over the flight condition with its intervals, one Axes for each parameter.

    Parameters
    ----------
    derivatives : Derivatives
    truth : mapping of parameter to function, optional
        True value as a function of the condition [SI]; drawn as a line.
    ax : sequence of Axes, Figure or SubFigure, optional
        One Axes for each parameter, or the figure that receives them.

    Returns
    -------
    tuple of Axes
        Conditions that are angles are in degrees. Methods are drawn side by side; an interval without an end is not
        drawn.
    """
    axes = _parameter_axes(len(derivatives.parameters), ax)
    factor = scale(derivatives.against)
    at = derivatives.conditions
    gaps = np.diff(np.unique(at))
    spacing = _SPACING * (float(gaps.min()) if gaps.size else 1.0)
    half = np.where(np.isfinite(derivatives.half), derivatives.half, 0.0)
    for i, (one, name) in enumerate(zip(axes, derivatives.parameters)):
        for j, method in enumerate(derivatives.methods):
            where = factor * (at + spacing * (j - 0.5 * (len(derivatives.methods) - 1)))
            style: dict[str, Any] = {"fmt": "o", "ms": 4, "capsize": 2, "color": line_colour(j), "label": method}
            one.errorbar(where, derivatives.values[:, i, j], yerr=half[:, i, j], **style)
        if truth is not None and name in truth:
            line = np.linspace(at.min(), at.max(), 50)
            true = np.broadcast_to(truth[name](line), line.shape)
            one.plot(factor * line, true, color=MEASURED, lw=0.8, label="truth")
        one.set_xlabel(label(derivatives.against))
        one.set_title(name, fontsize="small")
    axes[0].legend(fontsize="x-small")
    return axes


def plot_output(result: Refinement, recording: str = "", output: str = "", *, ax: Axes | None = None) -> Axes:
    """Draw one output of a refined model over time, as recorded and simulated.

    Parameters
    ----------
    result : Refinement
    recording, output : str, optional
        By default the first.
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees. The recorded output is the simulated one plus the residual; of a fit to transforms only
        the simulation is drawn.

    Raises
    ------
    DataError
        There is no such recording or output.
    """
    flights = {one.name: one for one in result.simulated}
    recording, output = recording or next(iter(flights)), output or next(iter(result.noise_std))
    if recording not in flights or output not in result.noise_std:
        raise DataError(
            f"the refinement has no output '{output}' of '{recording}'.\n"
            f"It has {', '.join(result.noise_std)} of {', '.join(flights)}."
        )
    ax = get_axes(ax)
    flight = flights[recording]
    if result.domain == "time":
        factor, some = scale(output, flight.units), decimate(len(flight))
        recorded = flight[output] + np.asarray(result.residuals[recording][output])
        ax.plot(flight.t[some], factor * recorded[some], color=MEASURED, lw=1.8, label="recorded")
    plot_channel(ax, flight, output, color=MODEL, lw=0.9, label="refined")
    ax.set_xlabel(TIME)
    ax.set_ylabel(label(output, flight.units))
    ax.set_title(recording, fontsize="small")
    ax.legend(fontsize="x-small")
    return ax


def draw_refinement(result: Refinement, recordings: Sequence[Recording] = ()) -> Iterator[tuple[str, Figure]]:
    """Figures of a refinement: outputs of each recording measured and simulated, and the history of the search.

    Parameters
    ----------
    result : Refinement
    recordings : sequence of Recording
        Those that the refinement used; without them the simulation is drawn alone.

    Yields
    ------
    name : str
        Name of the recording; ``history`` for the search.
    figure : Figure
    """
    outputs = list(result.noise_std)
    verdict = f": {result.verdict}" + ("" if result.converged else ", NOT CONVERGED")
    for flight in result.simulated:
        figure, axes = grid_figure(len(outputs), height=2.0, sharex=True)
        fits = {fit.output: fit for fit in result.fits if fit.recording == flight.name}
        for output, ax in zip(outputs, axes):
            for recording in recordings:
                if recording.name == flight.name:
                    plot_channel(ax, recording, output, color=MEASURED, lw=1.8, label="recorded")
            plot_channel(ax, flight, output, color=MODEL, lw=0.9, label="refined")
            ax.set_ylabel(label(output, flight.units))
            ax.set_xlabel(TIME)
            ax.set_title(f"R2 {r2_text(fits[output].r2)}", fontsize="x-small")
            ax.legend(fontsize="x-small")
        label_outer(axes)
        figure.suptitle(f"{flight.name}{verdict}", fontsize="medium")
        yield flight.name, figure
    yield "history", _draw_search(result, verdict)


def _draw_search(result: Refinement, verdict: str) -> Figure:
    """Figure of the cost and the parameters after every step."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    steps = np.arange(len(result.costs))
    left.plot(steps, result.costs, "o-", ms=3, color=SELECTED)
    left.set_xlabel("step")
    left.set_ylabel(f"cost, {result.cost}")
    sizes = np.where(result.std > 0.0, result.std, np.nan)
    with np.errstate(invalid="ignore"):
        lines = right.plot(steps, (result.thetas - result.values) / sizes, lw=0.9)
    if len(lines) <= _MAX_NAMED:
        right.legend(lines, result.names, fontsize="x-small")
    right.set_xlabel("step")
    right.set_ylabel("parameter minus estimate [std errors]")
    right.set_yscale("symlog", linthresh=1.0)
    figure.suptitle(f"descent of {len(result.names)} parameters{verdict}", fontsize="medium")
    return figure


def _parameter_axes(count: int, ax: Any) -> tuple[Axes, ...]:
    rows, columns = grid_shape(count, 4)
    axes = get_several_axes(ax, rows, columns, figsize=(2.6 * columns, 2.1 * rows))
    hide(axes[count:])
    return axes[:count]
