import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.signal import butter, sosfiltfilt

from structsel.errors import DataError, StructselWarning
from structsel.numerics.fourier_series import smooth_fourier
from structsel.numerics.signal_quality import is_sample_and_hold, largest_noise_level, noise_level
from structsel.numerics.smoothing import smooth_spline, smooth_splines

from .signals import sine, step_response

DT = 0.04


@pytest.fixture(scope="module")
def response():
    return step_response(DT)


def smooth(method, x, t):
    return smooth_spline(x, t) if method == "spline" else smooth_fourier(x, t[1] - t[0])


def signal_named(name, response):
    t, states, rates = response
    if name == "angle of attack":
        return t, states[:, 0], rates[:, 0]
    if name == "pitch rate":
        return t, states[:, 1], rates[:, 1]
    if name == "trend":
        return (
            t,
            3.0 + 0.4 * t + np.sin(0.7 * t) * np.exp(-0.1 * t),
            0.4 + np.exp(-0.1 * t) * (0.7 * np.cos(0.7 * t) - 0.1 * np.sin(0.7 * t)),
        )
    return sine(float(name.split()[1]), DT)


# The factor between the actual and the stated rms error of values and derivative, over five seeds of white noise.
CALIBRATED = [
    ("spline", "angle of attack", 0.77, 1.3),
    ("spline", "pitch rate", 0.77, 1.3),
    ("spline", "trend", 0.70, 1.3),
    ("spline", "sine 0.02", 0.65, 1.3),
    ("fourier", "angle of attack", 0.77, 1.3),
    ("fourier", "pitch rate", 0.77, 2.5),
    ("fourier", "trend", 0.70, 1.3),
    ("fourier", "sine 0.02", 0.70, 1.3),
    ("fourier", "sine 0.2", 0.77, 1.3),
]


