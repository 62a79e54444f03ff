"""Noise models and searches in turn: the iteration of Cochrane and Orcutt, with a selection in every round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.inclusion import moved_residuals
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
    centred,
    model_products,
    prediction_error,
    solve,
)
from structsel.selection.search_result import SearchResult

ROUNDS = 4  # of noise model and search; the terms stay the same after two almost always
SIGNIFICANCE = 0.01  # of the test that estimates differ
WORSE = 1.25  # ratio of squared errors of the fit from which it is asked whether noise can be why
POOL = 32, 0.2
"""Candidates that a pool takes from each of two rankings, and the fraction of all where that is more; of candidates up
to a lower degree half of the first, for the pilot search a quarter of either."""
LARGEST_POOL = 0.6  # of the candidates; the products cost the square of it
SPARSE, PARTS, SHORTEST_PART = 16, 4, 128
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
    of the next one, which usually confirms it. Where single moves decide, later rounds search only those that lower the
    residual most beside the terms of the last round or in the place of one: no other can come in if these do not.
    """
    choices = [Choice(search, result, (), False) for search, result in zip(plain, white_noise, strict=True)]
    pending = list(range(len(plain)))
    noise = fit_noise(data, choices, pending, shared)
    pilot = _pilot(data, choices, noise)
    if pilot is not None:
        searches = _search_only(data, plain, pending, noise, pilot)
        choices = [Choice(search, search.run(), models, False) for search, models in zip(searches, noise, strict=True)]
    pools = pilot is not None and data.options.moves_singly
    for number in range(ROUNDS):
        if number or pilot is not None:
            noise = fit_noise(data, choices, pending, shared)
        searches = _search_pool(data, plain, choices, pending, noise) if pools and number < ROUNDS - 1 else []
        searches = searches or _search_all(data, plain, pending, noise)
        for r, models, search in zip(list(pending), noise, searches, strict=True):
            result = search.run()
            converged = set(result.selected) == set(choices[r].result.selected)
            choices[r] = Choice(search, result, models, converged)
            if converged:
                pending.remove(r)
        if not pending:
            break
    return [_check_prewhitening(choice, search) for choice, search in zip(choices, plain, strict=True)]


def _search_all(
    data: EngineData, plain: Sequence[Search], responses: Sequence[int], noise: Sequence[Sequence[ARNoise]]
) -> list[Search]:
    """Searches of all candidates."""
    found = _prewhitened(data, responses, noise, data.exponents)
    return [replace(plain[r], products=_own_constants(of, plain[r])) for r, of in zip(responses, found, strict=True)]


def _search_pool(
    data: EngineData,
    plain: Sequence[Search],
    choices: Sequence[Choice],
    responses: Sequence[int],
    noise: Sequence[Sequence[ARNoise]],
) -> list[Search]:
    """Searches of those candidates that change the residual most; none where these are most of all.

    The products of all candidates with the terms of the choices are there too.
    """
    terms = [choices[r].result.selected for r in responses]
    count, pool = _pool_size(data), np.zeros(len(data.exponents), dtype=bool)
    found = _prewhitened(data, responses, noise, data.exponents, terms)
    every = [_own_constants(of, plain[r]) for r, of in zip(responses, found, strict=True)]
    for r, products, kept in zip(responses, every, terms, strict=True):
        search = replace(plain[r], products=products)
        pool |= _nearest(search, kept, count)
        for degree in np.unique(search.constraints.degrees)[:-1].tolist():
            pool |= _nearest(replace(search, degree=degree), kept, POOL[0] // 2)
    if pool.sum() > LARGEST_POOL * pool.size:
        return []
    return _search_only(data, plain, responses, noise, pool, every)


def _search_only(
    data: EngineData,
    plain: Sequence[Search],
    responses: Sequence[int],
    noise: Sequence[Sequence[ARNoise]],
    pool: NDArray[np.bool_],
    every: Sequence[CrossProducts] | None = None,
) -> list[Search]:
    """Searches of a pool; the other candidates have the products of ``every``, or none."""
    numbers = np.flatnonzero(pool)
    found = _prewhitened(data, responses, noise, data.exponents[numbers])
    others: Sequence[CrossProducts | None] = every or [None] * len(found)
    within = [
        _own_constants(of, plain[r]).among(numbers, plain[r].products.scale, other)
        for r, of, other in zip(responses, found, others, strict=True)
    ]
    return [replace(plain[r], products=of, pool=pool) for r, of in zip(responses, within, strict=True)]


def _prewhitened(
    data: EngineData,
    responses: Sequence[int],
    noise: Sequence[Sequence[ARNoise]],
    exponents: NDArray[np.integer],
    terms: Sequence[Sequence[int]] | None = None,
) -> list[CrossProducts]:
    """Prewhitened products of these candidates and responses."""
    return prewhitened_cross_products(
        [SelectedResponses(m, tuple(responses)) for m in data.manoeuvres],
        exponents,
        noise,
        terms=terms,
        scales=(data.scales[0], data.scales[1][list(responses)]),
        progress=data.stage("prewhitened"),
        **data.block_arguments,
    )


def _own_constants(products: CrossProducts, search: Search) -> CrossProducts:
    return products.within_manoeuvres() if search.products.own_constants else products


def _pool_size(data: EngineData) -> int:
    """Candidates that a pool takes from each ranking."""
    return max(POOL[0], int(POOL[1] * len(data.exponents)))


def _pilot(data: EngineData, choices: Sequence[Choice], noise: Sequence[Sequence[ARNoise]]) -> NDArray[np.bool_] | None:
    """(p,) candidates of a first search: that explain most in the unfiltered products, or in a part of the samples.

    None where these are most of all, or the data are short.
    """
    p, options, count = len(data.exponents), data.options, _pool_size(data)
    if 2 * count > LARGEST_POOL * p or options.criterion_used == "cv" or options.hierarchy != "none":
        return None
    parts, models = _in_parts(data.manoeuvres, noise)
    if not parts:
        return None
    some = _prewhitened(replace(data, manoeuvres=parts), range(len(choices)), models, data.exponents)
    pool = np.zeros(p, dtype=bool)
    for choice, products in zip(choices, some, strict=True):
        sparse = replace(choice.search, products=_own_constants(products, choice.search))
        pool |= _nearest(choice.search, choice.result.selected, count // 4)
        pool |= _nearest(sparse, sparse.run().selected, count // 4)
    return pool if pool.sum() <= LARGEST_POOL * p else None


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


def _nearest(search: Search, selected: Sequence[int], count: int) -> NDArray[np.bool_]:
    """(p,) the terms selected or given, and the candidates by which the residual sum of squares is least.

    As many as ``count`` beside the terms, and as many in the place of one, of each term the same number.
    """
    C = centred(search.products.total())
    pool = np.zeros(search.hidden.size, dtype=bool)
    pool[[*selected, *search.constraints.include, *search.constraints.initial]] = True
    pool &= ~search.hidden
    kept = np.flatnonzero(pool)
    outside = np.flatnonzero(~pool & ~search.hidden & (np.diag(C)[:-1] > 0.0))
    _, _, beside, exchanged = moved_residuals(C, kept, outside)
    pool[outside[np.argsort(beside, kind="stable")[:count]]] = True
    for rss in exchanged:
        pool[outside[np.argsort(rss, kind="stable")[: -(-count // kept.size)]]] = True
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
