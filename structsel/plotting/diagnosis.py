"""Figures of diagnoses: where the mismatch lies, what it follows, and what the physics found takes away."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from structsel.diagnosis.result import Diagnosis, EffectFinding
from structsel.diagnosis.views import (
    acting_range,
    bin_residuals,
    driving_channel,
    shown_responses,
    unit_shown,
    worth_showing,
)
from structsel.errors import DataError
from structsel.formatting import display_unit
from structsel.plotting.style import DOUBT, KEPT, MEASURED, MODELLED, OTHER, new_axes, symbol, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STAGES = {"delivered": "as delivered", "refitted": "refitted within tolerances", "physics": "with the physics found"}
_COLOURS = {"delivered": MODELLED, "refitted": DOUBT, "physics": KEPT}
_SHADES = (KEPT, DOUBT, "#7b5ea7", "#6b8e23")
_BAR = 0.26  # of the distance between groups
_ROOM = 1.15
_MARGIN = 0.03


def plot_time_history(diagnosis: Diagnosis, *, recording: str = "", response: str = "", ax: Axes | None = None) -> Axes:
    """Draw one response of one recording, measured and simulated, the located intervals of each finding shaded.

    Parameters
    ----------
    diagnosis : Diagnosis
    recording : str, optional
        Else the one in which the first finding acts longest.
    response : str, optional
        Else the one in which it is clearest.
    ax : Axes, optional

    Raises
    ------
    DataError
        The diagnosis keeps no such time history.
    """
    name = recording or _longest(diagnosis)
    response = _response(diagnosis, response, None)
    if name not in diagnosis.traces:
        raise DataError(f"the diagnosis keeps no time history of '{name}'; it has {_have(diagnosis.traces)}.")
    trace = diagnosis.traces[name]
    ax = new_axes(ax)
    factor, unit = display_unit(unit_shown(response))
    some = thin(len(trace.t))
    shown = (
        (trace.measured, MEASURED, "measured", 2.2),
        (trace.simulated, _COLOURS["delivered"], _STAGES["delivered"], 0.9),
        (trace.explained, _COLOURS["physics"], _STAGES["physics"], 0.9),
    )
    for held, colour, text, width in shown:
        ax.plot(trace.t[some], factor * held[response][some], color=colour, lw=width, label=text)
    for k, finding in enumerate(diagnosis.findings):
        for i, (start, end) in enumerate(finding.intervals.get(name, ())):
            shade = _SHADES[k % len(_SHADES)]
            ax.axvspan(start, end, color=shade, alpha=0.18, lw=0, label=None if i else finding.effect)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(_named(response, unit))
    ax.set_title(name, fontsize="small")
    ax.legend(fontsize="x-small")
    return ax


def plot_residual_over(
    diagnosis: Diagnosis, *, finding: int = 0, response: str = "", channel: str = "", ax: Axes | None = None
) -> Axes:
    """Draw what is left of the differences over the channel that drives an effect, before and after, with means.

    Parameters
    ----------
    diagnosis : Diagnosis
    finding : int, optional
        Its place among the findings.
    response : str, optional
        Else the one in which it is clearest.
    channel : str, optional
        Else what bounds the effect, what its terms hold, or what the differences vary most with.
    ax : Axes, optional

    Returns
    -------
    Axes
        Dots are samples; means stand with 95 % intervals from the spread between recordings. The region where the
        effect acts is shaded.

    Raises
    ------
    DataError
        No such finding, response or channel.
    """
    effect = _finding(diagnosis, finding)
    response = _response(diagnosis, response, effect)
    channel = channel or driving_channel(diagnosis, effect)
    if not channel or any(channel not in one.channels for one in diagnosis.traces.values()):
        raise DataError(f"the diagnosis keeps no time history of channel '{channel}' in every recording.")
    ax = new_axes(ax)
    along, along_unit = display_unit(unit_shown(channel))
    factor, unit = display_unit(unit_shown(response))
    region = effect.region.get(channel)
    acts = acting_range(diagnosis, effect, channel)
    binned = bin_residuals(diagnosis, response, channel, acts)
    x = along * np.concatenate([one.channels[channel] for one in diagnosis.traces.values()])
    some = thin(4 * len(x))
    for stage, held in (("delivered", "simulated"), ("physics", "explained")):
        left = np.concatenate(
            [one.measured[response] - getattr(one, held)[response] for one in diagnosis.traces.values()]
        )
        colour = _COLOURS[stage]
        ax.plot(x[some], factor * left[some], ".", ms=3, alpha=0.2, color=colour, mew=0, rasterized=True)
        half = np.nan_to_num(factor * binned.half[stage])
        ax.errorbar(along * binned.at, factor * binned.means[stage], yerr=half, fmt="o-", ms=4, lw=1.2, capsize=2,
                    color=colour, label=_STAGES[stage])  # fmt: skip
    if region is not None:
        ax.axvspan(along * region[0], along * region[1], color=OTHER, alpha=0.3, lw=0, label=effect.effect, zorder=0)
    ax.axhline(0.0, color=MEASURED, lw=0.6)
    low, high = (along * end for end in worth_showing(x / along, acts))
    ax.set_xlim(low - _MARGIN * (high - low), high + _MARGIN * (high - low))
    ax.set_xlabel(_named(channel, along_unit))
    ax.set_ylabel(f"measured less simulated {_named(response, unit)}")
    ax.legend(fontsize="x-small")
    return ax


def plot_bars(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """Draw the three bars of each response: rms error on flights not used for fitting, over the rms of the measured.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes, optional

    Returns
    -------
    Axes
        As delivered, refitted within tolerances, and with everything found.

    Raises
    ------
    DataError
        Nothing was found.
    """
    bars = _finding(diagnosis, -1).bars
    ax = new_axes(ax)
    names = list(bars)
    for k, (stage, text) in enumerate(_STAGES.items()):
        heights = [getattr(bars[c], stage).rrmse for c in names]
        drawn = ax.bar(np.arange(len(names)) + (k - 1) * _BAR, heights, 0.9 * _BAR, color=_COLOURS[stage], label=text)
        ax.bar_label(drawn, [f"{h:.2f}" for h in heights], fontsize="xx-small", padding=1)
    ax.set_xticks(np.arange(len(names)), [symbol(c) for c in names])
    ax.set_ylim(0.0, _ROOM * ax.get_ylim()[1])
    ax.set_ylabel("rms error over rms measured, held out")
    ax.legend(fontsize="x-small")
    return ax


def plot_shares(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """Draw the share of the mismatch explained by each finding and those before it, and the most there is to explain.

    Parameters
    ----------
    diagnosis : Diagnosis
    ax : Axes, optional

    Returns
    -------
    Axes
        One bar per finding, of the mismatch in the responses where it shows; the mark is what any function of the
        recorded channels explains there.

    Raises
    ------
    DataError
        Nothing was found.
    """
    _finding(diagnosis, 0)
    ax = new_axes(ax)
    rows = np.arange(len(diagnosis.findings))
    told = 100.0 * np.array([f.explained for f in diagnosis.findings])
    most = 100.0 * np.array([f.explainable for f in diagnosis.findings])
    drawn = ax.barh(rows, np.nan_to_num(told), 0.5, color=[_SHADES[k % len(_SHADES)] for k in rows])
    ax.bar_label(drawn, [f"{x:.0f} %" for x in told], label_type="center", color="white", fontsize="small")
    ax.plot(most, rows, "D", ms=7, mec="white", color=MEASURED, label="a free learner on all channels")
    ax.legend(fontsize="x-small", loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    ax.set_yticks(rows, [f"{k + 1}. {f.effect}\nin {', '.join(f.axes)}" for k, f in enumerate(diagnosis.findings)])
    ax.invert_yaxis()
    ax.set_xlim(0.0, 100.0)
    ax.set_xlabel("share of the mismatch explained, held out [%]")
    return ax


def _finding(diagnosis: Diagnosis, place: int) -> EffectFinding:
    if not diagnosis.findings:
        raise DataError(f"there is nothing to draw: the diagnosis is '{diagnosis.verdict}' and names nothing.")
    if place >= len(diagnosis.findings):
        raise DataError(f"there is no finding {place}; the diagnosis has {len(diagnosis.findings)}, from 0 on.")
    return diagnosis.findings[place]


def _response(diagnosis: Diagnosis, response: str, finding: EffectFinding | None) -> str:
    """The response asked for, else the clearest of a finding or of all."""
    have = shown_responses(diagnosis)
    first = [c for c in (finding.axes if finding is not None else ()) if c in have]
    chosen = response or next(iter([*first, *have]), "")
    if chosen not in have:
        raise DataError(f"the diagnosis keeps no time history of '{chosen}'; it has {_have(have)}.")
    return chosen


def _longest(diagnosis: Diagnosis) -> str:
    """Recording in which the first finding that is located acts longest; the first where none is."""
    for finding in diagnosis.findings:
        spans = {n: sum(b - a for a, b in each) for n, each in finding.intervals.items() if n in diagnosis.traces}
        if any(spans.values()):
            return max(spans, key=lambda name: spans[name])
    return next(iter(diagnosis.traces), "")


def _have(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _named(name: str, unit: str) -> str:
    return f"{symbol(name)} [{unit or '-'}]"
