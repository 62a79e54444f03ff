"""Linear-Gaussian evidence against dense textbook formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from structsel.numerics.evidence import Base, Further, NormalEquations, chi2_of, solve
from structsel.numerics.fourier_series import spectrum, taper
from structsel.numerics.projection import Projector


@pytest.fixture
def rows():
    rng = np.random.default_rng(7)
    sizes = (40, 55, 30)
    B = [rng.normal(size=(n, 4)) for n in sizes]
    H = [rng.normal(size=(n, 2)) for n in sizes]
    beta, theta = rng.normal(size=4), np.array([0.8, -0.3])
    y = [b @ beta + h @ theta + rng.normal(size=len(b)) for b, h in zip(B, H)]
    return y, B, H


def further(base, H):
    return [Further(b.T @ h, h.T @ h, h.T @ r) for b, h, r in zip(base.B, H, base.y)]


def log_density(y, columns):
    """Log density of rows whose coefficients are standard normal, by their dense covariance."""
    X, r = np.vstack(columns), np.concatenate(y)
    return multivariate_normal(np.zeros(len(r)), np.eye(len(r)) + X @ X.T).logpdf(r)


def test_evidence_is_the_density_of_the_rows(rows):
    y, B, _ = rows
    base = Base(y, B)
    constant = -0.5 * sum(map(len, y)) * np.log(2.0 * np.pi)
    assert_allclose(base.posterior.log_evidence + constant, log_density(y, B), rtol=1e-10)


def test_a_trial_is_the_ratio_of_two_densities_over_all_and_without_each(rows):
    y, B, H = rows
    base = Base(y, B)
    trial = base.try_each([further(base, H)])[0]
    both = [np.hstack([b, h]) for b, h in zip(B, H)]
    assert_allclose(trial.log_bayes, log_density(y, both) - log_density(y, B), rtol=1e-8)
    for m in range(3):
        rest = [k for k in range(3) if k != m]
        without = log_density([y[k] for k in rest], [both[k] for k in rest])
        without -= log_density([y[k] for k in rest], [B[k] for k in rest])
        assert_allclose(trial.predictive[m], trial.log_bayes - without, rtol=1e-7)


def test_parameters_are_those_of_ridge_regression(rows):
    y, B, H = rows
    X, r = np.vstack([np.hstack([b, h]) for b, h in zip(B, H)]), np.concatenate(y)
    ridge = np.linalg.solve(X.T @ X + np.eye(6), X.T @ r)
    base = Base(y, B)
    trial = base.try_each([further(base, H)])[0]
    assert_allclose(trial.theta, ridge[4:], rtol=1e-9)
    assert_allclose(trial.covariance, np.linalg.inv(X.T @ X + np.eye(6))[4:, 4:], rtol=1e-8)


def test_how_far_things_are_off_is_averaged_over(rows):
    y, B, H = rows
    scales = np.array([[1.0, 1.0, 1.0, 1.0], [0.1, 0.1, 0.1, 1.0]])
    base = Base(y, B, scales=scales)
    trial = base.try_each([[Further(b.T @ h, h.T @ h, h.T @ r) for b, h, r in zip(B, H, y)]])[0]

    def mixture(kept):
        held = [[[B[k] * s for k in kept], [np.hstack([B[k] * s, H[k]]) for k in kept]] for s in scales]
        plain, both = (np.logaddexp.reduce([log_density([y[k] for k in kept], X[i]) for X in held]) for i in (0, 1))
        return both - plain

    assert_allclose(trial.log_bayes, mixture(range(3)), rtol=1e-8)
    for m in range(3):
        assert_allclose(trial.log_bayes - trial.predictive[m], mixture([k for k in range(3) if k != m]), rtol=1e-7)
    each = [
        log_density(y, [np.hstack([b * s, h]) for b, h in zip(B, H)]) - log_density(y, [b * s for b in B])
        for s in scales
    ]
    assert_allclose(trial.at_scales, each, rtol=1e-8)


def test_one_column_freed_is_the_evidence_with_that_one_wide(rows):
    y, B, _ = rows
    scales = np.array([[1.0, 0.7, 1.0, 1.0], [0.1, 0.1, 0.2, 1.0]])
    base = Base(y, B, scales=scales)
    for j in range(4):
        mixed = np.where(np.arange(4) == j, scales[0], scales[1])
        gain = log_density(y, [b * mixed for b in B]) - log_density(y, [b * scales[1] for b in B])
        assert_allclose(base.freed[j], gain, rtol=1e-7, atol=1e-9)


def test_the_likeliest_factors_are_chosen_and_kept_with_further_columns(rows):
    y, B, H = rows
    small = [r - b @ np.linalg.lstsq(b, r, rcond=None)[0] for b, r in zip(B, y)]
    base = Base(small, B, scales=np.array([[1.0] * 4, [0.01] * 4]))
    assert base.chosen == 1
    assert_allclose(base.B[0], 0.01 * B[0])
    extended = base.with_columns(H)
    assert_allclose(extended.scales[:, 4:], 1.0)
    in_full = Base(small, extended.given, scales=extended.scales[:1])
    assert_allclose(in_full.posterior.mean, Base(small, [np.hstack(x) for x in zip(B, H)]).posterior.mean, rtol=1e-9)


def test_flights_held_out_together_are_left_out_together(rows):
    y, B, _ = rows
    base = Base(y, B, groups=[(0, 2)])
    alone = solve(NormalEquations.of(B[1], y[1]))
    assert_allclose(base.solved[1], alone.mean, rtol=1e-9)
    assert_allclose(chi2_of(NormalEquations.of(B[1], y[1]), alone.mean), alone.chi2, rtol=1e-9)


def test_the_projector_is_the_inverse_root_of_the_noise_with_its_nuisances():
    rng = np.random.default_rng(3)
    P, x = rng.normal(size=(20, 3)), rng.normal(size=20)
    whitened = Projector.of(P)(x)
    assert_allclose(whitened @ whitened, x @ np.linalg.solve(np.eye(20) + P @ P.T, x), rtol=1e-10)


def test_a_constant_stands_in_the_level_alone():
    made = spectrum(np.full(200, 3.0), 50, edge=20)
    assert_allclose(made[1:], 0.0, atol=1e-12)
    assert_allclose(made[0], 3.0 * np.linalg.norm(taper(200, 20)), rtol=1e-12)


def test_white_noise_has_a_flat_spectrum_and_its_derivative_one_that_rises():
    rng = np.random.default_rng(1)
    n, edge = 2000, 100
    white = np.mean([spectrum(rng.normal(size=n), 400, edge)[1:] ** 2 for _ in range(40)], axis=0)
    assert_allclose(white[:200].mean(), white[200:].mean(), rtol=0.05)
    # Differencing multiplies the spectrum by the square of the frequency; the ends' own noise must not fill it up.
    steps = np.mean([spectrum(np.gradient(rng.normal(size=n)), 400, edge)[1:] ** 2 for _ in range(40)], axis=0)
    assert steps[:20].mean() < 0.01 * steps[200:].mean()
