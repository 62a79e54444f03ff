"""Measures of fit and whiteness, validate() and ensemble()."""

import math

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from scipy import stats
from scipy.signal import lfilter
from sklearn.metrics import r2_score, root_mean_squared_error
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.tsa.stattools import acf

from structsel.candidates import Term
from structsel.errors import ChannelError, DataError, DomainError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.recording import Recording
from structsel.validation import (
    adjusted_r2,
    autocorrelation,
    correlation,
    durbin_watson,
    ensemble,
    ljung_box,
    r2,
    rrmse,
    tic,
    validate,
    white_bound,
)


@pytest.fixture
def pair():
    rng = np.random.default_rng(11)
    y = 3.0 + rng.normal(size=400)
    return y, y + lfilter([1.0], [1.0, -0.7], 0.3 * rng.normal(size=400))


def make_recording(name, seed, n=400, rho=0.0, sigma=0.02):
    rng = np.random.default_rng(seed)
    alpha, de = rng.uniform(-0.1, 0.3, n), rng.uniform(-0.2, 0.2, n)
    noise = lfilter([1.0], [1.0, -rho], sigma * rng.normal(size=n))
    CZ = -0.2 - 4.0 * alpha - 0.8 * de + noise
    return Recording(name, 0.02 * np.arange(n), {"alpha": alpha, "de": de, "CZ": CZ, "Cm": 0.1 - de + noise})


TRUTH = AeroModel(
    {
        "CZ": ResponseModel(("1", "alpha", "de"), [-0.2, -4.0, -0.8], ranges={"alpha": (-0.1, 0.3)}),
        "Cm": ResponseModel(("1", "de"), [0.1, -1.0]),
    },
    name="truth",
    recordings=("m00",),
)


# --- measures --------------------------------------------------------------------------------------


def test_measures_of_fit_equal_scikit_learn_and_numpy(pair):
    y, yhat = pair
    assert_allclose(r2(y, yhat), r2_score(y, yhat), rtol=1e-13)
    rms = root_mean_squared_error(y, yhat)
    assert_allclose(rrmse(y, yhat), rms / math.sqrt(sum(v * v for v in y) / 400), rtol=1e-13)
    assert_allclose(rrmse(y, yhat, "std"), rms / stats.tstd(y) * math.sqrt(400 / 399), rtol=1e-13)
    assert_allclose(rrmse(y, yhat, "range"), rms / (max(y) - min(y)), rtol=1e-13)
    assert_allclose(correlation(y, yhat), stats.pearsonr(y, yhat)[0], rtol=1e-13)


def test_theil_s_coefficient_is_zero_for_a_perfect_and_one_for_an_opposite_model(pair):
    y, _ = pair
    assert tic(y, y) == 0.0
    assert_allclose(tic(y, -y), 1.0, rtol=1e-15)
    # By hand: errors 1 and 1; rms 1; rms of (3, 4) and of (2, 5).
    assert_allclose(tic([3.0, 4.0], [2.0, 5.0]), 1.0 / (math.sqrt(12.5) + math.sqrt(14.5)), rtol=1e-15)


def test_adjusted_r2_equals_statsmodels_on_a_fit(pair):
    y, yhat = pair
    fit = sm.OLS(y, sm.add_constant(np.column_stack([yhat, yhat**2, np.arange(400.0)]))).fit()
    assert_allclose(adjusted_r2(y, fit.fittedvalues, 3), fit.rsquared_adj, rtol=1e-12)


def test_measures_of_whiteness_equal_statsmodels(pair):
    e = pair[1] - pair[0]
    assert_allclose(autocorrelation(e, 30), acf(e, nlags=30, fft=False), rtol=1e-12, atol=1e-15)
    table = acorr_ljungbox(e, lags=[12])
    assert_allclose(ljung_box(e, 12), table.iloc[0].to_list(), rtol=1e-12)
    assert_allclose(durbin_watson(e), sm.stats.durbin_watson(e), rtol=1e-14)
    assert_allclose(white_bound(400), stats.norm.ppf(0.975) / 20, rtol=1e-14)


