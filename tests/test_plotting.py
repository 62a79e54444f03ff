"""Figures show the numbers they were given, with units, and nothing runs out of them."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from structsel import Candidates, Recording, plotting, select, validate
from structsel.plotting import (
    draw_selection,
    label,
    plot_autocorrelation,
    plot_collinearity,
    plot_fit,
    plot_inclusion,
    plot_intervals,
    plot_residual_against,
    plot_search,
)
from structsel.plotting.style import grid_figure
from tests.figures import assert_nothing_outside, assert_tick_labels_apart


def manoeuvre(k, n=300):
    rng = np.random.default_rng([11, k])
    t = 5.0 + 0.05 * np.arange(n)
    alpha = 0.1 + 0.05 * np.sin(0.9 * t + k) + 0.01 * rng.standard_normal(n)
    de = 0.05 * np.sign(np.sin(1.3 * t)) + 0.005 * rng.standard_normal(n)
    # The square is left out of the pool below, so that the residual carries it.
    Cm = 0.05 - 0.5 * alpha - 1.5 * de + 8.0 * (alpha - 0.1) ** 2 + 0.004 * rng.standard_normal(n)
    return Recording(f"m{k}", t, {"alpha": alpha, "de": de, "Cm": Cm})


@pytest.fixture(scope="module")
def recordings():
    return [manoeuvre(k) for k in range(3)]


@pytest.fixture(scope="module")
def selections(recordings):
    return select(recordings, ["Cm"], Candidates(["alpha", "de", "alpha*de"]), bootstrap=30)


def test_the_fit_shows_measured_modelled_and_their_difference(recordings, selections):
    top, bottom = plot_fit(selections.model, recordings[0], "Cm", ax=Figure().subplots(2))
    modelled = selections.model.evaluate(recordings[0])["Cm"]
    measured, model = top.get_lines()[:2]
    assert_allclose(measured.get_xdata(), recordings[0].t)
    assert_allclose(measured.get_ydata(), recordings[0]["Cm"])
    assert_allclose(model.get_ydata(), modelled)
    assert_allclose(bottom.get_lines()[0].get_ydata(), recordings[0]["Cm"] - modelled)
    assert (top.get_ylabel(), bottom.get_xlabel()) == ("$C_m$ [-]", "time [s]")


def test_several_manoeuvres_stand_end_to_end_under_their_names(recordings, selections):
    top, _ = plot_fit(selections.model, recordings, "Cm", ax=Figure().subplots(2))
    clocks = [line.get_xdata() for line in top.get_lines() if len(line.get_xdata()) == 300][::2]
    t = np.concatenate(clocks)
    assert len(t) == 900
    assert_allclose(np.diff(t), 0.05, rtol=1e-9)
    assert [text.get_text().strip() for text in top.texts] == ["m0", "m1", "m2"]


def test_the_path_shows_the_residual_after_each_move(selections, ax):
    selection = selections["Cm"]
    plot_search(selection, ax=ax)
    lines = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    assert_allclose(lines["$1 - R^2$"], [1.0 - s.R2 for s in selection.trace])
    assert_allclose(lines["PSE"], [s.PSE for s in selection.trace])
    assert [tick.get_text() for tick in ax.get_xticklabels()] == [f"+ {s.term}" for s in selection.trace]
    assert f"selected: {len(selection.terms)} terms" in lines


def test_a_search_without_a_path_says_so(recordings, ax):
    selection = select(recordings, "Cm", Candidates(["alpha", "de"]), method="best_subset", bootstrap=0)
    assert "no path" in plot_search(selection, ax=ax).texts[0].get_text()


def test_inclusion_bars_are_the_fractions_the_models_own_terms_first(selections, ax):
    selection = selections["Cm"]
    plot_inclusion(selection, ax=ax)
    names = [tick.get_text() for tick in ax.get_yticklabels()]
    assert_allclose([bar.get_width() for bar in ax.patches], [selection.inclusion[name] for name in names])
    assert set(names[: len(selection.terms)]) == {str(term) for term in selection.terms}


def test_interval_bars_span_the_interval_relative_to_the_value(selections, ax):
    selection = selections["Cm"]
    plot_intervals(selection, ax=ax)
    low, high = selection.intervals().T
    bars = ax.patches[: len(selection.values)]
    assert_allclose([bar.get_width() for bar in bars], (high - low) / np.abs(selection.values), rtol=1e-9)


def test_the_heat_map_is_the_correlation_of_the_parameters_with_their_vif(selections):
    selection = selections["Cm"]
    drawn = plot_collinearity(selection, ax=Figure().add_subplot())
    spread = np.sqrt(np.diag(selection.covariance))
    R = (selection.covariance / np.outer(spread, spread))[1:, 1:]
    assert_allclose(drawn.images[0].get_array(), R, atol=1e-12)
    expected = [f"{term}  (VIF {vif:.3g})" for term, vif in zip(selection.terms, selection.vif)]
    assert [tick.get_text() for tick in drawn.get_yticklabels()] == expected


def test_the_autocorrelation_starts_at_lag_one_within_its_bound(recordings, selections, ax):
    score = validate(selections.model, recordings).score("Cm")
    plot_autocorrelation(score, ax=ax)
    tips = [segment[1, 1] for segment in ax.collections[0].get_segments()]
    assert_allclose(tips, score.autocorrelation[1:])
    assert_allclose(ax.patches[0].get_height(), 2.0 * score.bound)


def test_bin_means_of_the_residual_show_the_term_left_out(recordings, selections, ax):
    plot_residual_against(selections.model, recordings, "Cm", "alpha", bins=9, ax=ax)
    x = np.concatenate([r["alpha"] for r in recordings])
    e = np.concatenate([r["Cm"] - selections.model.evaluate(r)["Cm"] for r in recordings])
    order = np.argsort(x).reshape(9, 100)
    means = ax.containers[0].lines[0].get_ydata()
    assert_allclose(means, e[order].mean(axis=1), rtol=1e-9, atol=1e-12)
    # A parabola: both ends above the middle by far more than the noise of a mean, 0.004 / 10.
    assert min(means[0], means[-1]) - means[4] > 0.005
    assert ax.get_xlabel() == r"$\alpha$ [deg]"


def test_labels_carry_the_symbol_and_the_unit():
    assert label("V") == "$V$ [m/s]"
    assert label("load", {"load": "N"}) == r"$\mathrm{load}$ [N]"
    assert label("load") == r"$\mathrm{load}$"


def test_three_figures_for_every_response_with_every_text_inside_them(recordings, selections):
    drawn = dict(draw_selection(selections, recordings))
    assert list(drawn) == ["Cm_fit", "Cm_choice", "Cm_residual"]
    for figure in drawn.values():
        assert_nothing_outside(figure)


def test_only_plotting_imports_matplotlib():
    source = Path(__file__).parents[1] / "structsel"
    texts = [(p.parent.name, p.read_text()) for p in source.rglob("*.py")]
    users = {folder for folder, text in texts if "import matplotlib" in text or "from matplotlib" in text}
    assert users == {"plotting"}
    code = "import sys, structsel.cli; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_move_of_every_kind_has_its_mark(ax):
    # At nearly constant speed alpha and alpha*V_ratio are one column, so the search ends with a simplification.
    rng = np.random.default_rng(11)
    alpha, V_ratio = 0.1 * rng.standard_normal(2000), 1.0 + 6e-5 * rng.standard_normal(2000)
    CZ = -5.0 * alpha * V_ratio + 0.001 * rng.standard_normal(2000)
    flight = Recording("steady", 0.02 * np.arange(2000), {"alpha": alpha, "V_ratio": V_ratio, "CZ": CZ})
    pool = Candidates.parse(["alpha", "alpha*V_ratio"])
    selection = select(flight, "CZ", pool, noise="white", F_in="auto", bootstrap=0)
    actions = {step.action for step in selection.trace}
    plot_search(selection, ax=ax)
    labels = [text.get_text() for text in ax.get_xticklabels()]
    assert "simplify" in actions
    assert any(label.startswith("→ alpha") for label in labels)


def test_a_figure_with_several_axes_is_drawn_in_the_subfigure_that_is_given(recordings, selections):
    left, right = Figure().subfigures(1, 2)
    top, bottom = plot_fit(selections.model, recordings[0], "Cm", ax=right)
    assert list(right.axes) == [top, bottom]
    assert not left.axes


def test_old_names_and_arguments_still_work_with_a_warning(recordings, selections):
    with pytest.warns(DeprecationWarning, match="plot_search"):
        assert plotting.plot_path is plot_search
    with pytest.warns(DeprecationWarning, match="'axes'"):
        plot_fit(selections.model, recordings[0], "Cm", axes=Figure().subplots(2))


def test_the_labels_of_ticks_do_not_touch(recordings):
    # -0.0016 and -0.0008 touch under an axis of this width; 1.6 and 0.8 times 10^-3 do not.
    small = [r.with_channels(q_hat=0.0011 * (r["alpha"] - 0.1) / 0.05) for r in recordings]
    found = select(small, "Cm", Candidates.parse(["alpha", "de"]), include=["de"], bootstrap=0)
    figure, axes = grid_figure(3, height=3.3)
    for ax in axes:
        plot_residual_against(found.model, small, "Cm", "q_hat", ax=ax)
    assert_tick_labels_apart(figure)
    for _, figure in draw_selection(found, small):
        assert_tick_labels_apart(figure)


def test_the_unit_of_a_label_has_raised_exponents():
    assert label("az") == "$a_z$ [m/s$^{2}$]"
    assert label("Cm") == "$C_m$ [-]"
