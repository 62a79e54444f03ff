import numpy as np
import pytest
from numpy.testing import assert_allclose
from statsmodels.tsa.ar_model import AutoReg

from structsel.errors import SelectionError
from structsel.numerics.colour import Colour, LagMoments, fit_ar, whiten_rows

from .pools import ar1


def fitted(residual, max_order, chunks=1, **options):
    moments = LagMoments(max_order)
    for part in np.array_split(residual, chunks):
        moments.add(part)
    return fit_ar(moments, **options)


def test_autoregression_equals_statsmodels_conditional_least_squares():
    rng = np.random.default_rng(1)
    e = rng.standard_normal(4000)
    for t in range(3, 4000):
        e[t] += 1.2 * e[t - 1] - 0.6 * e[t - 2] + 0.1 * e[t - 3]
    colour = fitted(e, 3)
    expected = AutoReg(e, colour.order, trend="n", hold_back=3).fit()
    assert colour.order >= 2
    assert_allclose(colour.ar, expected.params, rtol=1e-9)
    sigma = np.sqrt(np.sum(expected.resid**2) / (3997 - colour.order))
    assert_allclose(colour.sigma, sigma, rtol=1e-9)


def test_order_is_the_least_bic_of_statsmodels_over_all_orders():
    e = ar1(np.random.default_rng(2), 3000, 0.9) + ar1(np.random.default_rng(3), 3000, 0.0, 0.5)
    top, scores = 12, []
    for order in range(top + 1):
        residual = AutoReg(e, order, trend="n", hold_back=top).fit().resid if order else e[top:]
        scores.append((3000 - top) * np.log(np.sum(residual**2)) + order * np.log(3000 - top))
    assert fitted(e, top).order == int(np.argmin(scores))


def test_stretches_of_any_length_add_up_to_the_whole():
    e = ar1(np.random.default_rng(4), 1000, 0.8)
    whole, parts = LagMoments(8), LagMoments(8)
    whole.add(e)
    for part in np.split(e, [1, 2, 5, 100, 101, 700]):
        parts.add(part)
    assert parts.n == whole.n
    assert_allclose(parts.products, whole.products, rtol=1e-12)


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
    whiten_rows(rows, ar, 1.7, order, out)
    expected = [
        [1.7 * (r[t] - sum(ar[l] * r[t - l - 1] for l in range(order))) for t in range(order, 60)] for r in rows
    ]
    assert_allclose(out, expected, rtol=1e-12, atol=1e-12)


def test_correlation_time_of_a_first_order_process_is_its_closed_form():
    # sum of rho^|l| over all lags is (1 + rho)/(1 - rho).
    colour = Colour(np.array([0.92]), 1.0)
    assert_allclose(colour.correlation_time(0.02), 0.02 * 1.92 / 0.08, rtol=1e-6)


def test_a_manoeuvre_too_short_for_its_orders_is_refused_with_the_remedy():
    with pytest.raises(SelectionError, match="Lower max_order"):
        fitted(np.ones(20), 10)
