"""The selectors as scikit-learn estimators: the library's own checks, and the same answers as the station's."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from structsel.candidates import Candidates
from structsel.errors import SelectionError
from structsel.estimators import BestSubsetRegressor, OrthogonalRegressor, StepwiseRegressor
from structsel.recording import Recording
from structsel.selection import select

from .pools import ar1

KINDS = [StepwiseRegressor, OrthogonalRegressor, BestSubsetRegressor]
METHOD = {StepwiseRegressor: "stepwise", OrthogonalRegressor: "orthogonal", BestSubsetRegressor: "best_subset"}
NAMES = ["alpha", "beta", "da", "de", "dr", "p_hat", "q_hat", "r_hat"]  # sorted, as Candidates sorts them


def problem(seed=0, n=600, noise=0.1, rho=0.0):
    """Eight correlated columns off zero; the response consists of columns 1, 4 and 6."""
    rng = np.random.default_rng(seed)
    X = np.array([ar1(rng, n, 0.9, 0.1) for _ in range(8)]).T
    X = 0.3 * X @ rng.normal(size=(8, 8)) / 3 + X + rng.normal(size=8)
    y = 2.0 + X[:, [1, 4, 6]] @ [1.0, -2.0, 0.5] + noise * ar1(rng, n, rho, np.sqrt(1 - rho**2))
    return X, y


@parametrize_with_checks([kind(**options) for kind in KINDS for options in ({}, {"noise": "white"})])
def test_scikit_learns_own_checks(estimator, check):
    check(estimator)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1000),
    order=st.permutations(range(8)),
    powers=st.lists(st.integers(-6, 6), min_size=8, max_size=8),
)
def test_a_noise_free_models_own_columns_are_found_in_any_order_and_scaling(kind, seed, order, powers):
    X, y = problem(seed, n=120, noise=0.0)
    scale = 10.0 ** np.array(powers)
    model = kind().fit((X * scale)[:, order], y)
    assert sorted(order[j] for j in model.get_support(indices=True)) == [1, 4, 6]
    assert_allclose(model.coef_[np.argsort(order)] * scale, [0, 1, 0, 0, -2, 0, 0.5, 0], rtol=1e-8, atol=1e-10)
    assert_allclose(model.intercept_, 2.0, rtol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", ["white", "ar"])
def test_an_estimator_gives_what_select_gives_on_recordings(kind, noise):
    X, y = problem(3, rho=0.8)
    groups = np.repeat(["second", "first", "third"], 200)  # in the order they come, not the alphabet's
    flights = [
        Recording(g, 0.02 * np.arange(200), {**dict(zip(NAMES, X[groups == g].T)), "CZ": y[groups == g]})
        for g in ("second", "first", "third")
    ]
    options = {"noise": noise, "bootstrap": 15, "seed": 2}
    expected = select(flights, "CZ", Candidates.polynomial(NAMES, 1), method=METHOD[kind], **options)
    model = kind(**options).fit(X, y, groups=groups)
    kept = [NAMES.index(str(t)) for t in expected.terms]
    assert list(model.selection_.search.selected) == kept
    assert_array_equal(model.support_, np.isin(range(8), kept))
    assert_allclose(model.coef_[kept], expected.values[1:], rtol=1e-8)
    assert_allclose(model.intercept_, expected.values[0], rtol=1e-8)
    assert_allclose(model.selection_.cross_validation.rms, expected.held_out_rms, rtol=1e-6)
    assert_allclose(model.selection_.bootstrap.inclusion, list(expected.inclusion.values()), atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_with_white_residuals_the_kept_columns_have_their_least_squares_coefficients(kind):
    X, y = problem(5)
    model = kind(noise="white").fit(X, y)
    plain = LinearRegression().fit(X[:, model.support_], y)
    assert_allclose(model.coef_[model.support_], plain.coef_, rtol=1e-9)
    assert_array_equal(model.coef_[~model.support_], 0.0)
    assert_allclose(model.intercept_, plain.intercept_, rtol=1e-9)
    assert_allclose(model.predict(X), plain.predict(X[:, model.support_]), rtol=1e-9)
    assert_allclose(model.score(X, y), model.selection_.r2, rtol=1e-9)


def test_coloured_residuals_are_accounted_for():
    # With lag-one correlation 0.95 the white rule lets useless columns in, the other does not: 20 flights.
    extra = {"white": 0, "ar": 0}
    for seed in range(20):
        X, y = problem(seed, rho=0.95, noise=0.3)
        for noise in extra:
            kept = StepwiseRegressor(noise=noise, F_in="auto").fit(X, y).get_support(indices=True)
            extra[noise] += len(set(kept) - {1, 4, 6})
    assert extra["ar"] <= 4  # 5 % probability each; five or more of 20 happen once in 400
    assert extra["white"] >= 20


def test_rows_of_one_group_need_not_be_together():
    X, y = problem(1, rho=0.8)
    groups = np.arange(600) % 2
    mixed = StepwiseRegressor().fit(X, y, groups=groups)
    order = np.argsort(groups, kind="stable")
    sorted_ = StepwiseRegressor().fit(X[order], y[order], groups=groups[order])
    assert_allclose(mixed.coef_, sorted_.coef_, rtol=1e-12)
    assert len(mixed.selection_.noise) == 2


# --- inside scikit-learn ---------------------------------------------------------------------------


def test_a_pipeline_of_polynomial_features_finds_the_terms_of_a_nonlinear_model():
    rng = np.random.default_rng(1)
    X = pd.DataFrame(rng.uniform(-1.0, 1.0, (500, 3)), columns=["alpha", "de", "q_hat"])
    y = 0.1 - 4.0 * X["alpha"] + 2.0 * X["alpha"] ** 2 * X["de"] - 5.0 * X["q_hat"] + 0.05 * rng.normal(size=500)
    pipe = make_pipeline(PolynomialFeatures(3, include_bias=False), StandardScaler(), StepwiseRegressor(F_in="auto"))
    pipe.set_output(transform="pandas").fit(X, y)
    assert set(pipe[:-1].transform(X).columns[pipe[-1].support_]) == {"alpha", "alpha^2 de", "q_hat"}
    assert list(pipe.transform(X).columns) == ["alpha", "q_hat", "alpha^2 de"]
    assert pipe.score(X, y) == pytest.approx(1 - 0.05**2 / y.var(), abs=1e-3)


def test_a_grid_search_over_complete_manoeuvres_stops_at_the_true_number_of_terms():
    X, y = problem(2, noise=0.05)
    manoeuvre = np.repeat(range(6), 100)
    search = GridSearchCV(BestSubsetRegressor(), {"max_terms": [1, 2, 3]}, cv=GroupKFold(3))
    search.fit(X, y, groups=manoeuvre)
    assert search.best_params_ == {"max_terms": 3}
    assert_array_equal(search.best_estimator_.get_support(indices=True), [1, 4, 6])
    scores = cross_val_score(clone(search.best_estimator_), X, y, groups=manoeuvre, cv=GroupKFold(3))
    assert_allclose(scores.mean(), search.best_score_, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_transform_keeps_the_chosen_columns(kind):
    X, y = problem()
    model = kind().fit(X, y)
    assert_array_equal(model.transform(X), X[:, model.support_])


# --- options and limits ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_forced_columns_stay_and_max_terms_holds(kind):
    X, y = problem()
    model = kind(include=[0, 7], max_terms=3).fit(X, y)
    kept = model.get_support(indices=True)
    assert {0, 7} <= set(kept)
    assert len(kept) <= 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_response_is_predicted_by_the_constant(kind):
    X, _ = problem()
    model = kind(include=[2]).fit(X, np.full(600, 3.7))
    assert_allclose(model.predict(X[:9]), 3.7, rtol=1e-15)
    assert_array_equal(model.get_support(indices=True), [2])
    assert model.selection_ is None


@pytest.mark.parametrize("kind", KINDS)
def test_columns_far_from_zero_keep_their_digits_and_constant_ones_stay_out(kind):
    X, y = problem(4)
    near = kind(noise="white").fit(X, y)
    far = kind(noise="white").fit(np.column_stack([X + 1e6, np.full(600, 0.1)]), y)
    assert_array_equal(far.get_support(indices=True), near.get_support(indices=True))
    # Adding 1e6 to columns of size 0.3 leaves them 1e-10 / 0.3 of their digits.
    assert_allclose(far.coef_[:8], near.coef_, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_ridge_estimates_are_smaller_and_named_biased(kind):
    X, y = problem(6)
    X[:, 5] = X[:, 4] + 0.001 * X[:, 5]
    plain, ridge = (kind(include=[4, 5], estimate=e).fit(X, y) for e in ("least_squares", "ridge"))
    assert np.abs(ridge.coef_[[4, 5]]).sum() < np.abs(plain.coef_[[4, 5]]).sum()
    assert "biased" in ridge.selection_.biased
    assert plain.selection_.biased == ""


def test_more_columns_than_rows_work_and_keep_fewer_than_rows():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(20, 60))
    y = 3.0 * X[:, 7] + 0.1 * rng.normal(size=20)
    model = StepwiseRegressor(F_in="auto").fit(X, y)
    assert model.support_[7]
    assert model.support_.sum() < 19


def test_a_forced_column_that_is_not_there_is_refused():
    X, y = problem()
    with pytest.raises(SelectionError, match=r"to include columns \[8\]; X has columns 0 to 7"):
        StepwiseRegressor(include=[8]).fit(X, y)


def test_an_option_that_cannot_be_meant_is_refused():
    X, y = problem()
    with pytest.raises(SelectionError, match="F_out=8 is above F_in=4"):
        StepwiseRegressor(F_in=4.0, F_out=8.0).fit(X, y)
    with pytest.raises(SelectionError, match="noise='pink' is not one of 'ar'"):
        OrthogonalRegressor(noise="pink").fit(X, y)


def test_groups_of_another_length_and_too_few_rows_are_refused():
    X, y = problem()
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        StepwiseRegressor().fit(X, y, groups=np.zeros(599))
    with pytest.raises(ValueError, match="minimum of 4 is required"):
        BestSubsetRegressor().fit(X[:3], y[:3])


def test_a_parameter_of_another_method_is_refused():
    X, y = problem()
    with pytest.raises(SelectionError, match=r"OrthogonalRegressor does not use F_in=12\.0: it belongs to the method"):
        OrthogonalRegressor(F_in=12.0).fit(X, y)
    with pytest.raises(SelectionError, match="StepwiseRegressor does not use order='given'"):
        StepwiseRegressor(order="given").fit(X, y)
