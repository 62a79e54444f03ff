"""Selection from arrays, against statsmodels, brute force and a search by QR."""

import itertools
import tracemalloc

import numpy as np
import pytest
import statsmodels.api as sm
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from structsel.numerics.cross_products import cross_products
from structsel.numerics.noise_models import random_block_weights
from structsel.numerics.regressors import ArrayData
from structsel.selection import prewhitening
from structsel.selection.engine import select_arrays
from structsel.selection.resampling import bootstrap_units
from structsel.selection.settings import SelectOptions

from .flights import cases, signals_of
from .pools import ar1, design, monomial_exponents

POOL = monomial_exponents(4, 2)  # 14 candidates
TRUE = {0: 1.0, 2: -0.7, 9: 0.5}  # three of them, in response standard deviations
METHODS = {
    "stepwise": {"method": "stepwise", "F_in": 12.0},
    "stepwise from all": {"method": "stepwise", "F_in": 12.0, "initial_terms": "all"},
    "stepwise, false discovery": {"method": "stepwise", "F_in": "fdr"},
    "orthogonal": {"method": "orthogonal"},
    "orthogonal, given order": {"method": "orthogonal", "order": "given"},
    "best subset": {"method": "best_subset"},
}


def run(flights, exponents=POOL, include=(), **options):
    asked = SelectOptions(
        **{"bootstrap": 0, "workers": 1, "F_in": 4.0, "constants": "shared", "parsimony": "none", **options}
    )
    start = range(len(exponents)) if asked.initial_terms == "all" else ()
    return select_arrays(flights, exponents, asked, include, start)


def flight(seed, n=1500, rho=0.0, noise=0.2, n_responses=1, true=TRUE):
    """Correlated signals off zero, and responses whose residual has lag-one correlation rho."""
    rng = np.random.default_rng(seed)
    own = np.array([ar1(rng, n, 0.95, 0.3) for _ in range(4)])
    base = own + 0.5 * np.roll(own, 1, axis=0) + np.array([[0.3], [0.0], [-0.5], [0.1]])
    X = design(base, POOL)[:, 1:]
    X = X[:, list(true)] / X[:, list(true)].std(axis=0)
    signal = X @ np.array(list(true.values())) + 0.4
    residual = [ar1(rng, n, rho, np.sqrt(1 - rho**2)) for _ in range(n_responses)]
    return ArrayData(base, signal * np.arange(1, n_responses + 1)[:, None] + noise * np.array(residual))


def matrix(flights, kept):
    """The constant and the kept terms, all flights after one another."""
    return np.vstack([design(f.base_signals, POOL[list(kept)]) for f in flights])


def response(flights):
    return np.concatenate([f.response_signals[0] for f in flights])


def prewhitened(flights, kept, colours):
    """Regressors and response through each flight's filter, its first samples left out, in equal units."""
    n = np.array([f.n for f in flights], dtype=float)
    level = np.sqrt(n.sum() / np.sum(n / np.array([c.sigma for c in colours]) ** 2))
    Z = []
    for f, c in zip(flights, colours):
        z = np.column_stack([design(f.base_signals, POOL[list(kept)]), f.response_signals[0]])
        lags = sum((a * z[c.order - l : len(z) - l] for l, a in enumerate(c.ar, 1)), np.zeros_like(z[c.order :]))
        Z.append((z[c.order :] - lags) * level / c.sigma)
    Z = np.vstack(Z)
    return Z[:, :-1], Z[:, -1]


# --- structure -------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", ["white", "ar", "cluster"])
@pytest.mark.parametrize("name", METHODS)
@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    order=st.permutations(range(14)),
    powers=st.lists(st.integers(-6, 6), min_size=4, max_size=4),
)
def test_every_method_finds_a_noise_free_models_own_terms_in_any_order_and_scaling(name, noise, seed, order, powers):
    # Tests by blocks need enough blocks to judge by: 31 here, of at least 64 samples.
    clean = flight(seed, n=2000 if noise == "cluster" else 400, noise=0.0)
    scale = 10.0 ** np.array(powers)
    scaled = ArrayData(clean.base_signals * scale[:, None], 1e3 * clean.response_signals)
    (found,) = run([scaled], POOL[order], noise=noise, **METHODS[name])
    assert sorted(order[j] for j in found.search.selected) == sorted(TRUE)
    X = design(clean.base_signals, POOL)[:, 1:]
    for j, value in zip(found.search.selected, found.values[1:]):
        back = np.prod(scale ** POOL[order[j]]) / 1e3
        assert_allclose(value * back, TRUE[order[j]] / X[:, order[j]].std(), rtol=1e-8)
    assert found.r2 == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("noise", ["white", "ar"])
