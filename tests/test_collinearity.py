"""Collinearity diagnostics and biased estimates against statsmodels, scikit-learn and singular values."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from statsmodels.stats.outliers_influence import variance_inflation_factor

from structsel.errors import SelectionError
from structsel.numerics.biased_estimation import (
    components_by_folds,
    components_by_pse,
    components_by_variance,
    principal_components,
    ridge,
    ridge_by_folds,
    ridge_by_gcv,
)
from structsel.numerics.collinearity import condition_indices, correlation, drop_correlated, parameter_correlation, vif
from tests.test_stepwise import problem, products


def collinear(seed, n=200, p=7, closeness=0.05):
    """Candidates of unequal scale and mean, the last nearly the sum of the first two."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p))
    X[:, -1] = X[:, 0] + X[:, 1] + closeness * X[:, -1]
    X = X * 10.0 ** rng.uniform(-2, 2, p) + rng.normal(size=p)
    y = X @ (1.0 / X.std(axis=0)) + rng.normal(size=n)
    return X, y


def test_correlation_equals_numpy_and_is_undefined_for_a_constant():
    X, y = collinear(0)
    C = products(X, y)
    assert_allclose(correlation(C), np.corrcoef(np.column_stack([X, y]).T), rtol=1e-10, atol=1e-13)
    C[2, :] = C[:, 2] = 0.0
    assert np.isnan(correlation(C)[2]).all()
    assert np.isfinite(np.delete(np.delete(correlation(C), 2, 0), 2, 1)).all()


def test_vif_equals_statsmodels():
    for seed in range(5):
        X, y = collinear(seed)
        A = sm.add_constant(X)
        expected = [variance_inflation_factor(A, j) for j in range(1, A.shape[1])]
        assert_allclose(vif(products(X, y)[:-1, :-1]), expected, rtol=1e-8)


def test_vif_is_infinite_for_a_dependent_group_and_not_for_the_others():
    X, y = collinear(1)
    X = np.column_stack([X[:, :4], X[:, 0] - 2.0 * X[:, 2]])
    C = products(X, y)[:-1, :-1]
    value = vif(C)
    assert np.isinf(value[[0, 2, 4]]).all()
    A = sm.add_constant(X[:, [0, 1, 2, 3]])
    expected = [variance_inflation_factor(A, j) for j in (2, 4)]
    assert_allclose(value[[1, 3]], expected, rtol=1e-8)


@pytest.mark.parametrize("centred", [False, True])
def test_condition_indices_and_proportions_equal_those_of_the_singular_values(centred):
    X, _ = collinear(2)
    A = np.column_stack([np.ones(len(X)), X])
    columns = X - X.mean(axis=0) if centred else A
    found = condition_indices(columns.T @ columns)
    _, mu, Vt = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    phi = (Vt.T / mu) ** 2
    assert_allclose(found.indices, mu[0] / mu, rtol=1e-8)
    assert_allclose(found.proportions, (phi / phi.sum(axis=1, keepdims=True)).T, rtol=1e-6, atol=1e-9)
    assert_allclose(found.proportions.sum(axis=0), 1.0, rtol=1e-12)


def test_the_high_index_names_the_columns_that_depend_on_one_another():
    X, _ = collinear(3, closeness=1e-3)
    centred = X - X.mean(axis=0)
    found = condition_indices(centred.T @ centred)
    assert found.indices[-1] > 100.0
    assert np.flatnonzero(found.proportions[-1] > 0.5).tolist() == [0, 1, 6]


def test_an_exact_dependence_has_an_infinite_index_and_a_zero_column_is_refused():
    X, _ = collinear(3)
    A = np.column_stack([np.ones(len(X)), X, X[:, 0] / 3.0])
    found = condition_indices(A.T @ A)
    assert np.isinf(found.indices[-1])
    assert np.flatnonzero(found.proportions[-1] > 0.5).tolist() == [1, 8]
    A[:, 2] = 0.0
    with pytest.raises(SelectionError, match=r"not zero; found \[2\]"):
        condition_indices(A.T @ A)


def test_parameter_correlation_equals_that_of_the_statsmodels_covariance():
    X, y = collinear(4)
    chosen = [6, 0, 3, 1]
    covariance = sm.OLS(y, sm.add_constant(X[:, chosen])).fit().cov_params()[1:, 1:]
    s = np.sqrt(np.diag(covariance))
    assert_allclose(parameter_correlation(products(X, y), chosen), covariance / np.outer(s, s), rtol=1e-8, atol=1e-10)
    with pytest.raises(SelectionError, match="do not depend on one another"):
        parameter_correlation(products(np.column_stack([X, X[:, 0]]), y), [0, 7])