def test_white_noise_passes_the_bound_at_one_lag_in_twenty():
    # 300 fixed seeds of 20 lags; the fraction beyond is 0.05 to within three standard errors of a proportion.
    beyond = []
    for seed in range(300):
        rho = autocorrelation(np.random.default_rng(seed).normal(size=1000), 20)
        beyond += list(np.abs(rho[1:]) > white_bound(1000))
    assert abs(np.mean(beyond) - 0.05) < 3 * math.sqrt(0.05 * 0.95 / 6000)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (
            lambda: r2(np.ones(5), np.arange(5.0)),
            DomainError,
            "R2 is not defined: the measured response is 1 at all 5",
        ),
        (lambda: correlation(np.arange(5.0), np.ones(5)), DomainError, "the modelled response is 1 at all 5"),
        (lambda: rrmse(np.zeros(5), np.ones(5)), DomainError, "only zeros"),
        (lambda: rrmse(np.ones(5), np.zeros(5), "std"), DomainError, "RRMSE is not defined"),
        (lambda: rrmse(np.ones(5), np.zeros(5), "mean"), DomainError, "'rms', 'std', 'range'"),
        (lambda: tic(np.zeros(5), np.zeros(5)), DomainError, "zero throughout"),
        (
            lambda: adjusted_r2(np.arange(4.0), np.arange(4.0), 3),
            DomainError,
            "more than 4 samples for 3 terms",
        ),
        (
            lambda: autocorrelation(np.arange(5.0), 5),
            DomainError,
            "to lag 5 needs more than 5 samples; found 5",
        ),
        (lambda: autocorrelation(np.ones(5), 2), DomainError, "residual is 1 at all 5"),
        (lambda: ljung_box(np.arange(5.0), 0), DomainError, "lag 0"),
        (lambda: durbin_watson(np.zeros(5)), DomainError, "zero throughout"),
        (lambda: r2(np.arange(5.0), np.arange(4.0)), DataError, "differ in length: 5 and 4"),
        (
            lambda: tic([1.0, np.nan], [1.0, 2.0]),
            DataError,
            "measured response must be finite; found nan at sample 1",
        ),
        (lambda: r2(1.0, 1.0), DataError, "at least one sample"),
    ],
)
def test_measures_refuse_what_has_no_answer(make, error, message):
    with pytest.raises(error, match=message):
        make()


# --- validate --------------------------------------------------------------------------------------


def test_every_score_is_the_measure_on_its_recording_and_the_pool_on_all():
    recordings = [make_recording("m01", 1), make_recording("m02", 2, n=600, rho=0.9)]
    validation = validate(TRUTH, recordings)
    values = [(r["CZ"], -0.2 - 4.0 * r["alpha"] - 0.8 * r["de"]) for r in recordings]
    for recording, (y, yhat) in zip(recordings, values):
        score = validation.score("CZ", recording.name)
        assert score.n == len(recording)
        assert_allclose(score.r2, r2_score(y, yhat), rtol=1e-12)
        assert_allclose(score.rms_error, root_mean_squared_error(y, yhat), rtol=1e-12)
        assert_allclose(score.bias, np.mean(y - yhat), rtol=1e-9)
        assert_allclose(score.autocorrelation, acf(y - yhat, nlags=40, fft=False), rtol=1e-9, atol=1e-12)
        assert_allclose(score.ljung_box_p, acorr_ljungbox(y - yhat, lags=[40]).lb_pvalue.iloc[0], rtol=1e-8)
    y, yhat = (np.concatenate(parts) for parts in zip(*values))
    pooled = validation.score("CZ")
    assert pooled.n == 1000
    assert_allclose([pooled.r2, pooled.tic], [r2_score(y, yhat), tic(y, yhat)], rtol=1e-12)
    assert_allclose(pooled.adjusted_r2, 1 - (1 - pooled.r2) * 999 / 997, rtol=1e-12)
    own = [validation.score("CZ", name) for name in ("m01", "m02")]
    assert_allclose(pooled.ljung_box_p, stats.chi2.sf(sum(s.ljung_box for s in own), 80), rtol=1e-9)


def test_coloured_residuals_are_stated_from_white_ones():
    validation = validate(TRUTH, [make_recording("m01", 1), make_recording("m02", 2, rho=0.9)])
    white, coloured = validation.score("CZ", "m01"), validation.score("CZ", "m02")
    assert white.white
    assert not coloured.white
    assert coloured.durbin_watson < 0.5 < 1.7 < white.durbin_watson
    assert white.outside < 0.15 < coloured.outside


