"""Filters agree with those of SciPy."""

import numpy as np
import pytest
import scipy.signal
from numpy.testing import assert_allclose, assert_array_equal

from structsel.numerics.filters import convolve, recursive_filter

X = np.random.default_rng(0).standard_normal(300)


@pytest.mark.parametrize("start", [None, np.array([0.3, -0.1])])
def test_a_recursive_filter_is_that_of_scipy(start):
    b, a = np.array([0.1, 0.2, 0.05]), np.array([2.0, -3.2, 1.5])
    at_rest = np.zeros(2) if start is None else start
    assert_array_equal(recursive_filter(b, a, X, start), scipy.signal.lfilter(b, a, X, zi=at_rest)[0])


@pytest.mark.parametrize("mode", ["full", "valid"])
def test_a_convolution_is_that_of_scipy(mode):
    weight = np.hanning(41)
    assert_allclose(convolve(X, weight, mode), scipy.signal.convolve(X, weight, mode, method="direct"), atol=1e-12)
