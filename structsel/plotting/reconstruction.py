"""Figures of a reconstructed flight path: what was read, what surprised the filter, what it found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, MaxNLocator
from scipy import stats

from structsel.nomenclature import latex_of
from structsel.plotting.style import (
    DOUBT,
    KEPT,
    MEASURED,
    MODELLED,
    OTHER,
    label,
    new_axes,
    symbol,
    thin,
    unit_label,
)
from structsel.reconstruction import CONSTANTS, Reconstruction, Reconstructions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SYMBOLS = {
    **{f"b{name}": f"b_{{{latex_of(name)}}}" for name in ("ax", "ay", "az", "p", "q", "r")},
    **{"wn": "W_n", "we": "W_e", "wd": "W_d", "KV": "K_V"},
    **{"Cup": r"C_\mathrm{up}", "Calpha0": r"C_{\alpha_0}", "Csi": r"C_\mathrm{si}", "Cbeta0": r"C_{\beta_0}"},
}
_DOTS = "#858585"  # light enough for a line to stand out before a cloud of them
_NIS_SECONDS = 1.0  # of the running mean
_FURTHEST = 6.0  # standard deviations shown
_FINDING = 0.1  # share of the run whose wide bands do not set an axis
_MOST_NAMES = 20  # of manoeuvres under an axis


def plot_readings(result: Reconstruction, channel: str, *, axes: Any = None) -> tuple[Axes, Axes]:
    """Draw one instrument's readings, what it should have read, and the difference.

    Parameters
    ----------
    result : Reconstruction
    channel : str
        One of its measured channels.
    axes : pair of Axes, optional

    Returns
    -------
    top, bottom : Axes
        Below, the band is two standard deviations of the innovations to either side.
    """
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(2, 1, sharex=True, height_ratios=(2, 1), figsize=(8, 4.5), layout="constrained")
    top, bottom = axes
    t, keep = result.recording.t, thin(len(result.recording))
    told, left = result.readings[channel], result.residuals[channel]
    style = {"ls": "", "marker": ".", "color": _DOTS, "ms": 2.0}
    top.plot(t[keep], (told + left)[keep], label="measured", **style)
    top.plot(t[keep], told[keep], color=MODELLED, lw=1.1, label="reconstructed")
    bottom.plot(t[keep], left[keep], **style)
    there = np.isfinite(result.innovation_std[channel])
    half = 2.0 * np.interp(t, t[there], result.innovation_std[channel][there])
    bottom.fill_between(t[keep], -half[keep], half[keep], color=OTHER, alpha=0.5, lw=0, label="2 std of innovation")
    bottom.axhline(0.0, color=OTHER, lw=0.8, zorder=0)
    # The start is found from wide bands, which would hide all the rest.
    reach = 1.15 * max(float(np.nanmax(np.abs(left))), float(np.median(half)))
    bottom.set_ylim(-reach, reach)
    top.set_ylabel(label(channel))
    bottom.set_ylabel("residual" + unit_label(channel), fontsize="small")
    bottom.set_xlabel("time [s]")
    for ax in (top, bottom):
        ax.grid(alpha=0.25)
        ax.margins(x=0.0)
        ax.yaxis.set_major_locator(MaxNLocator(4 if ax is top else 3))
    return top, bottom


def plot_innovations(result: Reconstruction, channel: str, *, axes: Any = None) -> tuple[Axes, Axes]:
    """Draw one channel's normalised innovations with their 2-sigma bounds, and their autocorrelation.

    Parameters
    ----------
    result : Reconstruction
    channel : str
    axes : pair of Axes, optional

    Returns
    -------
    left, right : Axes
        A filter that is right leaves 95 % of the innovations inside two standard deviations, and 95 % of the
        autocorrelations inside their bound.
    """
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(1, 2, width_ratios=(2, 1), figsize=(9, 3), layout="constrained")
    left, right = axes
    t, found = result.recording.t, result.consistency[channel]
    e = result.innovations[channel] / result.innovation_std[channel]
    seen = np.flatnonzero(np.isfinite(e))
    shown = seen[thin(len(seen))]
    cut = np.clip(e[shown], -_FURTHEST, _FURTHEST)
    beyond = cut != e[shown]
    left.axhspan(-2.0, 2.0, color=OTHER, alpha=0.5, lw=0)
    left.plot(t[shown], cut, ".", ms=2.0, color=MEASURED)
    left.plot(t[shown][beyond], cut[beyond], "x", ms=4, color=MODELLED)
    left.set_ylim(-1.1 * _FURTHEST, 1.1 * _FURTHEST)
    left.set_xlim(t[0], t[-1])
    left.set_ylabel(symbol(channel))
    left.set_xlabel("time [s]")
    inside = 100.0 * float(np.mean(np.abs(e[seen]) <= 2.0))
    rejected = f", {found.rejected} rejected" if found.rejected else ""
    text = f"variance {found.variance:.2f}, {inside:.0f} % inside{rejected}"
    left.set_title(text, fontsize="x-small", loc="right", pad=2)
    rho = found.autocorrelation
    lags = np.arange(1, len(rho) + 1)
    right.axhspan(-found.bound, found.bound, color=OTHER, alpha=0.5, lw=0)
    right.vlines(lags, 0.0, rho, colors=[MODELLED if abs(r) > found.bound else KEPT for r in rho], lw=1.0)
    right.axhline(0.0, color=MEASURED, lw=0.8)
    right.set_ylim(min(-0.3, 1.1 * float(np.min(rho, initial=0.0))), 1.05)
    right.set_xlabel("lag [readings]")
    right.set_title(f"{100.0 * found.outside:.0f} % of lags outside", fontsize="x-small", loc="right", pad=2)
    return left, right


def plot_nis(result: Reconstruction, *, ax: Axes | None = None) -> Axes:
    """Draw the running mean square of all normalised innovations with its 95 % band: 1 is right."""
    ax = new_axes(ax)
    t = result.recording.t
    e = np.stack([result.innovations[c] / result.innovation_std[c] for c in result.innovations], axis=1)
    width = max(1, round(_NIS_SECONDS / result.recording.dt))
    window = np.ones(width)
    total = np.convolve(np.nansum(e**2, axis=1), window, "same")
    count = np.convolve(np.isfinite(e).sum(axis=1), window, "same")
    seen = count > 0.5
    low, high = (stats.chi2.ppf(p, count[seen]) / count[seen] for p in (0.025, 0.975))
    keep = thin(int(seen.sum()))
    time = t[seen][keep]
    ax.fill_between(time, low[keep], high[keep], color=OTHER, alpha=0.5, lw=0, label="95 % of a filter that is right")
    ax.plot(time, (total[seen] / count[seen])[keep], color=KEPT, lw=1.0, label=f"mean over {_NIS_SECONDS:g} s")
    ax.axhline(1.0, color=MEASURED, lw=0.8)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))
    ax.set_xlabel("time [s]")
    ax.set_ylabel("mean square of normalised innovations [-]")
    c = result.consistency
    title = f"NIS {c.nis:.3f} per reading; 95 % band {c.nis_band[0]:.3f} to {c.nis_band[1]:.3f}"
    ax.set_title(title, fontsize="medium")
    ax.grid(alpha=0.25, which="both")
    ax.margins(x=0.0)
    ax.legend(fontsize="small", loc="best")
    return ax


def plot_estimate(result: Reconstruction, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw a state as the filter came to know it, and as all samples together have it.

    Parameters
    ----------
    result : Reconstruction
    name : str
        One of its states: a bias, a wind, a vane's correction, or motion.
    ax : Axes, optional

    Returns
    -------
    Axes
        Bands are two standard deviations to either side.
    """
    ax = new_axes(ax)
    t, keep, j = result.recording.t, thin(len(result.recording)), result.states.index(name)
    running, half = result.filtered[:, j], 2.0 * result.filtered_std[:, j]
    smooth = result.estimates[:, j]
    sure = 2.0 * (result.std[name] if name in result.std else np.full(len(t), result[name].std))
    ax.fill_between(t[keep], (running - half)[keep], (running + half)[keep], color=OTHER, alpha=0.6, lw=0)
    ax.plot(t[keep], running[keep], color=MEASURED, lw=0.9, label="from the samples so far")
    ax.fill_between(t[keep], (smooth - sure)[keep], (smooth + sure)[keep], color=KEPT, alpha=0.3, lw=0)
    ax.plot(t[keep], smooth[keep], color=KEPT, lw=1.2, label="from all samples")
    later = slice(int(_FINDING * len(t)), None)
    low = min(float((running - half)[later].min()), float((smooth - sure).min()))
    high = max(float((running + half)[later].max()), float((smooth + sure).max()))
    if high > low:
        ax.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    ax.set_ylabel(_label(name))
    ax.set_xlabel("time [s]")
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.grid(alpha=0.25)
    ax.margins(x=0.0)
    return ax


