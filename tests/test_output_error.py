import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import optimize, signal, stats

from structsel.errors import DataError, DomainError
from structsel.numerics import global_search, output_error
from structsel.numerics.linear_systems import simulate_linear
from structsel.numerics.output_error_problem import OutputErrorProblem

T = np.linspace(0.0, 4.0, 81)
OF_THE_PROBLEM = {"R", "cost", "full", "affects", "bounds", "constraint"}


def fit_output_error(predict, y, start, **options):
    problem = {name: options.pop(name) for name in OF_THE_PROBLEM & options.keys()}
    return output_error.fit_output_error(OutputErrorProblem(predict, y, **problem), start, **options)


def search_globally(predict, y, bounds, constraint=None, **options):
    problem = OutputErrorProblem(predict, y, bounds=bounds, constraint=constraint)
    return global_search.search_globally(problem, **options)


TRUTH = np.array([2.0, 0.8, 3.0])


def ringing(thetas):
    """Two outputs: a damped oscillation and its envelope; amplitude, decay, frequency."""
    a, d, w = (thetas[:, j, None] for j in range(3))
    envelope = a * np.exp(-d * T)
    return np.stack([envelope * np.cos(w * T), envelope], axis=2)


def ringing_with_noise(seed, std=(0.05, 0.2)):
    rng = np.random.default_rng(seed)
    return ringing(TRUTH[None])[0] + rng.standard_normal((len(T), 2)) * std


START = np.array([1.0, 0.3, 2.6])


def scipy_answer(y, R, bounds=(-np.inf, np.inf)):
    """scipy's least squares with known weights."""
    found = optimize.least_squares(
        lambda p: ((ringing(p[None])[0] - y) / np.sqrt(R)).ravel(), START, x_scale=np.abs(START), xtol=1e-14,
        ftol=1e-14, gtol=1e-14, bounds=bounds,
    )  # fmt: skip
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


@pytest.mark.parametrize("method", ["levenberg-marquardt", "gauss-newton"])
def test_weighted_least_squares_agrees_with_scipy(method):
    y, R = ringing_with_noise(1), np.array([0.05, 0.2]) ** 2
    fit = fit_output_error(ringing, y, START, R=R, cost="weighted", method=method, tolerance=1e-9)
    theta, covariance = scipy_answer(y, R)
    assert fit.converged
    assert_allclose(fit.theta, theta, rtol=1e-6)
    # The bound of the weighted cost takes the residuals' own variance; with the true weights that is nearly R.
    assert_allclose(fit.crlb, covariance, rtol=0.5, atol=1e-6)


def test_maximum_likelihood_is_the_fixed_point_of_weighting_with_its_own_residuals():
    y = ringing_with_noise(2)
    fit = fit_output_error(ringing, y, START, tolerance=1e-9)
    R = np.ones(2)
    for _ in range(30):
        theta, covariance = scipy_answer(y, R)
        R = np.mean((y - ringing(theta[None])[0]) ** 2, axis=0)
    assert fit.converged
    assert_allclose(fit.theta, theta, rtol=1e-5)
    assert_allclose(np.diag(fit.R), R, rtol=1e-5)
    assert_allclose(fit.crlb, covariance, rtol=1e-3, atol=1e-9)
    assert (np.diff(fit.costs) < 0.0).all()


def test_a_full_covariance_accounts_for_correlated_channels():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky([[1.0, 0.95], [0.95, 1.0]])
    y = ringing(TRUTH[None])[0] + 0.1 * rng.standard_normal((len(T), 2)) @ root.T
    full, diagonal = (fit_output_error(ringing, y, START, full=f) for f in (True, False))
    correlation = full.R[0, 1] / np.sqrt(full.R[0, 0] * full.R[1, 1])
    assert correlation == pytest.approx(0.95, abs=0.04)
    assert diagonal.R[0, 1] == 0.0
    assert np.linalg.det(full.crlb) < 0.5 * np.linalg.det(diagonal.crlb)
    assert np.all(np.abs(full.theta - TRUTH) < 4.0 * full.std_white)


