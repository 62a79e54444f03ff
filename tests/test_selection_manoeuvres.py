"""select() on several recordings: constants of their own, the simplest model that predicts as well, disagreement."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.errors import SelectionError
from structsel.numerics.cross_products import cross_products
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import ArrayData
from structsel.recording import Recording
from structsel.selection import select
from tests.pools import ar1, monomial_exponents

POOL = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
TRUTH = {"alpha": -1.0, "q_hat": -20.0, "de": -1.4}


def recorded(levels, seed=0, n=900, noise=0.002, trims=None, slopes=None, rho=0.6):
    """One recording for each level of Cm; alpha about the trim of each, and each with its own value of q_hat."""
    recordings = []
    for k, level in enumerate(levels):
        rng = np.random.default_rng([seed, k])
        alpha = (0.05 if trims is None else trims[k]) + 0.02 * ar1(rng, n, 0.97, 0.24)
        q_hat, de = 0.001 * ar1(rng, n, 0.9, 0.44), 0.02 * ar1(rng, n, 0.9, 0.44)
        q_value = TRUTH["q_hat"] if slopes is None else slopes[k]
        Cm = level + TRUTH["alpha"] * alpha + q_value * q_hat + TRUTH["de"] * de
        Cm = Cm + noise * ar1(rng, n, rho, np.sqrt(1.0 - rho**2))
        channels = {"alpha": alpha, "q_hat": q_hat, "de": de, "Cm": Cm}
        recordings.append(Recording(f"m{k}", 0.02 * np.arange(n), channels))
    return recordings


def with_indicators(recordings, names):
    """The terms and an indicator of each recording, and the response."""
    rows = []
    for k, r in enumerate(recordings):
        indicator = np.zeros((len(r), len(recordings)))
        indicator[:, k] = 1.0
        rows.append(np.column_stack([*(r[name] for name in names), indicator]))
    return np.vstack(rows), np.concatenate([r["Cm"] for r in recordings])


@pytest.mark.parametrize("noise", ["white", "ar"])
def test_own_constants_are_least_squares_with_an_indicator_of_each_recording(noise):
    recordings = recorded([0.0, 0.05, -0.02], rho=0.0)
    pool = Candidates.parse(list(TRUTH))
    found = select(recordings, "Cm", pool, constants="own", include=list(TRUTH), noise=noise, bootstrap=0)
    names = [str(term) for term in found.terms]
    X, y = with_indicators(recordings, names)
    ols = sm.OLS(y, X).fit()
    assert set(found.constants) == {"m0", "m1", "m2"}
    if noise == "white":
        assert_allclose(found.values[1:], ols.params[:3], rtol=1e-9)
        assert_allclose(list(found.constants.values()), ols.params[3:], rtol=1e-8)
        assert_allclose(found.values[0], np.mean(ols.params[3:]), rtol=1e-8)  # equally long
        assert_allclose(found.rms, np.sqrt(ols.ssr / ols.nobs), rtol=1e-9)
        assert found.dof == ols.df_resid
        within = sum(np.sum((r["Cm"] - r["Cm"].mean()) ** 2) for r in recordings)
        assert_allclose(found.r2, 1.0 - ols.ssr / within, rtol=1e-9)
    else:  # white noise is found to be white, except for a short autoregression now and then
        assert_allclose(found.values[1:], ols.params[:3], rtol=0.02)


def test_own_constants_with_prewhitening_are_generalised_least_squares_by_statsmodels():
    from structsel.numerics.least_squares import fit_each

    recordings = recorded([0.0, 0.05])
    names = list(TRUTH)
    sources = [ArrayData(np.array([r[name] for name in names]), r["Cm"][None]) for r in recordings]
    model = ARNoise(np.array([0.6]), 0.002)
    (fit,) = fit_each(sources, [np.eye(3, dtype=int)], [[model, model]], [0], own_constants=[True])
    X, y = with_indicators(recordings, names)
    white_X, white_y = [], []
    for rows, response in zip(np.split(X, 2), np.split(y, 2), strict=True):
        white_X.append(rows[1:] - 0.6 * rows[:-1])
        white_y.append(response[1:] - 0.6 * response[:-1])
    gls = sm.OLS(np.concatenate(white_y), np.vstack(white_X)).fit()
    assert_allclose(fit.theta[1:], gls.params[:3], rtol=1e-9)
    assert_allclose(fit.constants, gls.params[3:], rtol=1e-7)
    assert_allclose(fit.covariance[1:, 1:], gls.cov_params()[:3, :3], rtol=1e-8)
    mean = np.array([0.0, 0.0, 0.0, 0.5, 0.5])
    assert_allclose(fit.covariance[0, 0], mean @ gls.cov_params() @ mean, rtol=1e-7)
    assert_allclose(fit.covariance[0, 1:], gls.cov_params()[:3] @ mean, rtol=1e-6, atol=1e-12)


def test_cross_products_within_manoeuvres_are_those_of_the_deviations_from_their_means():
    rng = np.random.default_rng(3)
    sources = [ArrayData(rng.normal(k, 1.0, (3, 400)), rng.normal(size=(1, 400))) for k in range(3)]
    exponents = monomial_exponents(3, 2)
    within = cross_products(sources, exponents, blocks=12).within_manoeuvres()
    rows = []
    for source in sources:
        columns = np.array([np.prod(source.base_signals.T**e, axis=1) for e in exponents])
        rows.append(np.vstack([columns, source.response_signals]))
    Z = np.hstack([z - z.mean(axis=1, keepdims=True) for z in rows]) / within.scale[1:, None]
    assert_allclose(within.total()[1:, 1:], Z @ Z.T, rtol=1e-9, atol=1e-8)
    assert_allclose(within.total()[0, 1:], 0.0, atol=1e-9)
    assert within.dof() == 1200 - 3


def test_a_column_that_is_constant_in_every_manoeuvre_has_no_products_left():
    rng = np.random.default_rng(4)
    flap = [0.1, 0.35, 0.7]
    sources = [ArrayData(np.vstack([rng.normal(size=300), np.full(300, k)]), rng.normal(size=(1, 300))) for k in flap]
    given = cross_products(sources, np.array([[1, 0], [0, 1], [0, 2]]), blocks=6)
    within = given.within_manoeuvres().total()
    assert not within[2:4].any()
    assert within[1, 1] > 0.9 * given.total()[1, 1]


def test_recordings_of_different_levels_have_constants_of_their_own_by_default():
    # The level goes with the trim angle of attack, which one constant would take for a part of Cm_alpha.
    trims = [0.02, 0.05, 0.08, 0.11]
    recordings = recorded([0.0, 0.06, 0.02, 0.1], trims=trims)
    own = select(recordings, "Cm", POOL, bootstrap=0)
    shared = select(recordings, "Cm", POOL, constants="shared", bootstrap=0)
    assert {str(term) for term in own.terms} == set(TRUTH)
    low, high = own.intervals().T
    for term, value in TRUTH.items():
        i = 1 + [str(t) for t in own.terms].index(term)
        assert low[i] < value < high[i]
    assert_allclose(list(own.constants.values()), [0.0, 0.06, 0.02, 0.1], atol=0.003)
    assert own.held_out_r2 > 0.95
    assert shared.held_out_r2 < 0.8
    assert "own of each recording" in str(own)


def test_recordings_of_one_level_have_a_common_constant_by_default():
    # 20 sets of four recordings: a test at 5 %, and a better prediction besides, seldom occur together.
    own = sum(bool(select(recorded([0.01] * 4, seed=s), "Cm", POOL, bootstrap=0).constants) for s in range(20))
    assert own <= 3


def test_a_model_of_own_constants_predicts_a_new_recording_with_their_mean():
    recordings = recorded([0.0, 0.06, 0.03])
    found = select(recordings, "Cm", POOL, constants="own", bootstrap=0)
    model = found.model["Cm"]
    assert_allclose(model["1"], np.mean(list(found.constants.values())), rtol=1e-9)
    # The error of that mean is the scatter of the constants over the root of their number.
    scatter = np.std(list(found.constants.values()), ddof=1) / np.sqrt(3)
    assert_allclose(found.standard_errors[0], scatter, rtol=0.05)


def test_own_constants_of_recordings_in_common_blocks_are_refused():
    with pytest.raises(SelectionError, match="600 manoeuvres share"):
        select(recorded([0.0] * 600, n=70), "Cm", POOL, constants="own", noise="white", bootstrap=0)


def test_a_product_that_predicts_no_better_than_the_linear_terms_is_left_out():
    # A weak curvature in one recording only: it passes the F test, and does not help to predict the others.
    recordings = recorded([0.0] * 5, n=1500, noise=0.001)
    first = recordings[0]
    bent = first.with_channels(Cm=first["Cm"] + 6.0 * (first["alpha"] - 0.05) ** 2)
    searched = select([bent, *recordings[1:]], "Cm", POOL, parsimony="none", bootstrap=0)
    simplest = select([bent, *recordings[1:]], "Cm", POOL, bootstrap=0)
    assert len(searched.terms) > 3
    assert {str(term) for term in simplest.terms} == set(TRUTH)
    assert "candidates up to degree 1 predict as well" in simplest.stop_reason


def test_a_curvature_of_every_recording_stays():
    recordings = [
        r.with_channels(Cm=r["Cm"] + 4.0 * (r["alpha"] - 0.05) ** 2) for r in recorded([0.0] * 5, noise=0.001)
    ]
    found = select(recordings, "Cm", POOL, bootstrap=0)
    assert "alpha^2" in {str(term) for term in found.terms}


def test_the_held_out_r2_of_the_linear_model_is_printed_next_to_that_of_the_model():
    recordings = recorded([0.0] * 4)
    found = select(recordings, "Cm", POOL, constants="shared", bootstrap=0)
    error = total = 0.0
    for held in recordings:
        rest = [r for r in recordings if r is not held]
        X, y = (np.concatenate(v) for v in zip(*((np.column_stack([r[n] for n in TRUTH]), r["Cm"]) for r in rest)))
        fit = sm.OLS(y, sm.add_constant(X)).fit()
        y = held["Cm"]
        error += np.sum((y - fit.predict(sm.add_constant(np.column_stack([held[n] for n in TRUTH])))) ** 2)
        total += np.sum((y - y.mean()) ** 2)
    # The model is fitted to prewhitened rows, statsmodels' is not: equal up to the noise.
    assert_allclose(found.linear_held_out_r2, 1.0 - error / total, atol=2e-3)
    assert f"of the linear model {found.linear_held_out_r2:.4f}" in " ".join(str(found).split())


def test_a_value_that_differs_between_recordings_is_reported_and_widens_its_error():
    alike = select(recorded([0.0] * 5), "Cm", POOL, include=list(TRUTH), bootstrap=0)
    slopes = [-20.0, -20.0, -35.0, -20.0, -20.0]
    found = select(recorded([0.0] * 5, slopes=slopes), "Cm", POOL, include=list(TRUTH), bootstrap=0)
    i = 1 + [str(term) for term in found.terms].index("q_hat")
    j = 1 + [str(term) for term in alike.terms].index("q_hat")
    (warning,) = [d for d in found.doubts if d.startswith("q_hat differs between recordings")]
    assert "m2" in warning
    assert not any("differs between recordings" in d for d in alike.doubts)
    # Values of standard deviation 6.7 between five recordings: an error of 6.7 / sqrt(5) = 3 of the mean.
    assert_allclose(found.standard_errors[i], 3.0, rtol=0.3)
    assert found.standard_errors[i] > 3.0 * alike.standard_errors[j]


@pytest.mark.slow
def test_values_that_are_the_same_in_every_recording_have_intervals_of_their_stated_probability():
    # 60 sets of three recordings, three terms: 95 % of 180 within three binomial standard deviations, 86 at least.
    inside = 0
    for seed in range(60):
        found = select(recorded([0.0] * 3, seed=seed), "Cm", POOL, include=list(TRUTH), bootstrap=0)
        intervals = dict(zip(["1", *map(str, found.terms)], found.intervals(), strict=True))
        inside += sum(intervals[name][0] < value < intervals[name][1] for name, value in TRUTH.items())
    assert inside >= 0.90 * 180
