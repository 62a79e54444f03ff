"""Rows that the past predicts: two-stage least squares on cross-products, and aircraft that follow the residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from statsmodels.sandbox.regression.gmm import IV2SLS

import structsel as ss
from structsel.numerics.instrumental import InstrumentedProducts
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.past_data import RESIDUAL_LAGS, SIGNAL_LAGS, PastData, past_exponents
from structsel.numerics.prewhitened_products import prewhitened_cross_products
from structsel.numerics.regressors import ArrayData
from structsel.selection.causal import turbulence_shows
from structsel.selection.choices import FlowAngles

DEGREES = np.array([1, 1, 2])


def lagged(x: np.ndarray, lag: int) -> np.ndarray:
    return np.concatenate([np.full(lag, x[0]), x[: x.size - lag]])


def two_signals(n: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slow signals, one of them read with an error that is in the response too."""
    rng = np.random.default_rng(4)
    a, b = lfilter([0.2], [1.0, -0.98], rng.standard_normal((2, n)))
    shared = rng.standard_normal(n)
    x = np.array([a + 0.4 * shared, b])
    return x, 1.5 + 2.0 * x[0] - 0.7 * x[1] + 0.5 * x[0] * x[1] + shared, a


def instrumented(x: np.ndarray, y: np.ndarray) -> InstrumentedProducts:
    exponents = np.array([[1, 0], [0, 1], [1, 1]])
    data = PastData(ArrayData(x, y[None, :]), (exponents,), (np.zeros(4),), (0,), (0,))
    table, instruments, _ = past_exponents(exponents, [2], 1)
    white = [[ARNoise(np.empty(0), 1.0)]]
    products = prewhitened_cross_products([data], table, white)[0]
    return InstrumentedProducts(products, 3, instruments, np.empty(0, dtype=int))


@pytest.mark.parametrize(("start", "stop"), [(0, 9), (4, 40), (300, 340)])
def test_past_signals_and_residuals_are_those_of_earlier_samples(start, stop):
    x, y, _ = two_signals()
    theta = np.array([1.5, 2.0, 0.5])
    data = PastData(ArrayData(x, y[None, :]), (np.array([[1, 0], [2, 1]]),), (theta,), (0,), (0,))
    residual = y - 1.5 - 2.0 * x[0] - 0.5 * x[0] ** 2 * x[1]
    expected = [*x, *(lagged(signal, lag) for lag in SIGNAL_LAGS for signal in x)]
    expected += [lagged(residual, lag) for lag in RESIDUAL_LAGS]
    np.testing.assert_allclose(data.base(start, stop), np.array(expected)[:, start:stop], rtol=1e-12, atol=1e-12)


def reference(x: np.ndarray, y: np.ndarray) -> IV2SLS:
    one = np.ones(y.size)
    X = np.column_stack([one, x[0], x[1], x[0] * x[1]])
    Z = [lagged(signal, lag) for lag in SIGNAL_LAGS for signal in x]
    Z.append(lagged(x[0] * x[1], SIGNAL_LAGS[0]))
    return IV2SLS(y, X, instrument=np.column_stack([one, *Z]))


def test_two_stage_least_squares_on_products_is_that_of_statsmodels():
    x, y, _ = two_signals()
    fit = instrumented(x, y).fit_terms([0, 1, 2])
    expected = reference(x, y).fit()
    np.testing.assert_allclose(fit.theta, expected.params, rtol=1e-9)
    found = fit.fit(np.empty(0), np.ones(1))
    # Where the instruments are not all valid the variance is Sargan's F times that of the textbook.
    F = fit.test_instruments()[0]
    assert F > 1.0
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance) / F), expected.bse, rtol=1e-7)


def test_intervals_hold_where_the_instruments_have_random_effects_of_their_own_in_all_directions():
    # Effects with four times the variance of the noise, 200 draws of two values: standard error of the fraction 1.1 %.
    rng, inside, textbook, truth = np.random.default_rng(8), [], [], np.array([2.0, -0.7])
    for _ in range(200):
        x = lfilter([0.2], [1.0, -0.98], rng.standard_normal((2, 600)))
        columns = [lagged(signal, lag) for lag in SIGNAL_LAGS for signal in x] + [lagged(x[0] * x[1], SIGNAL_LAGS[0])]
        directions = np.linalg.qr(np.column_stack([np.ones(600), *columns]))[0][:, 1:]
        direct = directions @ (2.0 * rng.standard_normal(directions.shape[1]))
        fit = instrumented(x, truth @ x + direct + rng.standard_normal(600)).fit_terms([0, 1])
        errors = np.sqrt(np.diag(fit.fit(np.empty(0), np.ones(1)).covariance))[1:]
        off, F = np.abs(fit.theta[1:] - truth) / errors, max(1.0, fit.test_instruments()[0])
        inside.append(off < 2.57)  # the variance between five free directions: Student's t
        textbook.append(off * np.sqrt(F) < 2.57)
    assert abs(np.mean(inside) - 0.95) < 0.035
    assert np.mean(textbook) < 0.8