def test_samples_that_are_missing_take_no_part():
    y = ringing_with_noise(4)
    gone = y.copy()
    gone[10:30, 1] = np.nan
    gone[50, 0] = np.nan
    fit = fit_output_error(ringing, gone, START, R=np.array([0.0025, 0.04]), cost="weighted", tolerance=1e-9)
    seen = np.isfinite(gone)
    found = optimize.least_squares(
        lambda p: ((ringing(p[None])[0] - y) / (0.05, 0.2))[seen], START, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    assert_allclose(fit.theta, found.x, rtol=1e-6)
    assert np.isnan(fit.residuals[0][~seen]).all()


def test_manoeuvres_have_common_parameters_and_their_own():
    # Decay and frequency are common; each record has its own amplitude.
    rng = np.random.default_rng(5)
    amplitudes = (2.0, -1.2, 0.7)
    y = [ringing(np.array([[a, 0.8, 3.0]]))[0] + 0.05 * rng.standard_normal((len(T), 2)) for a in amplitudes]
    predict = [lambda p, j=j: ringing(p[:, [2 + j, 0, 1]]) for j in range(3)]
    affects = [np.array([True, True, j == 0, j == 1, j == 2]) for j in range(3)]
    start = np.array([0.5, 2.8, 1.0, -1.0, 1.0])
    narrow, wide = (fit_output_error(predict, y, start, affects=a, tolerance=1e-8) for a in (affects, None))
    assert narrow.converged
    assert_allclose(narrow.theta, wide.theta, rtol=1e-6)
    assert_allclose(narrow.crlb, wide.crlb, rtol=1e-5, atol=1e-12)
    assert np.all(np.abs(narrow.theta - [0.8, 3.0, *amplitudes]) < 4.0 * narrow.std_white)


def test_a_bound_that_holds_gives_scipys_bounded_answer():
    y, R = ringing_with_noise(6), np.array([0.05, 0.2]) ** 2
    limits = np.array([[-np.inf, np.inf], [0.0, 0.6], [-np.inf, np.inf]])
    fit = fit_output_error(ringing, y, START, bounds=limits, R=R, cost="weighted", tolerance=1e-9)
    theta, _ = scipy_answer(y, R, bounds=limits.T)
    assert fit.converged
    assert_allclose(fit.theta, theta, rtol=1e-5)
    assert fit.at_bound.tolist() == [0, 1, 0]


def test_a_constraint_is_never_left():
    y = ringing_with_noise(7)
    fit = fit_output_error(ringing, y, START, constraint=lambda p: 0.6 - p[:, 1])
    assert (fit.thetas[:, 1] <= 0.6).all()
    assert fit.theta[1] == pytest.approx(0.6, abs=0.02)
    assert not fit.converged
    assert "constraint" in fit.message
    refused = fit_output_error(ringing, y, START, constraint=lambda p: p[:, 1] - 0.6)
    assert "start does not satisfy the constraint" in refused.message


def test_parameters_that_only_appear_together_are_both_undetermined():
    def together(p):
        return ringing(np.column_stack([p[:, 0] * p[:, 3], p[:, 1], p[:, 2]]))

    fit = fit_output_error(together, ringing_with_noise(8), np.append(START, 1.0))
    assert fit.undetermined.tolist() == [True, False, False, True]
    assert np.isinf(fit.std[[0, 3]]).all()
    assert np.isfinite(fit.std[[1, 2]]).all()
    assert np.abs(fit.theta[1:3] - TRUTH[1:]).max() < 0.1


def test_a_parameter_that_does_nothing_is_undetermined_and_stays():
    fit = fit_output_error(lambda p: ringing(p[:, :3]), ringing_with_noise(9), np.append(START, 7.0))
    assert fit.converged
    assert fit.undetermined.tolist() == [False, False, False, True]
    assert fit.theta[3] == 7.0


def test_a_start_that_diverges_is_reported_without_a_warning():
    fit = fit_output_error(ringing, ringing_with_noise(10), np.array([1.0, -1e3, 3.0]))
    assert not fit.converged
    assert "diverges with the start values" in fit.message
    assert np.isnan(fit.std).all()


def test_steps_into_divergence_are_taken_back():
    def brittle(p):
        return np.where((p[:, 1] > 0.9)[:, None, None], np.inf, ringing(p))

    fit = fit_output_error(brittle, ringing_with_noise(11), START)
    assert fit.converged
    assert np.abs(fit.theta - TRUTH).max() < 0.2


def test_a_search_that_runs_out_of_steps_reports_it_and_returns_its_best_values():
    fit = fit_output_error(ringing, ringing_with_noise(12), START, iterations=1)
    assert not fit.converged
    assert "not converged after 1 step" in fit.message
    assert fit.costs[-1] < fit.costs[0]
    assert_allclose(fit.theta, fit.thetas[-1])


def test_without_noise_the_truth_comes_back_to_rounding():
    fit = fit_output_error(ringing, ringing(TRUTH[None])[0], START)
    assert fit.converged
    assert_allclose(fit.theta, TRUTH, rtol=1e-8)


def test_wrong_arguments_are_refused():
    y = ringing_with_noise(13)
    with pytest.raises(DomainError, match="outside its bounds"):
        fit_output_error(ringing, y, START, bounds=np.array([[2.0, 3.0]] * 3))
    with pytest.raises(DomainError, match="ask for cost 'weighted'"):
        fit_output_error(ringing, y, START, R=np.ones(2))
    with pytest.raises(DataError, match="each sampled somewhere"):
        fit_output_error(ringing, np.column_stack([y[:, 0], np.full(len(T), np.nan)]), START)
    with pytest.raises(DataError, match="either all outputs were read or none"):
        fit_output_error(ringing, np.where(np.arange(2) == np.arange(len(T))[:, None] % 2, y, np.nan), START, full=True)
    with pytest.raises(DomainError, match="finite bounds"):
        search_globally(ringing, y, np.array([[0.0, np.inf]] * 3))


LIMITS = np.array([[-6.0, 6.0], [-1.0, 3.0], [0.5, 12.0]])


def test_evolution_finds_the_valley_that_descent_misses():
    # Long ringing without its envelope: there are valleys at wrong frequencies.
    truth = np.array([2.0, 0.05, 9.0])
    y = ringing(truth[None])[0][:, :1] + 0.05 * np.random.default_rng(14).standard_normal((len(T), 1))

    def one(p):
        return ringing(p)[:, :, :1]

    start = np.array([1.0, 0.1, 2.0])
    alone = fit_output_error(one, y, start, bounds=LIMITS)
    assert abs(alone.theta[2] - 9.0) > 1.0
    seen = []
    found = search_globally(one, y, LIMITS, seed=1, progress=lambda count, cost: seen.append((count, cost)))
    fit = fit_output_error(one, y, found.theta, bounds=LIMITS)
    assert fit.converged
    assert np.all(np.abs(fit.theta - truth) < 4.0 * fit.std_white)
    assert [count for count, _ in seen] == list(range(1, len(seen) + 1))
    assert_allclose([cost for _, cost in seen], found.costs)
    again = search_globally(one, y, LIMITS, seed=1)
    assert_allclose(again.theta, found.theta, rtol=0)


def test_evolution_leaves_forbidden_and_diverging_values():
    def brittle(p):
        lost = np.broadcast_to((p[:, 0] < 1.0)[:, None, None] & (4.0 + p[:, 0, None] < T)[:, :, None], (len(p), 81, 2))
        return np.where(lost, np.nan, ringing(p))

    found = search_globally(brittle, ringing_with_noise(15), LIMITS, seed=2, constraint=lambda p: p[:, 1] - 0.7)
    assert np.isfinite(found.cost)
    assert found.theta[1] >= 0.7
    assert np.abs(found.theta - TRUTH).max() < 0.3
    hopeless = search_globally(
        lambda p: np.full((len(p), 81, 2), np.nan), ringing_with_noise(15), LIMITS, generations=3
    )
    assert np.isinf(hopeless.cost)


# --- Monte Carlo: a short period with noise on its outputs, and no other noise --------------------

DT, N = 0.05, 200
SHORT = np.array([-1.3, 0.95, -4.8, -1.7, -19.5])  # Z_alpha, 1 + Z_q, M_alpha, M_q, M_de
NOISE = np.array([0.004, 0.01])
CLOCK = DT * np.arange(N)
ELEVATOR = 0.03 * signal.square(2.0 * np.pi * 0.35 * CLOCK, 0.6) * (CLOCK < 6.0)


def short_period(p):
    m = len(p)
    A, B = np.zeros((m, 2, 2)), np.zeros((m, 2, 1))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1], B[:, 1, 0] = p.T
    eye, none = np.broadcast_to(np.eye(2), (m, 2, 2)), np.zeros((m, 2, 1))
    return simulate_linear(A, B, eye, none, ELEVATOR[:, None], DT)


