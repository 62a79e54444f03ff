"""select(): what each option does, and the old names of options."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression

from structsel.candidates import Candidates, Term
from structsel.errors import SelectionError
from structsel.recording import Recording
from structsel.selection import SelectOptions, select
from tests.flights import fly
from tests.pools import ar1
from tests.selections import POOL, TERMS, TRUTH, WHITE, columns, made, names


@pytest.fixture(scope="module")
def flights():
    return fly(TRUTH, 0.02, lengths=(2000, 1500, 1800))


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_every_method_finds_the_terms_of_a_noise_free_response_by_name(method):
    clean = fly(TRUTH, 0.0, lengths=(700, 800))
    for noise in ("white", "ar"):
        found = select(clean, "CZ", POOL, method=method, noise=noise, F_in=12.0, bootstrap=0)
        assert names(found.terms) == TERMS
        expected = [TRUTH[t] for t in ("1", *map(str, found.terms))]
        assert_allclose(found.values, expected, rtol=1e-7)


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_forced_terms_stay_by_name_or_term(flights, method):
    found = select(flights, "CZ", POOL, method=method, include=["de^3", Term("q_hat^2"), "1"], bootstrap=0)
    assert {"de^3", "q_hat^2"} <= names(found.terms)
    found = select(flights, "CZ", POOL, method=method, include="de^3", max_terms=2, bootstrap=0)
    assert "de^3" in names(found.terms)
    assert len(found.terms) <= 2


def test_a_search_may_start_from_nothing_the_linear_terms_or_all(flights):
    found = {s: select(flights, "CZ", POOL, initial_terms=s, F_in=12.0, **WHITE) for s in ("empty", "linear", "all")}
    assert {names(f.terms) == TERMS for f in found.values()} == {True}
    assert [str(s.term) for s in found["linear"].trace[:3]] == ["alpha", "de", "q_hat"]
    assert [s.action for s in found["all"].trace[:19]] == ["enter"] * 19
    assert sum(s.action == "leave" for s in found["all"].trace) >= 15
    assert found["empty"].trace[0].n_terms == 1


def test_the_automatic_threshold_is_sidaks_for_this_many_candidates(flights):
    found = select(flights, "CZ", POOL, F_in="auto", **WHITE)
    limit = stats.f.isf(1 - 0.95 ** (1 / 19), 1, 5299)
    assert min(s.F for s in found.trace if s.action == "enter") >= limit
    X, y = columns(flights, found.terms)
    outside = [t for t in POOL if t not in found.terms]
    F = [sm.OLS(y, np.column_stack([X, columns(flights, [t])[0][:, 1]])).fit().tvalues[-1] ** 2 for t in outside]
    assert max(F) < limit


def test_false_discovery_control_has_lower_thresholds_for_later_terms():
    # Forty orthogonal candidates, twelve of them true with t about 3.2: below what "auto" asks of everyone (10.4),
    # above what the later entries need under false-discovery control.
    rng = np.random.default_rng(1)
    n, p = 2000, 40
    X = rng.standard_normal((n, p))
    X = np.linalg.qr(X - X.mean(axis=0))[0]
    pool = Candidates.parse([f"x{j:02d}" for j in range(p)])
    kept = {"auto": 0, "fdr": 0}
    k = np.arange(1, p + 1)
    limits = stats.f.isf(0.05 * k / (p + 1 - 0.95 * k), 1, n - 1 - k)  # [BG09]
    for _ in range(10):
        y = 3.2 * X[:, :12].sum(axis=1) + rng.standard_normal(n)
        one = [Recording("a", 0.02 * np.arange(n), {**dict(zip(pool.names, X.T)), "CZ": y})]
        for F_in in kept:
            found = select(one, "CZ", pool, F_in=F_in, **WHITE)
            kept[F_in] += len(found.terms)
            entered = [s.F for s in found.trace if s.action == "enter"]
            assert F_in == "auto" or (entered >= limits[: len(entered)]).all()
    assert kept["fdr"] > 1.2 * kept["auto"]


def test_the_r2_stop_keeps_what_brings_enough_and_nothing_else(flights):
    found = select(flights, "CZ", POOL, stopping_rule="R2", min_r2_gain=0.01, **WHITE)
    r2 = [0.0, *(s.R2 for s in found.trace if s.action == "enter")]
    assert (np.diff(r2) >= 0.01).all()
    X, y = columns(flights, found.terms)
    gains = [
        sm.OLS(y, np.column_stack([X, columns(flights, [t])[0][:, 1]])).fit().rsquared - found.r2
        for t in POOL
        if t not in found.terms
    ]
    assert max(gains) < 0.01
    assert len(found.terms) < len(select(flights, "CZ", POOL, **WHITE).terms)


def test_the_pse_stop_ends_where_pse_would_rise(flights):
    found = select(flights, "CZ", POOL, stopping_rule="PSE", **WHITE)
    entered = [s.PSE for s in found.trace if s.action == "enter"]
    assert (np.diff(entered) < 0).all()
    X, y = columns(flights, found.terms)
    n, k = X.shape[0], len(found.terms)
    now = 1 - found.r2 + (k + 1) / n
    for t in POOL:
        if t not in found.terms:
            r2 = sm.OLS(y, np.column_stack([X, columns(flights, [t])[0][:, 1]])).fit().rsquared
            assert 1 - r2 + (k + 2) / n >= now


@pytest.mark.parametrize("criterion", ["PSE", "BIC", "AICc", "adj_R2"])
def test_a_criterion_chooses_its_best_of_the_models_visited(flights, criterion):
    found = select(flights, "CZ", POOL, F_in=0.5, criterion=criterion, **WHITE)
    assert f"least {criterion} of" in found.stop_reason
    n = found.n
    k = np.array([s.n_terms for s in found.trace])
    rss = np.array([1 - s.R2 for s in found.trace])
    K = k + 2
    score = {
        "PSE": rss + (k + 1) / n,
        "BIC": n * np.log(rss) + (k + 1) * np.log(n),
        "AICc": n * np.log(rss) + 2 * K + 2 * K * (K + 1) / (n - K - 1),
        "adj_R2": rss / (n - k - 1),
    }[criterion]
    best = int(np.argmin(score))
    assert len(found.terms) == k[best]
    assert_allclose(found.r2, found.trace[best].R2, rtol=1e-10)


def test_sigma_max_in_the_responses_units_is_the_charge_per_term(flights):
    # Morelli's bound: with sigma_max given, PSE charges sigma_max^2 / N per term, so a larger one keeps fewer terms.
    kept = [
        len(select(flights, "CZ", POOL, method="orthogonal", criterion="PSE", sigma_max=s, **WHITE).terms)
        for s in (0.02, 0.2, 2.0, 10.0)
    ]
    assert kept == sorted(kept, reverse=True)
    assert kept[0] > kept[-1]
    std = np.std(np.concatenate([r["CZ"] for r in flights]))
    same = select(flights, "CZ", POOL, method="orthogonal", criterion="PSE", sigma_max=float(std), **WHITE)
    assert same.terms == select(flights, "CZ", POOL, method="orthogonal", criterion="PSE", **WHITE).terms


def test_a_bound_of_pse_is_refused_where_pse_decides_nothing(flights):
    with pytest.raises(SelectionError, match=r"sigma_max=0\.2 is the bound of PSE, which decides nothing here"):
        select(flights, "CZ", POOL, sigma_max=0.2, bootstrap=0)


def test_splines_and_formulas_stand_in_the_pool_like_any_term():
    truth = {"1": 0.2, "alpha": 5.0, "(alpha - 0.12)+": -3.0, "abs(de)*de": 2.0}
    flights = fly(truth, 0.01, "ar1_0.92", lengths=(3000, 3000))
    pool = (
        Candidates.polynomial(["alpha", "de"], 2)
        + Candidates.splines("alpha", [0.04, 0.08, 0.12, 0.16], times=["de"])
        + Candidates.parse(["abs(de)*de", "abs(de)"])
    )
    found = select(flights, "CZ", pool, F_in="auto", bootstrap=0)
    assert names(found.terms) == set(truth) - {"1"}
    values = dict(zip(["1", *map(str, found.terms)], found.values))
    for name, value in truth.items():
        assert_allclose(values[name], value, rtol=0.15)
    clean = sum(v * Term(t).evaluate(flights[0]) for t, v in truth.items())
    assert_allclose(found.model.evaluate(flights[0])["CZ"], clean, atol=0.01)


def test_alpha_squared_is_replaced_by_alpha_where_alpha_is_far_from_zero():
    # [H17] on CX: over a narrow range of alpha the two parameters correlate above 0.9, and the weaker goes.
    far = {"alpha": lambda c, rng: 0.15 + 0.02 * ar1(rng, 1500, 0.98, 0.2)}
    flights = made(lambda c: -0.03 + 0.6 * c["alpha"] + 0.8 * c["alpha"] ** 2 - 0.2 * c["de"], noise=0.0005, **far)
    pool = Candidates.parse(["alpha", "alpha^2", "de", "q_hat"])
    both = select(flights, "CZ", pool, F_in=12.0, bootstrap=0)
    assert names(both.terms) == {"alpha", "alpha^2", "de"}
    one = select(flights, "CZ", pool, F_in=12.0, correlation_limit=0.9, bootstrap=0)
    assert names(one.terms) == {"alpha", "de"}
    assert one.stop_reason.endswith("; 1 dropped, parameters correlated above 0.9")
    last = one.trace[-1]
    assert (last.action, str(last.term)) == ("leave", "alpha^2")
    X, y = columns(flights, both.terms)
    correlation = sm.OLS(y, X).fit().cov_params()
    i, j = (1 + [str(t) for t in both.terms].index(n) for n in ("alpha", "alpha^2"))
    assert correlation[i, j] / np.sqrt(correlation[i, i] * correlation[j, j]) < -0.9
    forced = select(flights, "CZ", pool, F_in=12.0, correlation_limit=0.9, include=["alpha^2"], bootstrap=0)
    assert names(forced.terms) == {"alpha^2", "de"}


def test_a_loose_correlation_limit_changes_nothing(flights):
    free = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0)
    held = select(flights, "CZ", POOL, F_in=12.0, correlation_limit=0.999, bootstrap=0)
    assert held.terms == free.terms
    assert held.stop_reason == free.stop_reason


@pytest.mark.parametrize("components", [1, 2, 3])
def test_principal_components_equal_scikit_learns_and_are_called_biased(components):
    near = {"q_hat": lambda c, rng: 0.2 * c["alpha"] + 0.002 * rng.standard_normal(1500)}
    flights = made(lambda c: 1.0 + c["alpha"] + c["q_hat"] - c["de"], **near)
    pool = Candidates.polynomial(["alpha", "de", "q_hat"], 1)
    options = {"include": pool.names, "estimate": "principal_components", **WHITE}
    found = select(flights, "CZ", pool, components=components, **options)
    X, y = columns(flights, found.terms)
    X = X[:, 1:]
    size = X.std(axis=0)
    scores = PCA(components)
    z = scores.fit_transform((X - X.mean(axis=0)) / size)
    theta = scores.components_.T @ LinearRegression().fit(z, y).coef_ / size
    assert_allclose(found.values[1:], theta, rtol=1e-8)
    assert_allclose(found.values[0], y.mean() - X.mean(axis=0) @ theta, rtol=1e-8)
    error = y - found.values[0] - X @ theta
    assert_allclose(found.rms, np.sqrt(np.mean(error**2)), rtol=1e-9)
    biased = components < 3  # with all of them it is least squares
    assert found.biased == biased
    assert ("BIASED" in str(found)) == biased
    assert found.to_model().biased == biased
    assert found.to_dict()["biased"] == biased


def test_ridge_is_called_biased_and_shrinks_correlated_terms():
    near = {"q_hat": lambda c, rng: c["alpha"] + 0.001 * rng.standard_normal(1500)}
    flights = made(lambda c: c["alpha"] + c["q_hat"], noise=0.3, **near)
    pool = Candidates.polynomial(["alpha", "q_hat"], 1)
    plain, ridge = (
        select(flights, "CZ", pool, include=pool.names, estimate=e, **WHITE) for e in ("least_squares", "ridge")
    )
    assert not plain.biased
    assert ridge.biased
    # Neither intervals nor F nor textbook errors of an estimate whose bias is not known.
    assert np.isnan(ridge.intervals()).all()
    assert np.isnan(ridge.to_frame()[["low95", "high95", "partial_F", "textbook_error"]].to_numpy()).all()
    assert np.isnan(ridge.to_model().intervals()).all()
    assert np.isfinite(plain.intervals()).all()
    assert ridge.estimator.startswith("ridge, k = ")
    assert np.abs(ridge.values[1:] - 1.0).max() < np.abs(plain.values[1:] - 1.0).max()
    assert "BIASED estimates: ridge" in str(ridge)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"force": ["de^3"]}, {"include": ["de^3"]}),
        ({"residuals": "robust"}, {"noise": "cluster"}),
        ({"noise": "coloured"}, {"noise": "ar"}),
        ({"start": "all"}, {"initial_terms": "all"}),
        ({"stop": "R2", "r2_change": 0.01}, {"stopping_rule": "R2", "min_r2_gain": 0.01}),
        ({"max_order": 2}, {"max_ar_order": 2}),
        ({"criterion": "manoeuvre"}, {"criterion": "cv"}),
        ({"estimate": "ridge", "components": "manoeuvre"}, {"estimate": "ridge", "components": "cv"}),
    ],
)
def test_old_names_of_options_work_and_warn(flights, old, new):
    expected = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0, **new)
    with pytest.warns(DeprecationWarning, match="use ") as seen:
        found = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0, **old)
    assert {w.filename for w in seen} == {__file__}
    assert found.terms == expected.terms
    assert_array_equal(found.values, expected.values)


def test_options_may_be_given_as_one_object_and_single_ones_replaced(flights):
    options = SelectOptions(F_in=12.0, bootstrap=5, noise="white")
    as_object = select(flights, "CZ", POOL, options=options, bootstrap=0)
    as_keywords = select(flights, "CZ", POOL, F_in=12.0, noise="white", bootstrap=0)
    assert as_object.options == as_keywords.options
    assert_array_equal(as_object.values, as_keywords.values)
    with pytest.raises(TypeError, match="unexpected keyword argument 'F_inn'"):
        select(flights, "CZ", POOL, F_inn=4.0)


@pytest.mark.parametrize("order", [["alpha", "q_hat"], ["q_hat", "alpha"]])
def test_orthogonal_functions_are_made_in_the_order_the_candidates_were_given(order):
    # Two candidates with nearly the same motion: the one given first is credited with the common part.
    rng = np.random.default_rng(11)
    shared = ar1(rng, 2000, 0.95)
    channels = {name: shared + 0.3 * ar1(rng, 2000, 0.9) for name in ("alpha", "q_hat")}
    channels["CZ"] = channels["alpha"] + channels["q_hat"] + 0.1 * rng.standard_normal(2000)
    flight = Recording("f", np.arange(2000) * 0.02, channels)
    found = select(flight, "CZ", Candidates(order), method="orthogonal", order="given", **WHITE)
    assert [str(step.term) for step in found.trace if step.action == "enter"] == order


def test_the_order_of_the_pool_decides_with_orthogonal_functions_in_the_order_given():
    # What alpha and near have in common is attributed to the first; the second has less left than q_hat.
    recordings = made(
        lambda c: c["alpha"] + c["near"] + 0.5 * c["q_hat"],
        near=lambda c, rng: c["alpha"] + 0.02 * rng.normal(size=1500),
    )
    given = {"method": "orthogonal", "order": "given", "max_terms": 2, "noise": "white", "parsimony": "none"}
    kept = {
        first: names(select(recordings, "CZ", Candidates.parse([first, second, "q_hat"]), bootstrap=0, **given).terms)
        for first, second in (("alpha", "near"), ("near", "alpha"))
    }
    assert kept == {"alpha": {"alpha", "q_hat"}, "near": {"near", "q_hat"}}
