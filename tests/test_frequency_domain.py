import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, signal

from structsel.errors import DataError, DomainError
from structsel.numerics import frequency_regression, spectra
from structsel.numerics.output_error import fit_output_error
from structsel.numerics.output_error_problem import OutputErrorProblem

DT = 0.01
T = DT * np.arange(2001)  # 20 s
F = spectra.choose_frequencies(20.0, 0.05, 1.5)


def test_frequencies_are_integer_multiples_of_one_over_the_record():
    assert_allclose(F * 20.0, np.arange(1, 31), rtol=1e-12)
    with pytest.raises(DomainError, match="Widen the band"):
        spectra.choose_frequencies(2.0, 0.1, 0.4)


def test_transform_of_a_decaying_exponential_is_the_formula():
    a = 0.7
    w = 2.0 * np.pi * F
    exact = (1.0 - np.exp(-(a + 1j * w) * 20.0)) / (a + 1j * w)
    # The trapezoidal rule errs by dt^2/12 times the jump of the integrand's slope, at most |a + i w| here: 8e-5.
    assert_allclose(spectra.transform(np.exp(-a * T), DT, F, detrend=False), exact, atol=1e-4)


def test_a_long_record_at_even_frequencies_has_the_transform_of_the_explicit_sum():
    # Even frequencies of a long record are computed by the chirp z-transform; one uneven frequency more prevents it.
    # The largest phase of the chirp, pi df dt n^2, is rounded to eps of itself.
    x = np.random.default_rng(1).standard_normal((150_001, 1))
    even = np.linspace(0.1, 2.0, 30)
    explicit = spectra.transform(x, DT, np.append(even, 2.01))[:-1]
    rounding = np.finfo(float).eps * np.pi * (even[1] - even[0]) * DT * len(x) ** 2
    assert_allclose(spectra.transform(x, DT, even), explicit, atol=rounding * np.abs(explicit).max())


def regressors():
    rng = np.random.default_rng(2)
    b, a = signal.butter(2, 1.0, fs=1.0 / DT)
    return signal.lfilter(b, a, rng.standard_normal((len(T), 3)), axis=0)


def test_equation_error_finds_the_parameters_without_noise_whatever_trend_there_is():
    X = regressors()
    theta = np.array([1.5, -0.3, 20.0])
    fit = frequency_regression.equation_error(X, X @ theta + 4.0 - 0.2 * T, DT, F)
    assert_allclose(fit.theta, theta, rtol=1e-9)
    assert fit.r2 == pytest.approx(1.0)


@pytest.mark.default_cases("own frequencies")
@pytest.mark.parametrize("spacing", [1.0, 0.25], ids=["own frequencies", "four times as close"])
def test_equation_error_scatters_as_its_covariance_says(spacing):
    X = regressors()
    theta, noise = np.array([1.5, -0.3, 2.0]), 0.1
    f = np.arange(0.05, 1.5, 0.05 * spacing)
    fits = []
    for seed in range(150):
        y = X @ theta + noise * np.random.default_rng(seed).standard_normal(len(T))
        fits.append(frequency_regression.equation_error(X, y, DT, f))
    errors = np.array([fit.theta - theta for fit in fits])
    claimed = np.mean([np.diag(fit.covariance) for fit in fits], axis=0)
    # Variance of 150: standard error 11.5 %; three parameters within 3.3 of them.
    assert_allclose(errors.var(axis=0, ddof=1) / claimed, 1.0, atol=0.38)
    assert np.mean([fit.noise_std for fit in fits]) == pytest.approx(noise, rel=0.03)


def test_noise_outside_the_band_does_no_harm():
    X = regressors()
    theta = np.array([1.5, -0.3, 2.0])
    y = X @ theta + 5.0 * np.sin(2.0 * np.pi * 11.0 * T)  # a structural mode
    fit = frequency_regression.equation_error(X, y, DT, F)
    in_time = np.linalg.lstsq(np.column_stack([X, np.ones(len(T))]), y, rcond=None)[0][:3]
    assert np.abs(fit.theta - theta).max() < 0.02
    assert np.abs(in_time - theta).max() > 2.0 * np.abs(fit.theta - theta).max()


def test_regressors_that_depend_on_each_other_are_refused():
    X = regressors()
    with pytest.raises(DataError, match="depend on each other"):
        frequency_regression.equation_error(np.column_stack([X[:, 0], 2.0 * X[:, 0]]), X[:, 1], DT, F)
    with pytest.raises(DataError, match="ask for more"):
        frequency_regression.equation_error(X, X[:, 0], DT, F[:1])
    with pytest.raises(DataError, match="finite samples"):
        spectra.transform(np.full(10, np.nan), DT, F)
    with pytest.raises(DomainError, match="half the sampling"):
        spectra.transform(T, DT, np.array([60.0]))


