"""Figures of models and their selection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullLocator
from scipy import stats

from structsel.model import AeroModel
from structsel.plotting.style import (
    DOUBT,
    KEPT,
    MEASURED,
    MODELLED,
    OTHER,
    draw_cloud,
    label,
    new_axes,
    several,
    symbol,
    thin,
    unit_label,
)
from structsel.recording import Recording
from structsel.selection import Selection, Selections
from structsel.validation import Score, validate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_MOVES = 40
_MOST_NAMES = 8
_MOST_CHANNELS = 5
_WIDEST = 1.5  # relative intervals are cut here


def plot_fit(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, *, axes: Any = None
) -> tuple[Axes, Axes]:
    """Measured and modelled response over time, and what is left.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
        Several stand end to end, their names (numbers, where many) above.
    response : str
    axes : pair of Axes, optional

    Returns
    -------
    top, bottom : Axes
    """
    flown = several(recordings)
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(2, 1, sharex=True, height_ratios=(2, 1), figsize=(9, 5), layout="constrained")
    top, bottom = axes
    start = 0.0
    for i, recording in enumerate(flown):
        keep = thin(len(recording))
        t = recording.t if len(flown) == 1 else recording.t - recording.t[0] + start
        measured = recording[response]
        modelled = model.evaluate(recording, outside="ignore")[response]
        first = i == 0
        top.plot(t[keep], measured[keep], color=MEASURED, lw=1.0, label="measured" if first else None)
        top.plot(t[keep], modelled[keep], color=MODELLED, lw=1.0, label="model" if first else None)
        bottom.plot(t[keep], (measured - modelled)[keep], color=MEASURED, lw=0.7)
        if len(flown) > 1:
            # Names of many short manoeuvres would run into each other.
            name = recording.name if len(flown) <= _MOST_NAMES else str(i + 1)
            top.text(t[0], 1.01, f" {name}", transform=top.get_xaxis_transform(), fontsize="x-small")
            for ax in (top, bottom):
                ax.axvline(t[0], color=OTHER, lw=0.8)
            start = float(t[-1]) + recording.dt
    bottom.axhline(0.0, color=OTHER, lw=0.8, zorder=0)
    top.set_ylabel(label(response, flown[0].units))
    bottom.set_ylabel("residual" + unit_label(response, flown[0].units))
    bottom.set_xlabel("time [s]" if len(flown) == 1 else "time, manoeuvres end to end [s]")
    top.legend(loc="best", fontsize="small", ncols=2)
    for ax in (top, bottom):
        ax.grid(alpha=0.25)
        ax.margins(x=0.0)
    return top, bottom


def plot_path(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Unexplained share of the response, 1 - R2, and PSE, after each move of the search."""
    ax = new_axes(ax)
    steps = [s for s in selection.trace if s.action != "refuse"]
    ax.set_title(f"{symbol(selection.response)}: the search, move by move", fontsize="medium")
    if not steps:
        ax.text(0.5, 0.5, "every size searched at once:\nno path to show", ha="center", va="center")
        ax.set_axis_off()
        return ax
    shown = steps[:_MOST_MOVES]
    x = np.arange(1, len(shown) + 1)
    ax.semilogy(x, [s.PSE for s in shown], "o-", color=DOUBT, ms=4, lw=1.0, label="PSE")
    ax.semilogy(x, [1.0 - s.R2 for s in shown], "o-", color=KEPT, ms=4, lw=1.0, label="$1 - R^2$")
    final = len(selection.terms)
    ends = [i for i, s in enumerate(shown, 1) if s.n_terms == final]
    if ends:
        ax.axvline(ends[-1], color=MODELLED, lw=0.8, ls="--", label=f"chosen: {final} terms")
    ax.xaxis.set_major_locator(FixedLocator(x.tolist()))
    marks = {"enter": "+", "leave": "−", "swap": "⇄", "simplify": "→"}
    size = "small" if len(shown) <= 12 else "xx-small"
    ax.set_xticklabels([f"{marks[s.action]} {s.term}" for s in shown], rotation=60, ha="right", fontsize=size)
    whose = "whitened " if selection.noise_models else ""
    ax.set_ylabel(f"share of the {whose}response's variance [-]")
    if len(shown) < len(steps):
        ax.set_xlabel(f"the first {len(shown)} of {len(steps)} moves")
    ax.grid(alpha=0.25, which="both")
    ax.legend(fontsize="small")
    return ax


