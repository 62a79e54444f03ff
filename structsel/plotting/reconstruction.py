"""Figures of a reconstructed flight path: measurements, innovations, and estimates of the sensor errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, MaxNLocator

from structsel.deprecation import renamed_arguments
from structsel.nomenclature import latex_of
from structsel.plotting.style import (
    GREY,
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SECONDARY,
    SELECTED,
    TIME,
    add_grid,
    decimate,
    get_axes,
    get_several_axes,
    grid_figure,
    grid_shape,
    label,
    name_manoeuvres,
    scale,
    symbol,
)
from structsel.reconstruction import CONSTANTS, Reconstruction, Reconstructions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SYMBOLS = {
    **{f"b{name}": f"b_{{{latex_of(name)}}}" for name in ("ax", "ay", "az", "p", "q", "r")},
    **{"wn": "W_n", "we": "W_e", "wd": "W_d", "KV": "K_V", "Kphi": r"K_\phi", "Ktheta": r"K_\theta"},
    **{f"K{name}": f"K_{{{latex_of(name)}}}" for name in ("ax", "ay", "az", "p", "q", "r")},
    **{"Cup": r"C_\mathrm{up}", "Calpha0": r"C_{\alpha_0}", "Csi": r"C_\mathrm{si}", "Cbeta0": r"C_{\beta_0}"},
}
_NIS_SECONDS = 1.0  # of the running mean
_CLIP_SIGMA = 6.0  # standard deviations shown
_START_UP_FRACTION = 0.1  # of the run, whose wide bands do not set an axis


@renamed_arguments(axes="ax")
def plot_readings(result: Reconstruction, channel: str, *, ax: Any = None) -> tuple[Axes, Axes]:
    """Draw the measurements of one channel, the reconstruction, and the residual.

    Parameters
    ----------
    result : Reconstruction
    channel : str
        One of its measured channels.
    ax : pair of Axes, Figure or SubFigure, optional

    Returns
    -------
    top, bottom : Axes
        In the lower one, the band is two standard deviations of the innovations to either side. Angles are in degrees.
    """
    options = {"sharex": True, "height_ratios": (2, 1)}
    top, bottom = get_several_axes(ax, 2, 1, figsize=(8.0, 4.5), **options)
    t, some, factor = result.recording.t, decimate(len(result.recording)), scale(channel)
    reconstructed, residual = factor * result.readings[channel], factor * result.residuals[channel]
    style: dict[str, Any] = {"ls": "", "marker": ".", "color": GREY, "ms": 2.0}
    top.plot(t[some], (reconstructed + residual)[some], label="measured", **style)
    top.plot(t[some], reconstructed[some], color=MODEL, lw=1.1, label="reconstructed")
    bottom.plot(t[some], residual[some], **style)
    std = factor * result.innovation_std[channel]
    there = np.isfinite(std)
    half = 2.0 * np.interp(t, t[there], std[there])
    bottom.fill_between(t[some], -half[some], half[some], color=SECONDARY, alpha=0.5, lw=0, label="2 std of innovation")
    bottom.axhline(0.0, color=SECONDARY, lw=0.8, zorder=0)
    # The bands are wide while the filter converges; they must not set the axis.
    limit = 1.15 * max(float(np.nanmax(np.abs(residual))), float(np.median(half)))
    bottom.set_ylim(-limit, limit)
    top.set_ylabel(label(channel))
    bottom.set_ylabel(label(channel, text="residual"), fontsize="small")
    bottom.set_xlabel(TIME)
    for one in (top, bottom):
        add_grid(one)
        one.margins(x=0.0)
        one.yaxis.set_major_locator(MaxNLocator(4 if one is top else 3))
    return top, bottom


@renamed_arguments(axes="ax")
def plot_innovations(result: Reconstruction, channel: str, *, ax: Any = None) -> tuple[Axes, Axes]:
    """Draw the normalised innovations of one channel with their 2-sigma limits, and their autocorrelation.

    Parameters
    ----------
    result : Reconstruction
    channel : str
    ax : pair of Axes, Figure or SubFigure, optional

    Returns
    -------
    left, right : Axes
        If the filter's model is correct, 95 % of the innovations are within two standard deviations, and 95 % of the
        autocorrelations within their limits.
    """
    left, right = get_several_axes(ax, 1, 2, figsize=(9.0, 3.0), width_ratios=(2, 1))
    t, found = result.recording.t, result.consistency[channel]
    e = result.innovations[channel] / result.innovation_std[channel]
    known = np.flatnonzero(np.isfinite(e))
    shown = known[decimate(len(known))]
    clipped = np.clip(e[shown], -_CLIP_SIGMA, _CLIP_SIGMA)
    outside = clipped != e[shown]
    left.axhspan(-2.0, 2.0, color=SECONDARY, alpha=0.5, lw=0)
    left.plot(t[shown], clipped, ".", ms=2.0, color=MEASURED)
    left.plot(t[shown][outside], clipped[outside], "x", ms=4, color=MODEL)
    left.set_ylim(-1.1 * _CLIP_SIGMA, 1.1 * _CLIP_SIGMA)
    left.set_xlim(t[0], t[-1])
    left.set_ylabel(symbol(channel))
    left.set_xlabel(TIME)
    inside = 100.0 * float(np.mean(np.abs(e[known]) <= 2.0))
    rejected = f", {found.rejected} rejected" if found.rejected else ""
    text = f"variance {found.variance:.2f}, {inside:.0f} % inside{rejected}"
    left.set_title(text, fontsize="x-small", loc="right", pad=2)
    rho = found.autocorrelation
    lags = np.arange(1, len(rho) + 1)
    right.axhspan(-found.bound, found.bound, color=SECONDARY, alpha=0.5, lw=0)
    right.vlines(lags, 0.0, rho, colors=[MODEL if abs(r) > found.bound else SELECTED for r in rho], lw=1.0)
    right.axhline(0.0, color=MEASURED, lw=0.8)
    right.set_ylim(min(-0.3, 1.1 * float(np.min(rho, initial=0.0))), 1.05)
    right.set_xlabel("lag [samples]")
    right.set_title(f"{100.0 * found.outside:.0f} % of lags outside", fontsize="x-small", loc="right", pad=2)
    return left, right


def plot_nis(result: Reconstruction, *, ax: Axes | None = None) -> Axes:
    """Draw the running mean of the squared normalised innovations with its 95 % band; the expected value is 1."""
    ax = get_axes(ax)
    t = result.recording.t
    e = np.stack([result.innovations[c] / result.innovation_std[c] for c in result.innovations], axis=1)
    width = max(1, round(_NIS_SECONDS / result.recording.dt))
    window = np.ones(width)
    total = np.convolve(np.nansum(e**2, axis=1), window, "same")
    count = np.convolve(np.isfinite(e).sum(axis=1), window, "same")
    known = count > 0.5
    low, high = (scipy.stats.chi2.ppf(p, count[known]) / count[known] for p in (0.025, 0.975))
    some = decimate(int(known.sum()))
    time = t[known][some]
    text = "95 % band of a correct filter model"
    ax.fill_between(time, low[some], high[some], color=SECONDARY, alpha=0.5, lw=0, label=text)
    mean = total[known] / count[known]
    ax.plot(time, mean[some], color=SELECTED, lw=1.0, label=f"mean over {_NIS_SECONDS:g} s")
    ax.axhline(1.0, color=MEASURED, lw=0.8)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))
    ax.set_xlabel(TIME)
    ax.set_ylabel("mean square of normalised innovations [-]")
    c = result.consistency
    title = f"NIS {c.nis:.3f}; 95 % band {c.nis_band[0]:.3f} to {c.nis_band[1]:.3f}"
    ax.set_title(title, fontsize="medium")
    add_grid(ax, minor=True)
    ax.margins(x=0.0)
    ax.legend(fontsize="small", loc="best")
    return ax


def plot_estimate(result: Reconstruction, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw the estimate of a state over time, by the filter and by the smoother.

    Parameters
    ----------
    result : Reconstruction
    name : str
        One of its states: a bias, a wind component, a vane correction, or motion.
    ax : Axes, optional

    Returns
    -------
    Axes
        Bands are two standard deviations to either side. Angles are in degrees.
    """
    ax = get_axes(ax)
    t, some, j = result.recording.t, decimate(len(result.recording)), result.states.index(name)
    factor = scale(name, _units(name))
    filtered, filtered_half = factor * result.filtered[:, j], 2.0 * factor * result.filtered_std[:, j]
    smooth = factor * result.estimates[:, j]
    std = result.std[name] if name in result.std else np.full(len(t), result[name].std)
    half = 2.0 * factor * std
    for values, width, colour, alpha in (
        (filtered, filtered_half, SECONDARY, 0.6),
        (smooth, half, SELECTED, 0.3),
    ):
        ax.fill_between(t[some], (values - width)[some], (values + width)[some], color=colour, alpha=alpha, lw=0)
    ax.plot(t[some], filtered[some], color=MEASURED, lw=0.9, label="filter: samples so far")
    ax.plot(t[some], smooth[some], color=SELECTED, lw=1.2, label="smoother: all samples")
    later = slice(int(_START_UP_FRACTION * len(t)), None)
    low = min(float((filtered - filtered_half)[later].min()), float((smooth - half).min()))
    high = max(float((filtered + filtered_half)[later].max()), float((smooth + half).max()))
    if high > low:
        ax.set_ylim(low - 0.1 * (high - low), high + 0.1 * (high - low))
    ax.set_ylabel(_label(name))
    ax.set_xlabel(TIME)
    ax.yaxis.set_major_locator(MaxNLocator(5))
    add_grid(ax)
    ax.margins(x=0.0)
    return ax


