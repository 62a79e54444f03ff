"""Every figure; the only importer of matplotlib.

Each function draws one result on one Axes (or a pair), its own if none is given, and returns it; units stand on
the axes. `draw_selection`, `draw_reconstructions`, `draw_flight`, `draw_replay`, `draw_refinement` and `draw_inputs`
put them together, one figure per question, for files.
"""

from structsel.plotting.axes import label
from structsel.plotting.diagnosis import plot_bars, plot_residual_over, plot_shares, plot_time_history
from structsel.plotting.flight_path import (
    draw_reconstruction,
    draw_reconstructions,
    plot_constant,
    plot_estimate,
    plot_innovations,
    plot_nis,
    plot_readings,
)
from structsel.plotting.flights import draw_flight, draw_refinement, draw_replay, plot_flight, plot_replay
from structsel.plotting.inputs import draw_inputs, plot_bounds, plot_input
from structsel.plotting.models import (
    draw_selection,
    plot_autocorrelation,
    plot_collinearity,
    plot_fit,
    plot_inclusion,
    plot_intervals,
    plot_path,
    plot_residual_against,
)
from structsel.plotting.refinement import plot_comparison, plot_derivatives

__all__ = [
    "draw_flight",
    "draw_inputs",
    "draw_reconstruction",
    "draw_reconstructions",
    "draw_refinement",
    "draw_replay",
    "draw_selection",
    "label",
    "plot_autocorrelation",
    "plot_bars",
    "plot_bounds",
    "plot_collinearity",
    "plot_comparison",
    "plot_constant",
    "plot_derivatives",
    "plot_estimate",
    "plot_fit",
    "plot_flight",
    "plot_inclusion",
    "plot_innovations",
    "plot_input",
    "plot_intervals",
    "plot_nis",
    "plot_path",
    "plot_readings",
    "plot_replay",
    "plot_residual_against",
    "plot_residual_over",
    "plot_shares",
    "plot_time_history",
]