@pytest.mark.parametrize("level", [0.01, 0.05])
@pytest.mark.parametrize(("method", "name", "lowest", "highest"), CALIBRATED)
def test_the_stated_accuracy_of_values_and_derivative_is_the_actual_one(response, method, name, lowest, highest, level):
    t, x, rate = signal_named(name, response)
    inside = slice(t.size // 20, -t.size // 20)
    squares = np.zeros(4)
    noises = []
    for seed in range(5):
        noise = level * x.std() * np.random.default_rng(seed).standard_normal(t.size)
        got = smooth(method, x + noise, t)
        pairs = (got.values - x, got.values_std, got.derivative - rate, got.derivative_std)
        squares += [np.mean(a[inside] ** 2) for a in pairs]
        noises.append(got.noise)
    assert lowest < np.sqrt(squares[0] / squares[1]) < highest
    assert lowest < np.sqrt(squares[2] / squares[3]) < highest
    # The Fourier floor holds some of the kinks' k^-2 tail.
    assert np.mean(noises) == pytest.approx(
        level * x.std(), rel=0.5 if (method, name) == ("fourier", "pitch rate") else 0.1
    )


@pytest.mark.parametrize("method", ["spline", "fourier"])
def test_smoothing_beats_the_best_fixed_local_polynomial_on_a_noisy_angle_of_attack(response, method):
    from scipy.signal import savgol_filter

    t, states, rates = response
    x, rate = states[:, 0], rates[:, 0]
    noisy = x + 0.05 * x.std() * np.random.default_rng(3).standard_normal(t.size)
    fixed = min(
        np.sqrt(np.mean((savgol_filter(noisy, w, 3, deriv=1, delta=DT) - rate)[25:-25] ** 2)) for w in range(5, 45, 2)
    )
    got = smooth(method, noisy, t).derivative
    # The local polynomial was given its best window, chosen with the truth known.
    assert np.sqrt(np.mean((got - rate)[25:-25] ** 2)) < 1.15 * fixed


@pytest.mark.parametrize("method", ["spline", "fourier"])
def test_noise_at_the_two_end_samples_does_not_degrade_the_rest(response, method):
    # A line drawn through the end samples would be off by the noise there, and its 1/k coefficients with it.
    t, states, _ = response
    x = states[:, 0]
    noise = 0.02 * x.std() * np.random.default_rng(0).standard_normal(t.size)
    worse = noise.copy()
    worse[[0, -1]] = 0.1 * x.std(), -0.1 * x.std()
    plain, spoilt = smooth(method, x + noise, t), smooth(method, x + worse, t)
    middle = slice(60, -60)
    moved = np.abs(spoilt.derivative - plain.derivative)[middle].max()
    assert moved < 0.5 * np.median(plain.derivative_std)


@pytest.mark.parametrize("even", [False, True])
def test_the_spline_of_order_two_is_scipys_at_the_same_penalty(even):
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 40.0, 480) if even else np.sort(rng.uniform(0.0, 10.0, 120))
    y = np.sin(t) + 0.1 * rng.standard_normal(t.size)
    got = smooth_spline(y, t, order=2)
    # noise^2 / q with q from the cut-off: q = noise^2 dt (2 pi f)^4, dt the median step.
    lam = 1.0 / (np.median(np.diff(t)) * (2 * np.pi * got.cutoff) ** 4)
    expected = make_smoothing_spline(t, y, lam=lam)
    assert isinstance(expected, BSpline)
    assert_allclose(got.values, expected(t), atol=1e-8)
    assert_allclose(got.derivative, expected.derivative()(t), atol=1e-6)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_the_spline_and_its_accuracy_are_those_of_a_dense_gaussian_regression(order):
    # x = polynomial of degree m - 1 with a flat prior + m-fold integrated white noise (covariance in closed form).
    rng = np.random.default_rng(order)
    t = np.cumsum(rng.uniform(0.5, 1.5, 40))
    y = np.sin(0.3 * t) + 0.2 * rng.standard_normal(t.size)
    y[[7, 8]] = np.nan
    got = smooth_spline(y, t, order=order)
    q = got.noise**2 * np.median(np.diff(t)) * (2 * np.pi * got.cutoff) ** (2 * order)

    def covariance(a, b, da=0, db=0):
        # integral over (0, min) of the products of the kernels (a - s)^(m - 1 - d) / (m - 1 - d)!, by Gauss-Legendre.
        s, w = np.polynomial.legendre.leggauss(8)
        out = np.empty((a.size, b.size))
        for i, j in np.ndindex(out.shape):
            top = min(a[i], b[j]) - t[0]
            at = t[0] + 0.5 * top * (s + 1.0)
            parts = [
                (z - at) ** (order - 1 - d) / np.prod(np.arange(1, order - d), initial=1.0)
                for z, d in ((a[i], da), (b[j], db))
            ]
            out[i, j] = 0.5 * top * np.sum(w * parts[0] * parts[1])
        return q * out

    there = np.isfinite(y)
    K = covariance(t[there], t[there]) + got.noise**2 * np.eye(there.sum())
    basis = np.vander((t - t.mean()) / 10.0, order)
    slopes = np.array([np.polyder(np.eye(order)[k]) if k < order - 1 else [0.0] for k in range(order)], dtype=object)
    basis_slope = np.column_stack([np.polyval(p, (t - t.mean()) / 10.0) / 10.0 for p in slopes])
    H = basis[there]
    Ki = np.linalg.inv(K)
    flat = np.linalg.inv(H.T @ Ki @ H)
    theta = flat @ H.T @ Ki @ y[there]
    for d, own, values, std in (
        (0, basis, got.values, got.values_std),
        (1, basis_slope, got.derivative, got.derivative_std),
    ):
        across = covariance(t, t[there], da=d)
        assert_allclose(values, own @ theta + across @ Ki @ (y[there] - H @ theta), rtol=0, atol=1e-6)
        line = own - across @ Ki @ H
        variance = np.diag(covariance(t, t, d, d) - across @ Ki @ across.T + line @ flat @ line.T)
        # The dense covariance, not the spline, runs out of digits: its entries grow as t^(2 m - 1).
        assert_allclose(std, np.sqrt(variance), rtol=1e-4 if order < 4 else 0.02)


