from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal

from structsel.errors import DomainError
from structsel.numerics.kinematics import fly
from structsel.reconstruction import ukf
from structsel.reconstruction.ukf import KinematicsProblem, ukf_filter, ukf_smoother
from tests.dense_flight_path import ANGLES, G, dense_observe, dense_slope, dense_step, flight, jacobian

# ------------------------------------- a filter and smoother of dense covariances, straight from the textbook


def dense_noise(x, k, p):
    """Noise of the readings through [M86]'s equations at the centre of gravity, and the random walks."""
    dt = p.t[k] - p.t[k - 1]
    level = 0.5 * (p.input_std[k - 1] ** 2 + p.input_std[k] ** 2)
    bare = replace(p, place=np.zeros((6, 3)))
    columns = []
    for j in range(6):
        a = p.inputs[k].astype(complex)
        a[j] += 1e-30j
        columns.append(dense_slope(x.astype(complex), a, bare).imag / 1e-30)
    gain = np.array(columns).T
    return (gain * level) @ gain.T * dt**2 + np.diag(p.drift**2 * dt)


def unscented_moments(function, full, P, active, a):
    """Mean, covariance and cross-covariance of function(x), whose value may be longer than the active states."""
    L = len(active)
    root = a * np.sqrt(L) * np.linalg.cholesky(P)
    points = np.tile(full, (2 * L + 1, 1))
    points[1 : L + 1, active] += root.T
    points[L + 1 :, active] -= root.T
    mean_weights = np.full(2 * L + 1, 0.5 / (a * a * L))
    mean_weights[0] = 1.0 - 1.0 / (a * a)
    weights = mean_weights.copy()
    weights[0] += 1.0 - a * a + 2.0
    values = np.array([function(point) for point in points])
    mean = mean_weights @ values
    d, e = points[:, active] - full[active], values - mean
    return values[0], mean, (e.T * weights) @ e, (d.T * weights) @ e


def extended_moments(function, full, P, active):
    J = jacobian(function, full, active)
    value = function(full)
    return value, value, J @ P @ J.T, P @ J.T


def dense_smoother(p, spread):
    """Filtered and smoothed means and covariances, innovations, their std, NIS and the log-likelihood."""
    act, n = p.active, len(p.t)

    def moments(function, full, P):
        return unscented_moments(function, full, P, act, spread) if spread else extended_moments(function, full, P, act)

    full, P = p.start.copy(), np.diag(p.start_std**2)
    xs, Ps, predictions = [], [], []
    innovations, stds, nis, total = np.full((n, 12), np.nan), np.full((n, 12), np.nan), np.full(n, np.nan), 0.0
    for k in range(n):
        if k > 0:
            before = full
            centre, mean, cov, cross = moments(lambda x, k=k: dense_step(x, k, p), before, P)
            P = cov[np.ix_(act, act)] + dense_noise(before, k, p)[np.ix_(act, act)]
            full = centre.copy()
            full[act] = mean[act]
            predictions.append((full[act], P, cross[:, act]))
        seen = np.flatnonzero(np.isfinite(p.measurements[k]))
        if seen.size:
            _, mean, cov, cross = moments(lambda x, k=k: dense_observe(x, k, p), full, P)
            Pyy = cov[np.ix_(seen, seen)] + np.diag(p.measurement_std[seen] ** 2)
            nu = p.measurements[k] - mean
            nu[ANGLES] = np.angle(np.exp(1j * nu[ANGLES]))
            nu = nu[seen]
            K = np.linalg.solve(Pyy, cross[:, seen].T).T
            full = full.copy()
            full[act] += K @ nu
            P = P - K @ Pyy @ K.T
            innovations[k, seen], stds[k, seen] = nu, np.sqrt(np.diag(Pyy))
            nis[k] = nu @ np.linalg.solve(Pyy, nu)
            total += multivariate_normal(cov=Pyy).logpdf(nu)
        xs.append(full[act])
        Ps.append(P)
    x_s, P_s = [xs[-1]], [Ps[-1]]
    for k in range(n - 2, -1, -1):
        mean, cov, cross = predictions[k]
        C = np.linalg.solve(cov, cross.T).T
        x_s.append(xs[k] + C @ (x_s[-1] - mean))
        P_s.append(Ps[k] + C @ (P_s[-1] - cov) @ C.T)
    return np.array(xs), np.array(Ps), np.array(x_s[::-1]), np.array(P_s[::-1]), innovations, stds, nis, total


