"""Figures of models and their selection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullLocator

from structsel.deprecation import renamed_arguments
from structsel.formatting import format_number, format_percent
from structsel.model import AeroModel
from structsel.plotting.style import (
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SECONDARY,
    SELECTED,
    TIME,
    add_grid,
    as_list,
    decimate,
    display_values,
    get_axes,
    get_several_axes,
    grid_figure,
    label,
    scale,
    scatter_with_bin_means,
    shorten_ticks,
    show_text_only,
    symbol,
)
from structsel.recording import Recording
from structsel.selection import Selection, Selections
from structsel.validation import Score, Validation, validate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_MOVES = 40
_MAX_NAMES = 8  # of recordings above a time axis
_MAX_CHANNELS = 5
_MAX_INTERVAL = 1.5  # relative half width at which intervals are cut
_NO_SEARCH = "all model sizes were searched at once:\nthere is no path to show"
_MARKS = {"enter": "+", "leave": "−", "swap": "⇄", "simplify": "→"}


@renamed_arguments(axes="ax")
def plot_fit(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, *, ax: Any = None
) -> tuple[Axes, Axes]:
    """Draw measured and modelled response over time, and the residual.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
        Several are drawn one after another, with their names above, or numbers if there are many.
    response : str
    ax : pair of Axes, Figure or SubFigure, optional

    Returns
    -------
    top, bottom : Axes
        Angles are in degrees.
    """
    flights = as_list(recordings)
    options = {"sharex": True, "height_ratios": (2, 1)}
    top, bottom = get_several_axes(ax, 2, 1, figsize=(9.0, 5.0), **options)
    units, start = flights[0].units, 0.0
    factor = scale(response, units)
    for i, recording in enumerate(flights):
        some = decimate(len(recording))
        t = recording.t if len(flights) == 1 else recording.t - recording.t[0] + start
        measured = factor * recording[response]
        modelled = factor * model.evaluate(recording, outside="ignore")[response]
        top.plot(t[some], measured[some], color=MEASURED, lw=1.0, label=None if i else "measured")
        top.plot(t[some], modelled[some], color=MODEL, lw=1.0, label=None if i else "model")
        bottom.plot(t[some], (measured - modelled)[some], color=MEASURED, lw=0.7)
        if len(flights) > 1:
            # The names of many short manoeuvres would overlap.
            name = recording.name if len(flights) <= _MAX_NAMES else str(i + 1)
            top.text(t[0], 1.01, f" {name}", transform=top.get_xaxis_transform(), fontsize="x-small")
            for one in (top, bottom):
                one.axvline(t[0], color=SECONDARY, lw=0.8)
            start = float(t[-1]) + recording.dt
    bottom.axhline(0.0, color=SECONDARY, lw=0.8, zorder=0)
    top.set_ylabel(label(response, units))
    bottom.set_ylabel(label(response, units, text="residual"))
    order = ", numbered as they are given" if len(flights) > _MAX_NAMES else ""
    bottom.set_xlabel(TIME if len(flights) == 1 else f"{TIME}, manoeuvres one after another{order}")
    top.legend(loc="best", fontsize="small", ncols=2)
    for one in (top, bottom):
        add_grid(one)
        one.margins(x=0.0)
    return top, bottom


def plot_search(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Draw the unexplained fraction of the variance, 1 - R2, and the PSE after each move of the search."""
    ax = get_axes(ax)
    steps = [s for s in selection.trace if s.action != "refuse"]
    ax.set_title(f"{symbol(selection.response)}: moves of the search", fontsize="medium")
    if not steps:
        return show_text_only(ax, _NO_SEARCH)
    shown = steps[:_MAX_MOVES]
    x = np.arange(1, len(shown) + 1)
    ax.semilogy(x, [s.PSE for s in shown], "o-", color=HIGHLIGHT, ms=4, lw=1.0, label="PSE")
    ax.semilogy(x, [1.0 - s.R2 for s in shown], "o-", color=SELECTED, ms=4, lw=1.0, label="$1 - R^2$")
    final = len(selection.terms)
    ends = [i for i, s in enumerate(shown, 1) if s.n_terms == final]
    if ends:
        ax.axvline(ends[-1], color=MODEL, lw=0.8, ls="--", label=f"selected: {final} terms")
    ax.xaxis.set_major_locator(FixedLocator(x.tolist()))
    size = "small" if len(shown) <= 12 else "xx-small"
    ax.set_xticklabels([f"{_MARKS[s.action]} {s.term}" for s in shown], rotation=60, ha="right", fontsize=size)
    ax.set_ylabel(f"fraction of variance{_response_text(selection)} [-]")
    if len(shown) < len(steps):
        ax.set_xlabel(f"the first {len(shown)} of {len(steps)} moves")
    add_grid(ax, minor=True)
    ax.legend(fontsize="small")
    return ax


