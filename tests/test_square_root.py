"""Triangular factors against the products that they must keep."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.numerics.square_root import absorb, triangularise


@pytest.mark.parametrize(("rows", "columns", "below"), [(1, 3, 2), (4, 6, 5), (5, 2, 3), (3, 4, 0)])
def test_absorbing_columns_keeps_all_products_and_makes_the_first_factor_triangular(rows, columns, below):
    rng = np.random.default_rng(rows)
    R, A = np.tril(rng.standard_normal((rows, rows))), rng.standard_normal((rows, columns))
    Y, S = rng.standard_normal((below, rows)), rng.standard_normal((below, columns))
    complete = np.block([[R, A], [Y, S]])
    absorb(R, A.copy(), Y, S, rows, columns)
    made = np.block([[R, np.zeros((rows, columns))], [Y, S]])
    assert_allclose(R, np.tril(R), atol=0)
    assert_allclose(made @ made.T, complete @ complete.T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("shape", [(5, 5), (5, 9), (6, 4), (9, 20)])
def test_a_triangular_factor_keeps_the_product(shape):
    A = np.random.default_rng(1).standard_normal(shape)
    made = A.copy()
    triangularise(made, *shape)
    assert_allclose(made, np.tril(made), atol=0)
    assert_allclose(made @ made.T, A @ A.T, rtol=1e-12, atol=1e-12)
