from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from structsel.errors import DomainError
from structsel.numerics.kinematics import fly
from structsel.reconstruction import ukf
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.ukf import ukf_filter, ukf_smoother
from tests.dense_flight_path import ANGLES, G, dense_observe, dense_slope, dense_step, flight, rotation

# ------------------------------------- a filter and smoother of dense covariances, straight from the textbook


def internal(p):
    """States of the reference, in the order of the filter: constants first."""
    active = set(p.active.tolist())
    constant = [s for s in sorted(active) if 9 <= s < 31 and not p.drift[s]]
    return np.array(constant + sorted(active - set(constant)))


def plus(full, d, states):
    """Full vector with deviations d; those of the attitude are a rotation vector in earth axes."""
    z = np.zeros(34)
    z[states] = d
    made = full + z
    turned = Rotation.from_rotvec(z[3:6]) * Rotation.from_matrix(rotation(*full[3:6]))
    made[3:6] = turned.as_euler("ZYX")[::-1]
    return made


def minus(full, other, states):
    """Deviations of a full vector from another."""
    d = full - other
    turns = [Rotation.from_matrix(rotation(*x[3:6])) for x in (other, full)]
    d[3:6] = (turns[1] * turns[0].inv()).as_rotvec()
    return d[states]


def minus_readings(y, other):
    d = y - other
    d[ANGLES] = np.angle(np.exp(1j * d[ANGLES]))
    return d


def dense_noise(x, later, k, p):
    """Noise of the readings through [M86]'s equations at the centre of gravity, and the random walks."""
    dt = p.t[k] - p.t[k - 1]
    level = 0.5 * (p.input_std[k - 1] ** 2 + p.input_std[k] ** 2)
    bare = replace(p, place=np.zeros((6, 3)))
    columns = []
    for j in range(6):
        a = p.inputs[k].astype(complex)
        a[j] += 1e-30j
        column = dense_slope(x.astype(complex), a, bare).imag / 1e-30
        column[3:6] = rotation(*later[3:6])[:, j - 3] / (1.0 + x[25 + j]) if j >= 3 else 0.0
        columns.append(column)
    gain = np.array(columns).T
    return (gain * level) @ gain.T * dt**2 + np.diag(p.drift**2 * dt)


def unscented_moments(function, difference, full, P, states, a):
    """Value at the centre, mean deviation from it, covariance, and cross-covariance with the states."""
    L = len(states)
    root = a * np.sqrt(L) * np.linalg.cholesky(P)
    d = np.vstack([np.zeros(L), root.T, -root.T])
    mean_weights = np.full(2 * L + 1, 0.5 / (a * a * L))
    mean_weights[0] = 1.0 - 1.0 / (a * a)
    weights = mean_weights.copy()
    weights[0] += 1.0 - a * a + 2.0
    centre = function(full)
    e = np.array([difference(function(plus(full, one, states)), centre) for one in d])
    mean = mean_weights @ e
    e -= mean
    return centre, mean, (e.T * weights) @ e, (d.T * weights) @ e


def extended_moments(function, difference, full, P, states, _):
    h, std = 1e-4, np.sqrt(np.diag(P))
    centre = function(full)
    columns = [
        difference(function(plus(full, h * s * one, states)), function(plus(full, -h * s * one, states)))
        / (2.0 * h * s)
        for s, one in zip(std, np.eye(len(states)))
    ]
    J = np.array(columns).T
    return centre, np.zeros(len(J)), J @ P @ J.T, P @ J.T


def to_angles(x, P, states):
    """Covariance of Euler angles in place of the rotation vector."""
    at = np.flatnonzero((states >= 3) & (states <= 5))
    J = np.eye(len(states))
    J[np.ix_(at, at)] = np.linalg.inv(axes_of_angles(x))[np.ix_(states[at] - 3, states[at] - 3)]
    return J @ P @ J.T


def axes_of_angles(x):
    """Rotation vectors in earth axes, as columns, of unit changes of phi, theta and psi."""
    st, ct, sp, cp = np.sin(x[4]), np.cos(x[4]), np.sin(x[5]), np.cos(x[5])
    return np.array([[ct * cp, -sp, 0.0], [ct * sp, cp, 0.0], [-st, 0.0, 1.0]])


