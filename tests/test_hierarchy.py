"""Hierarchical models: parents, and every search against all models that are allowed."""

import itertools
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.numerics.best_subset import best_subset
from structsel.numerics.hierarchy import Hierarchy, find_parents
from structsel.numerics.orthogonal import orthogonal
from structsel.numerics.stepwise import refine_subset, stepwise
from structsel.selection import select
from tests.selections import made, names
from tests.test_stepwise import products

PROBLEMS = 40
POOL = Candidates.polynomial(["alpha", "de", "q_hat"], 2) + Candidates.parse(
    ["alpha^3", "alpha^2*de", "alpha*de*q_hat"]
)


@cache
def parents_by_name(pool):
    table = find_parents(pool.exponents)
    return {pool.names[i]: {pool.names[j] for j in row if j >= 0} for i, row in enumerate(table)}


def allowed(pool, model, strong):
    """The definition, by names and without the table of the package."""
    parents = parents_by_name(pool)
    kept = {pool.names[j] for j in model}
    return all(not parents[n] or (parents[n] <= kept if strong else parents[n] & kept) for n in kept)


def problem(seed, pool=POOL, n=60, true=3, noise=1.0):
    """Cross-products of correlated channels, their products, and a response of a few random terms."""
    rng = np.random.default_rng(seed)
    common = rng.standard_normal(n)
    base = {name: 0.7 * rng.standard_normal(n) + 0.5 * common + 0.3 for name in ("alpha", "de", "q_hat")}
    X = pool.evaluate(base)
    chosen = rng.choice(len(pool), true, replace=False)
    y = X[:, chosen] @ (rng.choice([-1, 1], true) * rng.uniform(0.5, 1.5, true)) + noise * rng.standard_normal(n)
    return products(X, y)


def every_model(pool, strong):
    """All allowed sets of candidates, by size."""
    p = len(pool)
    models = {}
    for k in range(p + 1):
        models[k] = [s for s in itertools.combinations(range(p), k) if allowed(pool, s, strong)]
    return models


def rss_of(C, models):
    """Residual sum of squares of each of several models of one size."""
    S = np.array(models, dtype=int).reshape(len(models), -1)
    A, b = C[S[:, :, None], S[:, None, :]], C[S, -1]
    return C[-1, -1] - np.sum(b * np.linalg.solve(A, b[..., None])[..., 0], axis=1)


def test_parents_are_the_candidates_that_divide_a_term_with_none_between():
    # Worked by hand. abs(beta) and the spline are signals of their own.
    pool = Candidates.parse(
        ["alpha", "de", "alpha^2", "alpha*de", "alpha^2*de", "alpha^3", "abs(beta)", "abs(beta)*beta", "beta^3", "beta",
         "(alpha - 0.2)+", "alpha*(alpha - 0.2)+"]
    )  # fmt: skip
    found = parents_by_name(pool)
    assert found["alpha"] == found["de"] == found["abs(beta)"] == found["(alpha - 0.2)+"] == set()
    assert found["alpha^2"] == {"alpha"}
    assert found["alpha*de"] == {"alpha", "de"}
    assert found["alpha^2*de"] == {"alpha^2", "alpha*de"}
    assert found["alpha^3"] == {"alpha^2"}
    assert found["abs(beta)*beta"] == {"abs(beta)", "beta"}
    assert found["beta^3"] == {"beta"}  # beta^2 is no candidate
    assert found["alpha*(alpha - 0.2)+"] == {"(alpha - 0.2)+", "alpha"}


def test_a_model_is_hierarchical_with_all_parents_or_with_one():
    pool = Candidates.parse(["alpha", "de", "alpha*de"])
    parents = find_parents(pool.exponents)
    assert Hierarchy(parents, strong=True).allows([0, 1, 2])
    assert not Hierarchy(parents, strong=True).allows([0, 2])
    assert Hierarchy(parents, strong=False).allows([0, 2])
    assert not Hierarchy(parents, strong=False).allows([2])
    assert Hierarchy(parents, strong=True).without([2]).allows([2])


@pytest.mark.parametrize("strong", [True, False])
def test_best_subset_is_the_best_allowed_model_of_every_size(strong):
    pool = POOL
    models, hierarchy = every_model(pool, strong), Hierarchy(find_parents(pool.exponents), strong)
    for seed in range(60):
        C = problem(seed, true=1 + seed % 4, noise=(0.3, 1.0, 3.0)[seed % 3])
        found = {s.n_terms: s for s in best_subset(C, 59.0, hierarchy=hierarchy, max_terms=6)}
        assert set(found) == set(range(7))
        for k, subset in found.items():
            assert allowed(pool, subset.selected, strong)
            assert_allclose(subset.rss, rss_of(C, models[k]).min(), rtol=1e-9)


