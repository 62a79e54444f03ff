import numpy as np
import pytest
from numpy.testing import assert_allclose
from statsmodels.tsa.ar_model import AutoReg

from structsel.errors import SelectionError
from structsel.numerics.noise_models import LagProducts, fit_ar, fit_ar_of_manoeuvres, prewhiten

from .pools import ar1


def fitted(residual, max_order, chunks=1, **options):
    lags = LagProducts(max_order)
    for part in np.array_split(residual, chunks):
        lags.add(part)
    return fit_ar(lags, **options)


def test_autoregression_equals_statsmodels_conditional_least_squares():
    rng = np.random.default_rng(1)
    e = rng.standard_normal(4000)
    for t in range(3, 4000):
        e[t] += 1.2 * e[t - 1] - 0.6 * e[t - 2] + 0.1 * e[t - 3]
    noise = fitted(e, 3)
    expected = AutoReg(e, noise.order, trend="n", hold_back=3).fit()
    assert noise.order >= 2
    assert_allclose(noise.ar, expected.params, rtol=1e-9)
    sigma = np.sqrt(np.sum(expected.resid**2) / (3997 - noise.order))
    assert_allclose(noise.sigma, sigma, rtol=1e-9)


def test_order_is_the_least_bic_of_statsmodels_over_all_orders():
    e = ar1(np.random.default_rng(2), 3000, 0.9) + ar1(np.random.default_rng(3), 3000, 0.0, 0.5)
    top, scores = 12, []
    for order in range(top + 1):
        residual = AutoReg(e, order, trend="n", hold_back=top).fit().resid if order else e[top:]
        scores.append((3000 - top) * np.log(np.sum(residual**2)) + order * np.log(3000 - top))
    assert fitted(e, top).order == int(np.argmin(scores))


def test_segments_of_any_length_add_up_to_the_complete_recording():
    e = ar1(np.random.default_rng(4), 1000, 0.8)
    complete, parts = LagProducts(8), LagProducts(8)
    complete.add(e)
    for part in np.split(e, [1, 2, 5, 100, 101, 700]):
        parts.add(part)
    assert parts.n == complete.n
    assert_allclose(parts.products, complete.products, rtol=1e-12)


def test_white_noise_gets_no_autoregression_and_a_noise_free_fit_gets_the_floor():
    assert fitted(np.random.default_rng(5).standard_normal(5000), 10).order == 0
    silent = fitted(np.zeros(500), 4, floor=1e-3)
    assert silent.order == 0
    assert silent.sigma == 1e-3


def lags_of(residual, max_order):
    lags = LagProducts(max_order)
    lags.add(residual)
    return lags


def test_short_manoeuvres_of_one_noise_have_one_autoregression_with_a_level_of_each():
    # Two superposed processes, so that no autoregression of low order is right; levels 1 and 3.
    rng = np.random.default_rng(6)
    residuals = [level * (ar1(rng, 500, 0.95) + 2.0 * ar1(rng, 500, -0.5)) for level in (1.0, 3.0, 1.0)]
    models = fit_ar_of_manoeuvres([lags_of(e, 20) for e in residuals])
    assert len({model.ar.tobytes() for model in models}) == 1
    assert models[0].order > 1
    assert 2.7 < models[1].sigma / models[0].sigma < 3.3  # standard error 5 %


def test_levels_and_common_autoregression_minimise_the_common_sum():
    # Given its order, the common autoregression is least squares of all rows divided by their manoeuvre's sigma.
    rng = np.random.default_rng(7)
    residuals = [level * ar1(rng, 400, 0.9) for level in (1.0, 2.0)]
    models = fit_ar_of_manoeuvres([lags_of(e, 6) for e in residuals])
    order = models[0].order
    rows, present = [], []
    for e, model in zip(residuals, models, strict=True):
        past = np.lib.stride_tricks.sliding_window_view(e, 7)[:, ::-1]  # the present, then the nearest lag first
        rows.append(past[:, 1 : 1 + order] / model.sigma)
        present.append(past[:, 0] / model.sigma)
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(present), rcond=None)[0]
    assert_allclose(models[1].ar, expected, rtol=1e-6)


def test_manoeuvres_of_different_noise_keep_their_own_autoregression():
    rng = np.random.default_rng(8)
    lags = [lags_of(ar1(rng, 800, of), 10) for of in (0.0, 0.95)]
    for model, one in zip(fit_ar_of_manoeuvres(lags), lags, strict=True):
        assert_allclose(model.ar, fit_ar(one).ar, rtol=1e-12)


def test_a_manoeuvre_without_noise_leaves_the_others_their_own_model():
    noisy, silent = lags_of(ar1(np.random.default_rng(9), 800, 0.9), 10), lags_of(np.zeros(800), 10)
    models = fit_ar_of_manoeuvres([noisy, silent], floor=1e-6)
    assert_allclose(models[0].ar, fit_ar(noisy).ar, rtol=1e-12)
    assert models[1].sigma == 1e-6


@pytest.mark.parametrize("order", [0, 1, 3, 4, 5, 9])
def test_whitening_rows_is_the_written_sum(order):
    rng = np.random.default_rng(order)
    rows, ar = rng.standard_normal((3, 60)), rng.standard_normal(order)
    out = np.empty((3, 60 - order))
    prewhiten(rows, ar, 1.7, order, out)
    expected = [
        [1.7 * (r[t] - sum(ar[l] * r[t - l - 1] for l in range(order))) for t in range(order, 60)] for r in rows
    ]
    assert_allclose(out, expected, rtol=1e-12, atol=1e-12)


def test_a_manoeuvre_too_short_for_its_orders_is_refused_with_the_remedy():
    with pytest.raises(SelectionError, match="Lower max_order"):
        fitted(np.ones(20), 10)