def dense_smoother(p, spread):
    """Filtered and smoothed means and covariances, innovations, their std, NIS and the log-likelihood."""
    states, n = internal(p), len(p.t)
    moments = unscented_moments if spread else extended_moments
    prior = np.zeros(34)
    prior[p.active] = p.start_std
    full, P = p.start.copy(), np.diag(prior[states] ** 2)
    at = np.flatnonzero((states >= 3) & (states <= 5))
    J = np.eye(len(states))
    J[np.ix_(at, at)] = axes_of_angles(full)[np.ix_(states[at] - 3, states[at] - 3)]
    P = J @ P @ J.T
    xs, Ps, predictions = [], [], []
    innovations, stds, nis, total = np.full((n, 12), np.nan), np.full((n, 12), np.nan), np.full(n, np.nan), 0.0
    for k in range(n):
        if k > 0:
            before = full
            centre, mean, cov, cross = moments(
                lambda x, k=k: dense_step(x, k, p), lambda x, y: minus(x, y, states), before, P, states, spread
            )
            P = cov + dense_noise(before, centre, k, p)[np.ix_(states, states)]
            full = plus(centre, mean, states)
            predictions.append((full, P, cross))
        seen = np.flatnonzero(np.isfinite(p.measurements[k]))
        if seen.size:
            centre, mean, cov, cross = moments(
                lambda x, k=k: dense_observe(x, k, p), minus_readings, full, P, states, spread
            )
            level = p.measurement_std.copy()
            level[ANGLES] /= np.cos(full[4])
            Pyy = cov[np.ix_(seen, seen)] + np.diag(level[seen] ** 2)
            nu = minus_readings(p.measurements[k], centre + mean)[seen]
            K = np.linalg.solve(Pyy, cross[:, seen].T).T
            full = plus(full, K @ nu, states)
            P = P - K @ Pyy @ K.T
            innovations[k, seen], stds[k, seen] = nu, np.sqrt(np.diag(Pyy))
            nis[k] = nu @ np.linalg.solve(Pyy, nu)
            total += multivariate_normal(cov=Pyy).logpdf(nu)
        xs.append(full)
        Ps.append(P)
    x_s, P_s = [xs[-1]], [Ps[-1]]
    for k in range(n - 2, -1, -1):
        mean, cov, cross = predictions[k]
        C = np.linalg.solve(cov, cross.T).T
        x_s.append(plus(xs[k], C @ minus(x_s[-1], mean, states), states))
        P_s.append(Ps[k] + C @ (P_s[-1] - cov) @ C.T)
    kept = np.array([int(np.flatnonzero(states == s)[0]) for s in p.active])
    pick = np.ix_(kept, kept)
    Ps = np.array([to_angles(x, P, states)[pick] for x, P in zip(xs, Ps)])
    P_s = np.array([to_angles(x, P, states)[pick] for x, P in zip(x_s[::-1], P_s[::-1])])
    return np.array(xs)[:, p.active], Ps, np.array(x_s[::-1])[:, p.active], P_s, innovations, stds, nis, total


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
def test_filter_and_smoother_are_those_of_dense_covariances(case, spread, monkeypatch):
    monkeypatch.setattr(ukf, "_NARROW", 0.0)
    p = problem_of(case)
    xs, Ps, x_s, P_s, innovations, stds, nis, total = dense_smoother(p, spread)
    filtered, smoothed = ukf_smoother(p, spread=spread)
    std, std_s = np.sqrt(np.diagonal(Ps, axis1=1, axis2=2)), np.sqrt(np.diagonal(P_s, axis1=1, axis2=2))
    assert filtered.failed == -1
    assert_array_equal(filtered.used, np.isfinite(p.measurements).sum(axis=1))
    # The derivatives of the linearised step leave out the third power of rate times step, (0.2 rad/s x 0.25 s)^3 here.
    # The gains of the smoother are of single precision.
    tolerance = 1e-4 if spread else 5e-3
    turns = 2.0 * np.pi * np.isin(p.active, (3, 5))
    for found, expected, error in ((filtered.x, xs, std), (smoothed.x, x_s, std_s)):
        difference = found - expected
        difference -= turns * np.round(difference / (2.0 * np.pi))
        assert np.abs(difference / error).max() < tolerance
    assert_allclose(filtered.std, std, rtol=tolerance)
    assert_allclose(smoothed.std, std_s, rtol=tolerance)
    scale = std_s[:, :, None] * std_s[:, None, :]
    assert_allclose(smoothed.covariance / scale, P_s / scale, rtol=0, atol=tolerance)
    assert_allclose(filtered.innovations / stds, innovations / stds, rtol=tolerance, atol=tolerance)
    assert_allclose(filtered.innovation_std, stds, rtol=tolerance)
    assert_allclose(filtered.nis, nis, rtol=tolerance)
    assert_allclose(filtered.log_likelihood, total, rtol=tolerance)


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
    # The gains of the smoother are kept in single precision, which has 7 digits.
    assert_allclose(smoothed.x, expected, rtol=1e-6)
    assert_allclose(smoothed.covariance, rows @ cov @ rows.transpose(0, 2, 1), rtol=1e-6, atol=1e-6)
    exact = multivariate_normal(height[seen] @ mean, S).logpdf(y)
    assert_allclose(filtered.log_likelihood, exact, rtol=1e-8)
    for k in (0, 9, 25, n - 1):
        best, cov, _ = condition(int(np.sum(seen <= k)))
        assert_allclose(filtered.x[k], rows[k] @ best + [known[k], 0.0], rtol=1e-8)
        assert_allclose(filtered.std[k] ** 2, np.diag(rows[k] @ cov @ rows[k].T), rtol=1e-7)


def test_smoothing_block_by_block_is_smoothing_at_once(monkeypatch):
    p = problem_of("random walks, flank vane, no position", 4500)
    _, at_once = ukf_smoother(p, gate=4.0)
    monkeypatch.setattr(ukf, "_BLOCK_BYTES", 2_000_000)
    _, by_blocks = ukf_smoother(p, gate=4.0)
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
