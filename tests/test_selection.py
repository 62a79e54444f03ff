"""select(): names, options, what a result says of itself, and what is refused."""

import json

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression

from structsel.candidates import Candidates, Term
from structsel.errors import ChannelError, DataError, SelectionError, StructselWarning
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.selection import Selections, SelectOptions, select

from .flights import fly
from .pools import ar1

TRUTH = {"1": -0.3, "alpha": -4.0, "alpha^2": 9.0, "de": -0.6, "q_hat": -12.0}
TERMS = {"alpha", "alpha^2", "de", "q_hat"}
POOL = Candidates.polynomial(["alpha", "q_hat", "de"], 3)  # 19 terms
WHITE = {"noise": "white", "bootstrap": 0}


@pytest.fixture(scope="module")
def flights():
    return fly(TRUTH, 0.02, lengths=(2000, 1500, 1800))


@pytest.fixture(scope="module")
def coloured():
    return fly(TRUTH, 0.02, "ar1_0.92", lengths=(2000, 1500, 1800))


def names(terms):
    return {str(t) for t in terms}


def columns(recordings, terms):
    """The constant and the terms over all recordings, and the response CZ."""
    X = np.vstack([np.column_stack([np.ones(len(r)), *(Term(str(t)).evaluate(r) for t in terms)]) for r in recordings])
    return X, np.concatenate([r["CZ"] for r in recordings])


def made(y, seed=0, n=1500, n_recordings=2, noise=0.1, **more):
    """Recordings of independent, well excited channels; y is a function of them."""
    recordings = []
    for k in range(n_recordings):
        rng = np.random.default_rng([seed, k])
        channels = {name: 0.1 * rng.standard_normal(n) for name in ("alpha", "de", "q_hat")}
        channels |= {name: make(channels, rng) for name, make in more.items()}
        channels["CZ"] = y(channels) + noise * rng.standard_normal(n)
        recordings.append(Recording(f"flight_{k + 1}", 0.02 * np.arange(n), channels))
    return recordings


# --- what comes back -------------------------------------------------------------------------------


def test_terms_come_back_by_name_with_values_the_fit_and_a_model(flights):
    found = select(flights, "CZ", POOL, F_in="auto")["CZ"]
    assert names(found.terms) == TERMS
    assert all(isinstance(t, Term) for t in found.terms)
    values = dict(zip(["1", *map(str, found.terms)], found.values))
    errors = dict(zip(["1", *map(str, found.terms)], found.standard_errors))
    for name, value in TRUTH.items():
        assert abs(values[name] - value) < 4 * errors[name]
    assert found.n == 5300
    assert found.recordings == ("flight_1", "flight_2", "flight_3")
    assert [p.name for p in found.held_out] == ["flight_1", "flight_2", "flight_3"]
    assert found.dt == pytest.approx(0.02)


def test_values_fit_and_textbook_errors_with_white_residuals_are_those_of_statsmodels(flights):
    found = select(flights, "CZ", POOL, F_in=12.0, **WHITE)["CZ"]
    X, y = columns(flights, found.terms)
    ols = sm.OLS(y, X).fit()
    assert_allclose(found.values, ols.params, rtol=1e-9)
    assert_allclose(found.textbook_errors, ols.bse, rtol=1e-8)
    assert_allclose(found.r2, ols.rsquared, rtol=1e-10)
    assert_allclose(found.adjusted_r2, ols.rsquared_adj, rtol=1e-10)
    assert_allclose(found.rms, np.sqrt(ols.ssr / ols.nobs), rtol=1e-10)
    assert_allclose(found.condition, np.linalg.cond(X / np.linalg.norm(X, axis=0)), rtol=1e-8)
    vif = [1 / (1 - sm.OLS(X[:, j], np.delete(X, j, axis=1)).fit().rsquared) for j in range(1, X.shape[1])]
    assert_allclose(found.vif, vif, rtol=1e-8)


