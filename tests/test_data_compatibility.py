from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from structsel.numerics.kinematics import STATES, fly, readings
from structsel.reconstruction.data_compatibility import check_data_compatibility
from tests.dense_flight_path import ANGLES, dense_observe, dense_step, flight, jacobian

BIASES = slice(9, 15)
HELD = (6, 7, 15, 16, 17, 21, 22)


def quiet(n, seed, held=HELD, **options):
    """A flight whose inputs carry biases but no noise, so that output error's own assumptions hold."""
    problem, path = flight(n, seed, held=held, noisy_inputs=False, **options)
    y = problem.measurements.copy()
    y[:, 7:12] = np.nan  # no satellite receiver
    return replace(problem, measurements=y), path


def test_set_biases_and_vane_errors_come_back():
    problem, path = flight(600, 1, noisy_inputs=False)
    fit = check_data_compatibility(problem)
    assert fit.converged
    assert "converged" in fit.message
    errors = (fit.values - path[0, problem.active]) / fit.std
    assert np.abs(errors).max() < 3.5  # 21 of them
    biased = np.flatnonzero((problem.active >= 9) & (problem.active < 15))
    assert (fit.std[biased] < [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4]).all()
    assert np.abs(errors[biased]).max() < 3.0
    seen = np.isfinite(problem.measurements)
    assert_allclose(fit.measurement_std, problem.measurement_std, rtol=4.0 / np.sqrt(2.0 * seen.sum(axis=0).min()))


def test_path_residuals_and_held_states_belong_to_the_values():
    problem, _ = quiet(300, 2)
    fit = check_data_compatibility(problem)
    start = problem.start.copy()
    start[problem.active] = fit.values
    path = fly(problem.t, problem.inputs, start, problem.place, problem.g, False)
    assert_allclose(fit.path, path, rtol=0)
    constants = [i for i in range(9, 34) if i not in problem.active]
    assert_allclose(fit.path[:, constants], np.tile(problem.start[constants], (300, 1)), rtol=0)
    expected = problem.measurements - readings(path, problem.inputs, problem.place, False)
    expected[:, ANGLES] = np.angle(np.exp(1j * expected[:, ANGLES]))
    assert_allclose(fit.residuals, expected, atol=1e-12)
    assert (np.diff(fit.costs) <= 0.0).all()


def test_the_bound_is_the_inverse_of_the_dense_information_matrix():
    problem, _ = quiet(70, 3)
    fit = check_data_compatibility(problem)
    full = problem.start.copy()
    full[problem.active] = fit.values
    # Sensitivities carried along the path by the chain rule, Jacobians by complex steps.
    everything, carried = np.arange(34), np.eye(34)[:, problem.active]
    information = np.diag(problem.start_std**-2)
    for k in range(70):
        if k:
            carried = jacobian(lambda x, k=k: dense_step(x, k, problem), full, everything) @ carried
            full = dense_step(full, k, problem)
        seen = np.isfinite(problem.measurements[k])
        S = jacobian(lambda x, k=k: dense_observe(x, k, problem), full, everything)[seen] @ carried
        information += S.T @ (S / fit.measurement_std[seen, None] ** 2)
    bound = np.linalg.inv(information)
    scale = np.sqrt(np.outer(np.diag(bound), np.diag(bound)))
    assert_allclose(fit.crlb / scale, bound / scale, atol=1e-5)


def spread_of_errors(seeds, n, correlation):
    """Errors of all values over the std of white and of coloured residuals, (seeds, L) each."""
    white, coloured = [], []
    for seed in seeds:
        problem, path = quiet(n, seed)
        if correlation:
            rng = np.random.default_rng(10_000 + seed)
            e = lfilter(
                [np.sqrt(1.0 - correlation**2)], [1.0, -correlation], rng.standard_normal((n + 200, 12)), axis=0
            )[200:]
            clean = readings(path, problem.inputs, problem.place, False)
            y = np.where(np.isfinite(problem.measurements), clean + problem.measurement_std * e, np.nan)
            problem = replace(problem, measurements=y)
        fit = check_data_compatibility(problem)
        assert fit.converged
        error = fit.values - path[0, problem.active]
        white.append(error / np.sqrt(np.diag(fit.crlb)))
        coloured.append(error / fit.std)
    return np.array(white), np.array(coloured)