def test_several_responses_at_once_equal_one_by_one(noise):
    flights = [flight(k, rho=0.8, n_responses=3) for k in (1, 2)]
    together = run(flights, noise=noise, F_in=12.0, bootstrap=20)
    assert len(together) == 3
    for r, joint in enumerate(together):
        alone = [ArrayData(f.base_signals, f.response_signals[r : r + 1]) for f in flights]
        (single,) = run(alone, noise=noise, F_in=12.0, bootstrap=20)
        assert joint.search.selected == single.search.selected
        assert joint.white_noise.selected == single.white_noise.selected
        assert [c.order for c in joint.noise] == [c.order for c in single.noise]
        # Whitened moments lose the first samples of the longest filter among the responses, hence not exact.
        tolerance = 1e-10 if noise == "white" else 1e-4
        assert_allclose(joint.values, single.values, rtol=tolerance)
        assert_allclose(joint.covariance, single.covariance, rtol=100 * tolerance, atol=1e-12)
        assert_allclose(joint.bootstrap.inclusion, single.bootstrap.inclusion, atol=0.1)


def test_white_residuals_make_a_list_of_manoeuvres_the_same_as_one_long_one():
    flights = [flight(k, n) for k, n in ((1, 700), (2, 1100), (3, 333))]
    joined = ArrayData(np.hstack([f.base_signals for f in flights]), np.hstack([f.response_signals for f in flights]))
    (separate,), (one,) = (run(f, noise="white", F_in=12.0) for f in (flights, [joined]))
    assert separate.search.selected == one.search.selected
    assert_allclose(separate.values, one.values, rtol=1e-10)
    assert_allclose(separate.r2, one.r2, rtol=1e-12)
    # The parts held out differ: complete manoeuvres there, parts of one here.
    assert not separate.cross_validation.within
    assert one.cross_validation.within
    assert_array_equal(separate.cross_validation.n, [700, 1100, 333])


def test_lags_do_not_cross_from_one_manoeuvre_to_the_next():
    flights = [flight(1, 800, rho=0.9), flight(2, 600, rho=0.6, noise=0.5)]
    (found,) = run(flights, F_in=12.0)
    assert [c.order for c in found.noise] != [0, 0]
    X, y = prewhitened(flights, found.search.selected, found.noise)
    by_hand = sm.OLS(y, X).fit()
    assert found.fit.n == len(y) == 1400 - sum(c.order for c in found.noise)
    assert_allclose(found.values, by_hand.params, rtol=1e-9)
    assert_allclose(found.covariance, by_hand.cov_params(), rtol=1e-8)


def test_selection_on_whitened_residuals_converges_on_the_truth_where_the_white_rule_keeps_false_terms():
    # 10 flights with lag-one correlation 0.92. Each false term enters with a probability of at most 0.1 % x 11 terms
    # at F = 12, so all ten are exact with a probability of about 99 %; the white rule is never exact here.
    exact = classical = 0
    for seed in range(10):
        (found,) = run([flight(seed, 3000, rho=0.92, noise=0.5)], F_in=12.0)
        assert found.converged
        exact += set(found.search.selected) == set(TRUE)
        classical += set(found.white_noise.selected) == set(TRUE)
    assert exact >= 9
    assert classical <= 2


def test_the_converged_structure_is_the_one_selected_with_its_own_residual_autocorrelation():
    # Whitening by hand with the estimated AR filter and selecting as if white gives the same terms again.
    flights = [flight(7, 2000, rho=0.9), flight(8, 1500, rho=0.8)]
    (found,) = run(flights, F_in=12.0)
    every = range(len(POOL))
    X, y = prewhitened(flights, every, found.noise)
    ones, X = X[:, :1], X[:, 1:]
    # The whitened constant is swept out by hand: an engine's constant would be another one.
    hat = ones / (ones.T @ ones)
    Z = np.column_stack([X, y]) - ones @ (hat.T @ np.column_stack([X, y]))
    (again,) = run([ArrayData(Z.T[:-1], Z.T[-1:])], np.eye(14, dtype=int), noise="white", F_in=12.0)
    assert set(again.search.selected) == set(found.search.selected)


