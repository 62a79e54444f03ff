"""One constant for all manoeuvres, or a constant of each: which predicts manoeuvres left out better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.regressors import DataSource
from structsel.selection.search import Search, model_products, prediction_error, solve

SIGNIFICANCE = 0.05  # of the test that constants differ
ROUNDING = 1e-6  # of a squared error: a smaller difference decides nothing


@dataclass(frozen=True)
class WithoutConstants:
    """A manoeuvre whose responses are reduced by a constant of each."""

    source: DataSource
    constants: Array

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.source.n

    def base(self, start: int, stop: int) -> NDArray[np.float64]:
        """Base signals of these samples."""
        return self.source.base(start, stop)

    def responses(self, start: int, stop: int) -> NDArray[np.float64]:
        """Responses of these samples, less the constants."""
        return self.source.responses(start, stop) - self.constants[:, None]


def choose_constants(search: Search) -> Search:
    """The search with one constant, or that with a constant of each manoeuvre, as the options ask.

    With ``constants="auto"`` each has its own where they differ by more than the noise explains, unless the slopes then
    predict manoeuvres left out worse, each about its own mean. The mean of a new manoeuvre is known when it is
    predicted from its start; which slopes belong to it is what is judged here.
    """
    if search.options.constants == "shared":
        return search
    products = search.products
    several = np.unique(products.manoeuvre).size > 1
    if search.options.constants == "auto" and not (several and products.separate):
        return search
    own = replace(search, products=products.within_manoeuvres())
    if search.options.constants == "own":
        return own
    if not constants_differ(products, own.products, own.result.selected):
        return search
    # Of two manoeuvres each fold has one, and both kinds of constant give the same slopes up to rounding.
    worse = slope_error(own, own.products) > slope_error(search, own.products) * (1.0 + ROUNDING)
    return search if worse else own


def constants_differ(products: CrossProducts, own: CrossProducts, kept: Sequence[int]) -> bool:
    """Analysis of variance of the mean residuals of blocks, between manoeuvres and within: different at 5 %.

    Means of blocks are independent where residuals are correlated over less than a block. Where every manoeuvre is one
    block there is no scatter within to compare with, and the answer is yes.
    """
    slopes = solve(model_products(own, kept))[1:]
    columns = [j + 1 for j in kept]
    heads = products.sums
    means, n = (heads[:, -1] - heads[:, columns] @ slopes) / heads[:, 0], heads[:, 0]
    _, group = np.unique(products.manoeuvre, return_inverse=True)
    size = np.bincount(group, n)
    of_group = np.bincount(group, n * means) / size
    freedom = size.size - 1, n.size - size.size
    if not freedom[1]:
        return True
    between = size @ (of_group - np.average(of_group, weights=size)) ** 2 / freedom[0]
    within = n @ (means - of_group[group]) ** 2 / freedom[1]
    return bool(between > within * scipy.stats.f.isf(SIGNIFICANCE, *freedom))


def slope_error(search: Search, within: CrossProducts) -> float:
    """Squared error of manoeuvres about their own means, each predicted by a selection without it."""
    total = 0.0
    for weights, kept, theta in search.without_folds:
        slopes = np.append(0.0, theta[1:])
        total += prediction_error(slopes, model_products(within, kept, 1.0 - weights))
    return total


def without_constants(
    manoeuvres: Sequence[DataSource],
    plain: Sequence[CrossProducts],
    models: Sequence[tuple[Array, Sequence[int]] | None],
) -> Sequence[DataSource]:
    """The manoeuvres less their own constants, of the responses for which a model is given.

    Parameters
    ----------
    plain : sequence of CrossProducts
        Of each response, with one constant.
    models : sequence of (scaled slopes, terms) or None
    """
    if not any(models):
        return manoeuvres
    table = np.zeros((len(manoeuvres), len(models)))
    for r, model in enumerate(models):
        if model is not None:
            slopes, kept = model
            table[:, r] = plain[r].constants(slopes, [j + 1 for j in kept]) * plain[r].scale[-1]
    return [WithoutConstants(m, row) for m, row in zip(manoeuvres, table, strict=True)]