# ------------------------------------------------------------------------------------------------- problems


CASES = {
    "all but vertical wind and sideslip offset": {"held": (17, 21)},
    "random walks, flank vane, no position": {"held": (6, 7, 15, 16, 21, 22), "flank": True, "drift": True},
    "gusts": {"held": (17, 21, 22), "gusts": True},
    "scale errors and gusts": {"held": (15, 16, 17, 21, 22), "gusts": True, "scales": (23, 24, 26, 28, 30)},
    "heading and height held": {"held": (5, 6, 7, 8, 15, 16, 17, 20, 21), "drift": True},
}


def problem_of(case, n=72):
    problem, _ = flight(n, **CASES[case])
    y = problem.measurements.copy()
    if not problem.located:
        y[:, 7:9] = np.nan
    return replace(problem, measurements=y)


@pytest.mark.default_cases(
    "narrow-heading and height held", "wide-heading and height held", "wide-scale errors and gusts"
)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("spread", [1.0, 0.6, 0.0], ids=["wide", "narrow", "extended"])
def test_filter_and_smoother_are_those_of_dense_covariances(case, spread):
    p = problem_of(case)
    xs, Ps, x_s, P_s, innovations, stds, nis, total = dense_smoother(p, spread)
    filtered, smoothed = ukf_smoother(p, spread=spread)
    std, std_s = np.sqrt(np.diagonal(Ps, axis1=1, axis2=2)), np.sqrt(np.diagonal(P_s, axis1=1, axis2=2))
    assert filtered.failed == -1
    assert_array_equal(filtered.used, np.isfinite(p.measurements).sum(axis=1))
    assert np.abs((filtered.x - xs) / std).max() < 1e-6
    assert np.abs((smoothed.x - x_s) / std_s).max() < 1e-6
    assert_allclose(filtered.std, std, rtol=1e-6)
    assert_allclose(smoothed.std, std_s, rtol=1e-6)
    scale = std_s[:, :, None] * std_s[:, None, :]
    assert_allclose(smoothed.covariance / scale, P_s / scale, rtol=0, atol=1e-6)
    assert_allclose(filtered.innovations / stds, innovations / stds, rtol=1e-6, atol=1e-6)
    assert_allclose(filtered.innovation_std, stds, rtol=1e-6)
    assert_allclose(filtered.nis, nis, rtol=1e-6)
    assert_allclose(filtered.log_likelihood, total, rtol=1e-6)


def climb(n, walk):
    """A steady climb; only height and vertical wind are unknown: h' = V sin(theta) - wd, exactly linear."""
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.1, 0.4, n))
    inputs = np.tile([G * np.sin(0.1), 0.0, -G * np.cos(0.1), 0, 0, 0, 0, 0, 0], (n, 1))
    start, drift = np.zeros(34), np.zeros(34)
    start[[0, 4, 8, 17]] = [100.0, 0.1, 500.0, 0.3]
    drift[17] = walk
    y = np.full((n, 12), np.nan)
    y[:, 6] = 500.0 + (100.0 * np.sin(0.1) - 1.0) * (t - t[0]) + 2.0 * rng.standard_normal(n)
    y[::4, 6] = np.nan
    return KinematicsProblem(
        *(t, inputs, np.zeros((n, 6)), y, np.full(12, 2.0), start, np.array([5.0, 1.5]), np.array([8, 17]), drift),
        *(np.zeros((6, 3)), False, G),
    )


