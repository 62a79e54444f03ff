"""Figures of inputs: their shape, what they move, and what they tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from structsel.inputs import InputComparison, InputDesign
from structsel.plotting.style import KEPT, MODELLED, OTHER, label, new_axes
from structsel.recording import Recording
from structsel.simulation import LinearModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = (KEPT, MODELLED, "#edae49", "#4d4d4d")


def plot_input(inputs: Recording, *, ax: Axes | None = None) -> Axes:
    """Draw a schedule of inputs over time, every control a line, held from sample to sample."""
    ax = new_axes(ax)
    for i, name in enumerate(inputs.names):
        ax.step(inputs.t, inputs[name], where="post", lw=1.0, color=_COLOURS[i % len(_COLOURS)], label=name)
    ax.axhline(0.0, color=OTHER, lw=0.6)
    one = len(inputs.names) == 1
    ax.set_ylabel(label(inputs.names[0], inputs.units) if one else "departure from trim")
    ax.set_xlabel("t [s]")
    if not one:
        ax.legend(fontsize="x-small")
    return ax


def plot_bounds(found: InputComparison, *, ax: Axes | None = None) -> Axes:
    """Draw Cramer-Rao bounds by kind of input, as a share of each parameter; an input that cannot tell has no point."""
    ax = new_axes(ax)
    names = [u.name for u in found.inputs]
    for j, parameter in enumerate(found.parameters):
        shares = [100.0 * info.crlb[j] / found.sizes[j] for info in found.found]
        ax.plot(shares, range(len(names)), "o", ms=5, color=f"C{j}", label=parameter)
    ax.set_yticks(range(len(names)), names, fontsize="small")
    ax.invert_yaxis()
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_xlabel("Cramer-Rao bound, % of the parameter")
    ax.grid(axis="y", color=OTHER, lw=0.4)
    ax.legend(fontsize="x-small")
    return ax


def draw_inputs(found: Recording | InputDesign | InputComparison, model: LinearModel | None = None) -> Figure:
    """Figure of an input, a designed input, or a comparison of inputs.

    Parameters
    ----------
    found : Recording, InputDesign or InputComparison
    model : LinearModel, optional
        Then the motion that a single input makes is drawn below it; limits are dashed.

    Returns
    -------
    Figure
    """
    if isinstance(found, InputComparison):
        return _draw_comparison(found)
    inputs = found if isinstance(found, Recording) else found.inputs
    flown = None if model is None else model.simulate(inputs)
    shown = () if model is None else model.outputs
    figure = Figure(figsize=(6.5, 2.0 + 1.5 * len(shown)), layout="constrained")
    places = np.ravel(figure.subplots(1 + len(shown), 1, squeeze=False, sharex=True))
    plot_input(inputs, ax=places[0])
    limits = {} if isinstance(found, Recording) else {reached.what: reached.allowed for reached in found.limits}
    for name, ax in zip(shown, places[1:]):
        assert flown is not None
        ax.plot(flown.t, flown[name], color=KEPT, lw=1.0)
        ax.set_ylabel(label(name, flown.units))
    for name, ax in zip((inputs.names[0], *shown), places):
        for side in (-1.0, 1.0):
            if name in limits:
                ax.axhline(side * limits[name], color=MODELLED, lw=0.8, ls="--")
    for ax in places[:-1]:
        ax.set_xlabel("")
    places[-1].set_xlabel("t [s]")
    figure.suptitle(inputs.name if isinstance(found, Recording) else f"optimal input, criterion {found.criterion}",
                    fontsize="medium")  # fmt: skip
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
        ax.set_ylabel("")
        ax.set_title(u.name, fontsize="x-small", loc="left", pad=2)
        if i < count - 1:
            ax.set_xlabel("")
            ax.tick_params(labelbottom=False)
        if i and (legend := ax.get_legend()) is not None:
            legend.remove()
    plot_bounds(found, ax=figure.add_subplot(grid[:, 1]))
    figure.suptitle(f"inputs of equal energy, {found.energy:.4g}", fontsize="medium")
    return figure