@pytest.mark.parametrize("strong", [True, False])
def test_searches_by_moves_end_in_allowed_models_and_mostly_in_the_best(strong):
    # The best is the allowed model of least dof log rss + F k. Measured over 300 problems: 0.97 (strong) and 0.91
    # (weak, where the parent of a group is chosen level by level), from no term.
    pool, price = POOL, 6.0
    hierarchy = Hierarchy(find_parents(pool.exponents), strong)
    every = every_model(pool, strong)
    hits = {"stepwise": 0, "refine_subset": 0}
    problems = PROBLEMS
    for seed in range(problems):
        C = problem(1000 + seed, true=1 + seed % 4)

        def criterion(model, C=C):
            return 59.0 * np.log(rss_of(C, [model])[0]) + price * len(model)

        least = min(59.0 * np.log(rss_of(C, of).min()) + price * k for k, of in every.items())
        thresholds = (59.0 - np.arange(len(pool)) - 1.0) * np.expm1(price / 59.0)
        found = {
            "stepwise": stepwise(C, 59.0, F_out=np.inf, entry_thresholds=thresholds, hierarchy=hierarchy),
            "refine_subset": refine_subset(C, 59.0, (), price, hierarchy=hierarchy),
        }
        for name, path in found.items():
            assert allowed(pool, path.selected, strong)
            hits[name] += criterion(path.selected) <= least + 1e-9
            inside = []
            for step in path.steps:  # every model on the way is allowed too
                inside.append(step.index) if step.action == "enter" else inside.remove(step.index)
                assert allowed(pool, inside, strong)
    assert min(hits.values()) >= 0.85 * problems, hits


@pytest.mark.parametrize("order", ["greedy", "given"])
@pytest.mark.parametrize("strong", [True, False])
def test_every_model_on_an_orthogonal_path_is_allowed(strong, order):
    hierarchy = Hierarchy(find_parents(POOL.exponents), strong)
    for seed in range(20):
        path = orthogonal(problem(seed), 59.0, order=order, hierarchy=hierarchy)
        assert len(path.order) == len(POOL)
        for k in range(len(path.order) + 1):
            assert allowed(POOL, path.order[:k], strong)


def test_without_needs_the_search_by_groups_is_that_of_single_terms():
    parents = np.empty((len(POOL), 0), dtype=np.int64)
    for seed in range(20):
        C = problem(seed)
        path = stepwise(C, 59.0, hierarchy=Hierarchy(parents, strong=True))
        assert set(path.selected) == set(stepwise(C, 59.0).selected)


def product_response(c):
    """alpha*de without alpha, and q_hat."""
    return 60.0 * c["alpha"] * c["de"] - 3.0 * c["q_hat"]


@pytest.mark.parametrize("noise", ["white", "ar", "cluster"])
@pytest.mark.parametrize("method", ["stepwise", "orthogonal", "best_subset"])
def test_parents_of_a_product_are_kept_by_every_method_and_noise_model(method, noise):
    # alpha and de by themselves explain nothing.
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
    recordings = made(product_response, noise=0.05)
    given = {"method": method, "noise": noise, "bootstrap": 0, "parsimony": "none"}
    kept = {
        rule: names(select(recordings, "CZ", pool, hierarchy=rule, **given)["CZ"].terms)
        for rule in ("none", "weak", "strong")
    }
    product, parents = {"q_hat", "alpha*de"}, {"alpha", "de"}
    assert all(found >= product for found in kept.values())
    assert kept["strong"] >= parents
    assert kept["weak"] & parents
    if noise != "cluster" or method == "stepwise":  # chosen by cross-validation else, which may keep a false term
        assert kept["none"] == product
        assert kept["strong"] == product | parents
        assert len(kept["weak"] & parents) == 1


def test_an_included_product_needs_no_parent():
    recordings = made(product_response, noise=0.05)
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
    given = {"hierarchy": "strong", "bootstrap": 0}
    kept = select(recordings, "CZ", pool, include=["alpha*de"], **given)["CZ"].terms
    assert names(kept) == {"alpha*de", "q_hat"}


def test_a_channel_that_does_not_move_is_no_parent():
    # V_ratio is constant: V_ratio^2 and its products are then columns of the other signals.
    recordings = made(
        lambda c: 3.0 * c["alpha"] * c["V_ratio"], noise=0.05, V_ratio=lambda c, rng: 1.0 + 0.0 * c["alpha"]
    )
    kept = select(recordings, "CZ", Candidates.parse(["V_ratio", "V_ratio*alpha"]), hierarchy="strong", bootstrap=0)
    assert names(kept["CZ"].terms) == {"V_ratio*alpha"}


def test_a_resampled_and_held_out_selection_is_hierarchical_too():
    recordings = made(product_response, noise=0.05, n_recordings=3)
    found = select(
        recordings, "CZ", Candidates.polynomial(["alpha", "q_hat", "de"], 2), hierarchy="strong", bootstrap=20
    )
    frequency = found["CZ"].inclusion
    assert min(frequency["alpha"], frequency["de"]) >= frequency["alpha*de"] == 1.0
    assert "0 terms" not in str(found)
