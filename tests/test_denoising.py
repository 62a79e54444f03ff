"""The white part of a reading: as much as there is, none of what the signal does."""

import numpy as np
import pytest
import scipy

from structsel.numerics.signal_quality import estimate_white_noise, smoothed

T = np.arange(0.0, 30.0, 0.02)


def _doublets() -> np.ndarray:
    return 0.05 * (((T > 4.0) & (T < 4.6)) * 1.0 - ((T >= 4.6) & (T < 5.2)) * 1.0 + (T > 17.0) * 0.4)


@pytest.mark.parametrize("sd", [0.0005, 0.002])
def test_of_steps_only_the_noise_is_taken(sd):
    rng = np.random.default_rng(1)
    noise = sd * rng.standard_normal(len(T))
    taken = estimate_white_noise(_doublets() + noise)
    assert np.std(taken) == pytest.approx(sd, rel=0.12)
    assert np.corrcoef(taken, noise)[0, 1] > 0.9
    # At the steps themselves a spline would be off by a tenth of them and more.
    edges = np.flatnonzero(np.abs(np.diff(_doublets())) > 0.0)
    assert max(np.abs((taken - noise)[k - 3 : k + 5]).max() for k in edges) < 4.0 * sd


def test_a_sweep_keeps_its_size_to_the_end():
    rng = np.random.default_rng(2)
    sweep = 0.03 * np.sin(2.0 * np.pi * (0.1 * T + 0.05 * T**2))
    noise = 0.0005 * rng.standard_normal(len(T))
    left = sweep + noise - estimate_white_noise(sweep + noise)
    assert np.std(left - sweep) < 0.0005
    fastest = T > 25.0
    assert left[fastest] @ sweep[fastest] / (sweep[fastest] @ sweep[fastest]) == pytest.approx(1.0, abs=0.005)


def test_of_noise_alone_hardly_anything_is_left():
    noise = np.random.default_rng(3).standard_normal(3000)
    assert np.std(noise - estimate_white_noise(noise)) < 0.3


@pytest.mark.parametrize("held", [np.zeros(200), np.repeat([0.0, 1.0, 0.5, 2.0], 50), np.arange(3.0)])
def test_what_is_held_or_too_short_has_none(held):
    np.testing.assert_array_equal(estimate_white_noise(held), 0.0)


@pytest.mark.parametrize("width", [5.0, 19.0, 40.0, 180.0])
def test_a_long_filter_is_the_sum_over_its_window(width):
    x = np.cumsum(np.random.default_rng(1).standard_normal(500)) + 30.0
    direct = scipy.ndimage.gaussian_filter1d(x, width, mode="nearest")
    np.testing.assert_allclose(smoothed(x, width), direct, atol=1e-12 * np.abs(x).max())
