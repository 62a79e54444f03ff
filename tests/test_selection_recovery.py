"""Choices after the search: thresholds that grow with the record, and models that are not refuted."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.numerics.criteria import ebic, ebic_F_in, familywise_F_in
from structsel.numerics.cross_products import cross_products
from structsel.numerics.regressors import ArrayData
from structsel.selection import SelectOptions, parsimony, select_arrays
from structsel.selection.methods import SearchConstraints
from structsel.selection.methods.method import automatic_F_in
from structsel.selection.parsimony import Simplest, is_larger
from structsel.selection.search import Search, fold_blocks


def test_a_term_lowers_the_extended_bic_exactly_where_its_F_is_above_the_threshold():
    n, p, rss = 5000.0, 164, 3.0
    F = ebic_F_in(p, n - 1.0)
    # F = (rss_before - rss_after) / (rss_after / (dof - k - 1)); with no other term dof - 1 is left, nearly dof.
    for factor, falls in ((1.01, True), (0.99, False)):
        after = rss / (1.0 + factor * F / (n - 1.0))
        assert (ebic(after, n, 1, p) < ebic(rss, n, 0, p)) is np.bool_(falls)


@pytest.mark.parametrize(("n", "larger"), [(500, familywise_F_in), (20_000, ebic_F_in)])
def test_the_automatic_threshold_is_the_larger_of_sidak_and_extended_bic(n, larger):
    assert automatic_F_in(164, n - 1.0) == larger(164, n - 1.0)
    assert automatic_F_in(164, n - 1.0) >= max(familywise_F_in(164, n - 1.0), ebic_F_in(164, n - 1.0))


def test_errors_are_larger_by_as_many_standard_errors_as_asked():
    # Differences 1, 2, 3: mean 2, standard error 1 / sqrt(3) = 0.577, so 3.46 of them.
    a, b = np.array([2.0, 4.0, 6.0]), np.array([1.0, 2.0, 3.0])
    assert is_larger(a, b)
    assert is_larger(a, b, 3.4)
    assert not is_larger(a, b, 3.5)


def test_errors_that_differ_by_rounding_are_not_larger():
    b = np.array([1.0, 2.0, 3.0])
    assert not is_larger(b * (1.0 + 4e-16), b)
    assert is_larger(b * 1.001, b)


@dataclass(frozen=True)
class Errors:
    """A search that is known by its errors in the folds, with a selection in each and with the terms given."""

    repeated: tuple[float, ...]
    given: tuple[float, ...]
    fixed: tuple[int, ...] | None = None
    degree: int | None = None


def simplest_of(complete, lower, monkeypatch):
    monkeypatch.setattr(parsimony, "fold_errors", lambda search: np.array(search.repeated))
    monkeypatch.setattr(parsimony, "unit_errors", lambda search: np.array(search.given))
    models = [(complete, (0, 1, 2)), (lower, (0, 1))]
    tried = [Simplest(errors, SimpleNamespace(selected=terms)) for errors, terms in models]
    return len(parsimony._fewest_terms(tried).result.selected)


def test_a_smaller_model_is_not_taken_where_the_terms_of_the_complete_one_clearly_predict_better(monkeypatch):
    # One of the repeated selections went astray (20): the errors are within one standard error of each other.
    complete, lower = (10.0, 10.0, 20.0, 10.0), (12.0, 12.1, 13.0, 12.2)
    steady = (10.0, 10.0, 11.0, 10.0)
    assert simplest_of(Errors(complete, steady), Errors(lower, steady), monkeypatch) == 2
    assert simplest_of(Errors(complete, steady), Errors(lower, lower), monkeypatch) == 3


def test_errors_of_three_manoeuvres_are_compared_by_blocks():
    # y = x0 + x1 in three manoeuvres; the errors of all blocks add up to those of the folds.
    rng = np.random.default_rng(3)
    manoeuvres = []
    for _ in range(3):
        base = rng.standard_normal((2, 1200))
        manoeuvres.append(ArrayData(base, (base.sum(axis=0) + rng.standard_normal(1200))[None]))
    products = cross_products(manoeuvres, np.eye(2, dtype=int), blocks=12)
    search = Search(products, SelectOptions(noise="white"), SearchConstraints(np.ones(2)), fold_blocks(products))
    errors = parsimony.unit_errors(search)
    assert errors.size == products.n_blocks == 12
    assert_allclose(errors.sum(), parsimony.fold_errors(search).sum(), rtol=1e-9)


def test_orthogonal_functions_drop_a_proxy_that_later_ones_explain():
    # x2 is nearly x0 + x1 and is ranked first; the response has x0 and x1.
    rng = np.random.default_rng(0)
    x = rng.standard_normal((2, 2000))
    base = np.vstack([x, x.sum(axis=0) + 0.2 * rng.standard_normal(2000), rng.standard_normal((3, 2000))])
    data = [ArrayData(base, (x.sum(axis=0) + 0.1 * rng.standard_normal(2000))[None])]
    options = {"method": "orthogonal", "bootstrap": 0, "noise": "white", "parsimony": "none"}
    found = select_arrays(data, np.eye(6, dtype=int), SelectOptions(**options))[0]
    on_path = select_arrays(data, np.eye(6, dtype=int), SelectOptions(**options, criterion="BIC"))[0]
    assert set(found.search.selected) == {0, 1}
    assert set(on_path.search.selected) == {0, 1, 2}
