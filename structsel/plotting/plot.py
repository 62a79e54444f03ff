"""plot(): the first figure of a result, by its type."""

from __future__ import annotations

from typing import Any

from structsel.comparison import Mismatch
from structsel.diagnosis import Diagnosis
from structsel.errors import ArgumentError
from structsel.frequency_domain import FrequencyResponse, RecursiveEstimate, TransferFunction
from structsel.inputs import InputComparison, InputDesign
from structsel.model import AeroModel, ResponseModel
from structsel.plotting.diagnosis import plot_time_history
from structsel.plotting.frequency_domain import plot_bode, plot_transfer_function
from structsel.plotting.inputs import plot_cramer_rao, plot_input
from structsel.plotting.models import plot_ensemble, plot_estimates, plot_modes
from structsel.plotting.qualification import channels_of, plot_match
from structsel.plotting.reconstruction import plot_constant, plot_nis
from structsel.plotting.recordings import plot_histories, plot_mismatch_coherence
from structsel.plotting.refinement import plot_comparison, plot_derivatives, plot_output
from structsel.plotting.selection import plot_autocorrelation, plot_intervals
from structsel.plotting.simulation import plot_resimulation
from structsel.qualification import Qualification
from structsel.reconstruction import Reconstruction, Reconstructions
from structsel.recording import Recording
from structsel.refinement import Derivatives, EquationError, EstimateComparison, Refinement
from structsel.selection import Selection, Selections
from structsel.simulation import LinearModel
from structsel.validation import Ensemble, Resimulation, Score, Validation


def plot_recording(recording: Recording, channel: str, *, ax: Any = None) -> Any:
    """Draw one channel of a recording over time."""
    return plot_histories({recording.name: recording}, channel, ax=ax)


def _plot_selections(found: Selections, response: str = "", *, ax: Any = None) -> Any:
    """Draw the intervals of one response of a selection, by default the first."""
    return plot_intervals(found[response or next(iter(found))], ax=ax)


def _plot_constants(found: Reconstructions, name: str = "", *, ax: Any = None) -> Any:
    """Draw one constant of all manoeuvres, by default the first that was estimated."""
    first = next((c.name for one in found for c in one.constants), "")
    return plot_constant(found, name or first, ax=ax)


def _plot_validation(found: Validation, response: str = "", recording: str = "all", *, ax: Any = None) -> Any:
    """Draw the autocorrelation of the residual of one response, by default the first, of all recordings."""
    return plot_autocorrelation(found.score(response or found.pooled[0].response, recording), ax=ax)


def _plot_qualification(found: Qualification, manoeuvre: str = "", channel: str = "", *, ax: Any = None) -> Any:
    """Draw one channel of one manoeuvre with its tolerance, by default of the first test and its first parameter."""
    tests = {one.name: one for one in found.tests}
    test = tests[manoeuvre] if manoeuvre else next((t for t in found.tests if t.kind), found.tests[0])
    return plot_match(test, channel or channels_of(test)[-1], corrected=bool(found.corrected), ax=ax)


def _plot_mismatch(found: Mismatch, response: str = "", *, ax: Any = None) -> Any:
    """Draw the coherence of the residual of one response with channels, by default of the first response."""
    first = next((one.response for one in found.coherences), "")
    return plot_mismatch_coherence(found, response or first, ax=ax)


_FIGURES = {
    AeroModel: plot_estimates,
    Ensemble: plot_ensemble,
    EquationError: plot_estimates,
    FrequencyResponse: plot_bode,
    LinearModel: plot_modes,
    Mismatch: _plot_mismatch,
    RecursiveEstimate: plot_estimates,
    Qualification: _plot_qualification,
    Reconstructions: _plot_constants,
    Refinement: plot_output,
    ResponseModel: plot_estimates,
    Selections: _plot_selections,
    TransferFunction: plot_transfer_function,
    Validation: _plot_validation,
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
_INSTEAD = {
    "Candidates": "They are terms without data: plot the Selection, or structsel.plotting.plot_collinearity of it.",
    "Trim": "It is one steady state: print it, or plot the modes of linearise(model, aircraft, trim).",
}
"""Results without a figure, with what to do."""


def plot(result: Any, *arguments: Any, ax: Any = None, **options: Any) -> Any:
    """Draw the first figure of a result; ``result.plot(...)`` does the same.

    Parameters
    ----------
    result : object
        A `Selection` is drawn as its intervals, a `Recording` as the channel that is named, a `Diagnosis` as the time
        history of its largest difference, a `Reconstruction` as its innovations, a `Resimulation` as the recording and
        output that are named, an `InputComparison` as its Cramer-Rao bounds, a `Refinement` as an output over time, a
        model as the intervals of its parameters, a `LinearModel` as its modes, a `FrequencyResponse` as a Bode plot.
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
    name = type(result).__name__
    raise ArgumentError(
        f"plot has no figure for a {name}.",
        remedy=_INSTEAD.get(name)
        or f"It has figures for {', '.join(sorted(kind.__name__ for kind in _FIGURES))}; "
        "structsel.plotting has others.",
    )