def test_exogeneity_is_rejected_where_reading_and_response_have_a_common_error_and_only_there():
    x, y, a = two_signals()
    assert instrumented(x, y).fit_terms([0, 1, 2]).test_exogeneity()[1] < 1e-6
    clean = np.array([a, x[1]])
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(y.size)
    exogenous = 1.5 + clean[0] + noise
    assert instrumented(clean, exogenous).fit_terms([0, 1]).test_exogeneity()[1] > 0.01


def test_least_squares_differs_and_the_past_gives_the_truth():
    x, y, _ = two_signals(20_000)
    X = np.column_stack([np.ones(y.size), x[0], x[1], x[0] * x[1]])
    ordinary = np.linalg.lstsq(X, y, rcond=None)[0]
    fit = instrumented(x, y).fit_terms([0, 1, 2])
    errors = np.sqrt(np.diag(fit.fit(np.empty(0), np.ones(1)).covariance))
    assert abs(ordinary[1] - 2.0) > 10 * errors[1]
    assert np.all(np.abs(fit.theta - [1.5, 2.0, -0.7, 0.5]) < 3.5 * errors)


def test_a_term_without_effect_is_eliminated_by_the_past():
    x, y, _ = two_signals()
    response = y - 0.5 * x[0] * x[1]
    left = instrumented(x, response).eliminate([0, 1, 2], 12.0, DEGREES)
    assert [number for number, _, _ in left] == [2]
    kept = instrumented(x, response).eliminate([0, 1, 2], 12.0, DEGREES, include=[2])
    assert kept == []


def test_partial_F_has_the_part_of_sargans_factor_that_is_beyond_chance():
    x, y, _ = two_signals()
    fit = instrumented(x, y).fit_terms([0, 1, 2])
    F, k = fit.test_instruments()[0], 6 + 1 - 3  # two signals at three lags and a product; three terms
    critical = stats.f.isf(0.05, k, 600 - 1 - 7)
    assert 1.0 < F < critical
    textbook = (fit.slopes / fit.standard_errors(1.0)) ** 2
    np.testing.assert_allclose(fit.partial_F, textbook, rtol=1e-12)
    doubted = instrumented(x, y + 0.5 * lagged(x[1], SIGNAL_LAGS[1])).fit_terms([0, 1, 2])
    F = doubted.test_instruments()[0]
    assert 2.0 * critical < F
    textbook = (doubted.slopes / doubted.standard_errors(1.0)) ** 2
    np.testing.assert_allclose(doubted.partial_F, textbook * critical / F, rtol=0.01)


def test_terms_of_the_highest_degree_are_eliminated_first():
    x, y, _ = two_signals()
    response = y + 0.7 * x[1] - 0.35 * x[0] * x[1]
    products = instrumented(x, response)
    first, second = products.fit_terms([0, 1, 2]).partial_F[1:]
    assert first < second < 12.0
    orders = [
        [number for number, _, _ in products.eliminate([0, 1, 2], 12.0, degrees)]
        for degrees in (DEGREES, np.array([1, 1, 1]))
    ]
    assert orders == [[2, 1], [1, 2]]


def test_a_linear_term_stays_where_another_value_would_move_by_more_than_its_error():
    rng = np.random.default_rng(12)
    a, c = lfilter([0.2], [1.0, -0.98], rng.standard_normal((2, 600)))
    x = np.array([a, 0.9 * a + 0.3 * c])
    products = instrumented(x, 2.0 * x[0] - 0.5 * x[1] + rng.standard_normal(600))
    fit = products.fit_terms([0, 1])
    assert fit.partial_F[1] < 12.0
    alone = products.fit_terms([0])
    error = np.sqrt(np.diag(alone.fit(np.empty(0), np.ones(1)).covariance))[1]
    assert alone.moved_from(fit) == pytest.approx(abs(alone.theta[1] - fit.theta[1]) / error, rel=1e-9)
    assert alone.moved_from(fit) > 1.0
    assert products.eliminate([0, 1], 12.0, DEGREES, confounders=[0, 1]) == []
    assert [number for number, _, _ in products.eliminate([0, 1], 12.0, DEGREES)] == [1]


def test_without_terms_the_constant_of_each_manoeuvre_is_left():
    x, y, _ = two_signals()
    own = replace(instrumented(x, y), own_constants=True)
    found = own.fit_terms([]).fit(np.array([y.mean()]), np.ones(1))
    assert found.theta == pytest.approx([y.mean()])
    assert found.condition == 1.0


@pytest.fixture(scope="module")
def flights() -> tuple[list[ss.Recording], dict[str, dict[str, float]]]:
    recordings, aircraft, truth = ss.demo_flights(6, 11, turbulence=2.0)
    return ss.compute_all(recordings, aircraft), truth


def of_rolling_moment(flights: tuple[list[ss.Recording], dict[str, dict[str, float]]], rows: str) -> ss.Selection:
    recordings, truth = flights
    terms = [term for term in truth["Cl"] if term != "1"]
    pool = ss.Candidates.parse(terms)
    return ss.select(recordings, "Cl", pool, include=terms, parsimony="none", bootstrap=0, rows=rows)


