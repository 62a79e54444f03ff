"""Probabilities that candidates belong in the model: the formulas against fits, and stated values against the truth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.numerics.inclusion import inclusion_probabilities
from structsel.numerics.regressors import ArrayData
from structsel.selection import SelectOptions, select, select_arrays
from tests.selections import made
from tests.test_stepwise import problem, products


def weights_by_fits(X, y, selected):
    """exp(-EBIC / 2) of a model and its neighbours, each fitted alone."""
    n, p = X.shape
    others = [j for j in range(p) if j not in selected]
    models = [tuple(selected)]
    models += [tuple(i for i in selected if i != j) for j in selected]
    models += [(*selected, j) for j in others]
    models += [(*(i for i in selected if i != j), o) for j in selected for o in others]

    def ebic(model):
        A = np.column_stack([np.ones(n), X[:, list(model)]])
        rss = np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2)
        return n * np.log(rss) + len(model) * (np.log(n) + np.log(p))

    values = np.array([ebic(model) for model in models])
    return models, np.exp(-0.5 * (values - values.min()))


@pytest.mark.parametrize("selected", [(0, 3, 5), (2,), ()])
def test_probabilities_are_weights_of_the_model_and_its_neighbours_each_fitted(selected):
    X, y, *_ = problem(4, noise=3.0)
    models, weights = weights_by_fits(X, y, selected)
    expected = [sum(w for m, w in zip(models, weights) if j in m) / weights.sum() for j in range(X.shape[1])]
    found = inclusion_probabilities(products(X, y), len(y) - 1.0, selected)
    assert_allclose(found, expected, rtol=1e-8, atol=1e-12)


def test_included_terms_are_certain_and_models_that_are_not_allowed_do_not_count():
    X, y, *_ = problem(5, noise=3.0)
    C = products(X, y)
    assert inclusion_probabilities(C, 119.0, (1, 2), include=(1,))[1] == 1.0
    found = inclusion_probabilities(C, 119.0, (1, 2), allowed=lambda model: set(model) == {1, 2})
    assert_allclose(found[[1, 2]], 1.0)
    assert found.sum() == 2.0


def test_of_two_terms_that_cannot_be_separated_each_has_half():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(400)
    X = np.column_stack([x + 1e-4 * rng.standard_normal(400), x + 1e-4 * rng.standard_normal(400)])
    found = inclusion_probabilities(products(X, x + 0.1 * rng.standard_normal(400)), 399.0, (0,))
    assert_allclose(found, 0.5, atol=0.1)


@pytest.mark.parametrize("records", [pytest.param(150, marks=pytest.mark.slow), 15])
def test_stated_probabilities_hold_on_records_unlike_those_of_the_calibration(records):
    # Records of white signals with white residuals (those of the calibration are coloured and correlated), four of 40
    # candidates true, with 0 to 8 standard errors. The sum of the probabilities between 5 and 95 % is the expected
    # number of true candidates among these; 0.05 of bias is allowed besides the scatter.
    stated, true = [], []
    for seed in range(records):
        rng = np.random.default_rng([seed, 9])
        base = rng.standard_normal((40, 600))
        chosen = rng.choice(40, 4, replace=False)
        values = rng.choice([-1, 1], 4) * rng.uniform(0.0, 8.0, 4) / np.sqrt(600.0)
        y = values @ base[chosen] + rng.standard_normal(600)
        options = SelectOptions(bootstrap=40, noise="white", workers=1)
        found = select_arrays([ArrayData(base, y[None])], np.eye(40, dtype=int), options)[0]
        stated.append(found.bootstrap.probability)
        true.append(np.isin(np.arange(40), chosen))
    stated, true = np.concatenate(stated), np.concatenate(true)
    middle = (stated > 0.05) & (stated < 0.95)
    assert middle.sum() > records
    scatter = np.sqrt((stated * (1 - stated))[middle].sum())
    assert abs(stated[middle].sum() - true[middle].sum()) < 3.0 * scatter + 0.05 * middle.sum()
    assert true[stated >= 0.95].mean() > 0.95
    assert true[stated <= 0.05].mean() < 0.05


def test_a_selection_prints_the_probability_of_each_term():
    pool = Candidates.polynomial(["alpha", "de", "q_hat"], 2)
    found = select(made(lambda c: c["alpha"] - 2.0 * c["de"]), "CZ", pool, bootstrap=20)["CZ"]
    assert min(found.probability["alpha"], found.probability["de"]) > 0.99
    assert found.probability["q_hat^2"] < 0.2
    assert "prob." in str(found)
    assert_allclose(found.to_frame()["probability"][1:], [found.probability[str(t)] for t in found.terms])
    assert not select(made(lambda c: c["alpha"]), "CZ", pool, bootstrap=0)["CZ"].probability