def plot_criteria(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """PSE and R2 against the number of terms, the best model the search visited of each size.

    Returns
    -------
    Axes
        PSE on a logarithmic scale; R2 has a scale of its own to the right.
    """
    ax = new_axes(ax)
    ax.set_title(f"{symbol(selection.response)}: how many terms", fontsize="medium")
    visited = [s for s in selection.trace if s.action != "refuse"]
    if not visited:
        ax.text(0.5, 0.5, "every size searched at once:\nno path to show", ha="center", va="center")
        ax.set_axis_off()
        return ax
    best = {s.n_terms: s for s in sorted(visited, key=lambda s: -s.PSE)}
    sizes = sorted(best)
    right = ax.twinx()
    lines = ax.semilogy(sizes, [best[k].PSE for k in sizes], "o-", color=DOUBT, ms=4, lw=1.0, label="PSE")
    lines += right.plot(sizes, [best[k].R2 for k in sizes], "s-", color=KEPT, ms=4, lw=1.0, label="$R^2$")
    final = len(selection.terms)
    lines.append(ax.axvline(final, color=MODELLED, lw=0.8, ls="--", label=f"chosen: {final} terms"))
    whose = "whitened " if selection.noise_models else ""
    ax.set_xlabel("terms beside the constant")
    ax.set_ylabel(f"PSE over the {whose}response's variance [-]")
    right.set_ylabel("$R^2$ [-]")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.grid(alpha=0.25)
    ax.legend(handles=lines, fontsize="small", loc="center right")
    return ax


def plot_inclusion(selection: Selection, *, most: int = 15, ax: Axes | None = None) -> Axes:
    """Share of the resampled selections that kept each candidate; the model's own terms are coloured."""
    ax = new_axes(ax)
    ax.set_title(f"{symbol(selection.response)}: inclusion", fontsize="medium")
    kept = {str(term) for term in selection.terms}
    found = {name: share for name, share in selection.inclusion.items() if share > 0 or name in kept}
    if not found:
        ax.text(0.5, 0.5, "no bootstrap was made" if not selection.inclusion else "nothing kept", ha="center")
        ax.set_axis_off()
        return ax
    ranked = sorted(found, key=lambda name: (name in kept, found[name]), reverse=True)[:most]
    ax.barh(ranked, [found[name] for name in ranked], color=[KEPT if n in kept else OTHER for n in ranked], height=0.7)
    ax.axvline(0.5, color=DOUBT, lw=1.0, ls="--")
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("share of resampled selections [-]")
    if len(found) > len(ranked):
        ax.set_ylabel(f"{len(ranked)} of {len(found)} ever kept", fontsize="small")
    return ax


def plot_intervals(selection: Selection, *, level: float = 0.95, ax: Axes | None = None) -> Axes:
    """Intervals of the parameters, relative to their values; thin: what white residuals would claim."""
    ax = new_axes(ax)
    names = ["1", *map(str, selection.terms)]
    values = selection.values
    scale = np.where(values != 0.0, np.abs(values), 1.0)
    half = np.nan_to_num((selection.intervals(level)[:, 1] - values) / scale)  # an unknown error draws no bar
    textbook = stats.t.ppf(0.5 + level / 2, max(selection.dof, 1)) * selection.textbook_errors / scale
    y = np.arange(len(names))
    cut = half > _WIDEST
    ax.barh(y, 2 * np.minimum(half, _WIDEST), left=-np.minimum(half, _WIDEST), height=0.55, color=KEPT, alpha=0.45)
    ax.barh(y, 2 * np.minimum(textbook, _WIDEST), left=-np.minimum(textbook, _WIDEST), height=0.14, color=MEASURED)
    for place in y[cut]:
        ax.text(_WIDEST, place, f" ±{100 * half[place]:.0f} %", va="center", fontsize="x-small")
    ax.set_yticks(y, [f"{name} = {value:.3g}" for name, value in zip(names, values)])
    ax.invert_yaxis()
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    reach = 1.1 * float(min(half.max(), _WIDEST)) or 1.0
    ax.set_xlim(-reach, 1.35 * reach if cut.any() else reach)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.xaxis.set_major_formatter(lambda x, _: f"{100 * x:g} %")
    ax.set_xlabel(f"{100 * level:g} % interval about the value, relative to it")
    ax.set_title(f"{symbol(selection.response)}: intervals (thin: textbook)", fontsize="medium")
    ax.grid(alpha=0.25, axis="x")
    return ax


def plot_collinearity(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Correlation of the estimated parameters; the variance inflation factors stand beside the terms."""
    ax = new_axes(ax)
    names = [str(term) for term in selection.terms]
    ax.set_title(f"{symbol(selection.response)}: parameter correlation", fontsize="medium")
    if not names:
        ax.text(0.5, 0.5, "no terms kept", ha="center")
        ax.set_axis_off()
        return ax
    covariance = selection.covariance[1:, 1:]
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    R = covariance / np.outer(spread, spread)
    image = ax.imshow(R, vmin=-1, vmax=1, cmap="RdBu_r")
    size = "small" if len(names) <= 10 else "xx-small"
    ax.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=size)
    ax.set_yticks(range(len(names)), [f"{n}  (VIF {v:.3g})" for n, v in zip(names, selection.vif)], fontsize=size)
    if len(names) <= 10:
        for i, j in np.ndindex(*R.shape):
            colour = "white" if abs(R[i, j]) > 0.6 else "black"
            ax.text(j, i, f"{R[i, j]:.2f}", ha="center", va="center", fontsize="x-small", color=colour)
    ax.figure.colorbar(image, ax=ax, shrink=0.8, label="correlation [-]")
    return ax


def plot_autocorrelation(score: Score, *, ax: Axes | None = None) -> Axes:
    """Autocorrelation of the residual with the 95 % bound of white noise."""
    ax = new_axes(ax)
    rho = score.autocorrelation[1:]
    lags = np.arange(1, len(rho) + 1)
    ax.axhspan(-score.bound, score.bound, color=OTHER, alpha=0.5, lw=0, label="95 % of white noise")
    beyond = np.abs(rho) > score.bound
    ax.vlines(lags, 0.0, rho, colors=[MODELLED if b else KEPT for b in beyond], lw=2.0)
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
    """Residual against a channel, with the mean of each bin; a trend in the means is a term left out.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
    response : str
    channel : str
        Any that the recordings have, in the model or not.
    bins : int, optional
        They hold equal numbers of samples.
    ax : Axes, optional

    Returns
    -------
    Axes
        Bars are 95 % intervals of the means from the spread between recordings, or between stretches of few.
    """
    ax = new_axes(ax)
    flown = several(recordings)
    x = np.concatenate([r[channel] for r in flown])
    e = np.concatenate([r[response] - model.evaluate(r, outside="ignore")[response] for r in flown])
    draw_cloud(ax, x, e, flown, bins)
    ax.set_xlabel(label(channel, flown[0].units))
    ax.set_ylabel(f"residual of {symbol(response)}" + unit_label(response, flown[0].units))
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.legend(fontsize="small", loc="best")
    return ax


def draw_selection(selections: Selections, recordings: Sequence[Recording]) -> Iterator[tuple[str, Figure]]:
    """Figures of a selection: per response the fit, the choice, and what is left.

    Parameters
    ----------
    selections : Selections
    recordings : sequence of Recording
        Those selected from, or held out.

    Yields
    ------
    name : str
        ``CZ_fit``, ``CZ_choice``, ``CZ_residual``: a file's stem.
    figure : Figure
    """
    model = selections.model
    scores = validate(model, recordings)
    for response, selection in selections.items():
        stem = "".join(c if c.isalnum() else "_" for c in response)
        figure = Figure(figsize=(10, 5), layout="constrained")
        plot_fit(model, recordings, response, axes=figure.subplots(2, 1, sharex=True, height_ratios=(2, 1)))
        yield f"{stem}_fit", figure
        figure = Figure(figsize=(11, 8.5), layout="constrained")
        panels = figure.subplots(2, 2)
        plot_path(selection, ax=panels[0, 0])
        plot_inclusion(selection, ax=panels[0, 1])
        plot_intervals(selection, ax=panels[1, 0])
        plot_collinearity(selection, ax=panels[1, 1])
        yield f"{stem}_choice", figure
        used = {c for term in selection.terms for c in term.channels}
        channels = sorted(selection.pool.channels, key=lambda c: (c not in used, c))[:_MOST_CHANNELS]
        columns = min(3, len(channels) + 1)
        rows = -(-(len(channels) + 1) // columns)
        figure = Figure(figsize=(4.2 * columns, 3.4 * rows), layout="constrained")
        places = list(np.ravel(figure.subplots(rows, columns, squeeze=False)))
        plot_autocorrelation(scores.score(response), ax=places[0])
        for channel, place in zip(channels, places[1:]):
            plot_residual_against(model, recordings, response, channel, ax=place)
        for spare in places[len(channels) + 1 :]:
            spare.set_axis_off()
        yield f"{stem}_residual", figure
