"""Bode plots: magnitude, phase and coherence over frequency, with random errors and fitted transfer functions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator

from structsel.frequency_domain import FrequencyResponse, TransferFunction
from structsel.frequency_domain.frequency_response import USABLE
from structsel.numerics.transfer_functions import DB, DEG
from structsel.plotting.style import (
    MEASURED,
    MODEL,
    SECONDARY,
    SELECTED,
    add_grid,
    get_several_axes,
    symbol,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FREQUENCY = "frequency [rad/s]"
_TWO_SIDED = 1.96  # standard deviations of a 95 % interval
_LEAST_SLACK = {DB: 3.0, DEG: 20.0}  # above and below the usable response, dB and deg; chosen, not critical
_LARGEST = 0.5  # relative error beyond which a band would hide everything; chosen, not critical


def plot_bode(
    response: FrequencyResponse,
    output: str | None = None,
    given: str | None = None,
    *,
    fit: TransferFunction | None = None,
    ax: Any = None,
) -> tuple[Axes, Axes, Axes]:
    """Draw magnitude, phase and coherence of one response, with 95 % bands of the random error.

    Parameters
    ----------
    response : FrequencyResponse
    output, given : str, optional
        Output and input; by default the first.
    fit : TransferFunction, optional
        Drawn over the frequencies to which it was fitted.
    ax : Figure, SubFigure or three Axes, optional

    Returns
    -------
    tuple of Axes
        Magnitude [dB of the displayed units], phase [deg], coherence. Where the coherence is below 0.6 the response is
        drawn in grey, and no band where the random error is above one half.

    Raises
    ------
    ChannelError
        There is no such response.
    """
    output, given = output or response.outputs[0], given or response.inputs[0]
    o, i = response.places(output, given)
    axes = get_several_axes(ax, 3, 1, figsize=(6.5, 6.5), sharex=True, height_ratios=(2.0, 2.0, 1.0))
    omega, error = response.omega, response.random_error[:, o, i]
    coherence = response.coherence[:, o, i]
    band = np.where(error < _LARGEST, _TWO_SIDED * error, np.nan)
    factor, unit = response.display_factor(output, given)
    values = (response.magnitude_db(output, given), response.phase_deg(output, given))
    for place, y, per in zip(axes[:2], values, (DB, DEG)):
        place.fill_between(omega, y - per * band, y + per * band, color=SELECTED, alpha=0.25, lw=0, label="95 % band")
        place.plot(omega, y, color=SECONDARY, lw=1.0)
        good = y[coherence >= USABLE]
        if good.size:
            slack = max(0.15 * float(np.ptp(good)), _LEAST_SLACK[per])
            place.set_ylim(good.min() - slack, good.max() + slack)
        place.plot(omega, np.where(coherence >= USABLE, y, np.nan), color=SELECTED, lw=1.4, label="recorded")
    if fit is not None and (output, given) in fit.pairs:
        _draw_fit(axes, response, fit, (output, given), factor, values[1])
    axes[2].plot(omega, coherence, color=SELECTED, lw=1.2)
    axes[2].axhline(USABLE, color=MEASURED, lw=0.8, ls=":")
    axes[2].set_ylim(0.0, 1.02)
    name = f"{symbol(output)}/{symbol(given)}"
    axes[0].set_ylabel(f"{name} [dB of {unit}]" if unit else f"{name} [dB]")
    axes[1].set_ylabel("phase [deg]")
    axes[1].yaxis.set_major_locator(MultipleLocator(_phase_step(axes[1])))
    axes[2].set_ylabel("partial coherence" if len(response.inputs) > 1 else "coherence")
    axes[2].set_xscale("log")
    axes[2].xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes[2].xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes[2].set_xlabel(FREQUENCY)
    axes[2].set_xlim(omega[0], omega[-1])
    for place in axes:
        add_grid(place)
    axes[0].legend(fontsize="x-small")
    return axes[0], axes[1], axes[2]


def _draw_fit(
    axes: tuple[Axes, ...],
    response: FrequencyResponse,
    fit: TransferFunction,
    pair: tuple[str, str],
    factor: float,
    phase: np.ndarray,
) -> None:
    """Draw a fitted transfer function; its phase has the turn of the recorded one."""
    low, high = fit.bands[fit.pairs.index(pair)]
    omega = np.geomspace(low, high, 200)
    value = fit.evaluate(omega, pair)
    angle = DEG * np.unwrap(np.angle(value))
    recorded = np.interp(np.log(omega), np.log(response.omega), phase)
    angle = angle + 360.0 * np.round(np.median(recorded - angle) / 360.0)
    for place, y in zip(axes, (DB * np.log(factor * np.abs(value)), angle)):
        place.plot(omega, y, color=MODEL, lw=1.2, ls="--", label="fitted")


def plot_transfer_function(
    fit: TransferFunction, output: str | None = None, given: str | None = None, *, ax: Any = None
) -> tuple[Axes, Axes]:
    """Draw magnitude and phase of a fitted transfer function over the frequencies to which it was fitted.

    Parameters
    ----------
    fit : TransferFunction
    output, given : str, optional
        Output and input; by default the first pair.
    ax : two Axes, Figure or SubFigure, optional

    Returns
    -------
    magnitude, phase : Axes
    """
    first, second = fit.pairs[0]
    pair = (output or first, given or second)
    axes = get_several_axes(ax, 2, 1, figsize=(6.5, 5.0), sharex=True)
    low, high = fit.bands[fit.pairs.index(pair)]
    omega = np.geomspace(low, high, 200)
    value = fit.evaluate(omega, pair)
    for place, y in zip(axes, (DB * np.log(np.abs(value)), DEG * np.unwrap(np.angle(value)))):
        place.semilogx(omega, y, color=MODEL, lw=1.2)
        add_grid(place, minor=True)
    axes[0].set_ylabel(f"{symbol(pair[0])}/{symbol(pair[1])} [dB, SI]")
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_xlabel(FREQUENCY)
    return axes[0], axes[1]


def _phase_step(ax: Axes) -> float:
    """Spacing of the ticks of a phase axis [deg]."""
    low, high = ax.get_ylim()
    return next((step for step in (15.0, 30.0, 45.0, 90.0, 180.0, 360.0) if (high - low) / step <= 7.0), 720.0)


def draw_frequency_response(
    response: FrequencyResponse, fit: TransferFunction | None = None
) -> Iterator[tuple[str, Figure]]:
    """Bode plots of all responses.

    Yields
    ------
    name : str
        Output and input, such as ``"q_de"``.
    figure : Figure
    """
    from matplotlib.figure import Figure as NewFigure

    for output, given in response.pairs:
        figure = NewFigure(figsize=(6.5, 6.5), layout="constrained")
        plot_bode(response, output, given, fit=fit, ax=figure)
        figure.suptitle(f"{symbol(output)} to {symbol(given)}", fontsize="medium")
        yield f"{output}_{given}", figure
