"""All figures; the only room that imports Matplotlib.

Each ``plot_`` function draws one result and returns its Axes. It draws on ``ax=``, or in a new figure without it; a
function with several Axes takes a Figure or SubFigure as ``ax`` too. Axes have labels with units, angles are in
degrees. Each ``draw_`` function returns complete figures;
`save_figure` writes one as PNG, SVG or PDF.
"""

from structsel.deprecation import renamed_names
from structsel.plotting.diagnosis import plot_difference_against, plot_error_by_stage, plot_explained, plot_time_history
from structsel.plotting.frequency_domain import draw_frequency_response, plot_bode, plot_transfer_function
from structsel.plotting.inputs import draw_inputs, plot_cramer_rao, plot_input
from structsel.plotting.models import plot_ensemble, plot_estimates, plot_modes, plot_recursive_estimates
from structsel.plotting.plot import plot, plot_recording
from structsel.plotting.qualification import draw_qualification, draw_qualification_test, plot_match
from structsel.plotting.reconstruction import (
    draw_reconstruction,
    draw_reconstructions,
    plot_constant,
    plot_estimate,
    plot_innovations,
    plot_nis,
    plot_readings,
)
from structsel.plotting.recordings import (
    plot_coherence,
    plot_coverage,
    plot_histories,
    plot_mismatch_coherence,
    plot_spectrum,
)
from structsel.plotting.refinement import draw_refinement, plot_comparison, plot_derivatives, plot_output
from structsel.plotting.saving import save_figure
from structsel.plotting.selection import (
    draw_selection,
    plot_autocorrelation,
    plot_collinearity,
    plot_criteria,
    plot_fit,
    plot_inclusion,
    plot_intervals,
    plot_residual_against,
    plot_search,
)
from structsel.plotting.simulation import draw_flight, draw_resimulation, plot_flight, plot_resimulation
from structsel.plotting.style import label
from structsel.plotting.terms import (
    draw_addition,
    plot_addition,
    plot_component,
    plot_estimates_by_manoeuvre,
    plot_residual_with,
)

__all__ = [
    "draw_addition",
    "draw_flight",
    "draw_frequency_response",
    "draw_inputs",
    "draw_qualification",
    "draw_qualification_test",
    "draw_reconstruction",
    "draw_reconstructions",
    "draw_refinement",
    "draw_resimulation",
    "draw_selection",
    "label",
    "plot",
    "plot_addition",
    "plot_autocorrelation",
    "plot_bode",
    "plot_coherence",
    "plot_collinearity",
    "plot_comparison",
    "plot_component",
    "plot_constant",
    "plot_coverage",
    "plot_cramer_rao",
    "plot_criteria",
    "plot_derivatives",
    "plot_difference_against",
    "plot_ensemble",
    "plot_error_by_stage",
    "plot_estimate",
    "plot_estimates",
    "plot_estimates_by_manoeuvre",
    "plot_explained",
    "plot_fit",
    "plot_flight",
    "plot_histories",
    "plot_inclusion",
    "plot_innovations",
    "plot_input",
    "plot_intervals",
    "plot_match",
    "plot_mismatch_coherence",
    "plot_modes",
    "plot_nis",
    "plot_output",
    "plot_readings",
    "plot_recording",
    "plot_recursive_estimates",
    "plot_residual_against",
    "plot_residual_with",
    "plot_resimulation",
    "plot_search",
    "plot_spectrum",
    "plot_time_history",
    "plot_transfer_function",
    "save_figure",
]

__getattr__ = renamed_names(
    __name__,
    {
        "draw_replay": "draw_resimulation",
        "plot_across": "plot_estimates_by_manoeuvre",
        "plot_bars": "plot_error_by_stage",
        "plot_bounds": "plot_cramer_rao",
        "plot_path": "plot_search",
        "plot_replay": "plot_resimulation",
        "plot_residual_over": "plot_difference_against",
        "plot_shares": "plot_explained",
    },
)