def test_the_spline_bridges_missing_samples_with_the_warning_that_deserves(response):
    t, states, _ = response
    x = states[:, 0]
    noisy = x + 0.02 * x.std() * np.random.default_rng(2).standard_normal(t.size)
    noisy[300:325] = np.nan
    got = smooth_spline(noisy, t)
    assert got.values_std[312] > 5 * got.values_std[260]
    assert np.abs((got.values - x) / got.values_std)[300:325].max() < 3.5
    with pytest.raises(DataError, match="sample 300 is nan"):
        smooth_fourier(noisy, DT)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_even_steps_which_are_not_worked_out_one_by_one_give_what_nearly_even_ones_give(order):
    rng = np.random.default_rng(order)
    t = 0.02 * np.arange(900)
    y = np.sin(4.0 * t) + 0.05 * rng.standard_normal(t.size)
    y[[400, 600, 601]] = np.nan
    turned = smooth_spline(y, t, order=order)
    every = smooth_spline(y, t + 1e-8 * rng.uniform(size=t.size), order=order)
    for name in ("values", "values_std", "derivative", "derivative_std", "noise", "cutoff"):
        assert_allclose(getattr(turned, name), getattr(every, name), rtol=1e-4, atol=1e-5)


def test_the_spline_takes_an_uneven_clock():
    rng = np.random.default_rng(4)
    t = np.sort(rng.uniform(0.0, 20.0, 600))
    got = smooth_spline(np.sin(t) + 0.05 * rng.standard_normal(t.size), t)
    error = (got.derivative - np.cos(t))[30:-30]
    assert 0.6 < np.sqrt(np.mean(error**2) / np.mean(got.derivative_std[30:-30] ** 2)) < 1.3


def test_channels_smoothed_together_are_those_smoothed_one_by_one(response):
    t, states, _ = response
    rng = np.random.default_rng(8)
    channels = [x + 0.01 * x.std() * rng.standard_normal(t.size) for x in states.T]
    for one, x in zip(smooth_splines(channels, t, order=3), channels, strict=True):
        alone = smooth_spline(x, t, order=3)
        assert one.cutoff == alone.cutoff
        assert_array_equal(one.values, alone.values)
        assert_array_equal(one.derivative_std, alone.derivative_std)
    assert smooth_splines([], t, order=3) == []


@pytest.mark.parametrize("method", ["spline", "fourier"])
def test_a_second_derivative_comes_with_its_accuracy(method):
    t, x, _ = sine(0.02, DT)
    w = 2 * np.pi * 0.02 / DT
    got = smooth(method, x + 0.02 * np.random.default_rng(5).standard_normal(t.size), t)
    error = (got.second + w**2 * x)[50:-50]
    assert np.sqrt(np.mean(error**2)) < 0.1 * w**2
    assert 0.5 < np.sqrt(np.mean(error**2) / np.mean(got.second_std[50:-50] ** 2)) < 1.4


def test_a_line_and_a_constant_come_back_as_they_are():
    t = DT * np.arange(200)
    for x in (2.0 + 0.5 * t, np.full(200, 7.0)):
        for got in (smooth_spline(x, t), smooth_fourier(x, DT)):
            assert_allclose(got.values, x, rtol=1e-9)
            assert_allclose(got.derivative, np.gradient(x, t), atol=1e-7)


def test_the_order_follows_how_sharply_the_signal_moves(response):
    t, states, _ = response
    rng = np.random.default_rng(6)
    orders = [smooth_spline(x + 0.01 * x.std() * rng.standard_normal(t.size), t).order for x in states.T]
    assert orders == [3, 2]  # angle of attack moves one integration more smoothly than the pitch rate


def test_a_motion_too_fast_for_the_spline_is_reported_and_the_fourier_smoother_follows_it():
    t, x, rate = sine(0.2, DT)
    noisy = x + 0.02 * np.random.default_rng(7).standard_normal(t.size)
    with pytest.warns(StructselWarning, match=r"one steady oscillation of 5\.0 samples per cycle"):
        smooth_spline(noisy, t)
    assert np.std((smooth_fourier(noisy, DT).derivative - rate)[50:-50]) < 0.05 * rate.std()


