"""Every figure; the only importer of matplotlib.

Each function draws one result on one Axes (or a pair), its own if none is given, and returns it; units stand on
the axes. `draw_selection`, `draw_reconstructions`, `draw_flight`, `draw_replay`, `draw_refinement` and `draw_inputs`
put them together, one figure per question, for files.
"""

from structsel.plotting.diagnosis import plot_bars, plot_residual_over, plot_shares, plot_time_history
from structsel.plotting.inputs import draw_inputs, plot_bounds, plot_input
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
from structsel.plotting.refinement import plot_comparison, plot_derivatives
from structsel.plotting.selection import (
    draw_selection,
    plot_autocorrelation,
    plot_collinearity,
    plot_criteria,
    plot_fit,
    plot_inclusion,
    plot_intervals,
    plot_path,
    plot_residual_against,
)
from structsel.plotting.simulation import draw_flight, draw_refinement, draw_replay, plot_flight, plot_replay
from structsel.plotting.style import label
from structsel.plotting.terms import draw_addition, plot_across, plot_addition, plot_component, plot_residual_with

__all__ = [
    "draw_addition",
    "draw_flight",
    "draw_inputs",
    "draw_reconstruction",
    "draw_reconstructions",
    "draw_refinement",
    "draw_replay",
    "draw_selection",
    "label",
    "plot_across",
    "plot_addition",
    "plot_autocorrelation",
    "plot_bars",
    "plot_bounds",
    "plot_coherence",
    "plot_collinearity",
    "plot_comparison",
    "plot_component",
    "plot_constant",
    "plot_coverage",
    "plot_criteria",
    "plot_derivatives",
    "plot_estimate",
    "plot_fit",
    "plot_flight",
    "plot_histories",
    "plot_inclusion",
    "plot_innovations",
    "plot_input",
    "plot_intervals",
    "plot_mismatch_coherence",
    "plot_nis",
    "plot_path",
    "plot_readings",
    "plot_replay",
    "plot_residual_against",
    "plot_residual_over",
    "plot_residual_with",
    "plot_shares",
    "plot_spectrum",
    "plot_time_history",
]
