"""Gusts against their published spectra and formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad
from scipy.signal import welch

from structsel.errors import DomainError
from structsel.numerics import atmosphere

V, SPAN = 45.0, 14.63
LENGTHS, SIGMAS = np.array([200.0, 150.0, 80.0]), np.array([1.5, 1.2, 0.9])


@pytest.fixture(scope="module")
def gusts():
    t = np.arange(2**18) * 0.02
    return t, atmosphere.dryden_gusts(t, V, SPAN, LENGTHS, SIGMAS, np.random.default_rng(3))


def test_the_spectra_of_what_is_drawn_are_those_of_the_specification(gusts):
    _, drawn = gusts
    for j in range(6):
        f, power = welch(drawn[:, j], fs=50.0, nperseg=4096, noverlap=2048)
        omega = 2.0 * np.pi * f
        # Well below half the sampling rate, where no power folds back; 126 averages scatter by 9 %.
        use = (f > 0.03) & (f < 2.0)
        ratio = power[use] / (2.0 * np.pi) / atmosphere.dryden_spectra(omega[use], V, SPAN, LENGTHS, SIGMAS)[:, j]
        assert abs(ratio.mean() - 1.0) < 0.03, j
        bands = [part.mean() for part in np.array_split(ratio, 8)]
        assert_allclose(bands, 1.0, atol=0.09)


def test_the_spectra_integrate_to_the_variances():
    for j in range(3):
        area = quad(lambda w: atmosphere.dryden_spectra([w], V, SPAN, LENGTHS, SIGMAS)[0, j], 0.0, np.inf, limit=400)[0]  # noqa: B023
        assert_allclose(area, SIGMAS[j] ** 2, rtol=1e-6)


def test_the_variance_is_the_same_from_the_first_sample_on():
    t = np.arange(3) * 0.02
    first = np.array(
        [atmosphere.dryden_gusts(t, V, SPAN, LENGTHS, SIGMAS, np.random.default_rng(k)) for k in range(4000)]
    )  # fmt: skip
    roll = 0.4 * np.pi * SIGMAS[2] ** 2 / (LENGTHS[2] * V) * (np.pi * LENGTHS[2] / (4 * SPAN)) ** (1 / 3)
    expected = np.append(SIGMAS, np.sqrt(roll * np.pi * V / (4.0 * SPAN)))
    # A standard deviation of 4000 draws scatters by 1.1 %.
    assert_allclose(first[:, 0, :4].std(axis=0), expected, rtol=0.045)
    assert_allclose(first[:, 2].std(axis=0), first[:, 0].std(axis=0), rtol=0.03)


def test_pitching_and_yawing_gusts_are_the_lagged_slopes_of_the_field(gusts):
    _, drawn = gusts
    # A lag much slower than the sampling: its own equation, lag q' + q = -w'/V, holds between samples.
    lag = 4.0 * SPAN / (np.pi * V)
    q, w = drawn[:5000, 4], drawn[:5000, 2]
    lhs = lag * np.diff(q) / 0.02 + 0.5 * (q[1:] + q[:-1])
    assert_allclose(lhs, -np.diff(w) / 0.02 / V, atol=0.04 * np.abs(lhs).max())
    r, v = drawn[:5000, 5], drawn[:5000, 1]
    lhs = 0.75 * lag * np.diff(r) / 0.02 + 0.5 * (r[1:] + r[:-1])
    assert_allclose(lhs, np.diff(v) / 0.02 / V, atol=0.04 * np.abs(lhs).max())


def test_one_seed_is_one_turbulence():
    t = np.arange(100) * 0.02
    same = [atmosphere.dryden_gusts(t, V, SPAN, LENGTHS, SIGMAS, np.random.default_rng(k)) for k in (1, 1, 2)]
    assert_array_equal(same[0], same[1])
    assert np.abs(same[0] - same[2]).max() > 0.1


def test_scales_are_those_of_the_specification():
    # At 1000 ft: 0.177 + 0.823 = 1, so every length is 1000 ft and every intensity 0.1 W20.
    lengths, sigmas = atmosphere.dryden_scales(304.8, 15.4)
    assert_allclose(lengths, 304.8, rtol=1e-12)
    assert_allclose(sigmas, 1.54, rtol=1e-12)
    lengths, sigmas = atmosphere.dryden_scales(30.48, 15.4)
    assert_allclose(lengths, [30.48 / 0.2593**1.2, 30.48 / 0.2593**1.2, 30.48], rtol=1e-12)
    assert_allclose(sigmas, [1.54 / 0.2593**0.4, 1.54 / 0.2593**0.4, 1.54], rtol=1e-12)
    lengths, sigmas = atmosphere.dryden_scales(5000.0, 15.4, high=3.0)
    assert_allclose(lengths, 533.4)
    assert_allclose(sigmas, 3.0)


def test_a_discrete_gust_rises_to_its_size_in_the_middle_and_is_gone_at_its_end():
    t = np.linspace(0.0, 5.0, 501)
    gust = atmosphere.one_minus_cosine(t, 1.0, 2.0, 6.0)
    assert_allclose(gust[[0, 100, 150, 200, 250, 300, 400]], [0.0, 0.0, 3.0, 6.0, 3.0, 0.0, 0.0], atol=1e-12)


def test_wind_laws_give_the_speed_at_the_reference_height():
    assert_allclose(atmosphere.power_law([0.0, 10.0, 1280.0], 5.0, 10.0), [0.0, 5.0, 10.0])
    assert_allclose(atmosphere.log_law([0.01, 10.0, 10.0**2 / 0.1], 5.0, 10.0, roughness=0.1), [0.0, 5.0, 10.0])


def test_what_cannot_be_is_refused():
    with pytest.raises(DomainError, match="even clock"):
        atmosphere.dryden_gusts([0.0, 0.1, 0.3], V, SPAN, LENGTHS, SIGMAS, np.random.default_rng(0))
    with pytest.raises(DomainError, match="airspeed above zero"):
        atmosphere.dryden_gusts([0.0, 0.1], 0.0, SPAN, LENGTHS, SIGMAS, np.random.default_rng(0))
    with pytest.raises(DomainError, match="duration"):
        atmosphere.one_minus_cosine([0.0], 0.0, 0.0, 1.0)
    with pytest.raises(DomainError, match="intensities of 0 or more"):
        atmosphere.dryden_scales(100.0, -1.0)
