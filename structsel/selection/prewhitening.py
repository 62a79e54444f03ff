"""Noise models and searches in turn: the iteration of Cochrane and Orcutt, with a selection in every round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.inclusion import DEPENDENT
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.normal_equations import least_rss, project
from structsel.numerics.prewhitened_products import prewhitened_cross_products
from structsel.numerics.regressors import DataSource
from structsel.selection.choices import Choice, EngineData, fit_noise
from structsel.selection.data import SelectedResponses
from structsel.selection.resampling import cross_validate
from structsel.selection.search import (
    ROUNDING,
    Search,
    SearchResult,
    centred,
    model_products,
    prediction_error,
    solve,
)

ROUNDS = 4  # of noise model and search; the terms stay the same after two almost always
SIGNIFICANCE = 0.01  # of the test that estimates differ
WORSE = 1.25  # ratio of squared errors of the fit from which it is asked whether noise can be why
PILOT = 32, 0.2
"""Candidates that a pilot search takes from each of two rankings, and the fraction of all where that is more. The first
is that of the unfiltered products, the second that of prewhitened products of a part of the samples."""
LARGEST_PILOT = 0.5  # of the candidates; the products cost the square of it
SPARSE, PARTS, SHORTEST_PART = 8, 4, 256
"""One sample in so many is in a part; parts of each manoeuvre; samples of the shortest part."""


@dataclass(frozen=True)
class PartOfData:
    """Consecutive samples of a manoeuvre."""

    source: DataSource
    first: int
    last: int

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.last - self.first

    def base(self, start: int, stop: int) -> Array:
        """Base signals of these samples."""
        return self.source.base(self.first + start, self.first + stop)

    def responses(self, start: int, stop: int) -> Array:
        """Responses of these samples."""
        return self.source.responses(self.first + start, self.first + stop)


def cluster_robust(plain: Search) -> Choice:
    """Ordinary least squares with tests between blocks."""
    search = replace(plain, cluster_robust=True)
    return Choice(search, search.run())


def iterate_prewhitening(
    data: EngineData, plain: list[Search], white_noise: list[SearchResult], shared: list[CrossProducts]
) -> list[Choice]:
    """Fit a noise model to each manoeuvre's residual, prewhiten, search; again until the terms stay the same.

    The first round searches the candidates that explain most of the residual only: what it finds makes the noise model
    of the first complete round, which usually confirms it.
    """
    choices = [Choice(search, result, (), False) for search, result in zip(plain, white_noise, strict=True)]
    pending = list(range(len(plain)))
    noise = fit_noise(data, choices, pending, shared)
    piloted = _pilot(data, choices, noise)
    for number in range(ROUNDS):
        if number:
            noise = fit_noise(data, choices, pending, shared)
        elif piloted:
            again = fit_noise(data, [piloted.get(r, choice) for r, choice in enumerate(choices)], list(piloted), shared)
            noise = [dict(zip(piloted, again, strict=True)).get(r, models) for r, models in enumerate(noise)]
            choices = [piloted.get(r, choice) for r, choice in enumerate(choices)]
        products = _prewhitened(data, pending, noise, data.exponents)
        for r, models, prewhitened in zip(list(pending), noise, products, strict=True):
            search = replace(plain[r], products=_own_constants(prewhitened, plain[r]))
            result = search.run()
            converged = set(result.selected) == set(choices[r].result.selected)
            choices[r] = Choice(search, result, models, converged)
            if converged:
                pending.remove(r)
        if not pending:
            break
    return [_check_prewhitening(choice, search) for choice, search in zip(choices, plain, strict=True)]


def _prewhitened(
    data: EngineData, responses: Sequence[int], noise: Sequence[Sequence[ARNoise]], exponents: NDArray[np.integer]
) -> list[CrossProducts]:
    """Prewhitened products of these candidates and responses."""
    return prewhitened_cross_products(
        [SelectedResponses(m, tuple(responses)) for m in data.manoeuvres],
        exponents,
        noise,
        scales=(data.scales[0], data.scales[1][list(responses)]),
        progress=data.stage("prewhitened"),
        **data.block_arguments,
    )


def _own_constants(products: CrossProducts, search: Search) -> CrossProducts:
    return products.within_manoeuvres() if search.products.own_constants else products


def _pilot(data: EngineData, choices: Sequence[Choice], noise: Sequence[Sequence[ARNoise]]) -> dict[int, Choice]:
    """Choices of a search among the candidates that explain most, where they differ from those given, by response."""
    p, options, everyone = len(data.exponents), data.options, range(len(choices))
    count = max(PILOT[0], int(PILOT[1] * p))
    if 2 * count > LARGEST_PILOT * p or options.criterion_used == "cv" or options.hierarchy != "none":
        return {}
    parts, models = _in_parts(data.manoeuvres, noise)
    if not parts:
        return {}
    some = _prewhitened(replace(data, manoeuvres=parts), everyone, models, data.exponents)
    pool = np.zeros(p, dtype=bool)
    for choice, products in zip(choices, some, strict=True):
        sparse = replace(choice.search, products=_own_constants(products, choice.search))
        pool |= _best_explaining(choice.search, choice.result, count) | _best_explaining(sparse, sparse.run(), count)
    numbers = np.flatnonzero(pool)
    if numbers.size > LARGEST_PILOT * p:
        return {}
    found = {}
    columns = np.concatenate([[0], 1 + numbers, [1 + p]])
    for r, products in enumerate(_prewhitened(data, everyone, noise, data.exponents[numbers])):
        search, inside = choices[r].search, np.zeros((p + 2, p + 2))
        inside[np.ix_(columns, columns)] = _own_constants(products, search).total()
        result = search.run(C=centred(inside))  # candidates that are constant zero are not searched
        if set(result.selected) != set(choices[r].result.selected):
            found[r] = Choice(search, result, (), False, scaled=solve(inside, result.selected))
    return found


def _in_parts(
    manoeuvres: Sequence[DataSource], noise: Sequence[Sequence[ARNoise]]
) -> tuple[list[PartOfData], list[list[ARNoise]]]:
    """Parts spread over the manoeuvres, with the noise models of theirs; none where they would be short."""
    parts: list[PartOfData] = []
    models: list[list[ARNoise]] = [[] for _ in noise]
    for k, manoeuvre in enumerate(manoeuvres):
        length = manoeuvre.n // (PARTS * SPARSE)
        if length < SHORTEST_PART:
            return [], []
        for i in range(PARTS):
            start = (2 * i + 1) * manoeuvre.n // (2 * PARTS) - length // 2
            parts.append(PartOfData(manoeuvre, start, start + length))
            for of, given in zip(models, noise, strict=True):
                of.append(given[k])
    return parts, models


def _best_explaining(search: Search, result: SearchResult, count: int) -> NDArray[np.bool_]:
    """(p,) whether a candidate is chosen, given, or among those that explain most of what the chosen ones leave."""
    product, kept = search.products.total(), list(result.selected)
    rows = [0, *(1 + j for j in kept)]
    on = project(product, rows)
    left, with_response = on.remaining[1:-1], (product[-1] - product[rows, -1] @ on.coefficients)[1:-1]
    varies = left > DEPENDENT * np.diag(product)[1:-1]
    explained = np.where(varies, with_response**2 / np.where(varies, left, 1.0), 0.0)
    always = [*kept, *search.constraints.include, *search.constraints.initial]
    explained[always] = np.inf
    pool = np.zeros(explained.size, dtype=bool)
    pool[np.argsort(-explained, kind="stable")[: max(count, len(set(always)))]] = True
    return pool


def _check_prewhitening(choice: Choice, plain: Search) -> Choice:
    """Drop prewhitening where it describes the response clearly worse than least squares, and noise cannot be why.

    With coloured noise both are right; where prewhitening is worse the residual is model error, not noise. That is so
    if it predicts worse as well, or if the parameters differ by more than noise would cause.
    """
    if not plain.folds:
        return choice
    total = plain.products.total()

    def error(of: Choice) -> float:
        kept = of.result.selected
        return prediction_error(solve(model_products(of.search.products, kept)), total, kept)

    with_noise_model, rounding = error(choice), ROUNDING * float(total[-1, -1])
    if with_noise_model <= max(WORSE * least_rss(total), rounding):  # whatever terms the other search selects
        return choice
    other = cluster_robust(plain)
    without = error(other)
    if with_noise_model <= max(WORSE * without, rounding):
        return choice
    if not _predicts_worse(choice, other, plain.products) and not _estimates_differ(choice, other):
        return choice
    return replace(other, prewhitening_dropped=(with_noise_model, without))


def _predicts_worse(choice: Choice, other: Choice, plain: CrossProducts) -> bool:
    """Whether the choice has the larger cross-validation error."""
    first, second = (cross_validate(c.search, plain) for c in (choice, other))
    return first is not None and second is not None and bool(first.sse.sum() > second.sse.sum())


def _estimates_differ(choice: Choice, other: Choice) -> bool:
    """Whether the slopes of the other's terms differ with and without prewhitening by more than noise would cause.

    Noise alone leaves both estimates without bias (the specification test of [H78]). The covariance is that of least
    squares from its scatter between blocks, which is larger than that of the difference.
    """
    kept, products = list(other.result.selected), other.search.products
    b, k = products.n_blocks, len(kept)
    if not k or b <= k + 1:
        return False
    columns = [*([] if products.own_constants else [0]), *(1 + j for j in kept)]
    blocks = products.parts([*columns, products.scale.size - 1])
    fit = project(blocks.sum(axis=0), range(len(columns)))
    theta = fit.coefficients[:, -1]
    scores = blocks[:, :-1, -1] - blocks[:, :-1, :-1] @ theta
    covariance = (fit.inverse @ (scores.T @ scores) @ fit.inverse)[-k:, -k:]
    difference = solve(model_products(choice.search.products, kept))[1:] - theta[-k:]
    F = float(difference @ np.linalg.pinv(covariance, hermitian=True) @ difference) * (b - k) / (k * b)
    return bool(scipy.stats.f.sf(F, k, b - k) < SIGNIFICANCE)