def test_pooled_lags_do_not_cross_from_one_manoeuvre_to_the_next():
    # Two white manoeuvres about different means: one long record of them would look strongly coloured.
    one, two = make_recording("m01", 1), make_recording("m02", 2)
    shifted = two.with_channels(CZ=two["CZ"] + 1.0)
    pooled = validate(TRUTH, [one, shifted], responses="CZ").score("CZ")
    assert pooled.white
    assert np.abs(pooled.autocorrelation[1:]).max() < 0.15


def test_warnings_are_stated_with_the_numbers():
    exact = make_recording("m00", 3, sigma=0.0)
    model = AeroModel({"CZ": ResponseModel(("1",), [0.5], ranges={})}, recordings=())
    assert "so no correlation" in str(validate(model, exact))
    flat = exact.with_channels(CZ=0.1 - exact["de"], Cm=0.1 - exact["de"])
    validation = validate(AeroModel({"Cm": TRUTH["Cm"]}, recordings=("m00",)), flat)
    assert math.isnan(validation.score("Cm").ljung_box_p)
    assert validation.score("Cm").r2 == 1.0
    assert any("was used to identify" in warning for warning in validation.doubts)
    assert any("no test of whiteness" in warning for warning in validation.doubts)
    wide = exact.with_channels(alpha=exact["alpha"] * 2)
    assert any("leaves the ranges the model was identified in: alpha [rad]" in d for d in validate(TRUTH, wide).doubts)


def test_of_many_recordings_that_leave_a_range_the_farthest_is_named():
    t = 0.1 * np.arange(50)
    model = AeroModel({"Cm": ResponseModel(("1", "alpha"), [0.1, -0.5], ranges={"alpha": (0.0, 0.2)})})

    def flights(count):  # m1 reaches 0.21, m2 0.22, ...
        return [Recording(f"m{k}", t, {"alpha": np.linspace(0.0, 0.2 + 0.01 * k, 50)}) for k in range(1, count + 1)]

    assert [text.split(" leaves ")[0] for text in model.warnings_on(flights(3))] == ["'m1'", "'m2'", "'m3'"]
    (text,) = model.warnings_on(flights(4))
    assert text.startswith("4 of 4 recordings leave the ranges the model was identified in, 'm4' farthest: alpha [rad]")
    used = AeroModel(model.responses, recordings=("m1", "m2", "m3", "m4"))
    assert used.warnings_on(flights(4))[1] == (
        "'m1', 'm2', 'm3' and 'm4' were used to identify the model: their scores describe the fit."
    )


