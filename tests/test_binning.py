"""Means over bins, and how sure they are where neighbours in time are alike."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from structsel.errors import DomainError
from structsel.numerics.binning import bin_means, split_into_segments


def test_bins_hold_equal_numbers_and_their_own_means():
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((2, 600))
    found = bin_means(x, y, split_into_segments([600]), bins=6)
    order = np.argsort(x).reshape(6, 100)
    assert_array_equal(found.counts, 100)
    assert_allclose(found.at, x[order].mean(axis=1), rtol=1e-12)
    assert_allclose(found.means, y[order].mean(axis=1), rtol=1e-12, atol=1e-15)


def test_the_interval_is_that_of_a_mean_from_clusters():
    # statsmodels' covariance by groups of a constant: the correction is m / (m - 1), as here.
    rng = np.random.default_rng(2)
    segment = rng.integers(0, 7, 400)
    y = rng.standard_normal(7)[segment] + 0.3 * rng.standard_normal(400)
    found = bin_means(rng.standard_normal(400), y, segment, bins=1)
    fit = sm.OLS(y, np.ones(400)).fit(cov_type="cluster", cov_kwds={"groups": segment})
    assert_allclose(found.half, stats.t.ppf(0.975, 6) * fit.bse, rtol=1e-10)


def test_intervals_cover_though_neighbours_are_alike():
    # A random walk about zero: taken as independent, means of 300 samples would miss zero in half the draws and more.
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((400, 3000))
    y = np.zeros_like(noise)
    for i in range(1, 3000):
        y[:, i] = 0.95 * y[:, i - 1] + noise[:, i]
    segment = split_into_segments([1500, 1500])
    x = np.tile(np.arange(150.0), 20)  # every bin is visited by all segments
    covered = plain = 0
    for one in y:
        found = bin_means(x, one, segment, bins=10)
        covered += np.sum(np.abs(found.means) < found.half)
        plain += np.sum(np.abs(found.means) < 1.96 * one.std() / np.sqrt(300))
    assert 0.92 < covered / 4000 < 0.97  # 95 % stated; 4000 draws, ten of a flight together
    assert plain / 4000 < 0.6


def test_a_bin_that_two_segments_fill_has_no_interval():
    found = bin_means(np.r_[0.0:10.0], np.r_[0.0:10.0], np.repeat([0, 1, 2, 3], [4, 2, 2, 2]), bins=2)
    assert np.isnan(found.half[0])  # samples 0 to 4 are of segments 0 and 1
    assert np.isfinite(found.half[1])


def test_recordings_are_cut_into_the_requested_number_of_segments_in_all():
    assert split_into_segments([100, 50], 4).tolist() == [0] * 50 + [1] * 50 + [2] * 25 + [3] * 25
    assert_array_equal(np.unique(split_into_segments([9] * 30)), np.arange(30))


def test_what_cannot_be_binned_is_refused():
    with pytest.raises(DomainError, match="three vectors of one length"):
        bin_means([1.0, 2.0], [1.0], [0, 0])
    with pytest.raises(DomainError, match="at least one bin"):
        bin_means([1.0, 2.0], [1.0, 2.0], [0, 0], bins=0)