@pytest.mark.parametrize("seed", range(4))
def test_alternatives_are_the_exchanges_brute_force_finds(seed):
    # Nearly constant fourth signal: products with it can replace others.
    one = flight(seed, 600, noise=0.4)
    base = one.base_signals.copy()
    base[3] = 1.0 + 0.02 * base[3]
    one = ArrayData(base, one.response_signals)
    (found,) = run([one], noise="white", F_in=12.0)
    kept = list(found.search.selected)
    y = response([one])
    own = sm.OLS(y, matrix([one], kept)).fit()
    expected = {}
    for j, i in itertools.product(kept, set(range(14)) - set(kept)):
        others = matrix([one], [m for m in kept if m != j])
        loss = (sm.OLS(y, matrix([one], [i if m == j else m for m in kept])).fit().ssr - own.ssr) / own.mse_resid
        left = [sm.OLS(matrix([one], [m])[:, 1], others).fit().resid for m in (j, i)]
        alike = np.corrcoef(*left)[0, 1]
        if loss < 4.0 and abs(alike) >= 0.7:
            expected[j, i] = (loss, alike)
    assert {(r.kept, r.other) for r in found.aliases} == set(expected)
    for r in found.aliases:
        assert_allclose((r.loss, r.correlation), expected[r.kept, r.other], rtol=1e-6, atol=1e-6)
    assert expected or seed != 0  # at least this flight has some


# --- uncertainty -----------------------------------------------------------------------------------


def test_the_textbook_covariance_equals_statsmodels():
    flights = [flight(1, 700), flight(2, 400)]
    for noise in ("white", "ar"):
        (found,) = run(flights, noise=noise, F_in=12.0)
        ols = sm.OLS(response(flights), matrix(flights, found.search.selected)).fit()
        assert_allclose(found.white_noise_covariance, ols.cov_params(), rtol=1e-8)
        if noise == "white":
            assert_allclose(found.values, ols.params, rtol=1e-10)
            assert_allclose(found.r2, ols.rsquared, rtol=1e-10)
            assert_allclose(found.rms, np.sqrt(ols.ssr / ols.nobs), rtol=1e-10)


@pytest.mark.parametrize("rho", [0.5, 0.95])
def test_the_coloured_fit_equals_statsmodels_glsar_with_the_same_autoregression(rho):
    one = flight(3, 1200, rho=rho)
    (found,) = run([one], F_in=12.0)
    assert found.noise[0].order >= 1
    gls = sm.GLSAR(response([one]), matrix([one], found.search.selected), rho=found.noise[0].ar).fit()
    assert_allclose(found.values, gls.params, rtol=1e-9)
    assert_allclose(found.covariance, gls.cov_params(), rtol=1e-8)


def test_the_bootstrap_is_a_fraction_repeats_with_its_seed_and_holds_strong_terms():
    flights = [flight(k, rho=0.8) for k in range(3)]
    (first,), (again,), (other,) = (run(flights, bootstrap=60, seed=s) for s in (5, 5, 6))
    inclusion = first.bootstrap.inclusion
    assert inclusion.min() >= 0.0
    assert inclusion.max() <= 1.0
    assert_allclose(inclusion * 60, np.round(inclusion * 60), atol=1e-9)
    assert_array_equal(inclusion, again.bootstrap.inclusion)
    assert_array_equal(first.bootstrap.std, again.bootstrap.std)
    assert not np.array_equal(inclusion, other.bootstrap.inclusion)
    assert_array_equal(inclusion[list(TRUE)], 1.0)  # t values above 20


def test_bootstrap_spread_of_forced_terms_is_that_of_weighted_fits_by_statsmodels():
    flights = [flight(k, 400) for k in range(9)]
    kept = list(TRUE)
    (found,) = run(flights, include=kept, noise="white", max_terms=3, bootstrap=25, seed=3)
    assert found.bootstrap.by == "manoeuvre"
    assert found.bootstrap.units == 9
    units = bootstrap_units(cross_products(flights, POOL))
    weights = random_block_weights(units, 25, np.random.default_rng(3))
    each = [weights[:, units == k][:, 0] for k in range(9)]
    X, y = matrix(flights, kept), response(flights)
    fits = [sm.WLS(y, X, weights=np.repeat([w[b] for w in each], 400)).fit().params for b in range(25)]
    low, high = np.percentile(fits, (15.87, 84.13), axis=0)  # one standard deviation of a normal either side
    assert_allclose(found.bootstrap.std, (high - low) / 2.0, rtol=1e-7)


