"""Modified stepwise search against statsmodels, and what it must refuse."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import mpmath
import numpy as np
import pytest
import statsmodels.api as sm
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from structsel.errors import SelectionError
from structsel.numerics.best_subset import best_subset
from structsel.numerics.criteria import fdr_F_in
from structsel.numerics.orthogonal import orthogonal
from structsel.numerics.stepwise import forward_selection, partial_f, refine_subset, stepwise
from structsel.numerics.stepwise_kernel import StepwiseRules, stepwise_search


def products(X, y):
    Z = np.column_stack([X, y])
    Z = Z - Z.mean(axis=0)
    return Z.T @ Z


def problem(seed, n=120, p=12, k=4, noise=1.0, shared=0.7):
    """Candidates with signals in common, and a response to k of them."""
    rng = np.random.default_rng(seed)
    X = shared * rng.normal(size=(n, 3)) @ rng.normal(size=(3, p)) + rng.normal(size=(n, p)) + rng.normal(size=p)
    true = rng.choice(p, k, replace=False)
    theta = rng.choice([-1.0, 1.0], k) * rng.uniform(0.5, 2.0, k)
    y = X[:, true] @ theta + noise * rng.normal(size=n) + 3.0
    return X, y, sorted(int(j) for j in true), dict(zip(true.tolist(), theta))


def first_zero_rss(subsets):
    return next(s for s in subsets if s.rss < 1e-12 * subsets[0].rss)


SELECTORS = {
    "stepwise": lambda C, dof: stepwise(C, dof),
    "stepwise, classical": lambda C, dof: stepwise(C, dof, F_in=12, F_out=12),
    "stepwise from all": lambda C, dof: stepwise(C, dof, initial=range(C.shape[0] - 1)),
    "stepwise, false discovery": lambda C, dof: stepwise(C, dof, entry_thresholds=fdr_F_in(C.shape[0] - 1, dof)),
    "refine_subset": lambda C, dof: refine_subset(C, dof, (), np.log(dof)),
    "orthogonal": lambda C, dof: orthogonal(C, dof, sigma_max2=1e-6 * C[-1, -1] / dof),
    "best subset": lambda C, dof: first_zero_rss(best_subset(C, dof)),
}


@pytest.mark.parametrize("name", SELECTORS)
@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    order=st.permutations(range(10)),
    powers=st.lists(st.integers(-6, 6), min_size=10, max_size=10),
)
def test_every_selector_finds_a_noise_free_models_own_terms_in_any_order_and_scaling(name, seed, order, powers):
    X, y, true, theta = problem(seed, n=300, p=10, k=3, noise=0.0, shared=0.3)
    scale = 10.0 ** np.array(powers)
    found = SELECTORS[name](products((X * scale)[:, order], y), 299.0)
    assert sorted(order[j] for j in found.selected) == true
    for j, value in zip(found.selected, found.theta):
        assert_allclose(value * scale[order[j]], theta[order[j]], rtol=1e-9)


@pytest.mark.parametrize("start", ["empty", "all"])
@pytest.mark.parametrize("seed", range(6))
def test_partial_f_partial_r_and_r2_of_every_step_equal_statsmodels(seed, start):
    X, y, *_ = problem(seed, noise=3.0)
    path = stepwise(products(X, y), len(y) - 1, initial=range(12) if start == "all" else ())
    inside = []
    for step in path.steps:
        before = list(inside)
        if step.action == "leave":
            fit = sm.OLS(y, sm.add_constant(X[:, before])).fit()
            at = 1 + before.index(step.index)
            inside.remove(step.index)
        else:
            if step.action == "swap":
                inside.remove(step.other)
            inside.append(step.index)
            fit = sm.OLS(y, sm.add_constant(X[:, inside])).fit()
            at = len(inside)
        t = fit.tvalues[at]
        assert_allclose(step.F, t**2, rtol=1e-10)
        assert_allclose(step.partial_r, t / np.sqrt(t**2 + fit.df_resid), rtol=1e-10)
        after = sm.OLS(y, sm.add_constant(X[:, inside])).fit()
        assert step.n_terms == len(inside)
        assert_allclose(1.0 - step.rss / path.tss, after.rsquared, rtol=1e-10)
    assert tuple(inside) == path.selected
    fit = sm.OLS(y, sm.add_constant(X[:, inside])).fit()
    assert_allclose(path.theta, fit.params[1:], rtol=1e-10)
    assert_allclose(path.r2, fit.rsquared, rtol=1e-10)
    assert (fit.tvalues[1:] ** 2 >= 4.0).all()


def test_partial_f_of_a_given_set_equals_statsmodels():
    X, y, *_ = problem(3)
    chosen = [7, 1, 4, 9]
    theta, F, rss = partial_f(products(X, y), len(y) - 1, chosen)
    fit = sm.OLS(y, sm.add_constant(X[:, chosen])).fit()
    assert_allclose(theta, fit.params[1:], rtol=1e-10)
    assert_allclose(F, fit.tvalues[1:] ** 2, rtol=1e-10)
    assert_allclose(rss, fit.ssr, rtol=1e-10)


@pytest.mark.parametrize("closeness", [1e-2, 1e-3, 1e-4])
def test_partial_f_of_near_copies_is_within_1e_6_of_sixty_digits(closeness):
    # The copy's Schur complement is the square of the closeness: down to 1e-8, above the refusal at 1e-9.
    rng = np.random.default_rng(5)
    X = rng.normal(size=(60, 3))
    X[:, 2] = X[:, 0] + closeness * X[:, 2]
    y = X @ [1.0, 0.5, 1.0] + 0.3 * rng.normal(size=60)
    _, F, _ = partial_f(products(X, y), 59.0, [0, 1, 2])
    with mpmath.workdps(60):
        A = mpmath.matrix(np.column_stack([np.ones(60), X]).tolist())
        b = mpmath.matrix(y.tolist())
        inverse = (A.T * A) ** -1
        theta = inverse * (A.T * b)
        residual = b - A * theta
        s2 = (residual.T * residual)[0] / 56
        exact = [float(theta[i] ** 2 / (s2 * inverse[i, i])) for i in range(1, 4)]
    assert_allclose(F, exact, rtol=1e-6)


def test_at_convergence_no_exchange_of_one_term_lowers_the_residual():
    for seed in range(20):
        X, y, *_ = problem(seed, n=40, p=9, k=4, noise=2.0, shared=2.0)
        C = products(X, y)
        path = stepwise(C, 39.0, F_in=2.0, F_out=2.0)
        for out, new in itertools.product(path.selected, set(range(9)) - set(path.selected)):
            other = [j for j in path.selected if j != out] + [new]
            left = y - (A := sm.add_constant(X[:, other])) @ np.linalg.lstsq(A, y, rcond=None)[0]
            assert left @ left > path.rss * (1.0 - 1e-9)


def test_a_term_that_replaced_two_leaves_when_both_are_in():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 500))
    X = np.column_stack([a + b + 0.1 * rng.normal(size=500), a, b])
    y = 1.5 * a + b + 0.05 * rng.normal(size=500)
    path = stepwise(products(X, y), 499.0, F_in=12, F_out=12)
    assert [(s.action, s.index) for s in path.steps] == [("enter", 0), ("enter", 1), ("enter", 2), ("leave", 0)]
    assert sorted(path.selected) == [1, 2]


@pytest.mark.parametrize("thresholds", [(0.5, 0.5), (2.0, 2.0), (4.0, 4.0), (4.0, 1.0)])
def test_the_search_always_ends_by_itself(thresholds):
    for seed in range(40):
        X, y, *_ = problem(seed, n=30, p=20, k=6, noise=2.0, shared=5.0)
        path = stepwise(products(X, y), 29.0, F_in=thresholds[0], F_out=thresholds[1])
        assert "limit" not in path.stopped


def test_forced_terms_enter_first_and_stay():
    X, y, true, _ = problem(1)
    useless = [j for j in range(12) if j not in true][:2]
    path = stepwise(products(X, y), 119.0, F_in=12, F_out=12, include=useless)
    assert list(path.selected[:2]) == useless
    assert set(true) < set(path.selected)


def test_max_terms_holds():
    X, y, *_ = problem(2)
    path = stepwise(products(X, y), 119.0, max_terms=2)
    assert len(path.selected) == 2
    assert path.stopped == "max_terms reached"


def test_r2_stop_leaves_out_what_gains_less_than_the_change_asked():
    X, y, *_ = problem(4, noise=2.0)
    C = products(X, y)
    long = stepwise(C, 119.0, F_in=0.1, F_out=0.0, swap=False)
    short = stepwise(C, 119.0, F_in=0.1, F_out=0.0, swap=False, min_gain=0.02)
    r2 = np.concatenate([[0.0], [1.0 - s.rss / long.tss for s in long.steps]])
    n = int(np.argmax(np.diff(r2) < 0.02))
    assert 0 < n < len(long.steps)
    assert short.selected == long.selected[:n]
    assert "gains too little" in short.stopped


def test_pse_stop_ends_where_the_next_term_would_raise_pse():
    X, y, *_ = problem(4, noise=2.0)
    C = products(X, y)
    long = stepwise(C, 119.0, F_in=0.1, F_out=0.0, swap=False)
    short = stepwise(C, 119.0, F_in=0.1, F_out=0.0, swap=False, min_gain=1.0 / 120)
    rss = np.array([long.tss] + [s.rss for s in long.steps])
    pse = rss / 120 + long.tss / 120 * (1 + np.arange(rss.size)) / 120
    n = int(np.argmax(np.diff(pse) > 0.0))
    assert 0 < n < len(long.steps)
    assert short.selected == long.selected[:n]


def test_three_columns_worked_by_hand():
    # x1 and x2 orthogonal, x3 = x1 + x2, each of length 1 or sqrt 2; y = 3 x1 + x2 + 1 e: products by hand.
    C = np.array([[1.0, 0, 1, 3], [0, 1, 1, 1], [1, 1, 2, 4], [3, 1, 4, 11]])
    path = stepwise(C, 100.0, F_in=4.0, F_out=4.0)
    # x1 explains 9 of 11, x3 16/2 = 8, x2 1. After x1, x2 and x3 both leave x2: 1 of the 2 left, F = 1 / (1 / 98).
    assert [(s.action, s.index) for s in path.steps] == [("enter", 0), ("enter", 1)]
    assert_allclose([s.rss for s in path.steps], [2.0, 1.0])
    assert_allclose([s.F for s in path.steps], [9.0 / (2.0 / 99.0), 98.0])
    assert_allclose(path.theta, [3.0, 1.0])
    assert path.refused == (2,)
    # From x3 alone, 3 are left; exchanging it for x1, or taking x1 and x2 for it, leaves 2 and 1.
    better = refine_subset(C, 100.0, [2], 4.0, depth=2)
    assert sorted(better.selected) in ([0, 1], [0, 2], [1, 2])
    assert_allclose(better.rss, 1.0)


def test_forward_selection_adds_the_largest_weighted_gain_until_it_is_too_small_a_fraction_of_what_is_left():
    X, y, *_ = problem(6, noise=2.0)
    weights = np.where(np.arange(12) % 3 == 0, 0.01, 1.0)
    path = forward_selection(products(X, y), 119.0, 0.05, weights=weights)
    Z, left, kept = X - X.mean(axis=0), y - y.mean(), []
    while True:
        size = np.sum(Z**2, axis=0)
        free = size > 1e-9 * 120
        gain = np.where(free, (Z.T @ left) ** 2 / np.where(free, size, 1.0), 0.0)
        j = int(np.argmax(weights * gain))
        if gain[j] < 0.05 * left @ left:
            break
        kept.append(j)
        q = Z[:, j] / np.sqrt(size[j])
        left = left - q * (q @ left)
        Z = Z - np.outer(q, q @ Z)
    assert len(kept) > 1
    assert list(path.selected) == kept
    assert_allclose(path.rss, left @ left, rtol=1e-9)
    assert set(kept) != set(forward_selection(products(X, y), 119.0, 0.05).selected)


def test_exact_copies_sums_and_constants_are_refused():
    rng = np.random.default_rng(8)
    X = rng.normal(size=(200, 3))
    X = np.column_stack([X, 2.0 * X[:, 0], X[:, 0] + X[:, 1], np.full(200, 3.0)])
    y = X[:, 0] - X[:, 1] + X[:, 2] + 0.1 * rng.normal(size=200)
    C = products(X, y)
    C[5, :] = C[:, 5] = 0.0
    path = stepwise(C, 199.0)
    assert set(path.selected) | set(path.refused) == set(range(6))
    assert len(path.selected) == 3
    assert 5 in path.refused
    everything = stepwise(C, 199.0, initial=range(6))
    assert sorted(everything.selected) == [0, 1, 2]
    assert [s.index for s in everything.steps if s.action == "refuse"] == [3, 4, 5]


def test_more_candidates_than_samples_still_finds_the_few_that_matter():
    rng = np.random.default_rng(2)
    X = rng.normal(size=(30, 80))
    y = 5.0 * X[:, 10] - 4.0 * X[:, 70]
    path = stepwise(products(X, y), 29.0)
    assert sorted(path.selected) == [10, 70]
    assert path.stopped == "perfect fit"
    greedy = stepwise(products(X, rng.normal(size=30)), 29.0, F_in=0.0, F_out=0.0, swap=False)
    assert len(greedy.selected) <= 28
    with pytest.raises(SelectionError, match="start from 80 terms but has 29 degrees of freedom"):
        stepwise(products(X, y), 29.0, initial=range(80))


def test_search_answers_as_the_readable_form_does_on_two_threads():
    Cs = [products(*problem(seed)[:2]) for seed in range(16)]
    none = np.empty(0, np.int64)

    def fast(C):
        rules = StepwiseRules(np.full(12, 4.0), 4.0, 12, 0.0, np.ones(12), True, 1e-9)
        return stepwise_search(C, 119.0, rules, none, none, np.empty((0, 7)))

    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(fast, Cs))
    for C, (chosen, theta, rss, *_) in zip(Cs, answers):
        path = stepwise(C, 119.0)
        assert tuple(chosen) == path.selected
        assert np.array_equal(theta, path.theta)
        assert rss == path.rss


def test_a_read_only_matrix_is_taken_as_it_is():
    C = products(*problem(1)[:2])
    C.setflags(write=False)
    assert stepwise(C, 119.0).selected == stepwise(C.copy(), 119.0).selected


def brute_force_criterion(C, dof, penalty):
    p = C.shape[0] - 1
    best = dof * np.log(C[-1, -1])
    for k in range(1, p + 1):
        S = np.array(list(itertools.combinations(range(p), k)))
        A, b = C[S[:, :, None], S[:, None, :]], C[S, -1]
        rss = C[-1, -1] - np.sum(b * np.linalg.solve(A, b[..., None])[..., 0], axis=1)
        best = min(best, float(np.min(dof * np.log(rss) + penalty * k)))
    return best


def test_polish_reaches_the_global_optimum_of_bic_nearly_always_and_never_passes_it():
    missed = {1: 0, 2: 0, 3: 0}
    for seed in range(100):
        X, y, *_ = problem(seed, n=40, p=9, k=3, noise=2.0, shared=2.0)
        C, penalty = products(X, y), np.log(40.0)
        best = brute_force_criterion(C, 39.0, penalty)
        for depth in missed:
            path = refine_subset(C, 39.0, (), penalty, depth=depth)
            value = 39.0 * np.log(path.rss) + penalty * len(path.selected)
            assert value > best - 1e-8
            missed[depth] += value > best + 1e-8
    assert missed[3] <= missed[2] <= missed[1]
    assert missed[2] <= 3


@pytest.mark.parametrize("separation", [1.0, 1e-3])
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_polish_ends_where_no_move_of_its_depth_would_lower_the_criterion(depth, separation):
    """Every set that differs by at most two terms out and two in, by solving for each; half the pool nearly copies."""
    gone, more = np.array([(i, j) for i in range(3) for j in range(3) if i + j <= depth + 1 and max(i, j) <= depth]).T
    for seed in range(12):
        X, y, *_ = problem(seed, n=80, p=6, k=3, noise=1.5, shared=1.5)
        X = np.hstack([X, X + separation * np.random.default_rng(seed).normal(size=X.shape)])
        C, penalty = products(X, y), np.log(80.0)
        path = refine_subset(C, 79.0, (), penalty, depth=depth)
        kept = set(path.selected)
        value = 79.0 * np.log(path.rss) + penalty * len(kept)
        for out, into in zip(gone, more):
            for left in itertools.combinations(sorted(kept), len(kept) - out if out <= len(kept) else 0):
                for new in itertools.combinations(sorted(set(range(12)) - kept), into):
                    S = [*left, *new]
                    rss = C[-1, -1] - (C[S, -1] @ np.linalg.solve(C[np.ix_(S, S)], C[S, -1]) if S else 0.0)
                    assert 79.0 * np.log(rss) + penalty * len(S) > value - 1e-6


def test_polish_never_ends_above_where_it_began_and_keeps_forced_terms():
    for seed in range(20):
        X, y, true, _ = problem(seed, n=60, p=15, k=5, noise=2.0)
        C, penalty = products(X, y), np.log(60.0)
        start = partial_f(C, 59.0, true)
        forced = next(j for j in range(15) if j not in true)
        path = refine_subset(C, 59.0, [*true, forced], penalty, include=[forced])
        assert forced in path.selected
        begin = partial_f(C, 59.0, [*true, forced])[2]
        assert begin < start[2]
        assert 59 * np.log(path.rss) + penalty * len(path.selected) <= 59 * np.log(begin) + penalty * 6 + 1e-9


def test_polish_replaces_one_substitute_by_the_two_it_replaced():
    # y = a - b with a and b nearly equal: each alone is useless, and c alone does fairly well.
    rng = np.random.default_rng(4)
    a = rng.normal(size=400)
    b = a + 0.1 * rng.normal(size=400)
    c = (a - b) + 0.05 * rng.normal(size=400)
    y = a - b + 0.002 * rng.normal(size=400)
    C = products(np.column_stack([a, b, c]), y)
    assert sorted(refine_subset(C, 399.0, [2], 6.0, depth=2).selected) == [0, 1]


def test_f_out_above_f_in_is_refused_with_the_reason():
    C = products(*problem(1)[:2])
    with pytest.raises(SelectionError, match="lies between would enter and leave for ever"):
        stepwise(C, 119.0, F_in=4.0, F_out=5.0)


def test_bad_input_is_refused_in_words():
    X, y, *_ = problem(1)
    C = products(X, y)
    with_nan = C.copy()
    with_nan[3, :] = with_nan[:, 3] = np.nan
    with pytest.raises(SelectionError, match="candidate 3 has NaN"):
        stepwise(with_nan, 119.0)
    with_nan = C.copy()
    with_nan[-1, -1] = np.nan
    with pytest.raises(SelectionError, match="the response has NaN"):
        stepwise(with_nan, 119.0)
    with pytest.raises(SelectionError, match="a response that varies"):
        stepwise(products(X, np.ones(120)), 119.0)
    with pytest.raises(SelectionError, match="more than one degree of freedom"):
        stepwise(C, 0.0)
    with pytest.raises(SelectionError, match="from 0 to 11; found \\[12\\]"):
        stepwise(C, 119.0, include=[12])
    with pytest.raises(SelectionError, match="square"):
        stepwise(C[:-1], 119.0)
    with pytest.raises(SelectionError, match=r"candidates \[1\] are constant or depend"):
        partial_f(products(np.column_stack([X[:, 0], X[:, 0]]), y), 119.0, [0, 1])