@pytest.mark.parametrize("walk", [0.0, 0.2])
@pytest.mark.parametrize("spread", [0.0, 0.6, 1.0])
def test_a_linear_problem_gets_its_exact_conditional_means(walk, spread):
    # All heights and winds are jointly normal: condition on the readings with one big covariance.
    n = 40
    p = climb(n, walk)
    dt = np.diff(p.t)
    # Unknowns: h at the start, the wind at the start, its n - 1 steps; wind and height are linear in them.
    wind = np.zeros((n, n + 1))
    wind[:, 1] = 1.0
    for k in range(1, n):
        wind[k:, 1 + k] = 1.0
    height = np.zeros((n, n + 1))
    height[:, 0] = 1.0
    for k in range(1, n):
        height[k] = height[k - 1] - dt[k - 1] * wind[k - 1]
    prior = np.diag(np.r_[25.0, 2.25, walk**2 * dt])
    mean = np.r_[500.0, 0.3, np.zeros(n - 1)]
    known = 100.0 * np.sin(0.1) * (p.t - p.t[0])
    seen = np.flatnonzero(np.isfinite(p.measurements[:, 6]))
    y = p.measurements[seen, 6] - known[seen]

    def condition(upto):
        H = height[seen[:upto]]
        S = H @ prior @ H.T + 4.0 * np.eye(upto)
        K = np.linalg.solve(S, H @ prior).T
        return mean + K @ (y[:upto] - H @ mean), prior - K @ H @ prior, S

    filtered, smoothed = ukf_smoother(p, spread=spread)
    best, cov, S = condition(seen.size)
    rows = np.stack([height, wind], axis=1)
    expected = rows @ best + np.c_[known, np.zeros(n)]
    assert_allclose(smoothed.x, expected, rtol=1e-8)
    assert_allclose(smoothed.covariance, rows @ cov @ rows.transpose(0, 2, 1), rtol=1e-7, atol=1e-9)
    exact = multivariate_normal(height[seen] @ mean, S).logpdf(y)
    assert_allclose(filtered.log_likelihood, exact, rtol=1e-8)
    for k in (0, 9, 25, n - 1):
        best, cov, _ = condition(int(np.sum(seen <= k)))
        assert_allclose(filtered.x[k], rows[k] @ best + [known[k], 0.0], rtol=1e-8)
        assert_allclose(filtered.std[k] ** 2, np.diag(rows[k] @ cov @ rows[k].T), rtol=1e-7)


def test_smoothing_block_by_block_is_smoothing_at_once(monkeypatch):
    p = problem_of("random walks, flank vane, no position", 4500)
    _, by_blocks = ukf_smoother(p, gate=4.0)
    monkeypatch.setattr(ukf, "_BLOCK", 10_000)
    _, at_once = ukf_smoother(p, gate=4.0)
    assert_array_equal(by_blocks.x, at_once.x)
    assert_array_equal(by_blocks.std, at_once.std)
    assert_array_equal(by_blocks.covariance, at_once.covariance)


def test_the_filter_alone_is_the_first_half_of_the_smoother():
    p = problem_of("heading and height held")
    alone, (both, _) = ukf_filter(p, spread=0.8), ukf_smoother(p, spread=0.8)
    assert_array_equal(alone.x, both.x)
    assert alone.log_likelihood == pytest.approx(both.log_likelihood, rel=1e-12)


def test_a_covariance_kept_for_some_samples_is_that_of_those_samples(monkeypatch):
    p = problem_of("heading and height held")
    _, full = ukf_smoother(p)
    monkeypatch.setattr(ukf, "_MAX_BYTES", 40 * p.active.size**2 * 8)
    _, thinned = ukf_smoother(p)
    assert thinned.at.size <= 40 < full.at.size == len(p.t)
    assert_array_equal(thinned.covariance, full.covariance[thinned.at])


@pytest.mark.parametrize("spread", [1.0, 0.0])
def test_a_heading_read_within_one_turn_is_a_heading_read_over_many(spread):
    p, path = flight(600, held=(21,), dt=0.1)
    inputs = p.inputs.copy()
    inputs[:, 5] += 0.3  # a turn every 21 s, in a roll and pitch that keep theta moderate
    inputs[:, 3:5] = 0.0
    start = p.start.copy()
    start[[3, 4, 12, 13, 14]] = 0.0
    path = fly(p.t, inputs, start, p.place, G, True)
    y = np.full_like(p.measurements, np.nan)
    y[:, 3:6] = path[:, 3:6] + 2e-3 * np.random.default_rng(4).standard_normal((600, 3))
    assert np.ptp(path[:, 5]) > 4.0 * np.pi
    wrapped = y.copy()
    wrapped[:, ANGLES] = np.angle(np.exp(1j * y[:, ANGLES]))
    many, _ = ukf_smoother(replace(p, inputs=inputs, start=start, measurements=y), spread=spread)
    one, _ = ukf_smoother(replace(p, inputs=inputs, start=start, measurements=wrapped), spread=spread)
    assert one.failed == many.failed == -1
    assert np.abs((one.x - many.x) / many.std).max() < 1e-6
    assert_allclose(one.innovations[:, 5], many.innovations[:, 5], atol=1e-8)