def test_intervals_are_student_s_about_the_values(coloured):
    found = select(coloured, "CZ", POOL, bootstrap=20)["CZ"]
    half = stats.t.ppf(0.95, found.dof) * found.standard_errors
    assert_allclose(found.intervals(0.9), np.column_stack([found.values - half, found.values + half]), rtol=1e-12)
    assert (found.standard_errors >= np.sqrt(np.diag(found.covariance)) * (1 - 1e-12)).all()
    assert set(found.inclusion) == set(POOL.names)


def test_several_responses_come_back_as_a_mapping_and_one_model(flights):
    more = [r.with_channels(Cm=0.05 - 0.7 * r["alpha"] - 1.2 * r["de"]) for r in flights]
    found = select(more, ["Cm", "CZ"], POOL, F_in=12.0, bootstrap=0)
    assert isinstance(found, Selections)
    assert list(found) == ["Cm", "CZ"]
    assert names(found["Cm"].terms) == {"alpha", "de"}
    assert_allclose(sorted(found["Cm"].values), [-1.2, -0.7, 0.05], rtol=1e-8)
    assert isinstance(found.model, AeroModel)
    assert set(found.model.responses) == {"Cm", "CZ"}
    assert list(found.to_frame()["response"].unique()) == ["Cm", "CZ"]
    with pytest.raises(SelectionError, match="No selection for 'CX'; there is one for Cm, CZ"):
        found["CX"]


def test_the_model_evaluates_to_the_values_fitted_and_knows_the_region_simulated(flights):
    found = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0)
    one, sse = found["CZ"], 0.0
    for r in flights:
        X, y = columns([r], one.terms)
        fitted = found.model.evaluate(r)["CZ"]
        assert_allclose(fitted, X @ one.values, rtol=1e-12)
        sse += np.sum((y - fitted) ** 2)
    assert_allclose(np.sqrt(sse / one.n), one.rms, rtol=1e-9)
    assert set(one.region) == {"alpha", "de", "q_hat"}
    for name, (low, high) in one.region.items():
        every = np.concatenate([r[name] for r in flights])
        assert (low, high) == (every.min(), every.max())
    with pytest.warns(StructselWarning, match="alpha"):
        found.model.evaluate(flights[0].with_channels(alpha=flights[0]["alpha"] + 0.5))


def test_only_channels_of_kept_terms_are_in_the_region():
    found = select(made(lambda c: 2.0 * c["alpha"]), "CZ", POOL, F_in="auto", bootstrap=0)["CZ"]
    assert set(found.region) == {"alpha"}


def test_the_result_is_plain_json(coloured):
    pool = POOL + Candidates.parse(["V_ratio", "V_ratio*alpha"])
    for options in ({"bootstrap": 10}, {"estimate": "ridge", "bootstrap": 0}, {"method": "orthogonal", "bootstrap": 0}):
        found = select(coloured, ["CZ"], pool, **options)
        again = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert again["schema"] == "structsel.selection/1"
        body = again["responses"]["CZ"]
        assert [p["term"] for p in body["parameters"]] == ["1", *map(str, found["CZ"].terms)]
        assert_allclose([p["value"] for p in body["parameters"]], found["CZ"].values, rtol=1e-15)
        assert len(body["trace"]) == len(found["CZ"].trace)
        assert body["doubts"] == list(found["CZ"].doubts)


def test_the_report_names_method_residuals_terms_and_warnings(coloured):
    found = select(coloured, "CZ", POOL, F_in=12.0, bootstrap=20)["CZ"]
    text = str(found)
    assert text.startswith(f"CZ: {len(found.terms)} of 19 candidate terms, stepwise, coloured residuals, AR order")
    for line in (*map(str, found.terms), *found.doubts):
        assert line in text


def test_progress_is_stated_stage_by_stage(coloured):
    calls = []
    select(coloured, "CZ", POOL, bootstrap=5, workers=1, progress=lambda *call: calls.append(call))
    assert {"cross-products", "prewhitened", "bootstrap"} <= {stage for stage, _, _ in calls}
    assert all(0 < done <= of for _, done, of in calls)
    assert calls[-1] == ("bootstrap", 5, 5)


