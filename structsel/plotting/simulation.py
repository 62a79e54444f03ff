"""Figures of simulated flights: against what was recorded, by output and over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from structsel.plotting.style import DOUBT, KEPT, MEASURED, MODELLED, label, new_axes, thin
from structsel.recording import Recording
from structsel.refinement import Refinement
from structsel.validation import Resimulation
from structsel.validation.resimulate import window_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOTION = ("V", "alpha", "beta", "q", "p", "r", "theta", "phi", "h", "az", "ax", "ay")
_CONTROLS = ("de", "da", "dr", "df", "throttle", "thrust", "dlon")
_NAMED = 10  # lines a legend can name
_BEYOND = 1.5  # measured ranges above and below which a flight that parted is not shown


def plot_flight(flight: Recording, channel: str, *, recorded: Recording | None = None, ax: Axes | None = None) -> Axes:
    """Draw one channel of a simulated flight over time, and of the recording whose inputs it flew.

    Parameters
    ----------
    flight : Recording
    channel : str
    recorded : Recording, optional
    ax : Axes, optional
    """
    alone, ax = ax is None, new_axes(ax)
    if recorded is not None and channel in recorded:
        _line(ax, recorded, channel, MEASURED, "recorded")
        _line(ax, flight, channel, MODELLED, "simulated")
        _frame(ax, recorded[channel])
    else:
        _line(ax, flight, channel, KEPT, "simulated")
    ax.set_ylabel(label(channel, flight.units))
    return _explain(ax) if alone else ax


def plot_replay(result: Resimulation, recording: str, output: str, *, ax: Axes | None = None) -> Axes:
    """Draw one output as recorded, flown whole, and flown in windows, with its proof-of-match band.

    Parameters
    ----------
    result : Resimulation
    recording : str
        Its name.
    output : str
    ax : Axes, optional
    """
    alone, ax = ax is None, new_axes(ax)
    place = [r.name for r in result.recordings].index(recording)
    measured, whole, windows = (part[place] for part in (result.recordings, result.whole, result.windows))
    if output in result.bands:
        band, y, t = result.bands[output], measured[output], measured.t
        some = thin(len(t))
        ax.fill_between(t[some], (y - band)[some], (y + band)[some], color=MEASURED, alpha=0.15, lw=0, label="band")
    _line(ax, measured, output, MEASURED, "recorded", 2.2)
    for rows in window_rows(windows, result.window):
        ax.plot(windows.t[rows], windows[output][rows], color=DOUBT, lw=1.4)
    ax.plot([], [], color=DOUBT, lw=1.4, label=f"windows of {result.window:g} s")
    _line(ax, whole, output, MODELLED, "whole", 0.8)
    _frame(ax, measured[output])
    for one in result.divergences:
        if one.recording == recording and one.kind == "whole":
            ax.axvline(one.at, color=MODELLED, lw=0.8, ls=":")
    ax.set_ylabel(label(output, measured.units))
    return _explain(ax) if alone else ax


def draw_flight(flight: Recording, recorded: Recording | None = None) -> Figure:
    """Figure of a simulated flight: its motion, and the controls that made it."""
    names = [name for name in _MOTION if name in flight]
    moving = [name for name in _CONTROLS if name in flight and np.ptp(flight[name]) > 0.0]
    names = names or [name for name in flight.names if name not in moving][:12]
    figure, places = _grid(len(names) + len(moving))
    for name, ax in zip((*names, *moving), places):
        plot_flight(flight, name, recorded=recorded if name in names else None, ax=ax)
    figure.suptitle(flight.name, fontsize="medium")
    if recorded is not None:
        places[0].legend(fontsize="x-small")
    return figure


def draw_replay(result: Resimulation) -> Iterator[tuple[str, Figure]]:
    """Figures of a replay, one for each recording.

    Yields
    ------
    name : str
        Of the recording.
    figure : Figure
    """
    for recording in result.recordings:
        figure, places = _grid(len(result.outputs))
        for output, ax in zip(result.outputs, places):
            plot_replay(result, recording.name, output, ax=ax)
            whole, windows = (result.score(output, recording.name, kind).r2 for kind in ("whole", "windows"))
            ax.set_title(f"R2: whole {_r2(whole)}, windows {_r2(windows)}", fontsize="x-small")
        places[0].legend(fontsize="x-small")
        figure.suptitle(f"{result.model or 'model'} with the inputs of {recording.name}", fontsize="medium")
        yield recording.name, figure


def draw_refinement(result: Refinement, recordings: Sequence[Recording] = ()) -> Iterator[tuple[str, Figure]]:
    """Figures of a refinement: outputs of each recording measured and simulated, and the history of the search.

    Parameters
    ----------
    result : Refinement
    recordings : sequence of Recording
        Those it was made of.

    Yields
    ------
    name : str
        Of the recording; ``history``.
    figure : Figure
    """
    outputs = list(result.noise_std)
    verdict = "" if result.converged else ": NOT CONVERGED"
    for flight in result.simulated:
        figure, places = _grid(len(outputs))
        fits = {fit.output: fit for fit in result.fits if fit.recording == flight.name}
        for output, ax in zip(outputs, places):
            for recording in recordings:
                if recording.name == flight.name:
                    _line(ax, recording, output, MEASURED, "recorded", 1.8)
            _line(ax, flight, output, MODELLED, "refined")
            ax.set_ylabel(label(output, flight.units))
            ax.set_title(f"R2 {_r2(fits[output].r2)}", fontsize="x-small")
        places[0].legend(fontsize="x-small")
        figure.suptitle(f"{flight.name}{verdict}", fontsize="medium")
        yield flight.name, figure
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(np.arange(len(result.costs)), result.costs, "o-", ms=3, color=KEPT)
    left.set_xlabel("step")
    left.set_ylabel(f"cost, {result.cost}")
    sizes = np.where(result.std > 0.0, result.std, np.nan)
    with np.errstate(invalid="ignore"):
        lines = right.plot(np.arange(len(result.costs)), (result.thetas - result.values) / sizes, lw=0.9)
    if len(lines) <= _NAMED:
        right.legend(lines, result.names, fontsize="x-small")
    right.set_xlabel("step")
    right.set_ylabel("parameters less their estimates, in std")
    right.set_yscale("symlog", linthresh=1.0)
    figure.suptitle(f"descent of {len(result.names)} parameters{verdict}", fontsize="medium")
    yield "history", figure


def _line(ax: Axes, recording: Recording, channel: str, colour: str, text: str, wide: float = 0.9) -> None:
    some = thin(len(recording))
    ax.plot(recording.t[some], recording[channel][some], color=colour, lw=wide, label=text)


def _explain(ax: Axes) -> Axes:
    """Label the time and name the lines of a figure that stands alone; in a grid this is said once."""
    ax.set_xlabel("t [s]")
    ax.legend(fontsize="small")
    return ax


def _frame(ax: Axes, measured: np.ndarray) -> None:
    """Keep a flight that grows without bound from hiding the recorded one."""
    seen = measured[np.isfinite(measured)]
    if len(seen) and (reach := float(np.ptp(seen))) > 0.0:
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, seen.min() - _BEYOND * reach), min(high, seen.max() + _BEYOND * reach))


def _r2(value: float) -> str:
    return f"{value:.3f}" if abs(value) < 10.0 else "-" if np.isnan(value) else f"{value:.1e}"


def _grid(count: int) -> tuple[Figure, Sequence[Axes]]:
    columns = min(3, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 2.0 * rows + 0.5), layout="constrained")
    places = list(np.ravel(figure.subplots(rows, columns, squeeze=False, sharex=True)))
    for spare in places[count:]:
        spare.set_axis_off()
    for ax in places[max(count - columns, 0) : count]:
        ax.set_xlabel("t [s]")
        ax.tick_params(labelbottom=True)
    return figure, places[:count]