@pytest.fixture(scope="module", params=[50, pytest.param(500, marks=pytest.mark.slow)], ids="{} flights".format)
def many_flights(request):
    clean = short_period(SHORT[None])[0]
    rng = np.random.default_rng(16)
    fits, regressed = [], []
    for _ in range(request.param):
        y = clean + rng.standard_normal(clean.shape) * NOISE
        fits.append(fit_output_error(short_period, y, 0.8 * SHORT))
        # Equation error on the same record: q_dot by central differences, regressors as read.
        X, z = np.column_stack([y[1:-1], ELEVATOR[1:-1]]), (y[2:, 1] - y[:-2, 1]) / (2.0 * DT)
        regressed.append(np.linalg.lstsq(X, z, rcond=None)[0])
    return fits, np.array(regressed)


def test_estimates_of_many_flights_scatter_as_the_cramer_rao_bound_says(many_flights):
    fits, _ = many_flights
    assert all(fit.converged for fit in fits)
    errors = np.array([fit.theta - SHORT for fit in fits])
    bound = np.mean([np.diag(fit.crlb) for fit in fits], axis=0)
    # A sample variance of 500 is within +-20.7 % of the variance at 99.9 % (chi-squared); five parameters.
    n = len(fits)
    low, high = stats.chi2.ppf([0.0005, 0.9995], n - 1) / (n - 1)
    ratio = errors.var(axis=0, ddof=1) / bound
    assert (ratio > low * 0.97).all()  # R is estimated from the residuals, short by the fitted parameters
    assert (ratio < high * 1.03).all()
    # No bias: the mean is within four standard errors of the truth.
    assert np.all(np.abs(errors.mean(axis=0)) < 4.0 * np.sqrt(bound / n))
    inside = np.mean(np.abs(errors) < 1.96 * np.array([fit.std_white for fit in fits]))
    # Four standard errors of 5 n intervals; at 500 flights 0.02.
    assert inside == pytest.approx(0.95, abs=max(0.02, 4.0 * np.sqrt(0.95 * 0.05 / (5 * n))))


def test_equation_error_on_the_same_flights_is_biased(many_flights):
    _, regressed = many_flights
    mean, std = regressed.mean(axis=0), regressed.std(axis=0, ddof=1)
    # Five standard errors of the mean of 500 flights: nothing that more flights would cure.
    assert (np.abs(mean - SHORT[2:]) / std > 5.0 / np.sqrt(500)).all()
    assert np.all(np.abs(mean / SHORT[2:]) < 1.0)  # towards zero, as noise in regressors does
