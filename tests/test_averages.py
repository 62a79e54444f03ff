"""Averages over time show exceeded tolerances where turbulence moves the aircraft."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime, minimize
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

import structsel as ss
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.preparing import prepare
from structsel.diagnosis.averages import _Averages, _scatter, _time_alike, exceeded_in_averages
from structsel.diagnosis.problem import DiagnosisProblem
from tests.models import model_of


class Differing:
    """A flight of which only its differences are known."""

    def __init__(self, x):
        self.difference = {"CZ": x}

    def __len__(self):
        return len(self.difference["CZ"])


def small(seed=0):
    """Twelve averages of two responses in two flights of three windows, three parameters, gusts in one channel."""
    rng = np.random.default_rng(seed)
    tolerances = [Nuisance(f"p{j}", 1.0, "-", [], effect="mass-error") for j in range(3)]
    response, flight, window = np.tile([0, 0, 0, 1, 1, 1], 2), np.repeat([0, 1], 6), np.tile([0, 1, 2], 4)
    window = window + 3 * flight
    B, expected = rng.standard_normal((12, 3)), np.array([0.5, 0.8])
    own = np.kron(np.eye(2), np.ones((6, 6)))
    slopes = np.column_stack([np.where(response, 2.0, 1.0), np.zeros(12)])
    scatter = _scatter(expected, slopes, response, flight, window)
    return _Averages(["CX", "CZ"], tolerances, rng.standard_normal(12), B, own, response, expected, *scatter)


LOG_SD = np.log([0.5, 0.8, 0.4, 0.25, 0.4, 0.2])  # each response and gusts, in a window; the same throughout a flight


def covariance(of, sd):
    """Sums over pairs of averages, as it is stated."""
    made = of.B @ of.B.T + of.own
    for a in range(12):
        for b in range(12):
            if a // 6 != b // 6:
                continue
            one, other = (1.0 + (k // 3) % 2 for k in (a, b))  # the slope: one, or two in the second response
            made[a, b] += sd[5] ** 2 * one * other + (a % 3 == b % 3) * sd[2] ** 2 * one * other
            if of.response[a] == of.response[b]:
                made[a, b] += sd[3 + of.response[a]] ** 2 + (a == b) * sd[of.response[a]] ** 2
    return made


def test_the_evidence_is_that_of_scipy_with_the_scatter_that_makes_it_largest():
    of = small()
    assert_allclose(np.log(of.sd), LOG_SD)

    def loss(x):
        normal = multivariate_normal(cov=covariance(of, np.exp(x))).logpdf(of.y)
        away = (x - LOG_SD) / [0.7, 0.7, 1.5, 1.5, 1.5, 1.5]
        return 0.5 * float(away @ away) - normal - 0.5 * len(of.y) * np.log(2.0 * np.pi)

    found = of.likeliest()
    best = minimize(
        loss, found.scatter, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10, "maxiter": 10_000}
    )
    assert_allclose(found.log_evidence, -best.fun, atol=1e-5)
    assert_allclose(found.scatter, best.x, atol=1e-3)
    assert_allclose(approx_fprime(found.scatter, loss, 1e-6), 0.0, atol=1e-3)


def test_the_posterior_is_that_of_a_regression_with_known_noise():
    of = small(1)
    K = of.covariance(LOG_SD)
    noise = K - of.B @ of.B.T
    precision = of.B.T @ np.linalg.solve(noise, of.B) + np.eye(3)
    mean, spread = of.posterior(K)
    assert_allclose(spread, np.linalg.inv(precision), atol=1e-12)
    assert_allclose(mean, np.linalg.solve(precision, of.B.T @ np.linalg.solve(noise, of.y)), atol=1e-12)


def test_an_exceeded_parameter_is_that_of_a_regression_with_its_wider_prior():
    of = small(2)
    noise = of.covariance(LOG_SD) - of.B @ of.B.T
    precision = of.B.T @ np.linalg.solve(noise, of.B) + np.diag([1.0, 1.0 / 15.0**2, 1.0])
    mean = np.linalg.solve(precision, of.B.T @ np.linalg.solve(noise, of.y))
    found = of.exceeding(1, 15.0, LOG_SD, 3.0, {})
    assert_allclose([found.deviations, found.std], [mean[1], np.sqrt(np.linalg.inv(precision)[1, 1])], rtol=1e-9)


@pytest.mark.parametrize("a", [0.0, 0.9, 0.98])
def test_the_time_over_which_an_autoregression_is_alike(a):
    rng = np.random.default_rng(3)
    flights = [Differing(lfilter([1.0], [1.0, -a], rng.standard_normal(20_000))) for _ in range(4)]
    assert_allclose(_time_alike(flights, "CZ"), (1.0 + a) / (1.0 - a), rtol=0.2)


@pytest.fixture(scope="module")
def in_turbulence():
    return ss.demo_flights(4, 5, turbulence=1.5)


def asked(in_turbulence, factor):
    recordings, aircraft, truth = in_turbulence
    heavy = ss.Aircraft.from_dict(aircraft.to_dict() | {"mass": factor * aircraft.mass})
    return exceeded_in_averages(DiagnosisProblem.set_up(prepare(model_of(truth), recordings, heavy).flights, ()))


def test_a_mass_that_is_wrong_by_a_fifth_is_found_in_turbulence(in_turbulence):
    found = asked(in_turbulence, 1.2)
    first = found.tolerances[0]
    assert first.effect == "mass-error"
    assert first.log_odds > 2.0
    assert abs(first.estimate.value - 0.2) < 3.0 * first.estimate.std
    assert found.responses[0] == "CZ"


def test_turbulence_alone_exceeds_no_tolerance(in_turbulence):
    found = asked(in_turbulence, 1.0)
    assert all(one.log_odds < -3.0 for one in found.tolerances)