A = np.array([[-1.3, 0.95], [-4.8, -1.7]])
B = np.array([[0.0], [-19.5]])
C = np.array([[1.0, 0.0], [0.0, 1.0], [-30.0, 0.5]])
D = np.array([[0.0], [0.0], [1.5]])
DELAY = 0.13


def command(t):
    return 0.03 * np.sin(0.9 * t + 0.06 * t**2) * np.sin(np.pi * np.clip(t, 0.0, 20.0) / 20.0) ** 2


def simulated(start):
    """Outputs and states by scipy's integrator."""
    found = integrate.solve_ivp(
        lambda t, x: A @ x + B[:, 0] * command(t - DELAY), (0.0, 20.0), start, t_eval=T, rtol=1e-10, atol=1e-12
    )
    return found.y.T @ C.T + command(T - DELAY)[:, None] * D[:, 0], found.y.T


def linear_response(A, B, C, D, delay, U, frequencies, jump=None):
    """Transforms (m, f, o) of y = C x + D u(t - tau), x' = A x + B u(t - tau); `jump` is x(0) - x(T) e^(-i w T)."""
    w = 2.0 * np.pi * np.asarray(frequencies, dtype=float)
    delayed = U[None] * np.exp(-1j * w[None, :] * np.asarray(delay)[:, None])[:, :, None]
    drive = np.einsum("msi,mfi->mfs", B, delayed) + (0.0 if jump is None else jump)
    resolvent = 1j * w[None, :, None, None] * np.eye(A.shape[1]) - A[:, None]
    x = np.linalg.solve(resolvent, drive[..., None])[..., 0]
    return np.einsum("mos,mfs->mfo", C, x) + np.einsum("moi,mfi->mfo", D, delayed)


def test_response_is_the_transform_of_the_flight_jump_included():
    y, x = simulated([0.02, -0.1])
    w = 2.0 * np.pi * F
    jump = x[0] - x[-1] * np.exp(-1j * w * 20.0)[:, None]
    U = spectra.transform(command(T)[:, None], DT, F, detrend=False)
    made = linear_response(A[None], B[None], C[None], D[None], np.array([DELAY]), U, F, jump[None])
    exact = spectra.transform(y, DT, F, detrend=False)
    assert_allclose(made[0], exact, atol=1e-3 * np.abs(exact).max())
    without = linear_response(A[None], B[None], C[None], D[None], np.array([DELAY]), U, F)
    assert np.abs(without[0] - exact).max() > 0.02 * np.abs(exact).max()


def test_output_error_in_the_frequency_domain_finds_derivatives_and_delay():
    y, _ = simulated([0.0, 0.0])
    rng = np.random.default_rng(5)
    noise = np.array([0.003, 0.01, 0.1])
    U = spectra.transform(command(T)[:, None], DT, F, detrend=False)
    truth = np.array([-1.3, 0.95, -4.8, -1.7, -19.5, DELAY])

    def predict(p):
        m = len(p)
        As, Bs = np.zeros((m, 2, 2)), np.zeros((m, 2, 1))
        As[:, 0, 0], As[:, 0, 1], As[:, 1, 0], As[:, 1, 1], Bs[:, 1, 0] = p[:, :5].T
        Cs, Ds = (np.broadcast_to(M, (m, *M.shape)) for M in (C, D))
        return frequency_regression.as_real(linear_response(As, Bs, Cs, Ds, p[:, 5], U, F))

    errors, bounds = [], []
    for _ in range(60):
        Y = spectra.transform(y + rng.standard_normal(y.shape) * noise, DT, F, detrend=False)
        fit = fit_output_error(
            OutputErrorProblem(predict, frequency_regression.as_real(Y)), truth * [0.6, 1.2, 1.4, 0.7, 0.8, 0.5]
        )
        assert fit.converged
        errors.append(fit.theta - truth)
        bounds.append(fit.crlb)
    normed = np.array(errors) / np.sqrt(np.diagonal(bounds, axis1=1, axis2=2))
    # 60 flights: a standard deviation is known to 9 %, here at 3.3 of that for six parameters.
    assert_allclose(normed.std(axis=0), 1.0, atol=0.32)
    assert np.abs(normed.mean(axis=0)).max() < 4.0 / np.sqrt(60)