@pytest.mark.parametrize("m", range(1, 8))
def test_principal_components_equal_scikit_learn(m):
    X, y = collinear(5)
    found = principal_components(products(X, y), 199.0, m)
    peer = make_pipeline(StandardScaler(), PCA(m), LinearRegression()).fit(X, y)
    slope = peer[1].components_.T @ peer[2].coef_ / peer[0].scale_
    assert_allclose(found.theta, slope, rtol=1e-8, atol=1e-8 * np.abs(slope).max())
    assert_allclose(found.rss, np.sum((y - peer.predict(X)) ** 2), rtol=1e-8)
    assert_allclose(found.explained[:m], peer[1].explained_variance_ratio_, rtol=1e-8)
    assert found.biased is (m < 7)
    assert ("biased" in found.method) is (m < 7)


def test_all_components_are_least_squares_with_its_covariance():
    X, y = collinear(6)
    found = principal_components(products(X, y), 199.0, 7)
    fit = sm.OLS(y, sm.add_constant(X)).fit()
    assert_allclose(found.theta, fit.params[1:], rtol=1e-8)
    assert_allclose(np.sqrt(np.diag(found.covariance)), fit.bse[1:], rtol=1e-8)


def test_covariance_of_biased_estimates_is_that_of_a_linear_function_of_the_samples():
    # theta = A y with A found by feeding in each sample alone, so cov = s^2 A A'.
    X, y = collinear(7, n=60)
    for estimate in (lambda C: principal_components(C, 59.0, 5), lambda C: ridge(C, 59.0, 0.05)):
        A = np.column_stack([estimate(products(X, row)).theta for row in np.eye(60)])
        found = estimate(products(X, y))
        assert_allclose(found.theta, A @ y, rtol=1e-8)
        s2 = found.rss / (59.0 - found.effective_terms)
        assert_allclose(found.covariance, s2 * A @ A.T, rtol=1e-7, atol=1e-9 * np.abs(found.covariance).min())


def test_number_of_components_by_variance_is_the_fewest():
    X, y = collinear(8)
    C = products(X, y)
    fraction = np.cumsum(PCA().fit(StandardScaler().fit_transform(X)).explained_variance_ratio_)
    for wanted in (0.3, 0.9, 0.99, 0.9999):
        assert components_by_variance(C, wanted) == 1 + int(np.argmax(fraction >= wanted))
    assert components_by_variance(C, 1.0) == 7


def test_number_of_components_by_pse_is_its_minimum():
    X, y = collinear(9)
    C = products(X, y)
    for bound in (None, 1.0, 0.01):
        value = [
            principal_components(C, 199.0, m).rss / 200 + (np.var(y) if bound is None else bound) * (m + 1) / 200
            for m in range(1, 8)
        ]
        assert components_by_pse(C, 199.0, bound) == 1 + int(np.argmin(value))


def folds(X, y, parts=4):
    pieces = np.array_split(np.arange(len(y)), parts)
    train = [products(np.delete(X, piece, 0), np.delete(y, piece)) for piece in pieces]
    return pieces, train, [products(X[piece], y[piece]) for piece in pieces]


def test_number_of_components_by_folds_is_the_best_prediction_of_what_was_held_out():
    X, y = collinear(10, n=80, closeness=0.01)
    pieces, train, test = folds(X, y)
    expected = np.zeros(7)
    for piece in pieces:
        peer_X, peer_y = np.delete(X, piece, 0), np.delete(y, piece)
        for m in range(1, 8):
            peer = make_pipeline(StandardScaler(), PCA(m), LinearRegression()).fit(peer_X, peer_y)
            error = y[piece] - peer.predict(X[piece])
            expected[m - 1] += np.sum((error - error.mean()) ** 2)
    m, error = components_by_folds(train, test)
    assert_allclose(error, expected, rtol=1e-7)
    assert m == 1 + np.argmin(expected)
    with pytest.raises(SelectionError, match="one held-out matrix for each fold; found 4 to fit and 3"):
        components_by_folds(train, test[:3])


@pytest.mark.parametrize("k", [1e-6, 1e-2, 1.0])
def test_ridge_equals_scikit_learn_on_columns_of_unit_length(k):
    X, y = collinear(11)
    found = ridge(products(X, y), 199.0, k)
    centred = X - X.mean(axis=0)
    length = np.linalg.norm(centred, axis=0)
    peer = Ridge(alpha=k, solver="svd").fit(centred / length, y)
    assert_allclose(found.theta, peer.coef_ / length, rtol=1e-8)
    assert_allclose(found.rss, np.sum((y - peer.predict(centred / length)) ** 2), rtol=1e-8)
    s = np.linalg.svd(centred / length, compute_uv=False)
    assert_allclose(found.effective_terms, np.sum(s**2 / (s**2 + k)), rtol=1e-8)
    assert "biased" in found.method