@pytest.mark.slow
def test_values_scatter_over_flights_as_their_bound_says():
    white, coloured = spread_of_errors(range(40), 400, 0.0)
    # 40 x 16 errors, not independent within a flight: 95.4 % within two standard deviations, give or take 2 %.
    assert np.mean(np.abs(white) < 2.0) == pytest.approx(0.954, abs=0.025)
    assert np.mean(np.abs(white[:, 7:13]) < 2.0) == pytest.approx(0.954, abs=0.04)  # the biases
    assert np.mean(np.abs(coloured) < 2.0) > 0.92


@pytest.mark.parametrize("flights", [8, pytest.param(30, marks=pytest.mark.slow)])
def test_coloured_residuals_widen_the_std_to_what_the_scatter_is(flights):
    white, coloured = spread_of_errors(range(flights), 900, 0.8)
    assert np.sqrt(np.mean(white**2)) > 1.8  # the bound believes three times what there is to know
    assert 0.85 < np.sqrt(np.mean(coloured**2)) < 1.25
    assert np.mean(np.abs(coloured) < 2.0) > 0.89


def test_undetermined_values_keep_their_start_and_their_standard_deviation():
    held = tuple(i for i in HELD if STATES[i] != "wn")
    problem, _ = quiet(300, 4, held)
    fit = check_data_compatibility(problem)
    wind = int(np.flatnonzero(problem.active == STATES.index("wn"))[0])
    assert fit.converged
    assert fit.values[wind] == pytest.approx(problem.start[STATES.index("wn")], abs=1e-9)
    assert fit.std[wind] == pytest.approx(problem.start_std[wind], rel=1e-9)


def test_without_noise_the_truth_comes_back_to_rounding():
    problem, path = quiet(300, 5)
    clean = readings(path, problem.inputs, problem.place, False)
    problem = replace(problem, measurements=np.where(np.isfinite(problem.measurements), clean, np.nan))
    fit = check_data_compatibility(problem)
    assert fit.converged
    # Channels then weigh a thousand times their stated accuracy; the start then moves them by 1e-6 of its spread.
    assert np.abs((fit.values - path[0, problem.active]) / problem.start_std).max() < 1e-4


def test_a_heading_recorded_within_one_turn_is_no_residual_of_a_full_turn():
    problem, _ = quiet(300, 6)
    y = problem.measurements.copy()
    y[100:200, 5] += 2.0 * np.pi
    y[200:, 3] -= 4.0 * np.pi
    one, other = check_data_compatibility(problem), check_data_compatibility(replace(problem, measurements=y))
    assert_allclose(other.values, one.values, rtol=1e-9, atol=1e-9)


def test_a_search_that_runs_out_of_steps_reports_it_and_returns_its_best_values():
    problem, _ = quiet(600, 7)
    fit = check_data_compatibility(problem, iterations=1)
    assert not fit.converged
    assert "not converged after 1 step" in fit.message
    assert np.isfinite(fit.path).all()
    assert fit.costs[-1] <= fit.costs[0]


def test_a_start_near_the_vertical_is_fitted_as_any_other():
    problem, _ = quiet(300, 8)
    start = problem.start.copy()
    start[4] = 1.56
    expected, fit = check_data_compatibility(problem), check_data_compatibility(replace(problem, start=start))
    assert fit.converged
    # Two starts, and iterations that end where the cost changes no more: the same to a fraction of the standard errors.
    assert np.abs((fit.values - expected.values) / expected.std).max() < 0.5


def test_a_start_that_cannot_be_simulated_is_reported():
    problem, _ = quiet(300, 8)
    start = problem.start.copy()
    start[0] = 1e200
    fit = check_data_compatibility(replace(problem, start=start))
    assert not fit.converged
    assert "diverges" in fit.message
    assert np.isnan(fit.std).all()
