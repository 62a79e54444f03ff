"""select(): values, fit, model and report of a selection, and the trace of its search."""

import json

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from scipy import stats

from structsel.candidates import Candidates, Term
from structsel.errors import SelectionError, StructselWarning
from structsel.model import AeroModel
from structsel.selection import Selections, select
from tests.flights import fly
from tests.selections import POOL, TERMS, TRUTH, WHITE, columns, made, names


@pytest.fixture(scope="module")
def flights():
    return fly(TRUTH, 0.02, lengths=(2000, 1500, 1800))


@pytest.fixture(scope="module")
def coloured():
    return fly(TRUTH, 0.02, "ar1_0.92", lengths=(2000, 1500, 1800))


def test_terms_come_back_by_name_with_values_the_fit_and_a_model(flights):
    found = select(flights, "CZ", POOL, F_in="auto")
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
    found = select(flights, "CZ", POOL, F_in=12.0, **WHITE)
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
    found = select(coloured, "CZ", POOL, bootstrap=20)
    half = stats.t.ppf(0.95, found.error_dof) * found.standard_errors
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
    one, sse = found, 0.0
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
    found = select(made(lambda c: 2.0 * c["alpha"]), "CZ", POOL, F_in="auto", bootstrap=0)
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
    found = select(coloured, "CZ", POOL, F_in=12.0, bootstrap=20)
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


@pytest.mark.parametrize("method", ["stepwise", "orthogonal"])
def test_the_trace_ends_where_the_model_is_and_every_line_is_statsmodels_fit(flights, method):
    found = select(flights, "CZ", POOL, method=method, F_in=12.0, **WHITE)
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
    found = select(flights, "CZ", POOL, F_in=12.0, **WHITE)
    frame = found.trace_frame()
    assert list(frame["term"]) == [str(s.term) for s in found.trace]
    assert (frame["R2"].diff().dropna() > 0).all()
    assert str(found.trace[0]).split()[:2] == ["enter", str(found.trace[0].term)]
    assert f"R2 {found.trace[0].R2:.5f}" in str(found.trace[0])