# --- the trace -------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["stepwise", "orthogonal"])
def test_the_trace_ends_where_the_model_is_and_every_line_is_statsmodels_fit(flights, method):
    found = select(flights, "CZ", POOL, method=method, F_in=12.0, **WHITE)["CZ"]
    inside, bic = [], []
    for step in found.trace:
        gone = step.other if step.other is not None else step.term if step.action == "leave" else None
        inside = [t for t in inside if t != gone] + ([step.term] if step.action != "leave" else [])
        X, y = columns(flights, inside)
        ols = sm.OLS(y, X).fit()
        n, k = len(y), len(inside)
        assert step.n_terms == k
        assert_allclose(step.R2, ols.rsquared, rtol=1e-9)
        # [H17]: PSE = rss / N + sigma_max^2 (k + 1) / N with sigma_max the response's deviation, here relative.
        assert_allclose(step.PSE, 1 - ols.rsquared + (k + 1) / n, rtol=1e-9)
        bic.append(ols.bic)
        if step.action == "enter" and method == "stepwise":
            assert_allclose(step.F, ols.tvalues[-1] ** 2, rtol=1e-8)
            assert_allclose(
                step.partial_r, ols.tvalues[-1] / np.hypot(ols.tvalues[-1], np.sqrt(ols.df_resid)), rtol=1e-8
            )
    # Ours is of rss / N in other units, which shifts a whole trace by one number.
    assert_allclose(np.diff([s.BIC for s in found.trace]), np.diff(bic), rtol=1e-6, atol=1e-4)
    assert set(inside) == set(found.terms)
    assert_allclose(found.trace[-1].R2, found.r2, rtol=1e-10)


def test_the_trace_reads_as_a_table_and_as_lines(flights):
    found = select(flights, "CZ", POOL, F_in=12.0, **WHITE)["CZ"]
    frame = found.trace_frame()
    assert list(frame["term"]) == [str(s.term) for s in found.trace]
    assert (frame["R2"].diff().dropna() > 0).all()
    assert str(found.trace[0]).split()[:2] == ["enter", str(found.trace[0].term)]
    assert f"R2 {found.trace[0].R2:.5f}" in str(found.trace[0])


# --- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_every_method_finds_the_terms_of_a_noise_free_response_by_name(method):
    clean = fly(TRUTH, 0.0, lengths=(700, 800))
    for noise in ("white", "ar"):
        found = select(clean, "CZ", POOL, method=method, noise=noise, F_in=12.0, bootstrap=0)["CZ"]
        assert names(found.terms) == TERMS
        expected = [TRUTH[t] for t in ("1", *map(str, found.terms))]
        assert_allclose(found.values, expected, rtol=1e-7)


@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_forced_terms_stay_by_name_or_term(flights, method):
    found = select(flights, "CZ", POOL, method=method, include=["de^3", Term("q_hat^2"), "1"], bootstrap=0)["CZ"]
    assert {"de^3", "q_hat^2"} <= names(found.terms)
    found = select(flights, "CZ", POOL, method=method, include="de^3", max_terms=2, bootstrap=0)["CZ"]
    assert "de^3" in names(found.terms)
    assert len(found.terms) <= 2


def test_a_search_may_start_from_nothing_the_linear_terms_or_all(flights):
    found = {
        s: select(flights, "CZ", POOL, initial_terms=s, F_in=12.0, **WHITE)["CZ"] for s in ("empty", "linear", "all")
    }
    assert {names(f.terms) == TERMS for f in found.values()} == {True}
    assert [str(s.term) for s in found["linear"].trace[:3]] == ["alpha", "de", "q_hat"]
    assert [s.action for s in found["all"].trace[:19]] == ["enter"] * 19
    assert sum(s.action == "leave" for s in found["all"].trace) >= 15
    assert found["empty"].trace[0].n_terms == 1


def test_the_automatic_threshold_is_sidaks_for_this_many_candidates(flights):
    found = select(flights, "CZ", POOL, F_in="auto", **WHITE)["CZ"]
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
            found = select(one, "CZ", pool, F_in=F_in, **WHITE)["CZ"]
            kept[F_in] += len(found.terms)
            entered = [s.F for s in found.trace if s.action == "enter"]
            assert F_in == "auto" or (entered >= limits[: len(entered)]).all()
    assert kept["fdr"] > 1.2 * kept["auto"]


