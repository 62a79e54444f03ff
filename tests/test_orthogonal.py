"""Orthogonal functions against explicit Gram-Schmidt on the columns."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.errors import SelectionError
from structsel.numerics.orthogonal import orthogonal
from tests.test_stepwise import problem, products


def gram_schmidt(X, y, order):
    """Cost reductions of the columns in the given order, by the formulas of the docstring."""
    functions, reductions = [np.ones(len(y))], []
    for j in order:
        function = X[:, j].copy()
        for _ in range(2):  # twice is enough
            for other in functions:
                function -= (other @ function) / (other @ other) * other
        functions.append(function)
        reductions.append((function @ y) ** 2 / (function @ function))
    return np.array(reductions)


def test_greedy_cost_reductions_equal_gram_schmidt_and_are_each_the_largest_left():
    X, y, *_ = problem(0)
    path = orthogonal(products(X, y), 119.0)
    assert_allclose(path.cost_reduction, gram_schmidt(X, y, path.order), rtol=1e-9)
    for i in range(len(path.order)):
        rest = [gram_schmidt(X, y, [*path.order[:i], j])[-1] for j in path.order[i:]]
        assert np.argmax(rest) == 0
    assert_allclose(path.rss_path[1:], path.tss - np.cumsum(path.cost_reduction), rtol=1e-9)


def test_given_order_ranks_by_the_reduction_each_had_in_its_own_place():
    X, y, *_ = problem(1)
    path = orthogonal(products(X, y), 119.0, order="given")
    expected = gram_schmidt(X, y, range(12))
    assert list(path.order) == np.argsort(-expected).tolist()
    assert_allclose(path.cost_reduction, np.sort(expected)[::-1], rtol=1e-9)


@pytest.mark.parametrize("order", ["greedy", "given"])
def test_every_model_on_the_path_decomposes_to_its_least_squares_fit(order):
    X, y, *_ = problem(2)
    path = orthogonal(products(X, y), 119.0, order=order, include=[5])
    assert path.order[0] == 5
    for n in range(len(path.order) + 1):
        A = np.column_stack([np.ones(120), X[:, list(path.order[:n])]])
        theta, *_ = np.linalg.lstsq(A, y, rcond=None)
        assert_allclose(path.coefficients(n), theta[1:], rtol=1e-8, atol=1e-10)
        assert_allclose(path.rss_path[n], np.sum((y - A @ theta) ** 2), rtol=1e-10)
    assert_allclose(path.theta, path.coefficients(len(path.selected)), rtol=1e-14)


def test_the_size_chosen_has_the_least_pse_of_the_formula():
    X, y, *_ = problem(3, noise=2.0)
    for sigma_max2 in (None, 4.0, 0.04):
        path = orthogonal(products(X, y), 119.0, sigma_max2=sigma_max2)
        bound = np.var(y) if sigma_max2 is None else sigma_max2
        pse = path.rss_path / 120 + bound * np.arange(1, 14) / 120
        assert_allclose(path.pse_path, pse, rtol=1e-12)
        assert len(path.selected) == np.argmin(pse)
        assert path.selected == path.order[: np.argmin(pse)]


def test_steps_carry_the_partial_f_of_each_entry():
    X, y, *_ = problem(3, noise=2.0)
    path = orthogonal(products(X, y), 119.0, sigma_max2=0.01)
    rss = path.rss_path
    for i, step in enumerate(path.steps):
        assert_allclose(step.F, (rss[i] - rss[i + 1]) / (rss[i + 1] / (119 - i - 1)), rtol=1e-8)


def test_dependent_candidates_are_refused_and_the_rest_ranked():
    X, y, *_ = problem(4, p=5, k=2)
    X = np.column_stack([X, X[:, 0] - X[:, 3]])
    for order in ("greedy", "given"):
        path = orthogonal(products(X, y), 119.0, order=order)
        assert len(path.order) == 5
        assert len(path.refused) == 1


def test_more_candidates_than_samples_end_the_greedy_path_and_refuse_the_given_order():
    rng = np.random.default_rng(0)
    C = products(rng.normal(size=(20, 40)), rng.normal(size=20))
    assert len(orthogonal(C, 19.0).order) <= 18
    with pytest.raises(SelectionError, match="start from 40 terms but has 19 degrees"):
        orthogonal(C, 19.0, order="given")
    with pytest.raises(SelectionError, match='"greedy" or "given"'):
        orthogonal(C, 19.0, order="best")