def test_results_cannot_be_written_to_and_say_what_they_are():
    t, x, _ = sine(0.02, DT)
    got = smooth_spline(x + 0.1 * np.random.default_rng(8).standard_normal(t.size), t)
    with pytest.raises(ValueError, match="read-only"):
        got.values[0] = 0.0
    assert "cut-off" in str(got)


def test_too_few_samples_are_refused():
    with pytest.raises(DataError, match="at least 12 finite samples"):
        smooth_spline(np.arange(8.0), np.arange(8.0))
    with pytest.raises(DataError, match="increasing clock"):
        smooth_spline(np.arange(20.0), np.zeros(20))
    with pytest.raises(DataError, match="at least 32 samples"):
        smooth_fourier(np.arange(20.0), DT)
    with pytest.raises(DataError, match="noise_level needs 16"):
        noise_level(np.arange(10.0), DT)


def test_the_noise_level_is_that_of_the_white_noise_on_average(response):
    t, states, _ = response
    x = states[:, 0]
    true = 0.02 * x.std()
    found = [noise_level(x + true * np.random.default_rng(s).standard_normal(t.size), DT) for s in range(40)]
    # The median of a quarter as many exponential variables as samples: 1.3 / sqrt(n) relative, n = 501.
    assert np.mean(found) == pytest.approx(true, rel=0.03)
    assert np.std(found) / true < 1.5 * 1.3 / np.sqrt(t.size)


@pytest.mark.parametrize("hold", [2, 3, 10])
def test_a_held_channel_has_the_noise_of_its_own_samples(hold):
    rng = np.random.default_rng(hold)
    slow = np.sin(0.02 * hold * np.arange(600)) + 0.1 * rng.standard_normal(600)
    held = np.repeat(slow, hold)
    assert is_sample_and_hold(held)
    assert not is_sample_and_hold(slow)
    assert noise_level(held, DT) == pytest.approx(0.1, rel=0.2)


def test_a_coarse_channel_has_at_least_the_error_of_its_step():
    t = DT * np.arange(2000)
    step = 0.01
    still = step * np.round((0.5 + 0.05 * np.sin(0.3 * t)) / step)
    assert noise_level(still, DT) >= 0.99 * step / np.sqrt(12)
    noisy = np.sin(0.3 * t) + 2 * step * np.random.default_rng(9).standard_normal(t.size)
    expected = np.sqrt((2 * step) ** 2 + step**2 / 12)  # independent errors add their squares
    assert noise_level(step * np.round(noisy / step), DT) == pytest.approx(expected, rel=0.06)
    assert noise_level(np.full(100, 3.0), DT) == 0.0


def test_white_noise_is_below_its_upper_limit_and_the_limit_near_it():
    slow = np.sin(0.02 * np.arange(500))
    limits = [
        largest_noise_level(slow + 0.1 * np.random.default_rng(s).standard_normal(500), DT) / 0.1 for s in range(40)
    ]
    # Three octaves of 125, 62 and 31 lines: relative standard errors of 5, 8 and 11 %, two are added.
    assert np.mean(np.array(limits) >= 1.0) > 0.95
    assert np.median(limits) < 1.4


def test_the_upper_limit_of_noise_after_a_filter_is_that_of_the_noise_before_it():
    # A Butterworth filter at 0.4 of the Nyquist frequency removes the highest octave, not the third.
    white = np.random.default_rng(11).standard_normal(4000)
    filtered = sosfiltfilt(butter(4, 0.4, output="sos"), white)
    assert noise_level(filtered, DT) < 0.2
    assert 0.9 < largest_noise_level(np.sin(0.002 * np.arange(4000)) + filtered, DT) < 1.3


def test_no_noise_is_above_the_standard_deviation_of_its_channel():
    short = np.random.default_rng(12).standard_normal(20)
    assert largest_noise_level(short, DT) <= short.std()
    assert largest_noise_level(np.full(100, 3.0), DT) == 0.0


def test_missing_samples_do_not_change_the_noise_level():
    x = 0.3 * np.random.default_rng(10).standard_normal(2000)
    x[::17] = np.nan
    assert noise_level(x, DT) == pytest.approx(0.3, rel=0.06)
    with pytest.raises(DataError, match="spectral lines above 12"):
        noise_level(x, DT, above=12.49)