def test_the_r2_stop_keeps_what_brings_enough_and_nothing_else(flights):
    found = select(flights, "CZ", POOL, stopping_rule="R2", min_r2_gain=0.01, **WHITE)["CZ"]
    r2 = [0.0, *(s.R2 for s in found.trace if s.action == "enter")]
    assert (np.diff(r2) >= 0.01).all()
    X, y = columns(flights, found.terms)
    gains = [
        sm.OLS(y, np.column_stack([X, columns(flights, [t])[0][:, 1]])).fit().rsquared - found.r2
        for t in POOL
        if t not in found.terms
    ]
    assert max(gains) < 0.01
    assert len(found.terms) < len(select(flights, "CZ", POOL, **WHITE)["CZ"].terms)


def test_the_pse_stop_ends_where_pse_would_rise(flights):
    found = select(flights, "CZ", POOL, stopping_rule="PSE", **WHITE)["CZ"]
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
    found = select(flights, "CZ", POOL, F_in=0.5, criterion=criterion, **WHITE)["CZ"]
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
        len(select(flights, "CZ", POOL, method="orthogonal", sigma_max=s, **WHITE)["CZ"].terms)
        for s in (0.02, 0.2, 2.0, 10.0)
    ]
    assert kept == sorted(kept, reverse=True)
    assert kept[0] > kept[-1]
    std = np.std(np.concatenate([r["CZ"] for r in flights]))
    same = select(flights, "CZ", POOL, method="orthogonal", sigma_max=float(std), **WHITE)["CZ"]
    assert same.terms == select(flights, "CZ", POOL, method="orthogonal", **WHITE)["CZ"].terms


def test_splines_and_formulas_stand_in_the_pool_like_any_term():
    truth = {"1": 0.2, "alpha": 5.0, "(alpha - 0.12)+": -3.0, "abs(de)*de": 2.0}
    flights = fly(truth, 0.01, "ar1_0.92", lengths=(3000, 3000))
    pool = (
        Candidates.polynomial(["alpha", "de"], 2)
        + Candidates.splines("alpha", [0.04, 0.08, 0.12, 0.16], times=["de"])
        + Candidates.parse(["abs(de)*de", "abs(de)"])
    )
    found = select(flights, "CZ", pool, F_in="auto", bootstrap=0)
    assert names(found["CZ"].terms) == set(truth) - {"1"}
    values = dict(zip(["1", *map(str, found["CZ"].terms)], found["CZ"].values))
    for name, value in truth.items():
        assert_allclose(values[name], value, rtol=0.15)
    clean = sum(v * Term(t).evaluate(flights[0]) for t, v in truth.items())
    assert_allclose(found.model.evaluate(flights[0])["CZ"], clean, atol=0.01)


def test_alpha_squared_is_replaced_by_alpha_where_alpha_is_far_from_zero():
    # [H17] on CX: over a narrow range of alpha the two parameters correlate above 0.9, and the weaker goes.
    far = {"alpha": lambda c, rng: 0.15 + 0.02 * ar1(rng, 1500, 0.98, 0.2)}
    flights = made(lambda c: -0.03 + 0.6 * c["alpha"] + 0.8 * c["alpha"] ** 2 - 0.2 * c["de"], noise=0.0005, **far)
    pool = Candidates.parse(["alpha", "alpha^2", "de", "q_hat"])
    both = select(flights, "CZ", pool, F_in=12.0, bootstrap=0)["CZ"]
    assert names(both.terms) == {"alpha", "alpha^2", "de"}
    one = select(flights, "CZ", pool, F_in=12.0, correlation_limit=0.9, bootstrap=0)["CZ"]
    assert names(one.terms) == {"alpha", "de"}
    assert one.stop_reason.endswith("; 1 dropped, parameters correlated above 0.9")
    last = one.trace[-1]
    assert (last.action, str(last.term)) == ("leave", "alpha^2")
    X, y = columns(flights, both.terms)
    correlation = sm.OLS(y, X).fit().cov_params()
    i, j = (1 + [str(t) for t in both.terms].index(n) for n in ("alpha", "alpha^2"))
    assert correlation[i, j] / np.sqrt(correlation[i, i] * correlation[j, j]) < -0.9
    forced = select(flights, "CZ", pool, F_in=12.0, correlation_limit=0.9, include=["alpha^2"], bootstrap=0)["CZ"]
    assert names(forced.terms) == {"alpha^2", "de"}


