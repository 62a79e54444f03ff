"""Figures of a diagnosis show its numbers, in the units people read."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.diagnosis.event import Event
from structsel.diagnosis.views import acting_range, bin_residuals, driving_channel, moving_channels, residuals
from structsel.errors import DataError
from structsel.plotting.diagnosis import plot_difference_against, plot_error_by_stage, plot_explained, plot_time_history
from tests.diagnoses import GROUND, HEIGHT, LIFT, VANE, diagnosis

pytestmark = pytest.mark.usefixtures("close_figures")


def test_the_time_history_shows_the_recording_where_the_effect_acts_longest_its_intervals_shaded():
    made = diagnosis()
    ax = plot_time_history(made)
    # 12.5 to 19.0 and 24.0 to 24.5 s are 7 s, more than in any other.
    assert ax.get_title() == "m03"
    measured, delivered, after = ax.get_lines()
    trace = made.traces["m03"]
    assert_allclose(measured.get_ydata(), trace.measured["CZ"])
    assert_allclose(delivered.get_ydata(), trace.simulated["CZ"])
    assert_allclose(after.get_ydata(), trace.explained["CZ"])
    spans = [(p.get_x(), p.get_x() + p.get_width()) for p in ax.patches]
    assert_allclose(spans, [(12.5, 19.0), (24.0, 24.5)])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "$C_Z$ [-]")


def test_the_residual_follows_the_height_before_and_not_after():
    # What the ground adds is LIFT exp(-h/HEIGHT); noise of 0.004 over some 40 samples in a bin leaves about 0.001.
    made = diagnosis()
    ax = plot_difference_against(made)
    before, after = ax.containers
    x, y = before.lines[0].get_data()
    assert_allclose(y, LIFT * np.exp(-x / HEIGHT), atol=0.004)
    assert_allclose(after.lines[0].get_ydata(), 0.0, atol=0.004)
    assert ax.get_xlabel() == "$h_{agl}$ [m]"
    (shade,) = ax.patches
    assert_allclose([shade.get_x(), shade.get_x() + shade.get_width()], [1.5, 5.4])
    # Of heights up to 100 m, those near the region are shown.
    assert ax.get_xlim()[1] < 20.0


def test_angles_are_drawn_in_degrees():
    ax = plot_difference_against(diagnosis(GROUND, VANE), finding=1)
    assert ax.get_xlabel() == r"$\alpha$ [deg]"
    (shade,) = ax.patches
    assert_allclose([shade.get_x(), shade.get_x() + shade.get_width()], np.rad2deg([0.05, 0.20]))


def test_each_response_has_three_bars_as_high_as_its_errors():
    ax = plot_error_by_stage(diagnosis())
    heights = np.array([[bar.get_height() for bar in container] for container in ax.containers])
    assert_allclose(heights, [[0.22, 0.31], [0.21, 0.30], [0.08, 0.19]])
    assert [text.get_text() for text in ax.get_xticklabels()] == ["$C_Z$", "$C_X$"]


def test_each_finding_has_a_bar_of_the_explained_part_and_a_mark_of_the_explainable_part():
    ax = plot_explained(diagnosis(GROUND, VANE))
    assert_allclose([bar.get_width() for bar in ax.containers[0]], [90.0, 94.0])
    assert_allclose(ax.get_lines()[0].get_xdata(), [93.0, 95.0])


def test_a_finding_that_was_only_detected_has_no_line_with_it_and_its_event_is_drawn():
    event = Event("m02", 7.5, 0.2, "step")
    made = diagnosis(replace(GROUND, intervals={}, events=(event,), is_fitted=False))
    ax = plot_time_history(made)
    assert ax.get_title() == "m02"
    _, _, retuned, change = ax.get_lines()
    assert_allclose(retuned.get_ydata(), made.traces["m02"].refitted["CZ"])
    assert_allclose(change.get_xdata(), 7.5)
    assert [text.get_text() for text in ax.get_legend().get_texts()][1:3] == ["as given", "retuned within tolerances"]
    assert len(plot_error_by_stage(made, ax=plt.figure().gca()).containers) == 2


@pytest.mark.parametrize("draw", [plot_error_by_stage, plot_explained, plot_difference_against])
def test_nothing_found_is_nothing_to_draw(draw):
    with pytest.raises(DataError, match="has no finding"):
        draw(diagnosis(verdict="consistent"))


def test_a_consistent_simulation_has_a_time_history_all_the_same():
    ax = plot_time_history(diagnosis(verdict="consistent"), response="CX")
    assert (ax.get_title(), len(ax.get_lines()), len(ax.patches)) == ("m01", 3, 0)


def test_what_is_not_there_is_said_with_what_is():
    with pytest.raises(DataError, match=r"no time history of 'm99'; it has m01, m02"):
        plot_time_history(diagnosis(), recording="m99")
    with pytest.raises(DataError, match=r"'Cn'; it has CZ, CX"):
        plot_time_history(diagnosis(), response="Cn")
    with pytest.raises(DataError, match="no finding 3"):
        plot_difference_against(diagnosis(), finding=3)
    with pytest.raises(DataError, match="channel 'mach'"):
        plot_difference_against(diagnosis(), channel="mach")


# --- what they are drawn from -----------------------------------------------------------------


def test_means_over_bins_have_intervals_from_the_spread_between_recordings():
    # Each recording off by a constant of its own: the mean of 8 such is uncertain by their spread over root 8.
    made = diagnosis()
    off = dict(zip(made.traces, np.random.default_rng(1).standard_normal(len(made.traces))))
    shifted = {
        name: replace(one, measured={"CZ": one.simulated["CZ"] + off[name], "CX": one.measured["CX"]})
        for name, one in made.traces.items()
    }
    binned = bin_residuals(replace(made, traces=shifted), "CZ", "alpha")
    std = np.std(list(off.values()), ddof=1) / np.sqrt(len(off))
    # Recordings are not spread evenly over each bin, so that the interval is near, not at, the one of equal parts.
    assert_allclose(np.median(binned.half["delivered"]), 1.96 * std, rtol=0.3)
    assert binned.counts.sum() == sum(len(one.t) for one in made.traces.values())


def test_a_bin_that_one_recording_alone_fills_has_no_interval():
    made = diagnosis()
    alone = replace(made, traces={"m01": made.traces["m01"]})
    assert np.isnan(bin_residuals(alone, "CZ", "alpha").half["physics"]).all()


def test_the_driving_channel_is_what_bounds_the_effect_else_what_its_terms_hold_else_what_the_differences_follow():
    made = diagnosis()
    assert driving_channel(made, GROUND) == "h_agl"
    assert driving_channel(made, replace(GROUND, region={})) == "h_agl"
    bare = replace(GROUND, region={}, physics=(replace(GROUND.physics[0], terms=()),))
    assert driving_channel(made, bare) == "h_agl"
    by_alpha = replace(GROUND, region={}, physics=(replace(GROUND.physics[0], terms=("alpha^2",)),))
    assert driving_channel(made, by_alpha) == "alpha"
    assert driving_channel(replace(made, traces={}), GROUND) == ""


def test_where_an_effect_acts_on_a_channel_is_its_region_else_the_range_in_its_segments():
    made = diagnosis()
    assert acting_range(made, GROUND, "h_agl") == (1.5, 5.4)
    # In its segments the height goes from 1.5 to at most (0.4 * 3.6)^2 + 1.5 = 3.6 m and, in the last of m03, 14.9 m.
    low, high = acting_range(made, replace(GROUND, region={}), "h_agl")
    assert 1.49 < low < 1.6
    assert 3.0 < high < 15.0
    # The angle of attack covers most of its range meanwhile, so it distinguishes nothing.
    assert acting_range(made, GROUND, "alpha") is None
    assert acting_range(made, replace(GROUND, region={}, intervals={}), "h_agl") is None


def test_a_constant_channel_drives_nothing():
    assert moving_channels(diagnosis()) == ["alpha", "h_agl"]


def test_residuals_are_measured_less_simulated():
    one = diagnosis().traces["m02"]
    assert_allclose(residuals(one, "CZ")["delivered"], one.measured["CZ"] - one.simulated["CZ"])
    assert_allclose(residuals(one, "CZ")["physics"], one.measured["CZ"] - one.explained["CZ"])
