import mpmath
import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose

from structsel.errors import SelectionError
from structsel.numerics.blocks import Samples
from structsel.numerics.coloured_fit import fit_of_products, streamed_coloured_covariance
from structsel.numerics.cross_products import cross_products
from structsel.numerics.least_squares import fit_each, fit_terms
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import ArrayData, find_scales
from structsel.numerics.residuals import Residuals, fit_residual_noise

from .pools import ar1, design, monomial_exponents


def one_flight(n=3000, s=3, seed=0):
    rng = np.random.default_rng(seed)
    base = rng.standard_normal((s, n)) * np.array([0.05, 2.0, 300.0])[:s, None] + 0.1
    exponents = monomial_exponents(s, 2)
    X = design(base, exponents)
    y = X @ rng.standard_normal(X.shape[1]) + rng.standard_normal(n)
    return ArrayData(base, y[None]), exponents, X, y


def test_white_refit_equals_statsmodels():
    flight, exponents, X, y = one_flight()
    fit, expected = fit_terms([flight], exponents), sm.OLS(y, X).fit()
    assert_allclose(fit.theta, expected.params, rtol=1e-9)
    assert_allclose(fit.covariance, expected.cov_params(), rtol=1e-8, atol=1e-14)
    assert_allclose(fit.rss, expected.ssr, rtol=1e-10)
    assert_allclose(fit.partial_F, expected.tvalues**2, rtol=1e-8)
    assert fit.dof == expected.df_resid


def test_whitened_refit_equals_statsmodels_generalised_least_squares():
    flight, exponents, X, y = one_flight()
    ar = np.array([0.7, 0.2])
    fit = fit_terms([flight], exponents, noise=[ARNoise(ar, 1.0)])
    expected = sm.GLSAR(y, X, rho=ar).fit()
    assert_allclose(fit.theta, expected.params, rtol=1e-8)
    assert_allclose(fit.covariance, expected.cov_params(), rtol=1e-7, atol=1e-14)


def test_manoeuvres_are_weighted_by_their_own_innovation_level():
    a, exponents, Xa, ya = one_flight(seed=1)
    b, _, Xb, yb = one_flight(seed=2)
    fit = fit_terms([a, b], exponents, noise=[ARNoise(np.empty(0), 1.0), ARNoise(np.empty(0), 4.0)])
    weights = np.r_[np.full(len(ya), 1.0), np.full(len(yb), 1.0 / 16.0)]
    expected = sm.WLS(np.r_[ya, yb], np.vstack([Xa, Xb]), weights=weights).fit()
    assert_allclose(fit.theta, expected.params, rtol=1e-9)
    # statsmodels' pseudo-inverse of columns of very different size leaves about seven digits.
    assert_allclose(fit.covariance, expected.cov_params(), rtol=1e-6, atol=1e-14)


def test_parameters_stay_within_twenty_eps_times_condition_of_a_sixty_digit_fit():
    rng = np.random.default_rng(3)
    n = 300
    for nearness in (1e-1, 1e-3, 1e-5, 1e-6):
        base = rng.standard_normal((3, n))
        base[2] = base[1] + nearness * base[2]
        y = base.sum(axis=0) + 0.1 * rng.standard_normal(n)
        fit = fit_terms([ArrayData(base, y[None])], np.eye(3, dtype=int))
        mpmath.mp.dps = 60
        X = mpmath.matrix(np.column_stack([np.ones(n), base.T]).tolist())
        exact = mpmath.lu_solve(X.T * X, X.T * mpmath.matrix(y.tolist()))
        exact = np.array([float(v) for v in exact])
        error = np.linalg.norm(fit.theta - exact) / np.linalg.norm(exact)
        assert error <= 20 * np.finfo(float).eps * fit.condition


@pytest.mark.parametrize("mean", [0.0, 10.0])
def test_printed_partial_f_of_a_near_copy_is_right_to_a_millionth(mean):
    # The copy's Schur complement is 1.6e-9, close to the least that the search allows, 1e-9.
    alpha, de, own, noise = np.random.default_rng(0).standard_normal((4, 1000))
    base = np.vstack([alpha, mean + de, mean + de + 4e-5 * own])
    y = 2.0 * alpha + de + own + 0.5 * noise
    fit = fit_terms([ArrayData(base, y[None])], np.eye(3, dtype=int))
    with mpmath.workdps(60):
        X = mpmath.matrix(np.column_stack([np.ones(y.size), base.T]).tolist())
        response = mpmath.matrix(y.tolist())
        inverse = (X.T * X) ** -1
        theta = inverse * (X.T * response)
        rss = (response.T * response)[0] - ((X.T * response).T * theta)[0]
        F = [float(theta[i] ** 2 / (rss / fit.dof * inverse[i, i])) for i in range(4)]
    assert_allclose(fit.partial_F, F, rtol=1e-6)


