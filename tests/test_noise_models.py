import numpy as np
import pytest
from numpy.testing import assert_allclose
from statsmodels.tsa.ar_model import AutoReg

from structsel.errors import SelectionError
from structsel.numerics.noise_models import LagProducts, fit_ar, prewhiten

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