def test_a_loose_correlation_limit_changes_nothing(flights):
    free = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0)["CZ"]
    held = select(flights, "CZ", POOL, F_in=12.0, correlation_limit=0.999, bootstrap=0)["CZ"]
    assert held.terms == free.terms
    assert held.stop_reason == free.stop_reason


@pytest.mark.parametrize("components", [1, 2, 3])
def test_principal_components_equal_scikit_learns_and_are_called_biased(components):
    near = {"q_hat": lambda c, rng: 0.2 * c["alpha"] + 0.002 * rng.standard_normal(1500)}
    flights = made(lambda c: 1.0 + c["alpha"] + c["q_hat"] - c["de"], **near)
    pool = Candidates.polynomial(["alpha", "de", "q_hat"], 1)
    options = {"include": pool.names, "estimate": "principal_components", **WHITE}
    found = select(flights, "CZ", pool, components=components, **options)["CZ"]
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
        select(flights, "CZ", pool, include=pool.names, estimate=e, **WHITE)["CZ"] for e in ("least_squares", "ridge")
    )
    assert not plain.biased
    assert ridge.biased
    assert ridge.estimator.startswith("ridge, k = ")
    assert np.abs(ridge.values[1:] - 1.0).max() < np.abs(plain.values[1:] - 1.0).max()
    assert "BIASED estimates: ridge" in str(ridge)


# --- doubts ----------------------------------------------------------------------------------------


def warnings_of(recordings, pool=POOL, **options):
    return "\n".join(select(recordings, "CZ", pool, **{"F_in": "auto", "bootstrap": 50, **options})["CZ"].doubts)


def test_well_excited_channels_with_white_noise_leave_no_warning():
    assert warnings_of(made(lambda c: c["alpha"] - 2 * c["de"] + 9 * c["q_hat"] * c["alpha"])) == ""


def test_white_and_coloured_rules_are_reported_side_by_side_where_they_disagree():
    # A lag-one correlation of 0.98 and slow channels: the white rule keeps terms that are not there.
    slow = {c: lambda _, rng: 0.1 * ar1(rng, 1500, 0.97, 0.24) for c in ("alpha", "de", "q_hat")}
    slow["gust"] = lambda _, rng: 0.1 * ar1(rng, 1500, 0.98, 0.2)
    flights = made(lambda c: c["alpha"] - c["de"] + c["gust"], noise=0.0, **slow)
    found = select(flights, "CZ", POOL, F_in="auto", bootstrap=0)["CZ"]
    extra = [str(t) for t in found.classical if t not in found.terms]
    assert names(found.terms) == {"alpha", "de"}
    assert len(extra) >= 2
    (stated,) = [d for d in found.doubts if d.startswith("With white residuals the search")]
    assert f"would also keep {', '.join(extra[:3])}" in stated
    white = select(flights, "CZ", POOL, F_in="auto", **WHITE)["CZ"]
    assert white.terms == found.classical
    assert not any(d.startswith("With white residuals") for d in white.doubts)


def delayed(recordings, samples):
    """The same recordings with the angle of attack read this many samples late."""
    shifted = [np.concatenate([np.full(samples, r["alpha"][0]), r["alpha"][:-samples]]) for r in recordings]
    return [r.with_channels(alpha=a) for r, a in zip(recordings, shifted)]


def test_whitening_is_given_up_where_the_residual_is_misfit_and_not_noise():
    # A channel that is late leaves a residual that follows the inputs: whitening takes it for noise and predicts worse.
    flights = fly(TRUTH, 0.005, lengths=(2000, 1500, 1800))
    found = select(delayed(flights, 10), "CZ", POOL, F_in="auto", bootstrap=0)["CZ"]
    (said,) = [d for d in found.doubts if d.startswith("Prewhitening was dropped")]
    assert "look for delayed channels" in said
    assert found.noise_models == ()
    robust = select(delayed(flights, 10), "CZ", POOL, F_in="auto", noise="cluster", bootstrap=0)["CZ"]
    assert found.terms == robust.terms
    assert_allclose(found.values, robust.values, rtol=1e-12)
    assert "Whitening" not in warnings_of(flights)