# --- held out --------------------------------------------------------------------------------------


def test_held_out_errors_equal_explicit_selections_and_refits_without_each_manoeuvre():
    flights = [flight(k, 300 + 50 * k, noise=0.6) for k in range(4)]
    (found,) = run(flights, noise="white", F_in=4.0)
    assert found.cross_validation.folds == ((0,), (1,), (2,), (3,))
    structures = set()
    for k, held in enumerate(flights):
        rest = [f for f in flights if f is not held]
        (without,) = run(rest, noise="white", F_in=4.0)
        structures.add(without.search.selected)
        ols = sm.OLS(response(rest), matrix(rest, without.search.selected)).fit()
        y = response([held])
        error = y - ols.predict(matrix([held], without.search.selected))
        assert_allclose(found.cross_validation.sse[k], np.sum(error**2), rtol=1e-9)
        assert_allclose(found.cross_validation.tss[k], np.sum((y - y.mean()) ** 2), rtol=1e-9)
    assert len(structures) > 1  # so the selections were repeated, not only the fits


def test_coloured_held_out_errors_equal_generalised_least_squares_without_each_manoeuvre():
    flights = [flight(k, 500, rho=0.8) for k in range(3)]
    kept = list(TRUE)
    (found,) = run(flights, include=kept, max_terms=3)
    n = np.array([f.n for f in flights], dtype=float)
    X, y = prewhitened(flights, kept, found.noise)
    owner = np.repeat(range(3), [f.n - c.order for f, c in zip(flights, found.noise)])
    assert len(y) == n.sum() - sum(c.order for c in found.noise)
    for k, held in enumerate(flights):
        fit = sm.OLS(y[owner != k], X[owner != k]).fit()
        error = response([held]) - matrix([held], kept) @ fit.params
        assert_allclose(found.cross_validation.sse[k], np.sum(error**2), rtol=1e-8)
    assert_allclose(found.cross_validation.rms**2 * n.sum(), found.cross_validation.sse.sum(), rtol=1e-12)


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_the_manoeuvre_criterion_chooses_the_visited_model_that_predicts_left_out_manoeuvres_best(method):
    flights = [flight(k, 250, noise=1.5) for k in range(3)]
    options = {"method": method, "noise": "white", "F_in": 1.0}
    (found,) = run(flights, criterion="cv", **options)

    def error(kept):
        total = 0.0
        for held in flights:
            rest = [f for f in flights if f is not held]
            fit = sm.OLS(response(rest), matrix(rest, kept)).fit()
            total += np.sum((response([held]) - matrix([held], kept) @ fit.params) ** 2)
        return total

    best = error(found.search.selected)
    if method == "best_subset":
        X, y = matrix(flights, range(14))[:, 1:], response(flights)
        for size in (2, 3):  # the best of each size is a model visited
            rss = {
                kept: sm.OLS(y, sm.add_constant(X[:, list(kept)])).fit().ssr
                for kept in itertools.combinations(range(14), size)
            }
            assert best <= error(min(rss, key=rss.get)) * (1 + 1e-9)
    else:
        inside, visited = [], [()]
        for s in found.search.steps:
            gone = s.index if s.action == "leave" else s.other
            inside = [j for j in inside if j != gone] + ([s.index] if s.action != "leave" else [])
            visited.append(tuple(inside))
        assert_allclose(best, min(map(error, visited)), rtol=1e-9)


# --- the machine -----------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", ["white", "ar", "cluster"])
def test_two_workers_give_what_one_gives(noise):
    flights = [flight(k, 2500, rho=0.7, n_responses=2) for k in range(3)]
    one, two = (run(flights, noise=noise, workers=w, bootstrap=10, F_in=12.0) for w in (1, 2))
    for a, b in zip(one, two):
        assert a.search.selected == b.search.selected
        assert_array_equal(a.values, b.values)
        assert_array_equal(a.covariance, b.covariance)
        assert_array_equal(a.bootstrap.inclusion, b.bootstrap.inclusion)


