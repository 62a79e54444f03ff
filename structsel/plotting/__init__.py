"""Every figure; the only importer of matplotlib.

Each function draws one result on one Axes (or a pair), its own if none is given, and returns it; units stand on
the axes. `draw_selection` and `draw_reconstructions` put them together, one figure per question, for files.
"""

from structsel.plotting.axes import label
from structsel.plotting.flight_path import (
    draw_reconstruction,
    draw_reconstructions,
    plot_constant,
    plot_estimate,
    plot_innovations,
    plot_nis,
    plot_readings,
)
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

__all__ = [
    "draw_reconstruction",
    "draw_reconstructions",
    "draw_selection",
    "label",
    "plot_autocorrelation",
    "plot_collinearity",
    "plot_constant",
    "plot_estimate",
    "plot_fit",
    "plot_inclusion",
    "plot_innovations",
    "plot_intervals",
    "plot_nis",
    "plot_path",
    "plot_readings",
    "plot_residual_against",
]
