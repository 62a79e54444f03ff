"""Figures of inputs: time histories, response, and accuracy of the parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from structsel.formatting import format_number
from structsel.inputs import InputComparison, InputDesign
from structsel.plotting.style import (
    MODEL,
    SECONDARY,
    SELECTED,
    TIME,
    add_grid,
    display_values,
    get_axes,
    label,
    line_colour,
    plot_channel,
    scale,
)
from structsel.recording import Recording
from structsel.simulation import LinearModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_input(inputs: Recording, *, ax: Axes | None = None) -> Axes:
    """Draw inputs over time, one line for each control, constant between samples; angles are in degrees."""
    ax = get_axes(ax)
    for i, name in enumerate(inputs.names):
        values = display_values(inputs, name)
        ax.step(inputs.t, values, where="post", lw=1.0, color=line_colour(i), label=label(name, inputs.units))
    ax.axhline(0.0, color=SECONDARY, lw=0.6)
    if len(inputs.names) == 1:
        ax.set_ylabel(label(inputs.names[0], inputs.units))
    else:
        ax.set_ylabel("deviation from trim")
        ax.legend(fontsize="x-small")
    ax.set_xlabel(TIME)
    return ax


def plot_cramer_rao(found: InputComparison, *, ax: Axes | None = None) -> Axes:
    """Draw the Cramer-Rao bound of each parameter for each input, in percent of the parameter.

    An input that does not determine a parameter has no point.
    """
    ax = get_axes(ax)
    names = [u.name for u in found.inputs]
    for j, parameter in enumerate(found.parameters):
        percent = [100.0 * info.crlb[j] / found.sizes[j] for info in found.found]
        ax.plot(percent, range(len(names)), "o", ms=5, color=line_colour(j), label=parameter)
    ax.set_yticks(range(len(names)), names, fontsize="small")
    ax.invert_yaxis()
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("Cramer-Rao bound [% of the parameter]")
    add_grid(ax, axis="y")
    ax.legend(fontsize="x-small")
    return ax


def draw_inputs(found: Recording | InputDesign | InputComparison, model: LinearModel | None = None) -> Figure:
    """Figure of an input, a designed input, or a comparison of inputs.

    Parameters
    ----------
    found : Recording, InputDesign or InputComparison
    model : LinearModel, optional
        Model whose response to a single input is drawn below the input. Limits of a design are dashed.

    Returns
    -------
    Figure
    """
    if isinstance(found, InputComparison):
        return _draw_comparison(found)
    inputs = found if isinstance(found, Recording) else found.inputs
    outputs = () if model is None else model.outputs
    figure = Figure(figsize=(6.5, 2.0 + 1.5 * len(outputs)), layout="constrained")
    axes = np.ravel(figure.subplots(1 + len(outputs), 1, squeeze=False, sharex=True))
    plot_input(inputs, ax=axes[0])
    units = dict(inputs.units)
    if model is not None:
        response = model.simulate(inputs)
        units |= response.units
        for name, ax in zip(outputs, axes[1:]):
            plot_channel(ax, response, name, color=SELECTED, lw=1.0)
            ax.set_ylabel(label(name, units))
    limits = {} if isinstance(found, Recording) else {reached.what: reached.allowed for reached in found.limits}
    for name, ax in zip((inputs.names[0], *outputs), axes):
        for side in (-1.0, 1.0):
            if name in limits:
                ax.axhline(side * scale(name, units) * limits[name], color=MODEL, lw=0.8, ls="--")
    axes[0].set_xlabel("")
    axes[-1].set_xlabel(TIME)
    title = inputs.name if isinstance(found, Recording) else f"optimal input, criterion {found.criterion}"
    figure.suptitle(title, fontsize="medium")
    return figure


def _draw_comparison(found: InputComparison) -> Figure:
    count = len(found.inputs)
    figure = Figure(figsize=(10.0, 0.9 * count + 0.6), layout="constrained")
    grid = figure.add_gridspec(count, 2, width_ratios=(1.0, 1.1))
    first = None
    for i, u in enumerate(found.inputs):
        ax = figure.add_subplot(grid[i, 0], sharex=first, sharey=first)
        first = first or ax
        plot_input(u, ax=ax)
        if len(u.names) == 1:
            ax.set_ylabel(ax.get_ylabel() if i == count // 2 else "")
        else:
            ax.set_ylabel("")
        ax.set_title(u.name, fontsize="x-small", loc="left", pad=2)
        if i < count - 1:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        if i and (legend := ax.get_legend()) is not None:
            legend.remove()
    plot_cramer_rao(found, ax=figure.add_subplot(grid[:, 1]))
    figure.suptitle(f"inputs of equal energy, {format_number(found.energy)}", fontsize="medium")
    return figure