def test_the_gate_turns_away_what_was_planted_and_nothing_else():
    p, _ = flight(600, seed=5)
    rng = np.random.default_rng(6)
    y, planted = p.measurements.copy(), np.zeros(p.measurements.shape, dtype=bool)
    for channel in range(12):
        sampled = np.flatnonzero(np.isfinite(y[:, channel]))[20:]
        planted[rng.choice(sampled, 3, replace=False), channel] = True
    clean = ukf_filter(p, gate=5.5)
    assert not clean.rejected.any()
    size = 20.0 * np.where(np.isnan(clean.innovation_std), 0.0, clean.innovation_std)
    y[planted] += (rng.choice([-1.0, 1.0], planted.shape) * size)[planted]
    gated = ukf_filter(replace(p, measurements=y), gate=5.5)
    assert_array_equal(gated.rejected, planted)
    assert_array_equal(gated.used, np.isfinite(y).sum(axis=1) - planted.sum(axis=1))
    # What is turned away counts for nothing, as though it had not been sampled.
    left_out = ukf_filter(replace(p, measurements=np.where(planted, np.nan, y)))
    assert_array_equal(gated.x, left_out.x)
    assert gated.log_likelihood == left_out.log_likelihood


def test_a_channel_that_stays_outside_the_gate_is_let_in_again():
    p = climb(200, 0.0)
    y = p.measurements.copy()
    y[:, 6] = np.where(np.arange(200) < 100, 500.0 + (100.0 * np.sin(0.1) - 1.0) * (p.t - p.t[0]), np.nan)
    y[100:, 6] = 500.0 + (100.0 * np.sin(0.1) - 1.0) * (p.t[100:] - p.t[0]) + 300.0
    run = ukf_filter(replace(p, measurements=y), gate=5.0)
    assert not run.rejected[:100].any()
    assert run.rejected[100:125, 6].all()
    assert not run.rejected[125, 6]


def test_a_pitch_attitude_near_the_vertical_ends_the_run_at_its_sample():
    p = climb(200, 0.0)
    inputs = p.inputs.copy()
    inputs[:, 4] = 0.08
    path = fly(p.t, inputs, p.start, p.place, G, False)
    first = int(np.argmax(np.abs(path[:, 4]) > 1.55))
    assert 0 < first < 199
    filtered, smoothed = ukf_smoother(replace(p, inputs=inputs))
    assert smoothed is None
    assert filtered.failed == first
    assert "vertical" in filtered.reason
    assert np.isfinite(filtered.x[:first]).all()
    assert np.isnan(filtered.x[first:]).all()


def test_an_estimate_that_is_no_number_ends_the_run_at_its_sample():
    p, _ = flight(100)
    inputs = p.inputs.copy()
    inputs[60, 2] = np.nan
    filtered, smoothed = ukf_smoother(replace(p, inputs=inputs))
    assert smoothed is None
    assert filtered.failed == 60
    assert "no longer finite" in filtered.reason


@pytest.mark.parametrize("spread", [0.5, 2.0, -1.0])
def test_a_spread_with_a_negative_weight_is_refused(spread):
    p = climb(5, 0.0)
    with pytest.raises(DomainError, match="spread of the sigma points"):
        ukf_filter(p, spread=spread)


def test_deviations_from_truth_are_as_large_as_the_filter_says():
    # Mean over 20 flights of the normalised squared error of 21 states: 21, std sqrt(2 * 21 / 20) = 1.45.
    filtered_error, smoothed_error, rms = [], [], []
    for seed in range(20):
        p, path = flight(300, seed=100 + seed)
        start = path[0].copy()
        rng = np.random.default_rng(seed)
        start[p.active] += p.start_std * rng.standard_normal(p.active.size)
        filtered, smoothed = ukf_smoother(replace(p, start=start))
        assert filtered.failed == -1
        last, mid = path[-1, p.active], path[150, p.active]
        d, e = smoothed.x[-1] - last, smoothed.x[150] - mid
        filtered_error.append(d @ np.linalg.solve(smoothed.covariance[-1], d))
        smoothed_error.append(e @ np.linalg.solve(smoothed.covariance[150], e))
        rms.append([np.sum((r.x[:, :6] - path[:, :6]) ** 2, axis=0) for r in (filtered, smoothed)])
    for error in (filtered_error, smoothed_error):
        assert abs(np.mean(error) - 21.0) < 3.5 * np.sqrt(2.0 * 21.0 / 20.0)
    before, after = np.sum(rms, axis=0)
    assert (after < before).all()
