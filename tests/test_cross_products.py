import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from structsel.errors import SelectionError, TermError
from structsel.numerics.blocks import split_manoeuvres
from structsel.numerics.cross_products import cross_products
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.normal_equations import centre
from structsel.numerics.polynomial_products import plan_polynomial_products
from structsel.numerics.prewhitened_products import prewhitened_cross_products
from structsel.numerics.rank_update import RowProducts, add_products
from structsel.numerics.regressors import CHUNK, ArrayData, words_of

from .pools import design, monomial_exponents


def manoeuvres(rng, lengths, s=4, m=2):
    return [ArrayData(rng.standard_normal((s, n)) + 0.5, rng.standard_normal((m, n))) for n in lengths]


def reference(signals, exponents, scale):
    Z = np.column_stack([design(signals.base_signals, exponents), signals.response_signals.T]) / scale
    return Z.T @ Z


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_products_of_any_pool_equal_the_explicit_regressors(data):
    s = data.draw(st.integers(1, 4))
    rows = st.lists(st.integers(0, 3), min_size=s, max_size=s).filter(lambda r: 0 < sum(r) < 6)
    exponents = np.array(data.draw(st.lists(rows, min_size=1, max_size=9)))
    lengths = data.draw(st.lists(st.integers(1, 3 * CHUNK), min_size=1, max_size=3))
    flights = manoeuvres(np.random.default_rng(1), lengths, s=s)
    moments = cross_products(flights, exponents, blocks=5)
    expected = sum(reference(f, exponents, moments.scale) for f in flights)
    assert_allclose(moments.total(), expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize(("s", "degree"), [(8, 3), (5, 4), (8, 2), (3, 3)])
def test_a_polynomial_pool_is_computed_from_its_distinct_sums_with_the_same_products(s, degree):
    exponents = monomial_exponents(s, degree)
    assert plan_polynomial_products(words_of(exponents), s, 1) is not None
    flights = manoeuvres(np.random.default_rng(2), [1300, 777], s=s)
    moments = cross_products(flights, exponents, blocks=3)
    expected = sum(reference(f, exponents, moments.scale) for f in flights)
    assert_allclose(moments.total(), expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


def test_blocks_manoeuvres_and_weights_add_up():
    exponents = monomial_exponents(4, 2)
    flights = manoeuvres(np.random.default_rng(3), [900, 1500, 400])
    moments = cross_products(flights, exponents, blocks=9)
    assert_allclose(moments.only(1), reference(flights[1], exponents, moments.scale), rtol=1e-10, atol=1e-9)
    assert_allclose(moments.only(1) + moments.without(1), moments.total(), rtol=1e-12)
    assert moments.n.sum() == 2800
    assert set(moments.manoeuvre) == {0, 1, 2}


def test_two_workers_give_the_same_products_as_one():
    exponents = monomial_exponents(4, 3)
    flights = manoeuvres(np.random.default_rng(4), [5000, 3000])
    one, two = (cross_products(flights, exponents, workers=w).packed for w in (1, 2))
    assert np.array_equal(one, two)


def test_whitened_products_equal_filtering_every_column_by_scipy():
    exponents = monomial_exponents(3, 2)
    flights = manoeuvres(np.random.default_rng(5), [1400, 600], s=3)
    colours = [
        [ARNoise(np.array([0.5, -0.2, 0.1, 0.05, 0.3]), 2.0), ARNoise(np.array([0.9]), 1.0)],
        [ARNoise(np.empty(0), 1.0), ARNoise(np.array([0.4, 0.1]), 0.5)],
    ]
    moments = prewhitened_cross_products(flights, exponents, colours, blocks=4)
    reach = [5, 2]  # the longest filter of any response in each manoeuvre
    for r in range(2):
        level = np.sqrt(2000 / sum(f.n / c.sigma**2 for f, c in zip(flights, colours[r], strict=True)))
        expected = 0.0
        for f, c, skip in zip(flights, colours[r], reach, strict=True):
            Z = np.column_stack([design(f.base_signals, exponents), f.response_signals[r]]) / moments[r].scale
            F = lfilter(np.r_[1.0, -c.ar], [1.0], Z, axis=0)[skip:] * level / c.sigma
            expected = expected + F.T @ F
        assert_allclose(moments[r].total(), expected, rtol=1e-10, atol=1e-10)
        assert moments[r].n.sum() == 2000 - sum(reach)


def test_sweeping_the_constant_leaves_the_covariance_times_n():
    flights = manoeuvres(np.random.default_rng(6), [800])
    exponents = monomial_exponents(4, 1)
    moments = cross_products(flights, exponents)
    Z = np.vstack([flights[0].base_signals, flights[0].response_signals]) / moments.scale[1:, None]
    assert_allclose(centre(moments.total()), 800 * np.cov(Z, bias=True), rtol=1e-10)


@given(lengths=st.lists(st.integers(1, 5000), min_size=1, max_size=30), wanted=st.integers(1, 40))
def test_blocks_cover_every_sample_once(lengths, wanted):
    blocks = split_manoeuvres(lengths, wanted)
    for k, n in enumerate(lengths):
        own = [b for b in blocks if b.manoeuvre == k]
        assert own[0].start == 0
        assert own[-1].stop == n
        assert all(a.stop == b.start for a, b in pairwise(own))


@pytest.mark.slow
def test_memory_above_the_signals_does_not_grow_with_samples():
    exponents = monomial_exponents(8, 3)
    rng = np.random.default_rng(7)
    peaks = []
    for n in (400_000, 1_600_000):  # from 400,000 samples the blocks have their full length
        flight = [ArrayData(rng.standard_normal((8, n)), rng.standard_normal((1, n)))]
        cross_products(flight, exponents, workers=1)
        tracemalloc.start()
        cross_products(flight, exponents, workers=1)
        prewhitened_cross_products(flight, exponents, [[ARNoise(np.full(6, 0.1))]], workers=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.05 * peaks[0]
    assert peaks[1] < 16e6


def test_a_constant_or_a_negative_power_is_refused():
    with pytest.raises(TermError, match="constant"):
        words_of(np.array([[1, 0], [0, 0]]))
    with pytest.raises(TermError, match="negative"):
        words_of(np.array([[1, -1]]))


def test_zero_workers_are_refused():
    with pytest.raises(SelectionError, match="workers"):
        cross_products(manoeuvres(np.random.default_rng(8), [100]), monomial_exponents(4, 1), workers=0)


@pytest.mark.parametrize("columns", [slice(None), slice(3, 20)])
def test_products_of_rows_are_added_to_the_upper_triangle(columns):
    rows = np.random.default_rng(2).standard_normal((7, 31))[:, columns]
    total = np.ones((7, 7))
    add_products(rows, total)
    expected = np.where(np.arange(7)[:, None] <= np.arange(7), 1.0 + rows @ rows.T, 1.0)
    assert_allclose(total, expected, rtol=1e-13)


@pytest.mark.parametrize("q", [1, 2, 3, 4, 5, 12, 31, 256, 257])
def test_products_of_few_and_of_many_rows_are_those_of_numpy(q):
    products, rows = RowProducts(q), np.random.default_rng(q).standard_normal((2, q, 53))
    for chunk in rows:
        products.add(chunk)
    expected = rows[0] @ rows[0].T + rows[1] @ rows[1].T
    assert_allclose(products.triangle(), expected[np.triu_indices(q)], rtol=1e-11, atol=1e-12)


def test_products_are_not_added_to_a_matrix_of_another_size():
    with pytest.raises(SelectionError, match="add_products needs rows"):
        add_products(np.ones((3, 5)), np.zeros((4, 4)))
