"""Figures of single terms show what the model has, what one more would add, and how it holds across manoeuvres."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from structsel import Candidates, select
from structsel.errors import DataError, ModelError
from structsel.exploring import try_additions
from structsel.plotting import (
    plot_addition,
    plot_component,
    plot_criteria,
    plot_estimates_by_manoeuvre,
    plot_residual_with,
)
from tests.test_exploring import MODEL, POOL, RECORDINGS


def line(ax, text):
    return next(one for one in ax.get_lines() if str(one.get_label()).startswith(text))


def means(ax, place=0):
    return ax.containers[place].lines[0].get_xydata().T


def test_the_component_is_the_models_own_curve_in_the_channel_and_the_means_lie_on_it(ax):
    model = select(RECORDINGS, "Cm", POOL, include=["alpha", "de", "alpha^2"], max_terms=3, bootstrap=0).model
    plot_component(model, RECORDINGS, "Cm", "alpha", bins=10, ax=ax)
    x, y = line(ax, "alpha + alpha^2").get_data()
    alpha = np.deg2rad(x)
    assert_allclose(y, model["Cm"]["alpha"] * alpha + model["Cm"]["alpha^2"] * alpha**2, rtol=1e-12)
    at, held = means(ax)
    # What is left is noise of 0.004; 120 samples in a bin, so five of a mean's errors are 0.002.
    assert_allclose(held, np.interp(at, x, y), atol=0.002)
    assert ax.get_xlabel() == r"$\alpha$ [deg]"


def test_the_means_leave_the_component_where_the_shape_is_wrong(ax):
    plot_component(MODEL, RECORDINGS, "Cm", "alpha", bins=10, ax=ax)
    x, y = line(ax, "alpha").get_data()
    at, held = means(ax)
    off = held - np.interp(at, x, y)
    assert min(off[0], off[-1]) - off[5] > 0.01  # 8 (alpha - 0.1)^2 was left out: 0.02 at either end


def test_a_product_is_drawn_against_the_product(ax):
    model = select(RECORDINGS, "Cm", POOL, include=["alpha*de"], bootstrap=0).model
    plot_component(model, RECORDINGS, "Cm", "alpha*de", ax=ax)
    x, y = line(ax, "alpha*de").get_data()
    assert_allclose(y, model["Cm"]["alpha*de"] * x, rtol=1e-12)
    assert ax.get_xlabel() == r"$\alpha \, \delta_e$ [SI, rad]"
    with pytest.raises(ModelError, match="no term in 'V' alone"):
        plot_component(model, RECORDINGS, "Cm", "V", ax=ax)


def test_the_slope_of_an_addition_is_the_value_the_term_would_get(ax):
    found = try_additions(MODEL, RECORDINGS, "Cm", POOL)
    plot_addition(MODEL, RECORDINGS, "Cm", "alpha^2", ax=ax)
    (x0, x1), (y0, y1) = next(one for one in ax.get_lines() if str(one.get_label()).endswith("alpha^2")).get_data()
    assert_allclose((y1 - y0) / (x1 - x0), found.values[0], rtol=1e-8)
    with pytest.raises(ModelError, match="it cannot add anything"):
        plot_addition(MODEL, RECORDINGS, "Cm", "V*alpha", ax=ax)


def test_with_the_missing_term_the_means_of_the_residual_are_straight(ax):
    plot_residual_with(MODEL, RECORDINGS, "Cm", "alpha", "alpha^2", bins=10, ax=ax)
    without, added = means(ax)[1], means(ax, 1)[1]
    assert min(without[0], without[-1]) - without[5] > 0.01
    assert_allclose(added, 0.0, atol=0.002)
    assert ax.containers[1].get_label() == "with alpha^2"


def test_a_coefficient_stands_manoeuvre_by_manoeuvre_with_its_interval(ax):
    each = [select(r, "Cm", POOL, include=["alpha", "de"], max_terms=2, bootstrap=0).model for r in RECORDINGS]
    plot_estimates_by_manoeuvre(each, "Cm", "de", together=MODEL, ax=ax)
    (bars,) = ax.containers
    assert_allclose(bars.lines[0].get_ydata(), [model["Cm"]["de"] for model in each])
    spans = [segment[:, 1] for segment in bars.lines[2][0].get_segments()]
    expected = [model["Cm"].intervals()[model["Cm"].terms.index(Candidates(["de"]).terms[0])] for model in each]
    assert_allclose(spans, expected)
    assert [text.get_text() for text in ax.get_xticklabels()] == ["m0", "m1", "m2", "m3"]
    assert_allclose(line(ax, "all together").get_ydata(), MODEL["Cm"]["de"])
    with pytest.raises(DataError, match="none of the 4 models has the term 'de\\^3'"):
        plot_estimates_by_manoeuvre(each, "Cm", "de^3", ax=ax)


def test_criteria_stand_over_the_number_of_terms_the_best_of_each_size():
    selection = select(RECORDINGS, "Cm", POOL, bootstrap=0)
    ax = plot_criteria(selection, ax=Figure().add_subplot())
    right = next(one for one in ax.figure.axes if one is not ax)
    sizes = sorted({step.n_terms for step in selection.trace})
    left = line(ax, "PSE")
    assert_allclose(left.get_xdata(), sizes)
    assert_allclose(left.get_ydata(), [min(s.PSE for s in selection.trace if s.n_terms == k) for k in sizes])
    assert_allclose(right.get_lines()[0].get_ydata()[-1], max(s.R2 for s in selection.trace), rtol=1e-3)
    assert line(ax, "selected").get_xdata()[0] == len(selection.terms)


def test_a_search_without_a_path_has_no_criteria_to_show():
    selection = select(RECORDINGS, "Cm", Candidates(["alpha", "de"]), method="best_subset", bootstrap=0)
    assert "no path" in plot_criteria(selection, ax=Figure().add_subplot()).texts[0].get_text()
