"""Spectra and coherence over several pieces."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from structsel.errors import DomainError
from structsel.numerics.spectra import coherence, power_spectrum

DT = 0.02


def noise(seed, n=3000):
    return np.random.default_rng(seed).standard_normal(n)


def test_one_piece_has_the_spectrum_of_welch():
    x = noise(1)
    f, density, segments = power_spectrum([x], DT, 4.0)
    fw, expected = signal.welch(x, 1.0 / DT, nperseg=200, detrend="linear")
    assert_allclose(f, fw[1:-1])
    assert_allclose(density, expected[1:-1], rtol=1e-12)
    assert segments == 29


def test_a_sine_keeps_its_variance_and_its_place():
    # Amplitude 3 at 2 Hz: variance 4.5, all of it near 2 Hz.
    t = DT * np.arange(4000)
    f, density, _ = power_spectrum([3.0 * np.sin(4.0 * np.pi * t)], DT, 8.0)
    assert_allclose(np.sum(density) * (f[1] - f[0]), 4.5, rtol=1e-3)
    assert f[np.argmax(density)] == 2.0


def test_pieces_count_by_their_segments_and_short_ones_not_at_all():
    long, short = noise(2, 1100), noise(3, 200)
    parts = [power_spectrum([x], DT, 4.0)[1] for x in (long, short)]
    _, both, segments = power_spectrum([long, short, noise(4, 50)], DT, 4.0)
    assert segments == 11
    assert_allclose(both, (10.0 * parts[0] + parts[1]) / 11.0, rtol=1e-12)


def test_coherence_of_one_piece_is_scipys():
    x = noise(5)
    y = np.convolve(x, [0.5, 0.3, 0.1], "same") + 0.5 * noise(6)
    f, squared, _ = coherence([x], [y], DT, 4.0)
    fs, expected = signal.coherence(x, y, 1.0 / DT, nperseg=200, detrend="linear")
    assert_allclose(f, fs[1:-1])
    assert_allclose(squared, expected[1:-1], rtol=1e-10)


def test_signals_without_relation_pass_the_threshold_about_once_in_a_hundred():
    passed = 0
    for seed in range(100):
        _, squared, threshold = coherence([noise(2 * seed, 1500)], [noise(2 * seed + 1, 1500)], DT, 2.0)
        passed += squared.max() > threshold
    assert passed <= 5  # 1 expected; six or more have odds of one in a thousand


def test_too_short_is_refused_with_what_there_is():
    with pytest.raises(DomainError, match=r"no piece is as long as a window of 8 s; the longest has 2 s"):
        power_spectrum([noise(1, 100)], DT, 8.0)
    with pytest.raises(DomainError, match="holds 5 samples"):
        power_spectrum([noise(1)], DT, 0.1)