def plot_criteria(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Draw PSE and R2 over the number of terms, for the best model of each size that the search visited.

    Returns
    -------
    Axes
        PSE on a logarithmic scale; the scale of R2 is on the right.
    """
    ax = get_axes(ax)
    ax.set_title(f"{symbol(selection.response)}: number of terms", fontsize="medium")
    visited = [s for s in selection.trace if s.action != "refuse"]
    if not visited:
        return show_text_only(ax, _NO_SEARCH)
    best = {s.n_terms: s for s in sorted(visited, key=lambda s: -s.PSE)}
    sizes = sorted(best)
    right = ax.twinx()
    lines = ax.semilogy(sizes, [best[k].PSE for k in sizes], "o-", color=HIGHLIGHT, ms=4, lw=1.0, label="PSE")
    lines += right.plot(sizes, [best[k].R2 for k in sizes], "s-", color=SELECTED, ms=4, lw=1.0, label="$R^2$")
    final = len(selection.terms)
    lines.append(ax.axvline(final, color=MODEL, lw=0.8, ls="--", label=f"selected: {final} terms"))
    ax.set_xlabel("number of terms without the constant")
    ax.set_ylabel(f"PSE over variance{_response_text(selection)} [-]")
    right.set_ylabel("$R^2$ [-]")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    add_grid(ax)
    ax.legend(handles=lines, fontsize="small", loc="center right")
    return ax


@renamed_arguments(most="max_terms")
def plot_inclusion(selection: Selection, *, max_terms: int = 15, ax: Axes | None = None) -> Axes:
    """Draw the selection frequency of each candidate; the terms of the model have another colour."""
    ax = get_axes(ax)
    ax.set_title(f"{symbol(selection.response)}: selection frequency", fontsize="medium")
    own = {str(term) for term in selection.terms}
    found = {name: frequency for name, frequency in selection.inclusion.items() if frequency > 0 or name in own}
    if not found:
        return show_text_only(ax, "no bootstrap was made" if not selection.inclusion else "no candidate was selected")
    ranked = sorted(found, key=lambda name: (name in own, found[name]), reverse=True)[:max_terms]
    colours = [SELECTED if name in own else SECONDARY for name in ranked]
    ax.barh(ranked, [found[name] for name in ranked], color=colours, height=0.7)
    ax.axvline(0.5, color=HIGHLIGHT, lw=1.0, ls="--")
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("fraction of bootstrap selections [-]")
    if len(found) > len(ranked):
        ax.set_ylabel(f"{len(ranked)} of {len(found)} candidates that were ever selected", fontsize="small")
    return ax


def plot_intervals(selection: Selection, *, level: float = 0.95, ax: Axes | None = None) -> Axes:
    """Draw the intervals of the parameters, relative to the estimates; thin bars assume white residuals."""
    ax = get_axes(ax)
    names = ["1", *map(str, selection.terms)]
    values = selection.values
    size = np.where(values != 0.0, np.abs(values), 1.0)
    half = np.nan_to_num((selection.intervals(level)[:, 1] - values) / size)  # no bar for an unknown error
    textbook = scipy.stats.t.ppf(0.5 + level / 2, max(selection.dof, 1)) * selection.textbook_errors / size
    y = np.arange(len(names))
    cut = half > _MAX_INTERVAL
    for width, height, style in (
        (half, 0.55, {"color": SELECTED, "alpha": 0.45}),
        (textbook, 0.14, {"color": MEASURED}),
    ):
        shown = np.minimum(width, _MAX_INTERVAL)
        ax.barh(y, 2 * shown, left=-shown, height=height, **style)
    for place in y[cut]:
        ax.text(_MAX_INTERVAL, place, f" ±{format_percent(half[place])}", va="center", fontsize="x-small")
    ax.set_yticks(y, [f"{name} = {format_number(value, 3)}" for name, value in zip(names, values)])
    ax.invert_yaxis()
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    limit = 1.1 * float(min(half.max(), _MAX_INTERVAL)) or 1.0
    ax.set_xlim(-limit, 1.35 * limit if cut.any() else limit)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.xaxis.set_major_formatter(lambda x, _: f"{100 * x:g} %")
    ax.set_xlabel(f"{100 * level:g} % interval relative to the estimate")
    ax.set_title(f"{symbol(selection.response)}: intervals (thin: white residuals)", fontsize="medium")
    add_grid(ax, axis="x")
    return ax


def plot_collinearity(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Draw the correlation of the estimates; the labels have the variance inflation factors."""
    ax = get_axes(ax)
    names = [str(term) for term in selection.terms]
    ax.set_title(f"{symbol(selection.response)}: parameter correlation", fontsize="medium")
    if not names:
        return show_text_only(ax, "the model has no terms")
    covariance = selection.covariance[1:, 1:]
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    R = covariance / np.outer(std, std)
    image = ax.imshow(R, vmin=-1, vmax=1, cmap="RdBu_r")
    size = "small" if len(names) <= 10 else "xx-small"
    ax.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=size)
    labels = [f"{name}  (VIF {format_number(vif, 3)})" for name, vif in zip(names, selection.vif)]
    ax.set_yticks(range(len(names)), labels, fontsize=size)
    if len(names) <= 10:
        for i, j in np.ndindex(*R.shape):
            colour = "white" if abs(R[i, j]) > 0.6 else "black"
            ax.text(j, i, f"{R[i, j]:.2f}", ha="center", va="center", fontsize="x-small", color=colour)
    ax.figure.colorbar(image, ax=ax, shrink=0.8, label="correlation [-]")
    return ax