def test_tests_by_blocks_hold_in_coloured_noise():
    # Ten flights with lag-one correlation 0.92; the white rule is right in none of them.
    exact = {"cluster": 0, "white": 0}
    for seed in range(10):
        flights = fly(TRUTH, 0.02, "ar1_0.92", lengths=(2000, 1500, 1800), seed=seed)
        for noise in exact:
            found = select(flights, "CZ", POOL, F_in="auto", noise=noise, bootstrap=0)["CZ"]
            exact[noise] += names(found.terms) == TERMS
    assert exact["cluster"] >= 8
    assert exact["white"] <= 2


def test_a_threshold_that_lets_probability_in_is_named():
    found = warnings_of(made(lambda c: c["alpha"]), F_in=4.0)
    assert "With F_in = 4 and 19 candidates about 0.8 false terms are expected" in found


def test_more_candidates_than_samples_is_said_and_the_search_goes_on():
    short = made(lambda c: 3.0 * c["alpha"], n=15, n_recordings=1, noise=0.01)
    found = select(short, "CZ", POOL, F_in="auto", bootstrap=0)["CZ"]
    assert "alpha" in names(found.terms)
    assert len(found.terms) < 14
    assert "15 samples for 19 candidates: many models fit equally well" in "\n".join(found.doubts)
    assert "No cross-validation" in "\n".join(found.doubts)
    assert np.isnan(found.held_out_r2)


def test_exactly_dependent_candidates_are_listed_not_fitted():
    copies = {"beta": lambda c, rng: 2.0 * c["alpha"], "da": lambda c, rng: c["de"] - c["q_hat"]}
    flights = made(lambda c: c["alpha"] + c["de"] + c["q_hat"], **copies)
    pool = Candidates.polynomial(["alpha", "beta", "de", "q_hat", "da"], 1)
    found = select(flights, "CZ", pool, F_in=12.0, bootstrap=0)["CZ"]
    assert len(found.terms) == 3
    assert len(found.dependent) == 2
    assert len({"alpha", "beta"} & names(found.dependent)) == 1
    assert "exactly dependent on the kept terms, so never tested" in "\n".join(found.doubts)


def test_a_channel_that_never_moves_is_listed_with_its_terms():
    flights = made(lambda c: c["alpha"], df=lambda c, rng: np.full(1500, 0.35))
    found = select(flights, "CZ", Candidates.polynomial(["alpha", "df"], 2), F_in=12.0, bootstrap=0)["CZ"]
    assert len(found.terms) == 1
    assert {"df", "df^2"} <= names(found.dependent)
    assert "Constant, or exactly dependent" in "\n".join(found.doubts)


def test_collinear_terms_and_a_bad_condition_are_named():
    near = {"q_hat": lambda c, rng: c["alpha"] + 1e-4 * rng.standard_normal(1500)}
    flights = made(lambda c: c["alpha"] + c["q_hat"], noise=1e-6, **near)
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 1)
    said = warnings_of(flights, pool, include=["alpha", "q_hat"])
    assert "Collinear (VIF above 10): alpha (" in said
    assert "Condition number" not in said
    # Two channels that hardly move, and move together to a thousandth: 1 / (1e-4 x 1e-3).
    still = {
        "beta": lambda c, rng: 1.0 + 1e-3 * c["alpha"],
        "da": lambda c, rng: 1.0 + 1e-3 * (c["alpha"] + 1e-3 * c["q_hat"]),
    }
    pool = Candidates.parse(["beta", "da", "de"])
    said = warnings_of(made(lambda c: c["de"], **still), pool, include=["beta", "da"])
    assert "about 7 digits of the values are correct" in said


def test_an_oscillation_the_noise_model_cannot_hold_is_named():
    flights = fly(TRUTH, 0.02, "ar2_mode_3Hz", lengths=(2000, 2000))
    assert "asks for more than AR order 1. Raise max_ar_order" in warnings_of(flights, max_ar_order=1)
    assert "Raise max_ar_order" not in warnings_of(flights)