def test_the_tables_hold_every_score():
    validation = validate(TRUTH, [make_recording("m01", 1), make_recording("m02", 2)])
    frame = validation.to_frame()
    assert list(frame.recording) == ["m01", "m01", "m02", "m02", "all", "all"]
    assert_allclose(frame.r2, [s.r2 for s in (*validation.scores, *validation.pooled)])
    held = validation.to_dict()
    assert held["schema"] == "structsel.validation/1"
    assert len(held["scores"][0]["autocorrelation"]) == 41
    text = str(validation)
    assert f"{validation.score('Cm', 'm02').r2:.4f}" in text
    assert len({len(line.rsplit("  ", 1)[0]) for line in text.splitlines()[1:8]}) == 1  # columns line up
    assert "rms error over the rms of the measured response" in text
    assert len(str(validate(TRUTH, make_recording("m01", 1))).splitlines()) == 1 + 1 + 2 + 2


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (
            lambda: validate(TRUTH, make_recording("m01", 1).with_channels(CZ=1.0)),
            DomainError,
            "CZ on 'm01': R2 is not defined",
        ),
        (lambda: validate(TRUTH, make_recording("m01", 1), responses=["CX"]), ModelError, "no response 'CX'"),
        (lambda: validate(TRUTH, []), DataError, "at least one recording"),
        (
            lambda: validate(TRUTH, [make_recording("a", 1), make_recording("a", 2)]),
            DataError,
            "a more than once",
        ),
        (
            lambda: validate(TRUTH, make_recording("m01", 1, n=9)),
            DataError,
            "10 samples or more; 'm01' has 9",
        ),
        (
            lambda: validate(TRUTH, Recording("m07", np.arange(20.0), {"alpha": np.arange(20.0)})),
            ChannelError,
            r"(?s)validate needs channels 'de' \[rad\].*'m07' has none",
        ),
        (
            lambda: validate(TRUTH, make_recording("m01", 1)).score("CZ", "m05"),
            ModelError,
            "No score of 'CZ'",
        ),
    ],
)
def test_validate_refuses_what_it_cannot_score(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_validate_refuses_a_nan_and_names_channel_and_sample():
    recording = make_recording("m01", 1)
    de = recording["de"].copy()
    de[33] = np.nan
    with pytest.raises(DataError, match=r"(?s)'de'.*'m01'.*nan at sample 33"):
        validate(TRUTH, recording.with_channels(de=de))


# --- ensemble --------------------------------------------------------------------------------------


def fitted(seed):
    recording = make_recording(f"m{seed:03d}", seed, n=100)
    fit = sm.OLS(recording["CZ"], sm.add_constant(np.column_stack([recording["alpha"], recording["de"]]))).fit()
    return AeroModel({"CZ": ResponseModel(("1", "alpha", "de"), fit.params, fit.cov_params())})


def test_an_ensemble_of_honest_fits_scatters_as_much_as_they_say():
    # Scatter of 200 values has a relative standard error of 1 / sqrt(400) = 5 %; three of them.
    table = ensemble([fitted(seed) for seed in range(200)])
    assert [(row.response, row.term) for row in table.rows] == [("CZ", "1"), ("CZ", "alpha"), ("CZ", "de")]
    for row, truth in zip(table.rows, [-0.2, -4.0, -0.8]):
        assert abs(row.ratio - 1.0) < 0.15
        assert abs(row.mean - truth) < 3 * math.sqrt(row.variance / 200)


def test_ensemble_rows_are_the_sample_statistics():
    values, errors = [1.0, 4.0, 2.5], [0.5, 0.7, 0.6]
    models = [
        AeroModel({"Cm": ResponseModel((Term("alpha"),), [v], standard_errors=[e])}) for v, e in zip(values, errors)
    ]
    models.append(AeroModel({"Cm": ResponseModel((Term("de"),), [-1.0])}))
    table = ensemble(models)
    alpha, de = table.rows
    assert (alpha.count, alpha.low, alpha.high) == (3, 1.0, 4.0)
    expected = [2.5, 2.25, 0.6, 1.5 / 0.6]
    assert_allclose([alpha.mean, alpha.variance, alpha.std_error, alpha.ratio], expected, rtol=1e-14)
    assert de.count == 1
    assert math.isnan(de.variance)
    assert math.isnan(de.ratio)
    assert table.to_dict()["rows"][1]["variance"] is None
    assert list(table.to_frame().term) == ["alpha", "de"]
    lines = str(table).splitlines()
    assert lines[2].split() == ["Cm", "alpha", "3", "2.5", "1", "4", "2.25", "0.6", "2.5"]
    assert len({len(line) for line in lines[1:4]}) == 1  # columns line up


def test_an_ensemble_of_nothing_is_refused():
    with pytest.raises(ModelError, match="at least one model"):
        ensemble([])


def test_responses_identified_with_own_constants_are_compared_about_the_means_of_each_recording():
    t = 0.02 * np.arange(200)
    alpha = np.sin(t)
    recordings = [
        Recording(f"m{k}", t, {"alpha": alpha, "CZ": level - 5.0 * alpha}) for k, level in enumerate((0.1, 0.9))
    ]
    model = AeroModel({"CZ": ResponseModel(("1", "alpha"), np.array([0.5, -5.0]), constants={"a": 0.3, "b": 0.7})})
    own = validate(model, recordings)
    assert_allclose([s.r2 for s in (*own.scores, *own.pooled)], 1.0, atol=1e-12)
    assert "about the means of each recording" in own.doubts[0]
    level = validate(model, recordings, constants="model")
    assert_allclose([s.rms_error for s in level.scores], 0.4, rtol=1e-9)
    with pytest.raises(ModelError, match="constants='each' is not one of 'auto', 'model', 'own'"):
        validate(model, recordings, constants="each")