def plot_constant(results: Sequence[Reconstruction] | Reconstructions, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw the estimate of one constant from each manoeuvre, with intervals of two standard deviations.

    A manoeuvre that did not estimate the constant has no point. Crosses are manoeuvres that are not trusted; the line
    is the mean of the others. Angles are in degrees.
    """
    ax = get_axes(ax)
    every = list(results)
    factor = scale(name, _units(name))
    found = {i: c for i, one in enumerate(every) for c in one.constants if c.name == name}
    for trusted, colour, mark, text in ((True, SELECTED, "o", "trusted"), (False, HIGHLIGHT, "x", "not trusted")):
        mine = [i for i in found if every[i].trusted is trusted]
        if not mine:
            continue
        values = [factor * found[i].value for i in mine]
        half = [2.0 * factor * found[i].std for i in mine]
        ax.errorbar(mine, values, half, fmt=mark, ms=4, lw=1.0, capsize=2, color=colour, label=text)
        if trusted:
            ax.axhline(float(np.mean(values)), color=SELECTED, lw=0.8, ls="--")
    ax.axhline(0.0, color=SECONDARY, lw=0.8, zorder=0)
    name_manoeuvres(ax, [one.name for one in every])
    ax.set_ylabel(_label(name))
    return ax


def draw_reconstruction(result: Reconstruction) -> Iterator[tuple[str, Figure]]:
    """Figures of one reconstruction: measurements, innovations, NIS, and constants.

    Yields
    ------
    name : str
        ``readings``, ``innovations``, ``nis``, ``constants``: end of the stem of a file name.
    figure : Figure
    """
    channels = [c.channel for c in result.consistency.channels]
    rows, columns = grid_shape(len(channels), 2)
    figure = Figure(figsize=(6.5 * columns, 2.6 * rows + 0.4), layout="constrained")
    cells = np.ravel(np.asarray(figure.subfigures(rows, columns, squeeze=False)))
    for i, (channel, cell) in enumerate(zip(channels, cells)):
        top, bottom = plot_readings(result, channel, ax=cell)
        if i == 0:
            top.legend(fontsize="small", loc="best", ncols=2, markerscale=4)
        if i + columns < len(channels):
            bottom.set_xlabel("")
    figure.suptitle(f"{_title(result)}; bands: 2 standard deviations of the innovations", fontsize="medium")
    yield "readings", figure

    figure = Figure(figsize=(10, 1.35 * len(channels) + 1.0), layout="constrained")
    grid = figure.subplots(len(channels), 2, sharex="col", width_ratios=(2, 1), squeeze=False)
    for channel, pair in zip(channels, grid):
        plot_innovations(result, channel, ax=pair)
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
        figure, axes = grid_figure(len(names), height=2.8)
        for name, ax in zip(names, axes):
            plot_estimate(result, name, ax=ax)
        axes[0].legend(fontsize="small", loc="best")
        figure.suptitle(f"{_title(result)}: constants; bands: 2 standard deviations", fontsize="medium")
        yield "constants", figure


def draw_reconstructions(results: Sequence[Reconstruction] | Reconstructions) -> Iterator[tuple[str, Figure]]:
    """Figures of several manoeuvres: those of each manoeuvre, and the constants of all.

    Yields
    ------
    name : str
        ``m01_readings``, ...; and ``constants`` if there are several manoeuvres.
    figure : Figure
    """
    every = list(results)
    for one in every:
        for name, figure in draw_reconstruction(one):
            yield f"{one.name}_{name}", figure
    names = [name for name in CONSTANTS if any(c.name == name for one in every for c in one.constants)]
    if len(every) > 1 and names:
        figure, axes = grid_figure(len(names), height=2.8)
        for name, ax in zip(names, axes):
            plot_constant(every, name, ax=ax)
        axes[0].legend(fontsize="small", loc="best")
        figure.suptitle("bars: 2 standard deviations; dashed: mean of the trusted manoeuvres", fontsize="medium")
        yield "constants", figure


def _title(result: Reconstruction) -> str:
    return f"{result.name}, {result.method}" + ("" if result.trusted else f": {result.verdict}")


def _units(name: str) -> dict[str, str]:
    """Unit of a constant."""
    return {name: CONSTANTS[name][1]} if name in CONSTANTS else {}


def _label(name: str) -> str:
    return label(name, _units(name), text=f"${_SYMBOLS[name]}$" if name in CONSTANTS else "")