def test_residuals_and_their_noise_model_come_back():
    flight, exponents, X, y = one_flight(n=20_000)
    y = y + ar1(np.random.default_rng(4), len(y), 0.9, 3.0) - (y - X @ np.linalg.lstsq(X, y, rcond=None)[0])
    flight = ArrayData(flight.base_signals, y[None])
    fit = fit_terms([flight], exponents)
    residuals = Residuals(exponents, fit.theta, 0, find_scales([flight]))
    residual = np.concatenate(list(residuals.over(Samples(flight, 0, flight.n))))
    assert_allclose(residual, y - X @ fit.theta, atol=1e-8)
    (noise,) = fit_residual_noise([flight], [exponents], [fit.theta], [0], 24, [0.0])[0]
    assert noise.order == 1
    assert_allclose(noise.ar, 0.9, atol=0.02)
    assert_allclose(noise.sigma, 3.0, rtol=0.03)


def test_exactly_dependent_terms_and_too_few_samples_are_refused():
    base = np.random.default_rng(5).standard_normal((2, 100))
    twice = ArrayData(np.vstack([base[0], 2 * base[0]]), base[1:])
    with pytest.raises(SelectionError, match="exactly dependent"):
        fit_terms([twice], np.eye(2, dtype=int))
    with pytest.raises(SelectionError, match="3 samples for 4 parameters"):
        fit_terms([ArrayData(np.ones((3, 3)), np.ones((1, 3)))], np.eye(3, dtype=int))
    with pytest.raises(SelectionError, match="zero in every sample"):
        fit_terms([ArrayData(np.zeros((1, 50)), np.ones((1, 50)))], np.eye(1, dtype=int))


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("nearness", [1.0, 1e-3])
def test_the_fit_from_cross_products_is_that_of_triangular_factors(own, nearness):
    rng = np.random.default_rng(4)
    flights = []
    for k, n in enumerate((70_000, 900)):  # the first is correlated in two segments
        base = rng.standard_normal((3, n)) + k
        base[2] = base[0] + nearness * base[2]
        y = 5.0 + 2.0 * k + np.array([1.0, -3.0, 2.0]) @ base + ar1(rng, n, 0.5)
        flights.append(ArrayData(base * np.array([[0.05], [2.0], [300.0]]), y[None]))
    exponents = monomial_exponents(3, 2)
    shared = cross_products(flights, exponents, blocks=5)
    kept = [2, 0, 1, 4]
    terms, scales = exponents[kept], find_scales(flights)
    found = fit_of_products(flights, exponents, shared.within_manoeuvres() if own else shared, shared, kept)
    (expected,) = fit_each(flights, [terms], [None], [0], own_constants=[own], scales=scales)
    assert found is not None
    fit, covariance = found
    errors = np.sqrt(np.diag(expected.covariance))
    assert_allclose(fit.theta / errors, expected.theta / errors, rtol=0.0, atol=1e-9)
    assert_allclose(fit.constants, expected.constants, rtol=1e-12)
    assert_allclose(fit.rss, expected.rss, rtol=1e-13)
    assert_allclose(fit.condition, expected.condition, rtol=1e-9)
    assert_allclose(fit.unscaled_covariance, expected.unscaled_covariance, rtol=1e-8)
    assert_allclose(covariance, streamed_coloured_covariance(flights, terms, expected), rtol=1e-8)


def test_cross_products_of_near_copies_are_left_to_triangular_factors():
    rng = np.random.default_rng(5)
    base = rng.standard_normal((2, 4000))
    flight = [ArrayData(np.vstack([base[0], base[0] + 1e-6 * base[1]]), rng.standard_normal((1, 4000)))]
    products = cross_products(flight, np.eye(2, dtype=int))
    assert fit_of_products(flight, np.eye(2, dtype=int), products, products, [0, 1]) is None
    assert fit_of_products(flight, np.eye(2, dtype=int), products, products, [0]) is not None
