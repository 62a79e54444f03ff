import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import savgol_filter

from structsel.errors import DataError, DomainError
from structsel.numerics.differentiation import SMOOTHERS, difference_weights, differentiate
from structsel.numerics.smoothing import smooth_spline
from structsel.recording import Recording

from .signals import sine, step_response

DIFFERENCES = [
    ("central", 2),
    ("central", 4),
    ("forward", 1),
    ("forward", 2),
    ("forward", 4),
    ("backward", 1),
    ("backward", 2),
    ("backward", 4),
]


def test_the_weights_are_those_of_the_textbook():
    # Abramowitz and Stegun table 25.2 and 25.3.24; fourth-order central and second-order one-sided.
    assert_allclose(difference_weights((-2, -1, 0, 1, 2)), np.array([1, -8, 0, 8, -1]) / 12, rtol=0, atol=0)
    assert_allclose(difference_weights((0, 1, 2)), [-1.5, 2.0, -0.5], rtol=0, atol=0)
    assert_allclose(difference_weights((-2, -1, 0, 1, 2), 2), np.array([-1, 16, -30, 16, -1]) / 12, rtol=0, atol=0)


@pytest.mark.parametrize("derivative", [1, 2, 3, 4])
@pytest.mark.parametrize(("method", "order"), DIFFERENCES)
def test_a_difference_is_exact_on_polynomials_up_to_its_degree_and_not_above(method, order, derivative):
    t = np.linspace(-1.0, 1.0, 15)
    dt = t[1] - t[0]
    degree = derivative + order - 1
    poly = np.polynomial.Polynomial(1.0 + 0.3 * np.arange(degree + 1))
    got = differentiate(poly(t), dt, method, order, derivative=derivative)
    assert_allclose(got, poly.deriv(derivative)(t), rtol=1e-9, atol=1e-9)
    # One degree more is beyond a one-sided stencil at the ends.
    higher = np.polynomial.Polynomial([0.0] * (degree + 1) + [1.0])
    got = differentiate(higher(t), dt, method, order, derivative=derivative)
    assert np.abs(got - higher.deriv(derivative)(t)).max() > 1e-6


@pytest.mark.parametrize(("method", "order"), DIFFERENCES)
def test_the_error_falls_with_the_stated_power_of_the_step_ends_included(method, order):
    errors = []
    for n in (81, 161):
        t = np.linspace(0.0, 2.0, n)
        errors.append(np.abs(differentiate(np.sin(3 * t), t[1], method, order) - 3 * np.cos(3 * t)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_the_local_polynomial_is_scipys_and_exact_on_its_own_degree():
    t = 0.05 * np.arange(60)
    poly = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.25])
    got = differentiate(poly(t), 0.05, "local-polynomial", order=3, window=9)
    assert_allclose(got, poly.deriv()(t), rtol=1e-9, atol=1e-9)
    noisy = np.random.default_rng(0).standard_normal(60)
    expected = savgol_filter(noisy, 9, 3, deriv=1, delta=0.05, mode="interp")
    assert_allclose(differentiate(noisy, 0.05, "local-polynomial", order=3, window=9), expected, rtol=1e-12, atol=1e-12)


def test_a_local_polynomial_amplifies_noise_less_than_a_fourth_order_difference():
    # The variance of a linear filter's output is the sum of its squared weights: for order 4 central,
    # (1 + 64 + 64 + 1) / 144 = 0.903; for a quadratic over 11 samples, 1 / (2 sum k^2, k = 1..5) = 1/110.
    noise = np.random.default_rng(1).standard_normal(200_000)
    assert differentiate(noise, 1.0).var() == pytest.approx(130 / 144, rel=0.02)
    smooth = differentiate(noise, 1.0, "local-polynomial", order=2, window=11)
    assert smooth.var() == pytest.approx(1 / 110, rel=0.02)


def test_time_may_run_along_any_axis():
    x = np.random.default_rng(2).standard_normal((3, 20))
    by_rows = differentiate(x, 0.1, axis=1)
    assert_allclose(by_rows[2], differentiate(x[2], 0.1), rtol=1e-13)


