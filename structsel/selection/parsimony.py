"""The simplest of several searches that predicts manoeuvres left out as well: the one-standard-error rule."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import columns_of
from structsel.selection.resampling import bootstrap_units
from structsel.selection.search import (
    ROUNDING,
    Search,
    model_products,
    prediction_error,
    weights_without,
)
from structsel.selection.search_result import SearchResult

SAME_ERROR = 1e-9  # of a squared error: a smaller difference is rounding
REFUTED = 2.0  # standard errors by which the complete model, its terms given, predicts better


@dataclass(frozen=True)
class Simplest:
    """The search that is used, and why.

    Attributes
    ----------
    search : Search
    result : SearchResult
    reason : str
        Empty where it is the complete search.
    """

    search: Search
    result: SearchResult
    reason: str = ""


def fold_errors(search: Search) -> Array:
    """Squared error of each fold predicted by a selection without it, (F,), in the units of the products.

    With prewhitened products these are errors of one-step predictions, which are independent of one another.
    """
    errors = []
    for weights, kept, theta in search.without_folds:
        left_out = model_products(search.products, kept, 1.0 - weights)
        floor = ROUNDING * float(left_out[-1, -1])
        errors.append(max(prediction_error(theta, left_out), floor))
    return np.array(errors)


def unit_errors(search: Search) -> Array:
    """Squared error of each unit of the bootstrap, (U,), predicted by a selection without its fold.

    Units are manoeuvres from eight on, and else blocks: three differences, one for each manoeuvre, do not give their
    standard error. In the units of the products.
    """
    products = search.products
    errors = np.zeros(products.n_blocks)
    for fold, (_, kept, theta) in zip(search.folds, search.without_folds, strict=True):
        model = products.parts(columns_of(products.scale.size, kept), fold)
        residual = np.append(-theta, 1.0)
        errors[fold] = np.maximum(model @ residual @ residual, 0.0)
    return np.bincount(bootstrap_units(products), errors).astype(float)


def linear_search(search: Search) -> Search | None:
    """The search that is given every linear term; None where there is none, or too many for the samples of a fold."""
    linear = tuple(np.flatnonzero(search.constraints.degrees == 1).tolist())
    terms = tuple(dict.fromkeys([*search.constraints.include, *linear]))
    samples = [search.products.dof(weights_without(search.products, fold)) for fold in search.folds]
    if not linear or not samples or min(samples) <= len(terms) + 1:
        return None
    return replace(search, fixed=terms)


def find_simplest(search: Search, result: SearchResult) -> Simplest:
    """The search with the fewest terms that predicts as well as the best of several [B84].

    They are: the complete search, those among candidates up to a lower degree, and the linear model with all its terms,
    if it is not larger than the complete one.
    "As well": the mean of the differences of squared error between folds is within one standard error of zero.
    Differences of the same fold are compared, since manoeuvres differ by more than models do.

    These are errors of selections repeated without each fold, and some may be wrong. So a model is not taken if
    the terms of the complete selection, only estimated again without each fold, predict better by more than two
    standard errors of the differences between manoeuvres or, of few manoeuvres, blocks.
    """
    given = Simplest(search, result)
    degrees = np.unique(search.constraints.degrees[~search.hidden])
    if len(search.folds) < 2 or degrees.size < 2:
        return given
    tried = [given]
    for degree in degrees[:-1].tolist():
        lower = replace(search, degree=degree)
        tried.append(Simplest(lower, lower.run(), f"candidates up to degree {degree} predict as well"))
    linear = linear_search(search) if search.options.correlation_limit is None else None
    if linear is not None and len(linear.fixed or ()) <= len(result.selected):
        tried.append(Simplest(linear, linear.run(), "the linear model predicts better"))
    return _fewest_terms(tried)


def is_larger(a: Array, b: Array, standard_errors: float = 1.0) -> bool:
    """Whether the errors a of the folds exceed b in the mean, by more than one standard error of the differences."""
    difference = a - b
    limit = standard_errors * np.std(difference, ddof=1) / np.sqrt(difference.size) if a.size > 1 else np.inf
    return bool(difference.mean() > max(limit, SAME_ERROR * b.mean()))


def _fewest_terms(tried: Sequence[Simplest]) -> Simplest:
    errors = [fold_errors(one.search) for one in tried]
    at = int(np.argmin([e.sum() for e in errors]))
    given = [unit_errors(replace(one.search, fixed=one.result.selected, degree=None)) for one in tried]
    usable = [
        one
        for one, error, of_terms in zip(tried, errors, given, strict=True)
        if not is_larger(error, errors[at]) and not is_larger(of_terms, given[0], REFUTED)
    ]
    return min(usable or [tried[at]], key=lambda one: len(one.result.selected))