def test_terms_that_resamples_often_omit_are_named():
    # A true t value near the entry threshold: kept here, but in about half of the resamples.
    for seed in range(30):
        flights = made(lambda c: c["alpha"] + 0.062 * c["de"], seed=seed)
        found = select(flights, "CZ", POOL, F_in="auto", bootstrap=50)["CZ"]
        unsure = [n for n in names(found.terms) if found.inclusion[n] < 0.5]
        said = [d for d in found.doubts if d.startswith("Kept in under half")]
        assert bool(unsure) == bool(said)
        if unsure:
            assert all(n in said[0] for n in unsure)
            break
    else:
        pytest.fail("no flight of thirty kept a term that most resamples leave out")


def test_one_manoeuvre_warns_that_its_held_out_parts_are_optimistic():
    flights = made(lambda c: c["alpha"])
    assert "One manoeuvre only" in warnings_of(flights[:1])
    assert "One manoeuvre only" not in warnings_of(flights)


def test_a_model_that_does_not_carry_over_to_other_flights_says_so():
    # The sign of alpha's effect differs between the flights.
    flights = made(lambda c: 0.0 * c["alpha"], noise=0.01)
    flights = [r.with_channels(CZ=r["CZ"] + s * r["alpha"]) for r, s in zip(flights, (1.0, 0.3))]
    assert "on data not used for selecting" in warnings_of(flights)


# --- bad input -------------------------------------------------------------------------------------


def test_a_missing_channel_is_named_with_its_recording(flights):
    with pytest.raises(ChannelError, match=r"(?s)select needs channel 'df'.*flight_1"):
        select(flights, "CZ", POOL + Candidates.parse(["df"]))
    with pytest.raises(ChannelError, match=r"(?s)select needs channel 'Cm'.*flight_1"):
        select(flights, "Cm", POOL)


@pytest.mark.parametrize("channel", ["alpha", "CZ"])
def test_a_sample_that_is_not_a_number_is_named(flights, channel):
    values = flights[1][channel].copy()
    values[17] = np.nan
    bad = [flights[0], flights[1].with_channels(**{channel: values})]
    with pytest.raises(DataError, match=rf"(?s){channel}.*17") as caught:
        select(bad, "CZ", POOL)
    assert "flight_2" in str(caught.value)


def test_a_constant_response_is_refused(flights):
    flat = [r.with_channels(CZ=-0.5) for r in flights]
    with pytest.raises(DataError, match=r"'CZ' is constant \(-0.5\) in flight_1, flight_2, flight_3"):
        select(flat, "CZ", POOL)


def test_a_response_among_the_candidates_is_refused(flights):
    with pytest.raises(SelectionError, match="response 'CZ' is also a channel of the candidates"):
        select(flights, "CZ", POOL + Candidates.parse(["CZ*alpha"]))


def test_a_recording_that_is_too_short_is_named(flights):
    short = Recording("blip", [0.0, 0.02], {n: flights[0][n][:2] for n in flights[0].names})
    with pytest.raises(DataError, match=r"'blip' has 2 sample"):
        select([*flights, short], "CZ", POOL)


def test_no_recording_and_no_candidate_are_refused(flights):
    with pytest.raises(SelectionError, match="at least one recording"):
        select([], "CZ", POOL)
    with pytest.raises(SelectionError, match="the pool is empty"):
        select(flights, "CZ", Candidates())


def test_a_forced_term_outside_the_pool_is_refused(flights):
    with pytest.raises(SelectionError, match=r"to include de\^4, which is not among the 19 candidates"):
        select(flights, "CZ", POOL, include=["de^4"])


