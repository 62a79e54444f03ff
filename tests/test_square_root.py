"""Triangular factors against the products that they must keep."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.numerics.square_root import absorb, add_rows, triangularise


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
def test_a_triangular_factor_keeps_the_product_with_the_rows_rotated_with_it(shape):
    rows, columns = shape
    above, below = 2, 3
    A = np.random.default_rng(1).standard_normal((above + rows + below, columns))
    made = np.ascontiguousarray(A.T)
    triangularise(made, above, rows, columns, len(A), np.empty(len(A)))
    factor = made.T[above : above + rows]
    assert_allclose(factor, np.tril(factor), atol=0)
    assert_allclose(made.T @ made, A @ A.T, rtol=1e-12, atol=1e-12)


def test_what_is_left_of_the_rows_rotated_with_a_factor_is_the_conditional_covariance():
    # Of [A; B] with the covariance of B given A: B B' - B A' (A A')^-1 A B'.
    rng = np.random.default_rng(2)
    A, B = rng.standard_normal((3, 7)), rng.standard_normal((2, 7))
    made = np.ascontiguousarray(np.vstack([A, B]).T)
    triangularise(made, 0, 3, 7, 5, np.empty(5))
    given = B @ B.T - B @ A.T @ np.linalg.solve(A @ A.T, A @ B.T)
    assert_allclose(made[3:, 3:].T @ made[3:, 3:], given, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 4, 7])
def test_rows_are_added_with_their_weights(count):
    rng = np.random.default_rng(3)
    total, weights, rows = rng.standard_normal(6), rng.standard_normal(7), rng.standard_normal((7, 6))
    made = total.copy()
    add_rows(made, -1.0, weights, rows, count, 5)
    expected = np.append(total[:5] - weights[:count] @ rows[:count, :5], total[5])
    assert_allclose(made, expected, rtol=1e-12, atol=1e-12)
