"""Best subset against every subset."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.errors import SelectionError
from structsel.numerics.best_subset import best_subset
from structsel.numerics.orthogonal import orthogonal
from structsel.numerics.stepwise import refine_subset, stepwise
from tests.test_stepwise import problem, products


def brute_force(C, force=()):
    """Least rss and its set for every size, by solving every subset's normal equations."""
    p = C.shape[0] - 1
    answer = {}
    for k in range(max(1, len(force)), p + 1):
        S = np.array([s for s in itertools.combinations(range(p), k) if set(force) <= set(s)])
        A, b = C[S[:, :, None], S[:, None, :]], C[S, -1]
        rss = C[-1, -1] - np.sum(b * np.linalg.solve(A, b[..., None])[..., 0], axis=1)
        answer[k] = (float(rss.min()), tuple(int(j) for j in S[np.argmin(rss)]))
    return answer


def test_best_subset_equals_brute_force_on_500_problems_and_the_greedy_answers_often_do():
    # A set counts if it is the best of its own size. Measured: stepwise 0.988 (0.978 without exchanges),
    # orthogonal 0.888, polish 0.998.
    hits = {"stepwise": 0, "orthogonal": 0, "refine_subset": 0, "stepwise, no swap": 0}
    problems = 500
    for seed in range(problems):
        rng = np.random.default_rng(seed)
        p = int(rng.integers(5, 13)) if seed % 10 else 12
        k = int(rng.integers(1, 5))
        X, y, *_ = problem(seed, n=50, p=p, k=k, noise=rng.choice([0.3, 1.0, 3.0]), shared=rng.choice([0.3, 1.0, 3.0]))
        C = products(X, y)
        truth = brute_force(C)
        for subset in best_subset(C, 49.0)[1:]:
            rss, selected = truth[subset.n_terms]
            assert subset.selected == selected
            assert_allclose(subset.rss, rss, rtol=1e-9)
        found = {
            "stepwise": stepwise(C, 49.0),
            "stepwise, no swap": stepwise(C, 49.0, swap=False),
            "orthogonal": orthogonal(C, 49.0),
            "refine_subset": refine_subset(C, 49.0, (), np.log(50.0)),
        }
        for name, path in found.items():
            selected = tuple(sorted(path.selected))
            hits[name] += not selected or truth[len(selected)][1] == selected
    fractions = {name: count / problems for name, count in hits.items()}
    assert fractions["stepwise"] >= 0.97
    assert fractions["refine_subset"] >= 0.99
    assert fractions["orthogonal"] >= 0.86
    assert fractions["stepwise"] >= fractions["stepwise, no swap"]


def test_forced_terms_are_in_every_model():
    for seed in range(10):
        X, y, *_ = problem(seed, n=60, p=9)
        C = products(X, y)
        truth = brute_force(C, force=(2, 6))
        subsets = best_subset(C, 59.0, include=[6, 2])
        assert [s.n_terms for s in subsets] == list(range(2, 10))
        for subset in subsets:
            assert subset.selected == truth[subset.n_terms][1]


def test_coefficients_are_the_least_squares_fit():
    X, y, *_ = problem(1, p=8)
    for subset in best_subset(products(X, y), 119.0, max_terms=5)[1:]:
        A = np.column_stack([np.ones(120), X[:, list(subset.selected)]])
        theta, rss, *_ = np.linalg.lstsq(A, y, rcond=None)
        assert_allclose(subset.theta, theta[1:], rtol=1e-9)
        assert_allclose(subset.rss, rss[0], rtol=1e-10)


def test_max_terms_gives_the_same_models_as_the_complete_search():
    X, y, *_ = problem(2, n=80, p=12, shared=2.0)
    C = products(X, y)
    assert [s.selected for s in best_subset(C, 79.0, max_terms=4)] == [s.selected for s in best_subset(C, 79.0)[:5]]


@pytest.mark.parametrize("seed", range(5))
def test_of_dependent_candidates_any_may_be_in_the_best_model(seed):
    # Column 3 is the sum of 0 and 1, column 5 a copy of 4: all 63 subsets, the singular ones left out.
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(40, 6))
    X[:, 3] = X[:, 0] + X[:, 1]
    X[:, 5] = 2.0 * X[:, 4]
    y = X[:, 3] + 0.3 * X[:, 2] + 0.5 * rng.normal(size=40)
    subsets = best_subset(products(X, y), 39.0)
    assert [s.n_terms for s in subsets] == [0, 1, 2, 3, 4]
    assert subsets[1].selected == (3,)
    for subset in subsets[1:]:
        best = np.inf
        for s in itertools.combinations(range(6), subset.n_terms):
            A = np.column_stack([np.ones(40), X[:, list(s)]])
            if np.linalg.matrix_rank(A) == A.shape[1]:
                best = min(best, float(np.linalg.lstsq(A, y, rcond=None)[1][0]))
        assert_allclose(subset.rss, best, rtol=1e-10)


def test_thirty_correlated_candidates_are_within_reach_and_no_greedy_answer_is_better():
    X, y, *_ = problem(7, n=400, p=30, k=8, noise=3.0, shared=2.0)
    C = products(X, y)
    subsets = best_subset(C, 399.0)
    for path in (stepwise(C, 399.0), orthogonal(C, 399.0), refine_subset(C, 399.0, (), 6.0)):
        assert subsets[len(path.selected)].rss <= path.rss * (1.0 + 1e-10)


def test_more_candidates_than_samples_stop_at_the_degrees_of_freedom():
    rng = np.random.default_rng(1)
    C = products(rng.normal(size=(8, 12)), rng.normal(size=8))
    assert best_subset(C, 7.0)[-1].n_terms == 6


def test_a_problem_too_large_is_refused_with_a_remedy():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(60, 41))
    with pytest.raises(SelectionError, match=r"up to 40 candidates .* found 41"):
        best_subset(products(X, X[:, 0]), 59.0)
    X[:, 1] = X[:, 0]
    with pytest.raises(SelectionError, match=r"candidate 1 is constant or depends on \[0\]"):
        best_subset(products(X[:, :5], X[:, 2]), 59.0, include=[0, 1])
