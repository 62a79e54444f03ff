"""Figures of diagnoses: where recordings and simulation differ, and how much the effects that were found explain."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.diagnosis.result import Diagnosis, EffectFinding
from structsel.diagnosis.views import (
    acting_range,
    bin_residuals,
    driving_channel,
    main_recording,
    shown_responses,
    shown_stages,
    simulated,
    unit_shown,
    worth_showing,
)
from structsel.errors import DataError
from structsel.formatting import format_decimals, format_percent
from structsel.plotting.style import (
    FINDINGS,
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SECONDARY,
    SELECTED,
    TIME,
    decimate,
    get_axes,
    label,
    scale,
    symbol,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STAGES = {"delivered": "as given", "refitted": "retuned within tolerances", "physics": "with the effects found"}
_COLOURS = {"delivered": MODEL, "refitted": HIGHLIGHT, "physics": SELECTED}
_BAR = 0.26  # of the distance between groups
_HEADROOM = 1.3  # above the highest bar, for the legend
_MARGIN = 0.03


def plot_time_history(diagnosis: Diagnosis, *, recording: str = "", response: str = "", ax: Axes | None = None) -> Axes:
    """Draw one response of one recording, measured and simulated; the intervals of each finding are shaded.

    Parameters
    ----------
    diagnosis : Diagnosis
    recording : str, optional
        By default the one in which the first finding acts longest, or that of its event.
    response : str, optional
        By default the one in which the first finding is clearest.
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees.

    Raises
    ------
    DataError
        The diagnosis has no such time history.
    """
    name = recording or _shown_recording(diagnosis)
    response = _response(diagnosis, response, None)
    if name not in diagnosis.traces:
        raise DataError(f"the diagnosis has no time history of '{name}'; it has {_list(diagnosis.traces)}.")
    trace = diagnosis.traces[name]
    ax = get_axes(ax)
    units = {response: unit_shown(response)}
    factor, some = scale(response, units), decimate(len(trace.t))
    ax.plot(trace.t[some], factor * trace.measured[response][some], color=MEASURED, lw=2.2, label="measured")
    for stage in _first_and_last(diagnosis):
        values = factor * simulated(trace, stage)[response][some]
        ax.plot(trace.t[some], values, color=_COLOURS[stage], lw=0.9, label=_STAGES[stage])
    for k, finding in enumerate(diagnosis.findings):
        for i, (start, end) in enumerate(finding.intervals.get(name, ())):
            shade = FINDINGS[k % len(FINDINGS)]
            ax.axvspan(start, end, color=shade, alpha=0.18, lw=0, label=None if i else finding.effect)
        for event in finding.events:
            if event.recording == name:
                ax.axvline(event.t, color=FINDINGS[k % len(FINDINGS)], ls="--", lw=1.0, label=finding.effect)
    ax.set_xlabel(TIME)
    ax.set_ylabel(label(response, units))
    ax.set_title(name, fontsize="small")
    ax.legend(fontsize="x-small")
    return ax


def plot_difference_against(
    diagnosis: Diagnosis, *, finding: int = 0, response: str = "", channel: str = "", ax: Axes | None = None
) -> Axes:
    """Draw measured minus simulated response over the channel on which an effect depends, without and with the effect.

    Parameters
    ----------
    diagnosis : Diagnosis
    finding : int, optional
        Index of the finding.
    response : str, optional
        By default the one in which the finding is clearest.
    channel : str, optional
        By default a channel that bounds the effect, one in its terms, or the one on which the differences depend most.
    ax : Axes, optional

    Returns
    -------
    Axes
        Dots are samples; bin means have 95 % intervals from the scatter between recordings. The region in which the
        effect acts is shaded. Angles are in degrees.

    Raises
    ------
    DataError
        There is no such finding, response or channel.
    """
    effect = _finding(diagnosis, finding)
    response = _response(diagnosis, response, effect)
    channel = channel or driving_channel(diagnosis, effect)
    traces = list(diagnosis.traces.values())
    if not channel or any(channel not in one.channels for one in traces):
        raise DataError(f"the diagnosis has no time history of channel '{channel}' in every recording.")
    ax = get_axes(ax)
    units = {name: unit_shown(name) for name in (channel, response)}
    along, factor = scale(channel, units), scale(response, units)
    acts = acting_range(diagnosis, effect, channel)
    binned = bin_residuals(diagnosis, response, channel, acts)
    x = np.concatenate([one.channels[channel] for one in traces])
    some = decimate(4 * len(x))
    for stage in _first_and_last(diagnosis):
        difference = np.concatenate([one.measured[response] - simulated(one, stage)[response] for one in traces])
        style: dict[str, Any] = {"color": _COLOURS[stage], "alpha": 0.2, "mew": 0, "ms": 3}
        ax.plot(along * x[some], factor * difference[some], ".", rasterized=True, **style)
        half = np.nan_to_num(factor * binned.half[stage])
        ax.errorbar(along * binned.at, factor * binned.means[stage], yerr=half, fmt="o-", ms=4, lw=1.2, capsize=2,
                    color=_COLOURS[stage], label=_STAGES[stage])  # fmt: skip
    if (region := effect.region.get(channel)) is not None:
        low, high = along * region[0], along * region[1]
        ax.axvspan(low, high, color=SECONDARY, alpha=0.3, lw=0, label=effect.effect, zorder=0)
    ax.axhline(0.0, color=MEASURED, lw=0.6)
    low, high = (along * end for end in worth_showing(x, acts))
    ax.set_xlim(low - _MARGIN * (high - low), high + _MARGIN * (high - low))
    ax.set_xlabel(label(channel, units))
    ax.set_ylabel(label(response, units, text=f"measured minus simulated {symbol(response)}"))
    ax.legend(fontsize="x-small")
    return ax


def plot_error_by_stage(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """Draw the error of each response in validation: as given, retuned within tolerances, with the effects found.

    Where no finding was added to the simulation, the first two.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes, optional

    Returns
    -------
    Axes
        RRMSE: rms error over the rms of the measured response, on recordings that were not used for fitting.

    Raises
    ------
    DataError
        The diagnosis has no finding.
    """
    bars = _finding(diagnosis, -1).bars
    ax = get_axes(ax)
    names = list(bars)
    stages = shown_stages(diagnosis)
    for k, stage in enumerate(stages):
        heights = [getattr(bars[c], stage).rrmse for c in names]
        at = np.arange(len(names)) + (k - 0.5 * (len(stages) - 1)) * _BAR
        drawn = ax.bar(at, heights, 0.9 * _BAR, color=_COLOURS[stage], label=_STAGES[stage])
        ax.bar_label(drawn, [format_decimals(h, 2) for h in heights], fontsize="xx-small", padding=1)
    ax.set_xticks(np.arange(len(names)), [symbol(c) for c in names])
    ax.set_ylim(0.0, _HEADROOM * ax.get_ylim()[1])
    ax.set_ylabel("RRMSE in validation [-]")
    ax.legend(fontsize="x-small")
    return ax


def plot_explained(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """Draw the fraction of the difference's variance that the findings explain, and the fraction that is explainable.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes, optional

    Returns
    -------
    Axes
        A bar is the fraction that one finding and those before it explain, in the responses in which the finding shows.
        The mark is the fraction that a regression on all recorded channels explains there.

    Raises
    ------
    DataError
        The diagnosis has no finding.
    """
    _finding(diagnosis, 0)
    ax = get_axes(ax)
    rows = np.arange(len(diagnosis.findings))
    explained = np.array([f.explained for f in diagnosis.findings])
    explainable = np.array([f.explainable for f in diagnosis.findings])
    colours = [FINDINGS[k % len(FINDINGS)] for k in rows]
    drawn = ax.barh(rows, 100.0 * np.nan_to_num(explained), 0.5, color=colours)
    ax.bar_label(drawn, list(map(format_percent, explained)), label_type="center", color="white", fontsize="small")
    ax.plot(100.0 * explainable, rows, "D", ms=7, mec="white", color=MEASURED, label="regression on all channels")
    ax.legend(fontsize="x-small", loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    ax.set_yticks(rows, [f"{k + 1}. {f.effect}\nin {', '.join(f.axes)}" for k, f in enumerate(diagnosis.findings)])
    ax.invert_yaxis()
    ax.set_xlim(0.0, 100.0)
    ax.set_xlabel("explained variance of the difference in validation [%]")
    return ax


def _finding(diagnosis: Diagnosis, place: int) -> EffectFinding:
    if not diagnosis.findings:
        raise DataError(f"there is nothing to draw: the diagnosis is '{diagnosis.verdict}' and has no finding.")
    if place >= len(diagnosis.findings):
        raise DataError(f"there is no finding {place}; the diagnosis has {len(diagnosis.findings)}, from 0 on.")
    return diagnosis.findings[place]


def _response(diagnosis: Diagnosis, response: str, finding: EffectFinding | None) -> str:
    """Response that was requested, or the clearest one of a finding or of all."""
    have = shown_responses(diagnosis)
    first = [c for c in (finding.axes if finding is not None else ()) if c in have]
    chosen = response or next(iter([*first, *have]), "")
    if chosen not in have:
        raise DataError(f"the diagnosis has no time history of '{chosen}'; it has {_list(have)}.")
    return chosen


def _shown_recording(diagnosis: Diagnosis) -> str:
    """Recording of the first finding that does not act all the time; else the first recording."""
    named = (main_recording(diagnosis, finding) for finding in diagnosis.findings)
    return next(filter(None, named), next(iter(diagnosis.traces), ""))


def _first_and_last(diagnosis: Diagnosis) -> tuple[str, str]:
    """The simulation as given, and the last stage that differs from it."""
    stages = shown_stages(diagnosis)
    return stages[0], stages[-1]


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