def plot_constant(results: Sequence[Reconstruction] | Reconstructions, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw one constant, manoeuvre by manoeuvre, with intervals of two standard deviations to either side.

    Manoeuvres in which it was not estimated stay empty; crosses mark those that are not trusted, and the line is the
    mean of the others.
    """
    ax = new_axes(ax)
    flown = list(results)
    found = {i: c for i, one in enumerate(flown) for c in one.constants if c.name == name}
    for trusted, colour, mark, of in ((True, KEPT, "o", "trusted"), (False, DOUBT, "x", "not trusted")):
        mine = [i for i in found if flown[i].trusted is trusted]
        if not mine:
            continue
        values = [found[i].value for i in mine]
        error = [2.0 * found[i].std for i in mine]
        ax.errorbar(mine, values, error, fmt=mark, ms=4, lw=1.0, capsize=2, color=colour, label=of)
        if trusted:
            ax.axhline(float(np.mean(values)), color=KEPT, lw=0.8, ls="--")
    ax.axhline(0.0, color=OTHER, lw=0.8, zorder=0)
    ax.set_xlim(-0.6, len(flown) - 0.4)
    if len(flown) <= _MOST_NAMES:
        size = "small" if len(flown) <= 8 else "xx-small"
        ax.set_xticks(range(len(flown)), [one.name for one in flown], rotation=40, ha="right", fontsize=size)
    else:
        ax.set_xlabel("manoeuvre, in order")
    ax.set_ylabel(_label(name))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.grid(alpha=0.25, axis="y")
    return ax


def draw_reconstruction(result: Reconstruction) -> Iterator[tuple[str, Figure]]:
    """Figures of one reconstruction: readings, innovations, NIS, and the constants as they were found.

    Yields
    ------
    name : str
        ``readings``, ``innovations``, ``nis``, ``constants``: the end of a file's stem.
    figure : Figure
    """
    channels = [c.channel for c in result.consistency.channels]
    columns = 1 if len(channels) == 1 else 2
    rows = -(-len(channels) // columns)
    figure = Figure(figsize=(6.5 * columns, 2.6 * rows + 0.4), layout="constrained")
    cells = np.ravel(np.asarray(figure.subfigures(rows, columns, squeeze=False)))
    for i, (channel, cell) in enumerate(zip(channels, cells)):
        top, bottom = plot_readings(result, channel, axes=cell.subplots(2, 1, sharex=True, height_ratios=(2, 1)))
        if i == 0:
            top.legend(fontsize="small", loc="best", ncols=2, markerscale=4)
        if i + columns < len(channels):
            bottom.set_xlabel("")
    figure.suptitle(f"{_title(result)}; bands: 2 standard deviations of the innovations", fontsize="medium")
    yield "readings", figure

    figure = Figure(figsize=(10, 1.35 * len(channels) + 1.0), layout="constrained")
    grid = figure.subplots(len(channels), 2, sharex="col", width_ratios=(2, 1), squeeze=False)
    for channel, pair in zip(channels, grid):
        plot_innovations(result, channel, axes=pair)
        if channel != channels[-1]:
            for ax in pair:
                ax.set_xlabel("")
    figure.suptitle(f"{_title(result)}: normalised innovations [-], their autocorrelation [-]", fontsize="medium")
    yield "innovations", figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    plot_nis(result, ax=figure.add_subplot())
    figure.suptitle(_title(result), fontsize="medium")
    yield "nis", figure

    if result.constants:
        names = [constant.name for constant in result.constants]
        figure, places = _grid(len(names))
        for name, place in zip(names, places):
            plot_estimate(result, name, ax=place)
        places[0].legend(fontsize="small", loc="best")
        figure.suptitle(f"{_title(result)}: what was found; bands: 2 standard deviations", fontsize="medium")
        yield "constants", figure


def draw_reconstructions(results: Sequence[Reconstruction] | Reconstructions) -> Iterator[tuple[str, Figure]]:
    """Figures of several manoeuvres: those of each, its name before theirs, and the constants of all together.

    Yields
    ------
    name : str
        ``m01_readings``, ...; and ``constants`` where there are several manoeuvres.
    figure : Figure
    """
    flown = list(results)
    for one in flown:
        for name, figure in draw_reconstruction(one):
            yield f"{one.name}_{name}", figure
    names = [name for name in CONSTANTS if any(c.name == name for one in flown for c in one.constants)]
    if len(flown) > 1 and names:
        figure, places = _grid(len(names))
        for name, place in zip(names, places):
            plot_constant(flown, name, ax=place)
        places[0].legend(fontsize="small", loc="best")
        figure.suptitle("bars: 2 standard deviations; dashed: mean of those trusted", fontsize="medium")
        yield "constants", figure


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    columns = min(3, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 2.8 * rows + 0.4), layout="constrained")
    places = list(np.ravel(figure.subplots(rows, columns, squeeze=False)))
    for spare in places[count:]:
        spare.set_axis_off()
    return figure, places[:count]


def _title(result: Reconstruction) -> str:
    return f"{result.name}, {result.method}" + ("" if result.trusted else ": NOT TRUSTED")


def _label(name: str) -> str:
    return f"${_SYMBOLS[name]}$ [{CONSTANTS[name][1]}]" if name in CONSTANTS else label(name)
