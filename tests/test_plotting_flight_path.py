"""Figures of a reconstruction show its numbers, with units, and nothing runs out of them."""

import warnings

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from scipy import stats
from statsmodels.tsa.stattools import acf

from structsel.demo import demo_instruments
from structsel.plotting import (
    draw_reconstruction,
    draw_reconstructions,
    plot_constant,
    plot_estimate,
    plot_innovations,
    plot_nis,
    plot_readings,
)
from structsel.reconstruction import reconstruct
from structsel.reconstruction.result import Reconstruction
from tests.figures import assert_nothing_outside


@pytest.fixture(scope="module")
def flight():
    simulated = demo_instruments("all-axes", 2, duration=8.0)
    # Height is read four times a second only.
    h = simulated.measured["h"].copy()
    h[np.arange(len(h)) % 12 != 0] = np.nan
    return simulated.measured.with_channels(h=h), simulated.aircraft


@pytest.fixture(scope="module")
def result(flight):
    return reconstruct(*flight)


@pytest.fixture(scope="module")
def several(result):
    def other(name, **changes):
        return Reconstruction(**{**result.__dict__, "name": name, **changes})

    return [result, other("second", constants=result.constants[1:]), other("third", distrust=("it does not fit",))]


def band(axes, k=0):
    """Lower and upper edge of a filled band, over its samples."""
    corners = axes.collections[k].get_paths()[0].vertices
    half = (len(corners) - 1) // 2
    return corners[1:half, 1], corners[half + 1 : -1, 1][::-1]


def test_measurements_are_drawn_with_reconstruction_and_residual(flight, result):
    top, bottom = plot_readings(result, "alpha", ax=Figure().subplots(2))
    measured, reconstructed = top.get_lines()
    assert_allclose(measured.get_ydata(), np.rad2deg(flight[0]["alpha"]), atol=1e-10)
    assert_allclose(reconstructed.get_ydata(), np.rad2deg(result.readings["alpha"]))
    residual = np.rad2deg(flight[0]["alpha"] - result.readings["alpha"])
    assert_allclose(bottom.get_lines()[0].get_ydata(), residual, atol=1e-10)
    assert top.get_ylabel() == r"$\alpha$ [deg]"
    assert bottom.get_ylabel() == "residual [deg]"
    low, high = band(bottom)
    assert_allclose(
        high[: len(result.recording)], 2.0 * np.rad2deg(result.innovation_std["alpha"][: len(high)]), rtol=1e-6
    )
    assert_allclose(low, -high)


def test_a_slow_channel_shows_its_readings_only(flight, result):
    top, _ = plot_readings(result, "h", ax=Figure().subplots(2))
    drawn = top.get_lines()[0].get_ydata()
    assert_allclose(drawn, flight[0]["h"], atol=1e-9)
    assert np.isfinite(drawn).sum() == -(-len(drawn) // 12)


def test_innovations_are_normalised_and_their_autocorrelation_is_statsmodels(result):
    left, right = plot_innovations(result, "theta", ax=Figure().subplots(1, 2))
    e = result.innovations["theta"] / result.innovation_std["theta"]
    assert np.abs(e).max() < 6.0
    assert_allclose(left.get_lines()[0].get_ydata(), e)
    bounds = left.patches[0]
    assert (bounds.get_y(), bounds.get_y() + bounds.get_height()) == (-2.0, 2.0)
    tips = [segment[1, 1] for segment in right.collections[0].get_segments()]
    converged = e[int(0.05 * len(e)) :]  # the first twentieth finds the start
    assert_allclose(tips, acf(converged, nlags=len(tips), fft=False)[1:], atol=1e-10)
    assert_allclose(right.patches[0].get_height(), 2.0 * 1.96 / np.sqrt(len(converged)))


def test_the_running_nis_has_the_chi_squared_band_of_its_readings(result):
    ax = plot_nis(result, ax=Figure().add_subplot())
    i, half = 200, 25
    rows = slice(i - half, i + half)
    e = np.concatenate([(result.innovations[c] / result.innovation_std[c])[rows] for c in result.innovations])
    e = e[np.isfinite(e)]
    assert ax.get_lines()[0].get_ydata()[i] == pytest.approx(np.mean(e**2), rel=1e-9)
    low, high = band(ax)
    expected = stats.chi2.ppf([0.025, 0.975], len(e)) / len(e)
    assert low[i] == pytest.approx(expected[0], rel=1e-6)
    assert high[i] == pytest.approx(expected[1], rel=1e-6)


def test_an_estimate_is_shown_as_the_filter_came_to_it_and_as_all_samples_have_it(result):
    ax = plot_estimate(result, "bax", ax=Figure().add_subplot())
    j = result.states.index("bax")
    running, smooth = ax.get_lines()
    assert_allclose(running.get_ydata(), result.filtered[:, j])
    assert_allclose(smooth.get_ydata(), result.estimates[:, j])
    low, high = band(ax)
    assert_allclose((high - low)[-50:], 4.0 * result.filtered_std[-50:, j], rtol=1e-6)
    low, high = band(ax, 1)
    assert_allclose(high - low, 4.0 * result["bax"].std, rtol=1e-6)
    assert ax.get_ylabel() == "$b_{a_x}$ [m/s$^{2}$]"


def test_motion_has_the_standard_deviation_of_its_samples(result):
    ax = plot_estimate(result, "theta", ax=Figure().add_subplot())
    low, high = band(ax, 1)
    assert_allclose(high - low, 4.0 * np.rad2deg(result.std["theta"][: len(low)]), rtol=1e-5)


def test_a_constant_is_shown_manoeuvre_by_manoeuvre_with_its_interval(result, several):
    ax = plot_constant(several, "baz", ax=Figure().add_subplot())
    trusted, not_trusted = ax.containers
    assert_allclose(trusted.lines[0].get_xdata(orig=False), [0, 1])
    assert_allclose(not_trusted.lines[0].get_xdata(orig=False), [2])
    assert_allclose(trusted.lines[0].get_ydata(orig=False), result["baz"].value)
    ends = trusted.lines[2][0].get_segments()[0][:, 1]
    assert_allclose(ends, result["baz"].value + np.array([-2.0, 2.0]) * result["baz"].std)
    # The second did not look for this one.
    ax = plot_constant(several, result.constants[0].name, ax=Figure().add_subplot())
    assert_allclose(ax.containers[0].lines[0].get_xdata(orig=False), [0])


@pytest.mark.parametrize("drawn", [("all-axes_", "constants"), pytest.param(("second_",), marks=pytest.mark.slow)])
def test_every_figure_of_a_folder_has_its_text_inside(several, drawn):
    names = []
    for name, figure in draw_reconstructions(several[:2]):
        names.append(name)
        if not name.startswith(drawn):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # such as a layout that does not fit
            warnings.filterwarnings("ignore", r"'\w+' .*deprecated")  # Matplotlib 3.9's names for parts of its parser
            assert_nothing_outside(figure)
    each = ("readings", "innovations", "nis", "constants")
    assert names == [f"{name}_{of}" for name in ("all-axes", "second") for of in each] + ["constants"]


def test_the_verdict_stands_above_the_figures(several):
    for one in several[1:]:
        titles = [figure.get_suptitle() for _, figure in draw_reconstruction(one)]
        assert all(("NOT TRUSTED" in title) is not one.trusted for title in titles)