def test_ridge_constant_by_gcv_is_no_worse_than_a_fine_grid():
    X, y = collinear(12, n=40)
    y = y + 5.0 * np.random.default_rng(0).normal(size=40)
    C = products(X, y)

    def gcv(k):
        found = ridge(C, 39.0, k)
        return 40 * found.rss / (40 - 1 - found.effective_terms) ** 2

    best = ridge_by_gcv(C, 39.0)
    assert 1e-10 < best < 1e2
    assert gcv(best) <= min(gcv(k) for k in 10.0 ** np.linspace(-10, 2, 500)) * (1 + 1e-9)


def test_ridge_constant_by_folds_is_no_worse_than_a_fine_grid():
    X, y = collinear(13, n=60)
    y = y + 5.0 * np.random.default_rng(0).normal(size=60)
    pieces, train, test = folds(X, y)

    def error(k):
        total = 0.0
        for piece, C in zip(pieces, train):
            left = y[piece] - X[piece] @ ridge(C, 44.0, k).theta
            total += np.sum((left - left.mean()) ** 2)
        return total

    best = ridge_by_folds(train, test)
    assert error(best) <= min(error(k) for k in 10.0 ** np.linspace(-10, 2, 500)) * (1 + 1e-9)


def test_drop_correlated_leaves_out_the_weaker_of_each_pair_until_none_is_above_the_limit():
    X, y = collinear(14, closeness=0.3)
    C = products(X, y)
    kept, dropped = drop_correlated(C, 199.0, range(7), 0.8)
    inside = list(range(7))
    for gone in dropped:
        fit = sm.OLS(y, sm.add_constant(X[:, inside])).fit()
        covariance = fit.cov_params()[1:, 1:]
        R = correlation(covariance)
        a, b = inside.index(gone.index), inside.index(gone.other)
        assert_allclose(gone.correlation, R[a, b], rtol=1e-8)
        assert abs(R[a, b]) == pytest.approx(np.abs(np.triu(R, 1)).max(), rel=1e-10)
        assert abs(R[a, b]) > 0.8
        assert fit.tvalues[1 + a] ** 2 <= fit.tvalues[1 + b] ** 2
        inside.remove(gone.index)
    assert len(dropped) >= 1
    assert list(kept) == inside
    assert np.abs(np.triu(parameter_correlation(C, kept), 1)).max() <= 0.8


def test_drop_correlated_keeps_forced_terms_and_ends_when_only_they_correlate():
    X, y = collinear(15)
    C = products(X, y)
    _, dropped = drop_correlated(C, 199.0, range(7), 0.8)
    weaker = dropped[0].index
    kept, _ = drop_correlated(C, 199.0, range(7), 0.8, include=[weaker])
    assert weaker in kept
    kept, dropped = drop_correlated(C, 199.0, range(7), 0.01, include=range(7))
    assert kept == tuple(range(7))
    assert dropped == ()


def test_alpha_squared_is_dropped_where_the_recorded_range_makes_it_collinear_with_alpha():
    # [H17], CX: alpha between 0.1 and 0.2 rad, linear truth.
    rng = np.random.default_rng(0)
    alpha, q, de = rng.uniform(0.1, 0.2, 400), rng.normal(size=400), rng.normal(size=400)
    y = 0.86 * alpha - 0.04 * q + 0.02 * de + 0.005 * rng.normal(size=400)
    kept, dropped = drop_correlated(products(np.column_stack([alpha, alpha**2, q, de]), y), 399.0, range(4), 0.9)
    assert kept == (0, 2, 3)
    assert (dropped[0].index, dropped[0].other) == (1, 0)
    assert dropped[0].correlation < -0.98


def test_what_cannot_be_done_is_refused_in_words():
    X, y, *_ = problem(0, p=4, k=2)
    C = products(np.column_stack([X, X[:, 0]]), y)
    with pytest.raises(SelectionError, match="1 to 4 components; found 5"):
        principal_components(C, 119.0, 5)
    with pytest.raises(SelectionError, match="constant above zero"):
        ridge(C, 119.0, 0.0)
    with pytest.raises(SelectionError, match="limit between 0 and 1"):
        drop_correlated(C, 119.0, [0, 1], 2.0)
    C[1, :] = C[:, 1] = 0.0
    with pytest.raises(SelectionError, match=r"\[1\] are constant"):
        ridge(C, 119.0, 1.0)
