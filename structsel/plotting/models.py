"""Figures of models: estimates with their intervals, over manoeuvres and over time, and the modes of a linear model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from structsel.formatting import count_of, format_number, format_percent
from structsel.frequency_domain import RecursiveEstimate
from structsel.model import AeroModel, ResponseModel
from structsel.plotting.style import MEASURED, SELECTED, TIME, add_grid, get_axes, show_text_only, symbol
from structsel.results import Estimates
from structsel.simulation import LinearModel
from structsel.validation import Ensemble

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_INTERVAL = 1.5  # of an estimate, above which the bar is cut and its length written


def plot_estimates(result: Any, response: str = "", *, level: float = 0.95, ax: Axes | None = None) -> Axes:
    """Draw the intervals of the parameters of a model or an estimation, relative to the estimates.

    Parameters
    ----------
    result : AeroModel, ResponseModel, EquationError, Refinement or RecursiveEstimate
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
    size = "small" if len(values) <= 20 else "xx-small"
    labels = [f"{name} = {format_number(value, 3)}" for name, value in values.items()]
    _draw_relative_bars(ax, shown, labels, fontsize=size, alpha=0.6)
    for place in y[half > _MAX_INTERVAL]:
        ax.text(_MAX_INTERVAL, place, f" ±{format_percent(half[place])}", va="center", fontsize="x-small")
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    ax.set_xlabel(f"{100.0 * level:g} % interval relative to the estimate")
    named = response if isinstance(result, AeroModel | ResponseModel) else getattr(result, "response", "")
    ax.set_title(f"{symbol(named)}: intervals" if named else "intervals", fontsize="medium")
    return ax


def _draw_relative_bars(
    ax: Axes, half: np.ndarray, labels: Sequence[str], *, fontsize: str, alpha: float, label: str = ""
) -> None:
    """Draw a horizontal bar of this half width [fraction] about zero for each label, the first at the top."""
    y = np.arange(len(half))
    ax.use_sticky_edges = False  # of a bar, which the margins would not extend
    ax.barh(y, 2.0 * half, left=-half, height=0.5, color=SELECTED, alpha=alpha, label=label)
    ax.set_yticks(y, labels, fontsize=fontsize)
    ax.invert_yaxis()
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.xaxis.set_major_formatter(lambda x, _: f"{100.0 * x:g} %")
    add_grid(ax, axis="x")


def plot_ensemble(found: Ensemble, response: str = "", *, ax: Axes | None = None) -> Axes:
    """Draw the range of each term over manoeuvres, and the mean standard error, relative to the mean.

    Parameters
    ----------
    found : Ensemble
    response : str, optional
        By default the first.
    ax : Axes, optional

    Returns
    -------
    Axes
        A range far beyond the bar is of a term that differs between the manoeuvres, or whose standard error is too
        small. A term whose mean is zero is not drawn.
    """
    ax = get_axes(ax)
    response = response or found.rows[0].response
    rows = [row for row in found.rows if row.response == response and row.mean]
    if not rows:
        return show_text_only(ax, f"no term of {response}")
    y = np.arange(len(rows))
    mean, low, high, std = (
        np.array([getattr(row, name) for row in rows]) for name in ("mean", "low", "high", "std_error")
    )
    size = np.abs(mean)
    labels = [f"{row.term} = {format_number(row.mean, 3)} ({row.count})" for row in rows]
    bar = np.nan_to_num(std / size)
    _draw_relative_bars(ax, bar, labels, fontsize="small", alpha=0.45, label="mean standard error")
    ax.errorbar(np.zeros(len(rows)), y, xerr=[(mean - low) / size, (high - mean) / size], fmt="o", ms=4, lw=1.4,
                capsize=3, color=MEASURED, label="mean, least and greatest")  # fmt: skip
    ax.set_xlabel("departure from the mean, relative to it")
    ax.set_title(f"{symbol(response)} over {count_of(found.count, 'manoeuvre')}", fontsize="medium")
    ax.legend(fontsize="x-small")
    return ax


def plot_recursive_estimates(
    estimates: Sequence[RecursiveEstimate], parameter: str, *, level: float = 0.95, ax: Axes | None = None
) -> Axes:
    """Draw a parameter over time, as a recursive estimator finds it, with its interval.

    Parameters
    ----------
    estimates : sequence of RecursiveEstimate
        As `RecursiveEstimator.feed` returns them.
    parameter : str
        A term.
    level : float, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        Times at which the samples do not determine the parameters are left out. The axis is that of the intervals of
        the second half: the first ones are many times longer.
    """
    ax = get_axes(ax)
    shown = [one for one in estimates if one.determined]
    if not shown:
        return show_text_only(ax, "the samples do not determine the parameters")
    t = np.array([one.t for one in shown])
    values = np.array([one.params[parameter] for one in shown])
    low, high = np.transpose([one.conf_int(1.0 - level).loc[parameter].to_numpy() for one in shown])
    ax.fill_between(t, low, high, color=SELECTED, alpha=0.25, lw=0, label=f"{100.0 * level:g} % interval")
    ax.plot(t, values, color=SELECTED, lw=1.3, label="estimate")
    late = slice(len(t) // 2, None)
    margin = 0.5 * max(float(np.ptp([low[late].min(), high[late].max()])), 1e-12)
    bottom, top = ax.get_ylim()
    ax.set_ylim(max(bottom, low[late].min() - margin), min(top, high[late].max() + margin))
    ax.set_xlabel(TIME)
    ax.set_ylabel(f"{parameter} of {shown[0].response}, SI units and radians")
    ax.legend(fontsize="x-small")
    add_grid(ax)
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