@pytest.mark.parametrize("method", SMOOTHERS)
def test_a_smoother_without_noise_is_as_good_as_a_fourth_order_difference(method):
    t, x, rate = sine(0.02)
    inside = slice(30, -30)
    error = np.abs(differentiate(x, t[1], method) - rate)[inside].max()
    assert error < np.abs(differentiate(x, t[1]) - rate)[inside].max()
    curvature = -((2 * np.pi * 0.02 / t[1]) ** 2) * x
    assert_allclose(
        differentiate(x, t[1], method, derivative=2)[inside], curvature[inside], atol=1e-3 * curvature.max()
    )


@pytest.mark.parametrize("method", SMOOTHERS)
def test_a_smoother_beats_every_difference_on_a_noisy_manoeuvre(method):
    t, states, rates = step_response()
    noisy = states + 0.05 * states.std(axis=0) * np.random.default_rng(3).standard_normal(states.shape)
    smooth = np.abs(differentiate(noisy, t[1], method) - rates).mean(axis=0)
    for other, order in DIFFERENCES:
        assert (smooth < 0.6 * np.abs(differentiate(noisy, t[1], other, order) - rates).mean(axis=0)).all()


def test_the_second_derivative_by_spline_is_there_also_where_order_two_is_likeliest():
    t, states, rates = step_response()
    rng = np.random.default_rng(4)
    noisy = states[:, 1] + 0.01 * states[:, 1].std() * rng.standard_normal(t.size)
    assert smooth_spline(noisy, t).order == 2
    got = differentiate(noisy, t[1], "spline", derivative=2)
    # Away from the edges of the elevator q'' = -6 alpha' - 1.4 q' by the state equation.
    quiet = slice(180, 260)
    truth = (rates @ [-6.0, -1.4])[quiet]
    assert np.std(got[quiet] - truth) < 0.2 * np.std(differentiate(noisy, t[1], order=2, derivative=2)[quiet] - truth)


def test_a_recording_differentiates_by_smoother_on_any_clock_the_smoother_takes():
    t = 0.02 * (np.arange(600) + np.random.default_rng(5).uniform(-0.3, 0.3, 600))
    p = np.sin(2 * t) + 0.01 * np.random.default_rng(6).standard_normal(600)
    p[200:203] = np.nan
    recording = Recording("flight", t, {"p": p})
    got = recording.differentiate("p", method="spline")
    assert np.std((got["p_dot"] - 2 * np.cos(2 * t))[20:-20]) < 0.1
    assert got.provenance[-1].endswith("method spline, non-uniform sampling, 3 missing samples of p interpolated")
    with pytest.raises(DataError, match="finite samples of channel 'p'"):
        recording.differentiate("p", method="fourier")
    complete = recording.with_channels(p=np.sin(2 * t))
    with pytest.raises(DataError, match="fourier needs uniform sampling"):
        complete.differentiate("p", method="fourier")
    even = Recording("flight", 0.02 * np.arange(600), {"p": np.sin(0.04 * np.arange(600))})
    assert np.std((even.differentiate("p", method="fourier")["p_dot"] - 2 * np.cos(2 * even.t))[20:-20]) < 0.01


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"x": np.ones(3), "dt": 0.1}, DataError, "at least 5 samples; there are 3"),
        ({"x": np.ones(9), "dt": 0.0}, DomainError, "dt above zero"),
        ({"x": np.ones(9), "dt": 0.1, "order": 3}, DomainError, "order 2, 4, not 3"),
        ({"x": np.ones(9), "dt": 0.1, "method": "wavelet"}, DomainError, "no method 'wavelet'"),
        ({"x": np.ones(50), "dt": 0.1, "method": "spline", "derivative": 3}, DomainError, "first and the second"),
        ({"x": np.ones(9), "dt": 0.1, "method": "spline"}, DataError, "at least 12 finite samples"),
        ({"x": np.full(50, np.nan), "dt": 0.1, "method": "fourier"}, DataError, "sample 0 is nan"),
        ({"x": np.ones(9), "dt": 0.1, "method": "local-polynomial", "window": 8}, DomainError, "odd"),
        ({"x": np.ones(9), "dt": 0.1, "method": "local-polynomial"}, DataError, "there are 9"),
    ],
)
def test_what_cannot_be_differentiated_is_said(arguments, error, says):
    with pytest.raises(error, match=says):
        differentiate(**arguments)