def plot_autocorrelation(score: Score, *, ax: Axes | None = None) -> Axes:
    """Draw the autocorrelation of the residual with the 95 % limits of white noise."""
    ax = get_axes(ax)
    rho = score.autocorrelation[1:]
    lags = np.arange(1, len(rho) + 1)
    ax.axhspan(-score.bound, score.bound, color=SECONDARY, alpha=0.5, lw=0, label="95 % of white noise")
    outside = np.abs(rho) > score.bound
    ax.vlines(lags, 0.0, rho, colors=[MODEL if one else SELECTED for one in outside], lw=2.0)
    ax.axhline(0.0, color=MEASURED, lw=0.8)
    ax.set_xlabel("lag [samples]")
    ax.set_ylabel("autocorrelation [-]")
    ax.set_ylim(min(-0.3, 1.1 * float(np.nanmin(rho, initial=0.0))), 1.05)
    where = "all recordings" if score.recording == "all" else score.recording
    ax.set_title(f"{symbol(score.response)}: residual, {where}", fontsize="medium")
    ax.legend(fontsize="small", loc="upper right")
    return ax


def plot_residual_against(
    model: AeroModel,
    recordings: Recording | Sequence[Recording],
    response: str,
    channel: str,
    *,
    bins: int = 15,
    ax: Axes | None = None,
) -> Axes:
    """Draw the residual over a channel, with the mean of each bin; a trend of the means is a missing term.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
    response : str
    channel : str
        Any channel of the recordings; it need not be in the model.
    bins : int, optional
        Number of bins; each has the same number of samples.
    ax : Axes, optional

    Returns
    -------
    Axes
        Bars are 95 % intervals of the means, from the scatter between recordings, or between segments of few
        recordings. Angles are in degrees.
    """
    ax = get_axes(ax)
    flights = as_list(recordings)
    units = flights[0].units
    x = np.concatenate([display_values(r, channel) for r in flights])
    e = np.concatenate([r[response] - model.evaluate(r, outside="ignore")[response] for r in flights])
    scatter_with_bin_means(ax, x, scale(response, units) * e, flights, bins)
    ax.set_xlabel(label(channel, units))
    ax.set_ylabel(label(response, units, text=f"residual of {symbol(response)}"))
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.legend(fontsize="small", loc="best")
    return ax


def draw_selection(selections: Selection | Selections, recordings: Sequence[Recording]) -> Iterator[tuple[str, Figure]]:
    """Figures of a selection: for each response the fit, the choice of the terms, and the residual.

    Parameters
    ----------
    selections : Selections
    recordings : sequence of Recording
        Those used for the selection, or validation recordings.

    Yields
    ------
    name : str
        ``CZ_fit``, ``CZ_choice``, ``CZ_residual``: stem of a file name.
    figure : Figure
    """
    if isinstance(selections, Selection):
        selections = Selections({selections.response: selections})
    scores = validate(selections.model, recordings)
    for response, selection in selections.items():
        stem = "".join(c if c.isalnum() else "_" for c in response)
        figure = Figure(figsize=(10, 5), layout="constrained")
        plot_fit(selections.model, recordings, response, ax=figure)
        yield f"{stem}_fit", figure
        figure = Figure(figsize=(11, 8.5), layout="constrained")
        panels = figure.subplots(2, 2)
        shorten_ticks(*panels.flat)
        plot_search(selection, ax=panels[0, 0])
        plot_inclusion(selection, ax=panels[0, 1])
        plot_intervals(selection, ax=panels[1, 0])
        plot_collinearity(selection, ax=panels[1, 1])
        yield f"{stem}_choice", figure
        yield f"{stem}_residual", _draw_residual(selections.model, selection, recordings, scores)


def _draw_residual(
    model: AeroModel, selection: Selection, recordings: Sequence[Recording], scores: Validation
) -> Figure:
    """Figure of the autocorrelation of a residual, and of the residual over channels."""
    response = selection.response
    used = {c for term in selection.terms for c in term.channels}
    channels = sorted(selection.pool.channels, key=lambda c: (c not in used, c))[:_MAX_CHANNELS]
    figure, axes = grid_figure(len(channels) + 1, height=3.3)
    plot_autocorrelation(scores.score(response), ax=axes[0])
    for channel, ax in zip(channels, axes[1:]):
        plot_residual_against(model, recordings, response, channel, ax=ax)
    return figure


def _response_text(selection: Selection) -> str:
    return ", prewhitened" if selection.noise_models else ""
