"""Products without rounding, and searches among terms that nearly depend on each other."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.numerics.colour import Colour
from structsel.numerics.exact import exact_centred
from structsel.numerics.moments import accumulate, accumulate_whitened, sweep_constant
from structsel.numerics.passes import Passes
from structsel.numerics.rows import ArraySignals, base_scale
from structsel.numerics.stepwise import partial_f
from structsel.selection import Options
from structsel.selection.search import Pool, centred
from structsel.selection.sharpening import NEAR, look_again, smallest_schur
from structsel.selection.way import Way

LINEAR = np.eye(3, dtype=int)
ONES = (np.ones(3), np.ones(1))
N = 3000


def signals(share, mean=0.0, seed=0):
    """Two signals, a near copy of the second, and a response to all three."""
    rng = np.random.default_rng(seed)
    alpha, de, own, noise = rng.standard_normal((4, N))
    base = np.vstack([alpha, mean + de, mean + de + share * own])
    return ArraySignals(base, (2.0 * alpha + de + own + 0.5 * noise)[None])


def in_fractions(flight):
    """Centred products of base signals and response, exactly, then rounded once."""
    rows = [[Fraction(float(v)) for v in row] for row in np.vstack([flight.base_signals, flight.response_signals])]
    sums = [sum(row) for row in rows]
    return np.array(
        [
            [float(sum(a * b for a, b in zip(x, y)) - sx * sy / N) for y, sy in zip(rows, sums)]
            for x, sx in zip(rows, sums)
        ]
    )


@pytest.mark.parametrize("mean", [0.0, 1e4])
def test_centred_products_are_rounded_once_whatever_the_mean(mean):
    flight = signals(1e-4, mean)
    C = exact_centred([flight], LINEAR, [0, 1, 2], 0, blocks=12, scales=ONES, passes=Passes())
    exact = in_fractions(flight)
    root = np.sqrt(np.diag(exact))
    # A few roundings of an entry, and at this mean those of the cross-parts, 2^-22 of ordinary ones times 1e8.
    assert np.abs((C - exact) / np.outer(root, root)).max() < 1e-15
    if mean:
        ordinary = sweep_constant(accumulate([flight], LINEAR, scales=ONES).total())
        assert np.abs((ordinary - exact) / np.outer(root, root)).max() > 1e-10


def test_whitened_products_are_those_of_ordinary_ones_but_for_rounding():
    flights = [signals(0.5, seed=k) for k in (1, 2)]
    two = [ArraySignals(f.base_signals, np.vstack([f.base_signals[0] ** 2, f.response_signals])) for f in flights]
    scales = base_scale(two)
    colours = [[Colour(np.array(ar), 0.3) for ar in rows] for rows in (((0.5,), (0.4, 0.1)), ((0.7,), (0.6,)))]
    moments = accumulate_whitened(two, LINEAR, colours, scales=scales)
    for r in range(2):
        C = exact_centred(two, LINEAR, [0, 2], r, colours, blocks=12, scales=scales, passes=Passes())
        assert_allclose(C, sweep_constant(moments[r].total())[np.ix_([0, 2, 3], [0, 2, 3])], rtol=1e-11, atol=1e-9)


def looked_again(flight):
    moments = accumulate([flight], LINEAR, scales=ONES)
    way = Way(moments, Options(residuals="white", F_in=12.0), Pool(np.ones(3, dtype=int)), ())
    found = way.find()
    exact = partial(exact_centred, [flight], LINEAR, response=0, blocks=12, scales=ONES, passes=Passes())
    return way, found, *look_again(way, found, exact)


@pytest.mark.parametrize("seed", range(5))
def test_partial_f_of_a_near_copy_is_right_to_a_millionth(seed):
    # Schur complement 1.6e-9, as little as a term may have; a mean of 10 takes two more digits of ordinary products.
    flight = signals(4e-5, mean=10.0, seed=seed)
    way, found, again, now = looked_again(flight)
    assert set(found.selected) == set(now.selected) == {0, 1, 2}
    exact = in_fractions(flight)
    F = partial_f(exact, N - 1.0, now.selected)[1]
    before = partial_f(centred(way.moments.total()), N - 1.0, now.selected)[1]
    after = partial_f(centred(again.moments.total(), again.exact), N - 1.0, now.selected)[1]
    assert_allclose(after, F, rtol=1e-6)
    assert np.abs(before / F - 1.0).max() > 1e-6


def test_products_are_not_made_again_where_terms_are_apart():
    way, found, again, now = looked_again(signals(0.01))
    assert smallest_schur(centred(way.moments.total()), found.selected) > NEAR
    assert again is way
    assert now is found