def test_in_turbulence_rows_are_causal_by_default_and_roll_damping_is_that_of_the_aircraft(flights):
    sampled, chosen = (of_rolling_moment(flights, rows) for rows in ("sampled", "auto"))
    assert (sampled.rows, chosen.rows) == ("sampled", "causal")
    assert "causal rows" in chosen.residual_description
    truth = flights[1]["Cl"]["p_hat"]
    at = [str(term) for term in chosen.terms].index("p_hat") + 1
    assert abs(sampled.values[at] / truth - 1.0) > 0.2
    assert abs(chosen.values[at] / truth - 1.0) < 0.1
    low, high = chosen.intervals()[at]
    assert low < truth < high


def test_in_strong_gusts_few_false_terms_are_selected_and_the_linear_ones_stay(flights):
    recordings, truth = flights
    pool = ss.Candidates.polynomial(["alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr"], 3)
    found = ss.select(recordings, "Cl", pool, bootstrap=0)
    terms = set(map(str, found.terms))
    assert "causal rows" in found.stop_reason
    assert {"beta", "p_hat", "r_hat", "da"} <= terms
    assert len(terms - set(truth["Cl"])) <= 1


def test_turbulence_is_that_of_the_recording_whatever_the_candidates(flights):
    recordings, truth = flights
    terms = [term for term in truth["Cn"] if term != "1"]
    assert "alpha" not in terms
    given = {"include": terms, "parsimony": "none", "bootstrap": 0}
    assert ss.select(recordings, "Cn", ss.Candidates.parse(terms), **given).rows == "causal"
    blind = [ss.Recording(r.name, r.t, {c: r[c] for c in r.names if c not in ("t", "alpha")}) for r in recordings]
    assert ss.select(blind, "Cn", ss.Candidates.parse(terms), **given).rows == "sampled"


@pytest.mark.parametrize(("size", "shows"), [(0.1, False), (0.3, True)])
def test_an_angle_that_hardly_moves_shows_no_turbulence(size, shows):
    rng = np.random.default_rng(2)
    still, moving = lfilter([0.02], [1.0, -0.98], rng.standard_normal(2000)), np.sin(np.arange(2000) / 40.0)
    angle = size * still / still.std()
    flow = FlowAngles([ArrayData(np.array([moving, angle]), np.ones((1, 2000)))], (0, 1))
    assert turbulence_shows(flow) == shows


@pytest.mark.parametrize(("noise", "shows"), [(0.03, False), (0.3, True)])
def test_signals_that_are_constant_in_a_manoeuvre_neither_show_turbulence_nor_hide_it(noise, shows):
    rng = np.random.default_rng(5)
    angle = np.sin(np.arange(2000) / 40.0) + noise * rng.standard_normal(2000)
    for levels in ([], [0.1, -0.7, 3.3], list(rng.standard_normal(7))):
        signals = np.array([angle, *(np.full(2000, level) for level in levels)])
        flow = FlowAngles([ArrayData(signals, np.ones((1, 2000)))], (0,))
        assert turbulence_shows(flow) == shows


def test_in_strong_gusts_causal_intervals_of_yawing_moment_hold_and_its_instruments_are_doubted(flights):
    recordings, truth = flights
    terms = [term for term in truth["Cn"] if term != "1"]
    pool = ss.Candidates.parse(terms)
    found = ss.select(recordings, "Cn", pool, include=terms, parsimony="none", bootstrap=0, rows="causal")
    intervals = zip(map(str, found.terms), found.intervals()[1:], strict=True)
    assert all(low < truth["Cn"][term] < high for term, (low, high) in intervals)
    assert any("Sargan" in doubt and "times as large" in doubt for doubt in found.doubts)


def test_in_calm_air_with_exact_readings_rows_stay_as_sampled():
    recordings, aircraft, truth = ss.demo_flights(4, 3, turbulence=0.0, noise=0.0)
    manoeuvres = ss.compute_all(recordings, aircraft)
    terms = [term for term in truth["Cl"] if term != "1"]
    found = ss.select(manoeuvres, "Cl", ss.Candidates.parse(terms), bootstrap=0)
    assert found.rows == "sampled"


def test_causal_rows_without_noise_models_are_refused():
    recordings, aircraft, _ = ss.demo_flights(1, duration=5.0)
    manoeuvres = ss.compute_all(recordings, aircraft)
    with pytest.raises(ss.StructselError, match="rows='causal' needs the noise model of each recording"):
        ss.select(manoeuvres, "Cm", ss.Candidates.parse(["alpha"]), rows="causal", noise="white")


def test_the_past_before_the_first_sample_is_the_first_sample():
    x, y, _ = two_signals(60)
    data = PastData(ArrayData(x, y[None, :]), (np.array([[1, 0]]),), (np.array([0.5, 1.0]),), (0,), (0,))
    complete = data.base(0, 60)
    for row, lag in enumerate(SIGNAL_LAGS, start=1):
        np.testing.assert_array_equal(complete[2 * row], lagged(x[0], lag))
    np.testing.assert_allclose(data.base(25, 40), complete[:, 25:40], atol=1e-15)