def test_more_forced_terms_than_samples_are_refused():
    short = made(lambda c: c["alpha"], n=15, n_recordings=1)
    with pytest.raises(SelectionError, match="19 terms but has 14 degrees of freedom"):
        select(short, "CZ", POOL, include=POOL.names)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"F_in": 4.0, "F_out": 5.0}, "F_out=5 is above F_in=4"),
        ({"F_in": "auto", "F_out": 50.0}, "F_out=50 is above the F_in of 9"),
        ({"F_in": -1.0}, "F_in must be above zero"),
        ({"F_in": "some"}, "give 'auto', 'fdr' or a number"),
        ({"F_out": -1.0}, "F_out must not be negative"),
        ({"method": "lasso"}, "method='lasso' is not one of 'stepwise', 'orthogonal', 'best_subset'"),
        ({"noise": "red"}, "noise='red'"),
        ({"criterion": "R2"}, "criterion='R2'"),
        ({"initial_terms": "half"}, "initial_terms='half'"),
        ({"estimate": "lasso"}, "estimate='lasso'"),
        ({"sigma_max": 0.0}, "sigma_max must be above zero"),
        ({"sigma_max": "big"}, "give 'response', 'residual' or a number"),
        ({"components": 0}, "components must be 1 or more"),
        ({"correlation_limit": 1.5}, "must lie between 0 and 1"),
        ({"bootstrap": -1}, "bootstrap must be 0 or more"),
        ({"max_terms": 0}, "max_terms must be 1 or more"),
    ],
)
def test_an_option_that_cannot_be_meant_is_refused(flights, options, message):
    with pytest.raises(SelectionError, match=message):
        select(flights[:1], "CZ", POOL, **{"bootstrap": 0, **options})


def test_leaving_out_manoeuvres_needs_something_to_leave_out():
    short = made(lambda c: c["alpha"], n=100, n_recordings=1)
    with pytest.raises(SelectionError, match="needs parts to hold out"):
        select(short, "CZ", POOL, criterion="cv", bootstrap=0)


def test_what_a_selection_returns_cannot_be_changed(flights):
    found = select(flights, "CZ", POOL, bootstrap=5)
    with pytest.raises(AttributeError):
        found["CZ"].r2 = 1.0
    with pytest.raises(TypeError):
        found.by_response["CZ"] = None
    one = found["CZ"]
    for array in (one.values, one.covariance, one.textbook_errors, one.standard_errors, one.partial_F, one.vif):
        assert not array.flags.writeable


def test_collinearity_tables_equal_belsleys_formulas_and_the_parameter_correlation(flights):
    terms = ["alpha", "alpha^2", "q_hat"]
    found = select(flights, "CZ", Candidates.parse(terms), include=terms, noise="white", bootstrap=0)["CZ"]
    names = ["1", *map(str, found.terms)]
    columns = [np.concatenate([Candidates.parse([t]).evaluate(f)[:, 0] for f in flights]) for t in names[1:]]
    X = np.column_stack([np.ones(len(columns[0])), *columns])
    _, singular, Vt = np.linalg.svd(X / np.linalg.norm(X, axis=0))
    phi = (Vt.T / singular) ** 2
    credit = (phi / phi.sum(axis=1, keepdims=True)).T
    table = found.collinearity_frame()
    assert_allclose(table["condition_index"], singular[0] / singular, rtol=1e-7)
    assert_allclose(table[names].to_numpy(), credit, rtol=1e-6, atol=1e-9)
    correlation = found.correlation_frame()
    assert list(correlation.columns) == names
    assert_allclose(np.diag(correlation), 1.0)


# --- old names, for one release ---------------------------------------------------------------------


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
    expected = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0, **new)["CZ"]
    with pytest.warns(DeprecationWarning, match="use ") as seen:
        found = select(flights, "CZ", POOL, F_in=12.0, bootstrap=0, **old)["CZ"]
    assert {w.filename for w in seen} == {__file__}
    assert found.terms == expected.terms
    assert_array_equal(found.values, expected.values)


def test_options_may_be_given_as_one_object_and_single_ones_replaced(flights):
    options = SelectOptions(F_in=12.0, bootstrap=5, noise="white")
    as_object = select(flights, "CZ", POOL, options=options, bootstrap=0)["CZ"]
    as_keywords = select(flights, "CZ", POOL, F_in=12.0, noise="white", bootstrap=0)["CZ"]
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
    found = select(flight, "CZ", Candidates(order), method="orthogonal", order="given", **WHITE)["CZ"]
    assert [str(step.term) for step in found.trace if step.action == "enter"] == order
