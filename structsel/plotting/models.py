"""Figures of models: estimates with their intervals, and the modes of a linear model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from structsel.formatting import format_number, format_percent
from structsel.model import AeroModel, ResponseModel
from structsel.plotting.style import MEASURED, SELECTED, add_grid, get_axes, symbol
from structsel.results import Estimates
from structsel.simulation import LinearModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_INTERVAL = 1.5  # of an estimate, above which the bar is cut and its length written


def plot_estimates(result: Any, response: str = "", *, level: float = 0.95, ax: Axes | None = None) -> Axes:
    """Draw the intervals of the parameters of a model or an estimation, relative to the estimates.

    Parameters
    ----------
    result : AeroModel, ResponseModel, EquationError or Refinement
    response : str, optional
        Of an AeroModel; by default the first.
    level : float, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        A parameter whose standard error is not known, or whose estimate is zero, has no bar.
    """
    ax = get_axes(ax)
    one: Estimates = result
    if isinstance(result, AeroModel):
        response = response or next(iter(result.responses))
        one = result[response]
    values = one.params
    bounds = one.conf_int(1.0 - level)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.nan_to_num((bounds.iloc[:, 1].to_numpy() - values.to_numpy()) / np.abs(values.to_numpy()), posinf=0.0)
    y = np.arange(len(values))
    shown = np.minimum(half, _MAX_INTERVAL)
    ax.barh(y, 2.0 * shown, left=-shown, height=0.5, color=SELECTED, alpha=0.6)
    for place in y[half > _MAX_INTERVAL]:
        ax.text(_MAX_INTERVAL, place, f" ±{format_percent(half[place])}", va="center", fontsize="x-small")
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    size = "small" if len(values) <= 20 else "xx-small"
    ax.set_yticks(y, [f"{name} = {format_number(value, 3)}" for name, value in values.items()], fontsize=size)
    ax.invert_yaxis()
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.xaxis.set_major_formatter(lambda x, _: f"{100.0 * x:g} %")
    ax.set_xlabel(f"{100.0 * level:g} % interval relative to the estimate")
    named = response if isinstance(result, AeroModel | ResponseModel) else ""
    ax.set_title(f"{symbol(named)}: intervals" if named else "intervals", fontsize="medium")
    add_grid(ax, axis="x")
    return ax


def plot_modes(model: LinearModel, *, ax: Axes | None = None) -> Axes:
    """Draw the eigenvalues of a linear model in the complex plane, with the names of the modes.

    Parameters
    ----------
    model : LinearModel
    ax : Axes, optional

    Returns
    -------
    Axes
        Modes right of the vertical line are unstable.
    """
    ax = get_axes(ax)
    modes = model.modes()
    values = np.asarray(modes.eigenvalues)
    ax.plot(values.real, values.imag, "x", color=SELECTED, ms=7, mew=1.5)
    for name, value in zip(modes.names, values):
        ax.annotate(name, (value.real, value.imag), xytext=(5, 4), textcoords="offset points", fontsize="x-small")
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    ax.axhline(0.0, color=MEASURED, lw=0.8)
    ax.margins(0.15)
    ax.set_xlabel("real part [1/s]")
    ax.set_ylabel("imaginary part [rad/s]")
    add_grid(ax)
    return ax
