"""plot(): the first figure of a result, by its type."""

from __future__ import annotations

from typing import Any

from structsel.diagnosis import Diagnosis
from structsel.errors import ArgumentError
from structsel.inputs import InputComparison, InputDesign
from structsel.plotting.diagnosis import plot_time_history
from structsel.plotting.inputs import plot_cramer_rao, plot_input
from structsel.plotting.reconstruction import plot_nis
from structsel.plotting.recordings import plot_histories
from structsel.plotting.refinement import plot_comparison, plot_derivatives
from structsel.plotting.selection import plot_autocorrelation, plot_intervals
from structsel.plotting.simulation import plot_resimulation
from structsel.reconstruction import Reconstruction
from structsel.recording import Recording
from structsel.refinement import Derivatives, EstimateComparison
from structsel.selection import Selection
from structsel.validation import Resimulation, Score


def plot_recording(recording: Recording, channel: str, *, ax: Any = None) -> Any:
    """Draw one channel of a recording over time."""
    return plot_histories({recording.name: recording}, channel, ax=ax)


_FIGURES = {
    Derivatives: plot_derivatives,
    Diagnosis: plot_time_history,
    EstimateComparison: plot_comparison,
    InputComparison: plot_cramer_rao,
    InputDesign: lambda design, ax=None: plot_input(design.inputs, ax=ax),
    Reconstruction: plot_nis,
    Recording: plot_recording,
    Resimulation: plot_resimulation,
    Score: plot_autocorrelation,
    Selection: plot_intervals,
}
"""First figure of each type of result."""


def plot(result: Any, *arguments: Any, ax: Any = None, **options: Any) -> Any:
    """Draw the first figure of a result; ``result.plot(...)`` does the same.

    Parameters
    ----------
    result : object
        A `Selection` is drawn as its intervals, a `Recording` as the channel that is named, a `Diagnosis` as the time
        history of its largest difference, a `Reconstruction` as its innovations, a `Resimulation` as the recording and
        output that are named, an `InputComparison` as its Cramer-Rao bounds.
    *arguments, **options
        Those of the function that draws it, such as the name of the channel.
    ax : Axes, optional
        Axes, or a Figure for several; a new figure is made without it.

    Returns
    -------
    Axes, or tuple of Axes

    Raises
    ------
    ArgumentError
        Results of this type have no figure.
    """
    for kind, draw in _FIGURES.items():
        if isinstance(result, kind):
            return draw(result, *arguments, ax=ax, **options)  # type: ignore[operator]
    raise ArgumentError(
        f"plot has no figure for a {type(result).__name__}.",
        remedy=f"It has figures for {', '.join(sorted(kind.__name__ for kind in _FIGURES))}; "
        "structsel.plotting has others.",
    )