@pytest.mark.slow
def test_memory_above_the_signals_does_not_grow_with_the_samples():
    # 164 candidates; as a matrix they would be 26 MB and 157 MB.
    exponents = monomial_exponents(8, 3)
    peaks = []
    for n in (20_000, 120_000):
        base = cases.flight_signals(n, 3)
        y = base[0] - 2 * base[5] + 0.01 * ar1(np.random.default_rng(1), n, 0.9)
        one = ArrayData(base, y[None])
        traced = []
        for _ in range(3):
            # What is loaded or compiled meanwhile is counted too, but once; the minimum is the search's own.
            tracemalloc.start()
            run([one], exponents, F_in=12.0, max_terms=10)
            traced.append(tracemalloc.get_traced_memory()[1] / 1e6)
            tracemalloc.stop()
        peaks.append(min(traced))
    assert peaks[1] < 20.0
    assert peaks[1] < peaks[0] + 2.0


@pytest.mark.parametrize("seed", [3, 7])
def test_a_pilot_search_saves_a_complete_pass_and_changes_nothing(monkeypatch, seed):
    # 164 candidates, AR(1) residuals of 0.9: without prewhitening many false terms are selected first.
    flights, exponents = coloured_flight(seed, 3), monomial_exponents(8, 3)
    complete = count_complete_passes(monkeypatch, len(exponents))
    found, passes = run(flights, exponents, F_in=20.0)[0], sum(complete)
    complete.clear()
    monkeypatch.setattr(prewhitening, "LARGEST_POOL", 0.0)
    without = run(flights, exponents, F_in=20.0)[0]
    assert (passes, sum(complete)) == (1, 2)
    assert len(without.white_noise.selected) > len(without.search.selected)
    assert_same_model(found, without)


@pytest.mark.parametrize("degree", [3, 4])  # 164 and 494 candidates
@pytest.mark.parametrize("constants", ["shared", "own"])
@pytest.mark.parametrize("options", [{}, {"parsimony": "one_se"}, {"method": "orthogonal"}])
def test_of_many_candidates_a_pool_is_searched_with_the_same_result(monkeypatch, options, constants, degree):
    flights, exponents = [*coloured_flight(3, degree), *coloured_flight(7, degree)], monomial_exponents(8, degree)
    complete = count_complete_passes(monkeypatch, len(exponents))
    given = {"F_in": "auto", "bootstrap": 20, "constants": constants, **options}
    found, passes = run(flights, exponents, **given)[0], sum(complete)
    monkeypatch.setattr(SelectOptions, "moves_singly", False)
    without = run(flights, exponents, **given)[0]
    assert (passes, sum(complete)) == (0, 1)
    assert_same_model(found, without)
    assert found.aliases == without.aliases
    assert found.dependent == without.dependent
    assert_allclose(found.bootstrap.probability, without.bootstrap.probability, atol=0.1)


def coloured_flight(seed, degree):
    """Four terms and AR(1) residuals of 0.9, by eight signals."""
    rng, exponents = np.random.default_rng(seed), monomial_exponents(8, degree)
    signals = np.array([ar1(rng, 9000, 0.97) for _ in range(8)])
    X = design(signals, exponents[[0, 5, 20, 90]])[:, 1:]
    response = X / X.std(axis=0) @ [1.0, -0.7, 0.5, 0.1] + 0.3 * ar1(rng, 9000, 0.9)
    return [ArrayData(signals, response[None, :])]


def count_complete_passes(monkeypatch, p):
    """List to which every prewhitened pass adds whether it forms all products of all candidates and samples."""
    complete, prewhitened = [], prewhitening._prewhitened

    def counted(data, responses, noise, candidates, terms=None):
        complete.append(terms is None and len(candidates) == p and data.manoeuvres[0].n == 9000)
        return prewhitened(data, responses, noise, candidates, terms)

    monkeypatch.setattr(prewhitening, "_prewhitened", counted)
    return complete


def assert_same_model(found, expected):
    assert found.search.selected == expected.search.selected
    assert_allclose(found.values, expected.values, rtol=1e-9)
    scale = np.abs(expected.covariance).max()
    assert_allclose(found.covariance, expected.covariance, rtol=1e-8, atol=1e-12 * scale)


@pytest.mark.parametrize("method", ["stepwise", "orthogonal"])
@pytest.mark.parametrize(("noise_model", "seed"), [("ar2_mode_3Hz", 51), ("white", 102)])
def test_pairs_of_terms_that_stand_in_for_the_true_pair_are_exchanged(method, noise_model, seed):
    # Exchanges of single terms end 20 units of BIC above the true model.
    case = cases.recovery_case(noise_model, seed)
    found = run(signals_of(case), case.exponents, method=method, F_in="auto", constants="auto")[0]
    assert set(found.search.selected) == set(case.true)
