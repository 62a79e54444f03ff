"""Standard errors where residuals are coloured: formulas, references, coverage, and one answer everywhere."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from statsmodels.stats.sandwich_covariance import S_hac_simple

from structsel import Candidates, select
from structsel.numerics.coloured_fit import streamed_coloured_covariance
from structsel.numerics.cross_products import cross_products
from structsel.numerics.least_squares import fit_terms
from structsel.numerics.noise_models import autocorrelation, autocovariance, random_block_weights
from structsel.numerics.regressors import ArrayData
from structsel.numerics.score_covariance import (
    coloured_covariance,
    last_correlated_lag,
    parzen_window,
    score_covariance,
)
from structsel.recording import Recording
from structsel.refinement import equation_error
from structsel.selection.resampling import bootstrap_units

from .pools import ar1


def test_autocovariance_equals_statsmodels():
    e = ar1(np.random.default_rng(1), 500, 0.8)
    expected = sm.tsa.acovf(e, demean=False, adjusted=False, nlag=40, fft=False)
    assert_allclose(autocovariance(e, 40), expected, rtol=1e-10, atol=1e-12)


def test_autocorrelation_equals_statsmodels_and_a_constant_has_none():
    e = 3.0 + ar1(np.random.default_rng(1), 500, 0.8)
    assert_allclose(autocorrelation(e, 40), sm.tsa.acf(e, nlags=40, fft=False), rtol=1e-10, atol=1e-12)
    assert_allclose(autocorrelation(np.full(9, 2.0), 3), [1.0, 0.0, 0.0, 0.0])


def regression(n=300):
    rng = np.random.default_rng(2)
    base = np.vstack([ar1(rng, n, 0.9), ar1(rng, n, 0.5)])
    y = base[0] - 2 * base[1] + ar1(rng, n, 0.8)
    X = np.column_stack([np.ones(n), base.T])
    return base, y, X, y - X @ np.linalg.lstsq(X, y, rcond=None)[0]


def test_coloured_covariance_is_the_written_double_sum():
    n = 600
    _, _, X, e = regression(n)
    rho = [np.mean(e[: n - l] * e[l:]) for l in range(n // 5)]
    M = next(m for m in range(1, 100) if max(np.abs(rho[m : m + 5])) < 2 * rho[0] * np.sqrt(np.log10(n) / n))
    lags = 6 * M
    assert 1 < M < lags < n // 5
    R = np.array([parzen_window(l / lags) * rho[l] for l in range(lags + 1)])
    middle = np.zeros((3, 3))
    for i in range(n):
        for j in range(max(0, i - lags), min(n, i + lags + 1)):
            middle += R[abs(i - j)] * np.outer(X[i], X[j])
    D = np.linalg.inv(X.T @ X)
    assert_allclose(coloured_covariance([X], [e]), D @ middle @ D * n / (n - 3), rtol=1e-8)


def test_the_variance_of_a_mean_is_that_of_statsmodels_with_the_same_window():
    # With a constant regressor the double sum is sum_l w(l) sum_t e(t) e(t + l).
    e = ar1(np.random.default_rng(7), 700, 0.9)
    e -= e.mean()
    pairs = 700.0 - np.arange(141)
    lags = 6 * last_correlated_lag(autocovariance(e, 140) * 700.0 / pairs, pairs)
    expected = S_hac_simple(e[:, None], nlags=lags, weights_func=lambda n: parzen_window(np.arange(n + 1) / lags))
    assert 1 < lags < 140
    assert_allclose(score_covariance(np.ones((1, 700, 1)), e[:, None]), expected, rtol=1e-10)


def test_the_last_correlated_lag_is_that_of_a_moving_average_and_counts_sampled_lags_only():
    rng = np.random.default_rng(8)
    e = np.convolve(rng.standard_normal(20_003), np.ones(4), mode="valid")  # correlated to lag 3
    pairs = 20_000.0 - np.arange(400)
    covariance = autocovariance(e, 399)
    assert last_correlated_lag(covariance, pairs) == 4
    rare = np.zeros(4000)
    rare[::10], every_tenth = covariance, np.zeros(4000)
    every_tenth[::10] = pairs
    assert last_correlated_lag(rare, every_tenth) == 40
    assert last_correlated_lag(covariance[:5], pairs[:5]) == 5  # too few lags to say


@pytest.mark.parametrize("rho", [0.0, 0.8, 0.99])
@pytest.mark.parametrize("n", [9, 300, 5000])
def test_few_lags_directly_and_all_by_transforms_give_the_same_covariance(n, rho):
    # A channel without samples leaves the sum as it is; with it the transforms are used. At rho = 0.99 both use them.
    rng = np.random.default_rng(10)
    S, e = np.stack([ar1(rng, n, 0.9), np.ones(n)])[:, :, None], ar1(rng, n, rho)[:, None]
    absent = np.full((n, 1), np.nan)
    both = score_covariance(np.concatenate([S, np.zeros_like(S)], axis=2), np.concatenate([e, absent], axis=1))
    alone = score_covariance(S, e)
    assert_allclose(both, alone, rtol=1e-10, atol=1e-12 * np.abs(alone).max())
    assert not score_covariance(S, 0.0 * e).any()


def test_residuals_of_channels_sampled_at_different_rates_need_no_filling_in():
    # The slow channel alone, and with one whose residuals carry no information on the parameter.
    rng = np.random.default_rng(9)
    S, e = rng.standard_normal(3000), ar1(rng, 3000, 0.6)
    e[np.arange(3000) % 3 != 0] = np.nan
    S = np.where(np.isfinite(e), S, 0.0)
    alone = score_covariance(S[None, ::3, None], e[::3, None])
    both = score_covariance(
        np.stack([S, np.zeros(3000)], axis=1)[None], np.stack([e, rng.standard_normal(3000)], axis=1)
    )
    assert_allclose(both, alone, rtol=1e-9)


@pytest.mark.parametrize("n", [300, 70_000])  # the longer one is correlated in two segments
def test_streamed_over_the_recordings_it_is_the_same(n):
    base, y, X, e = regression(n)
    flight = [ArrayData(base, y[None])]
    exponents = np.eye(2, dtype=int)
    found = streamed_coloured_covariance(flight, exponents, fit_terms(flight, exponents))
    assert_allclose(found, coloured_covariance([X], [e]), rtol=1e-7)


def test_selection_and_equation_error_give_one_regression_the_same_standard_errors():
    flights = []
    for seed, n in ((3, 900), (4, 600)):
        rng = np.random.default_rng(seed)
        alpha, q_hat = 0.05 * ar1(rng, n, 0.95), 0.01 * ar1(rng, n, 0.9)
        CZ = 0.2 - 4.0 * alpha + 8.0 * q_hat + 0.05 * ar1(rng, n, 0.9)
        flights.append(
            Recording(f"f{seed}", np.arange(n) * 0.02, {"alpha": alpha, "q_hat": q_hat, "CZ": CZ}, {"alpha": "rad"})
        )
    names = ["alpha", "q_hat"]
    selections = select(flights, ["CZ"], Candidates(names), include=names, noise="white", bootstrap=0)
    selected = selections["CZ"]
    estimated = equation_error(selections.model, None, flights)
    assert_allclose(estimated.values, selected.values, rtol=1e-9)
    assert_allclose(estimated.std, selected.standard_errors, rtol=1e-7)


@pytest.mark.parametrize("rho", [0.0, 0.92])
def test_coloured_intervals_cover_the_truth_and_the_white_formula_does_not(rho):
    # 300 draws: 95 % +- three standard errors of a proportion is 91.2 to 98.8 %.
    rng = np.random.default_rng(3)
    X = np.column_stack([np.ones(2000), ar1(rng, 2000, 0.98), ar1(rng, 2000, 0.95)])
    D = np.linalg.inv(X.T @ X)
    inside = {"white": 0, "coloured": 0}
    for _ in range(300):
        y = X[:, 1] + X[:, 2] + ar1(rng, 2000, rho)
        theta = D @ X.T @ y
        e = y - X @ theta
        inside["white"] += abs(theta[1] - 1) < 1.96 * (D[1, 1] * e @ e / 1997) ** 0.5
        inside["coloured"] += abs(theta[1] - 1) < 1.96 * coloured_covariance([X], [e])[1, 1] ** 0.5
    assert 0.89 < inside["coloured"] / 300 < 0.988
    assert inside["white"] / 300 > 0.9 if rho == 0 else inside["white"] / 300 < 0.6


def test_bootstrap_weights_have_mean_and_variance_one_and_keep_units_together():
    units = np.array([0, 0, 1, 2, 3, 3, 4, 5, 6, 7])
    weights = random_block_weights(units, 4000, np.random.default_rng(4))
    assert np.array_equal(weights[:, 0], weights[:, 1])
    by_unit = weights[:, [0, 2, 3, 4, 6, 7, 8, 9]]
    assert_allclose(by_unit.mean(axis=1), 1.0, rtol=1e-12)
    # Dividing by the mean of 8 takes 2/9 off the variance of an exponential: 8 * 7 / (8 * 9) = 7/9.
    assert_allclose(by_unit.var(axis=0).mean(), 7 / 9, rtol=0.05)


def test_few_manoeuvres_are_resampled_by_block_and_many_as_complete_manoeuvres():
    rng = np.random.default_rng(5)
    flights = [ArrayData(rng.standard_normal((1, 500)), rng.standard_normal((1, 500))) for _ in range(9)]
    assert len(set(bootstrap_units(cross_products(flights[:3], np.eye(1, dtype=int), blocks=15)))) == 15
    assert len(set(bootstrap_units(cross_products(flights, np.eye(1, dtype=int))))) == 9
