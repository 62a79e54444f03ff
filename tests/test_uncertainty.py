import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose

from structsel.numerics.least_squares import refit
from structsel.numerics.moments import accumulate
from structsel.numerics.rows import ArraySignals
from structsel.numerics.uncertainty import (
    bootstrap_units,
    bootstrap_weights,
    coloured_covariance,
    residual_autocorrelation,
)

from .pools import ar1


def test_autocovariance_equals_statsmodels():
    e = ar1(np.random.default_rng(1), 500, 0.8)
    expected = sm.tsa.acovf(e, demean=False, adjusted=False, nlag=40, fft=False)
    assert_allclose(residual_autocorrelation(e, 40), expected, rtol=1e-10, atol=1e-12)


def test_coloured_covariance_is_the_written_double_sum():
    rng = np.random.default_rng(2)
    n, lags = 300, 25
    base = np.vstack([ar1(rng, n, 0.9), ar1(rng, n, 0.5)])
    y = base[0] - 2 * base[1] + ar1(rng, n, 0.8)
    flight = [ArraySignals(base, y[None])]
    fit = refit(flight, np.eye(2, dtype=int))
    X = np.column_stack([np.ones(n), base.T])
    e = y - X @ fit.theta
    R = np.array([np.sum(e[: n - l] * e[l:]) / n for l in range(lags + 1)])
    meat = np.zeros((3, 3))
    for i in range(n):
        for j in range(max(0, i - lags), min(n, i + lags + 1)):
            meat += R[abs(i - j)] * np.outer(X[i], X[j])
    D = np.linalg.inv(X.T @ X)
    found = coloured_covariance(flight, np.eye(2, dtype=int), fit, max_lag=lags)
    assert_allclose(found, D @ meat @ D * n / (n - 3), rtol=1e-8)


@pytest.mark.parametrize("rho", [0.0, 0.92])
def test_coloured_intervals_cover_the_truth_and_the_white_formula_does_not(rho):
    # 300 draws: 95 % +- three standard errors of a proportion is 91.2 to 98.8 %.
    rng = np.random.default_rng(3)
    base = np.vstack([ar1(rng, 2000, 0.98), ar1(rng, 2000, 0.95)])
    exponents = np.eye(2, dtype=int)
    inside = {"white": 0, "coloured": 0}
    for _ in range(300):
        y = base.sum(axis=0) + ar1(rng, 2000, rho)
        flight = [ArraySignals(base, y[None])]
        fit = refit(flight, exponents)
        sandwich = coloured_covariance(flight, exponents, fit, max_lag=200)
        inside["white"] += abs(fit.theta[1] - 1) < 1.96 * fit.covariance[1, 1] ** 0.5
        inside["coloured"] += abs(fit.theta[1] - 1) < 1.96 * sandwich[1, 1] ** 0.5
    assert 0.89 < inside["coloured"] / 300 < 0.988
    assert inside["white"] / 300 > 0.9 if rho == 0 else inside["white"] / 300 < 0.6


def test_bootstrap_weights_have_mean_and_variance_one_and_keep_units_together():
    units = np.array([0, 0, 1, 2, 3, 3, 4, 5, 6, 7])
    weights = bootstrap_weights(units, 4000, np.random.default_rng(4))
    assert np.array_equal(weights[:, 0], weights[:, 1])
    by_unit = weights[:, [0, 2, 3, 4, 6, 7, 8, 9]]
    assert_allclose(by_unit.mean(axis=1), 1.0, rtol=1e-12)
    # Dividing by the mean of 8 takes 2/9 off the variance of an exponential: 8 * 7 / (8 * 9) = 7/9.
    assert_allclose(by_unit.var(axis=0).mean(), 7 / 9, rtol=0.05)


def test_few_manoeuvres_are_resampled_by_block_and_many_whole():
    rng = np.random.default_rng(5)
    flights = [ArraySignals(rng.standard_normal((1, 500)), rng.standard_normal((1, 500))) for _ in range(9)]
    assert len(set(bootstrap_units(accumulate(flights[:3], np.eye(1, dtype=int), blocks=15)))) == 15
    assert len(set(bootstrap_units(accumulate(flights, np.eye(1, dtype=int))))) == 9
