import numpy as np
import pytest

from structsel.errors import DataError
from structsel.frequency_domain import RecursiveEstimate
from structsel.plotting.models import plot_ensemble, plot_recursive_estimates
from structsel.plotting.refinement import plot_comparison, plot_derivatives
from structsel.refinement import Derivatives, compare_estimates
from structsel.validation import Ensemble
from structsel.validation.ensembles import TermScatter
from tests.report_pages import refined

pytestmark = pytest.mark.usefixtures("close_figures")


def test_each_parameter_has_its_axes_with_a_bar_for_each_method_that_knows_it():
    table = compare_estimates(
        {"equation error": {"mw": (-0.05, 0.001), "mq": (-1.6, 0.1)}, "output error": {"mw": (-0.048, 0.0005)}},
        truth={"mw": -0.0479},
    )
    first, second = plot_comparison(table)
    assert first.get_title() == "mw"
    assert len(first.containers) == 2
    assert len(second.containers) == 1
    # Half of a 95 % interval is 1.96 standard deviations.
    low, high = first.containers[0].lines[1][0].get_ydata(), first.containers[0].lines[1][1].get_ydata()
    np.testing.assert_allclose([low[0], high[0]], [-0.05 - 0.00196, -0.05 + 0.00196], rtol=1e-4)
    assert any(np.allclose(line.get_ydata(), -0.0479) for line in first.get_lines())


def test_an_ensemble_shows_range_and_mean_standard_error_relative_to_the_mean(ax):
    # Mean -1, least -1.2, greatest -0.8 and a standard error of 0.1: a range of 20 %, a bar of 10 %.
    rows = (TermScatter("Cm", "de", 3, -1.0, -1.2, -0.8, 0.04, 0.1, 2.0), TermScatter("CZ", "1", 3, 0, 0, 0, 0, 1, 0))
    plot_ensemble(Ensemble(3, rows), ax=ax)
    (bar,) = ax.patches
    np.testing.assert_allclose([bar.get_x(), bar.get_x() + bar.get_width()], [-0.1, 0.1])
    low, high = (line.get_xdata()[0] for line in ax.containers[-1].lines[1])
    np.testing.assert_allclose([low, high], [-0.2, 0.2])
    assert [text.get_text() for text in ax.get_yticklabels()] == ["de = -1 (3)"]
    plot_ensemble(Ensemble(3, rows), "CZ", ax=ax.figure.add_subplot())


def test_a_recursive_estimate_is_drawn_over_time_without_the_times_that_determine_nothing(ax):
    def at(t, value, std):
        return RecursiveEstimate("q_dot", ("de",), t, np.array([value]), np.array([std]), 0.9, 1000, 1.0)

    plot_recursive_estimates([at(0.0, np.nan, np.nan), at(1.0, -2.0, 50.0), at(2.0, -3.0, 0.1), at(3.0, -3.1, 0.1)],
                             "de", ax=ax)  # fmt: skip
    (line,) = ax.get_lines()
    np.testing.assert_allclose(line.get_xydata(), [[1.0, -2.0], [2.0, -3.0], [3.0, -3.1]])
    # The interval of 98 at 1 s is cut: the axis is that of the later ones, with half their reach around.
    assert ax.get_ylim()[0] > -4.0
    assert ax.get_ylim()[1] < -2.0


def test_an_output_is_drawn_as_recorded_and_refined_in_degrees(ax):
    found, flights, _ = refined()
    found.plot("m01", "alpha", ax=ax)
    recorded, simulated = ax.get_lines()
    np.testing.assert_allclose(recorded.get_ydata(), np.rad2deg(flights[0]["alpha"]), rtol=1e-9)
    np.testing.assert_allclose(simulated.get_ydata(), np.rad2deg(found.simulated[0]["alpha"]), rtol=1e-9)
    with pytest.raises(DataError, match="no output 'V' of 'm01'"):
        found.plot("m01", "V", ax=ax)


def test_derivatives_are_drawn_over_their_condition_in_degrees_with_the_truth():
    values = np.array([[[-0.6, -0.65]], [[-0.8, np.nan]]])
    std = np.array([[[0.01, 0.02]], [[np.inf, np.nan]]])
    at = np.array([0.05, 0.10])
    table = Derivatives(
        "alpha", at, (("m1",), ("m2",)), ("Cm:alpha",), ("two-step", "output error"), values, std, 0.95, {}
    )
    (ax,) = plot_derivatives(table, truth={"Cm:alpha": lambda alpha: -0.4 - 4.0 * alpha})
    assert ax.get_xlabel() == r"$\alpha$ [deg]"
    first, second = (container.lines[0].get_xdata() for container in ax.containers)
    np.testing.assert_allclose(0.5 * (first + second), np.rad2deg(at), rtol=1e-9)
    low, high = (cap.get_ydata() for cap in ax.containers[0].lines[1])
    np.testing.assert_allclose(high - low, [2.0 * 1.959964 * 0.01, 0.0], rtol=1e-5, atol=1e-12)
    truth = ax.get_lines()[-1]
    np.testing.assert_allclose(truth.get_ydata()[[0, -1]], [-0.6, -0.8])
