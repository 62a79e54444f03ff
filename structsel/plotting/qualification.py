"""Figures of a proof of match: recorded and simulated time histories with the tolerance bands."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure, SubFigure

from structsel.nomenclature import LATERAL_OUTPUTS, LONGITUDINAL_OUTPUTS
from structsel.plotting.style import (
    HIGHLIGHT,
    MEASURED,
    MODEL,
    SELECTED,
    TIME,
    add_grid,
    decimate,
    display_values,
    get_axes,
    grid_shape,
    hide,
    label,
    label_outer,
    plot_channel,
    scale,
)
from structsel.qualification import Qualification, QualificationTest
from structsel.qualification.manoeuvre_kinds import MOVED
from structsel.qualification.result import AFTER, BEFORE, tolerance_text, verdict_cell

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CONTROLS = ("de", "da", "dr", "df", "throttle", "thrust")
_LATERAL = ("roll-response", "rudder-response", "dutch-roll")
_COLOURS = {BEFORE: MODEL, AFTER: SELECTED}
_NOTICEABLE = 0.5  # of the movement that counts as an input; chosen, not critical
_PAGE = (11.69, 8.27)  # in, A4
_LINES = 34  # of the overview on a page
_CHARACTERS = 150  # of a line of text on a page
_MARGIN = 1.0  # recorded ranges, or bands, beyond which a simulation is not shown; chosen, not critical


def plot_match(test: QualificationTest, channel: str, *, corrected: bool = True, ax: Axes | None = None) -> Axes:
    """Draw one channel of a manoeuvre as recorded and simulated, with the tolerance band of its test.

    Parameters
    ----------
    test : QualificationTest
    channel : str
    corrected : bool
        Whether the names of the lines say before and after.
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees. A parameter without tolerance in this test has no band.
    """
    ax = get_axes(ax)
    recorded = test.recorded
    y = display_values(recorded, channel)
    tolerances = [t for g in test.test.tolerances for t in g] if test.test and test.test.how == "history" else []
    shown = next((one for one in tolerances if one.parameter == channel), None)
    width = np.zeros(len(y))
    if shown is not None:
        width = scale(channel, recorded.units) * shown.half_width(recorded[channel])
        some = decimate(len(y))
        band: dict[str, Any] = {"color": MEASURED, "alpha": 0.16, "lw": 0, "label": "tolerance"}
        ax.fill_between(recorded.t[some], (y - width)[some], (y + width)[some], **band)
    plot_channel(ax, recorded, channel, color=MEASURED, lw=1.4, label="recorded")
    for stage, simulated in test.simulated.items():
        if channel in simulated and channel not in _CONTROLS:
            text = f"simulated, {stage}" if corrected else "simulated"
            plot_channel(ax, simulated, channel, color=_COLOURS[stage], lw=1.1, ls="--" if stage == BEFORE else "-",
                         label=text)  # fmt: skip
    if test.test is not None and test.test.how == "value" and test.free < recorded.t[-1]:
        ax.axvline(test.free, color=HIGHLIGHT, lw=1.0, ls=":")
    _limit(ax, y, width)
    ax.set_ylabel(label(channel, recorded.units))
    ax.set_xlabel(TIME)
    ax.margins(x=0.0)
    add_grid(ax)
    return ax


def _limit(ax: Axes, y: np.ndarray, width: np.ndarray) -> None:
    """Show the recording and its band; a simulation that leaves them far is cut off."""
    finite = y[np.isfinite(y)]
    if not len(finite):
        return
    reach = _MARGIN * max(float(np.ptp(finite)), 2.0 * float(width.max()))
    if reach > 0.0:
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, finite.min() - width.max() - reach), min(high, finite.max() + width.max() + reach))


def channels_of(test: QualificationTest) -> list[str]:
    """Channels of the page of a test: the controls that move, what is judged, and the rest of its motion."""
    recorded = test.recorded
    moving = [name for name in _CONTROLS if name in recorded and _moves(recorded[name], name)]
    judged = [t.parameter for g in test.test.tolerances for t in g] if test.test is not None else []
    first, second = LONGITUDINAL_OUTPUTS, LATERAL_OUTPUTS
    rest = (*second, *first) if test.kind in _LATERAL else (*first, *second) if not test.kind else first
    there = next(iter(test.simulated.values()))
    names = dict.fromkeys((*moving, *judged, *rest))
    return [name for name in names if name in recorded and (name in moving or name in there)]


def _moves(values: np.ndarray, name: str) -> bool:
    """Whether a control moves by a noticeable part of what counts as an input."""
    size = abs(float(np.median(values))) if name == "thrust" else 1.0
    return bool(np.ptp(values) > _NOTICEABLE * MOVED[name] * size)


def draw_qualification_test(result: Qualification, test: QualificationTest) -> Figure:
    """Figure of one manoeuvre: its channels, and pass or fail of each parameter as the title of its axes."""
    rows, columns = grid_shape(len(channels_of(test)))
    figure = Figure(figsize=(3.6 * columns, 1.9 * rows + 0.4), layout="constrained")
    _fill(figure, result, test)
    return figure


def _fill(figure: Figure | SubFigure, result: Qualification, test: QualificationTest) -> None:
    """Draw the channels of a test on a figure, with one legend."""
    names = channels_of(test)
    rows, columns = grid_shape(len(names))
    axes = list(np.ravel(figure.subplots(rows, columns, squeeze=False, sharex=True)))
    hide(axes[len(names) :])
    axes = axes[: len(names)]
    for name, ax in zip(names, axes):
        plot_match(test, name, corrected=bool(result.corrected), ax=ax)
        ax.set_title(_title(result, test, name), fontsize="x-small", loc="left")
    label_outer(axes)
    drawn: dict[str, Any] = {}
    for ax in axes:
        drawn |= {text: line for line, text in zip(*ax.get_legend_handles_labels()) if text not in drawn}
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=4, fontsize="small", frameon=False)


def _title(result: Qualification, test: QualificationTest, channel: str) -> str:
    """Tolerance and results of a parameter that is compared over time; empty for other channels."""
    if test.test is None or test.test.how != "history":
        return ""
    for checks in zip(*(test.checks[stage] for stage in result.stages)):
        if checks[0].tolerance.parameter == channel:
            verdicts = ", ".join(
                f"{stage} {verdict_cell(check.passed, test.kind).value}" if result.corrected
                else str(verdict_cell(check.passed, test.kind).value)
                for stage, check in zip(result.stages, checks)
            )  # fmt: skip
            return _plain(f"{tolerance_text(checks[0].tolerance)}: {verdicts}")
    return ""


def draw_qualification(result: Qualification) -> Iterator[tuple[QualificationTest, Figure]]:
    """Figures of all manoeuvres, in order.

    Yields
    ------
    test : QualificationTest
    figure : Figure
    """
    for test in result.tests:
        yield test, draw_qualification_test(result, test)


def draw_qualification_pages(result: Qualification, source: str) -> Iterator[Figure]:
    """Pages for printing, A4: an overview, then one for each manoeuvre.

    Parameters
    ----------
    result : Qualification
    source : str
        Where the tolerances are from.

    Yields
    ------
    Figure
    """
    overview = result.overview()
    for first in range(0, max(1, len(overview.rows)), _LINES):
        some = replace(overview, rows=overview.rows[first : first + _LINES], title="")
        page = Figure(figsize=_PAGE)
        models = f"{result.model}, corrected: {result.corrected}" if result.corrected else result.model
        page.text(0.05, 0.93, "Proof of match", fontsize=20, weight="bold")
        page.text(0.05, 0.89, result.headline(), fontsize=13)
        page.text(0.05, 0.86, f"Simulation: {models}.", fontsize=10)
        page.text(0.05, 0.82, _plain(some.to_text()), family="monospace", fontsize=7.5, va="top", linespacing=1.5)
        page.text(0.05, 0.04, f"Tolerances: {source}.", fontsize=8)
        yield page
    for number, test in enumerate(result.tests, 1):
        page = Figure(figsize=_PAGE, layout="constrained")
        lines = result.table_of(test).to_text().splitlines() if test.kind else []
        note = result.table_of(test).note if test.kind else ""
        why = textwrap.wrap(f"Taken for this test because {test.why}. {note}", _CHARACTERS)
        fraction = 0.16 + 0.02 * (len(lines) + len(why))
        head, body = np.ravel(np.asarray(page.subfigures(2, 1, height_ratios=(fraction, 1.0 - fraction))))
        head.text(0.03, 0.93, f"{test.name}: {test.title}", fontsize=15, weight="bold", va="top")
        text = "\n".join(why)
        head.text(0.03, 0.62, text, fontsize=9, va="top")
        table = _plain("\n".join(lines))
        head.text(0.03, 0.02, table, family="monospace", fontsize=7.5, va="bottom", linespacing=1.3)
        page.text(0.97, 0.97, f"{number} of {len(result.tests)}", fontsize=8, ha="right", va="top")
        _fill(body, result, test)
        yield page


def svg_pictures(result: Qualification) -> Iterator[bytes]:
    """SVG of the figure of each manoeuvre, in order."""
    for _, figure in draw_qualification(result):
        content = io.BytesIO()
        figure.savefig(content, format="svg")
        yield content.getvalue()


def pdf_pages(result: Qualification, source: str, creator: str) -> bytes:
    """PDF of the pages for printing; see `draw_qualification_pages`."""
    content = io.BytesIO()
    with PdfPages(content, metadata={"Title": "Proof of match", "Creator": creator}) as pages:
        for figure in draw_qualification_pages(result, source):
            pages.savefig(figure)
    return content.getvalue()


def _plain(text: str) -> str:
    """Text in which Matplotlib finds no formula."""
    return text.replace("$", r"\$").replace("+-", "±")
