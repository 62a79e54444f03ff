"""Selection on arrays: noise models and search in turn, then the fit, aliases, cross-validation and bootstrap.

Candidates are rows of a table of exponents. `structsel.selection.select` puts names on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, choose_workers
from structsel.numerics.collinearity import ConditionIndices, condition_indices, vif
from structsel.numerics.cross_products import CrossProducts, cross_products, prewhitened_cross_products, project
from structsel.numerics.least_squares import LeastSquaresFit, fit_each
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import DataSource, Scales, find_scales
from structsel.numerics.residuals import fit_residual_noise, streamed_coloured_covariance
from structsel.selection.biased import estimate_biased
from structsel.selection.data import SelectedResponses
from structsel.selection.methods import SearchConstraints
from structsel.selection.resampling import Bootstrap, CrossValidation, bootstrap_selection, cross_validate
from structsel.selection.search import (
    ROUNDING,
    AliasedPair,
    Search,
    SearchResult,
    centred,
    find_aliases,
    find_dependent,
    fold_blocks,
    prediction_error,
    solve,
    weights_without,
)
from structsel.selection.settings import SelectOptions

ROUNDS = 4  # of noise model and search; the terms stay the same after two almost always
WORSE = 1.25  # squared error of the fit from which prewhitening is dropped, if cross-validation agrees
MANY_BLOCKS, FEW_BLOCKS = 32, 12  # kept apart, for resampling and tests between blocks
MANY_UP_TO = 200  # candidates; above it blocks take much memory
FEW_TERMS = 30  # that a pass over selected terms is taken to have
LEAST_INNOVATION = 1e-10  # of the response's scale

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ArraySelection:
    """Selection of one response, candidates by number.

    Attributes
    ----------
    search, white_noise : SearchResult
        With the noise model used, and with white noise.
    dependent : tuple of int
        Candidates that are constant, or explained by the selected ones.
    noise : tuple of ARNoise
        One per manoeuvre; empty without prewhitening.
    cluster_robust : bool
        Tests took the scatter between blocks.
    n_blocks : int
    converged : bool
        False where terms and noise models did not agree after the last round.
    prewhitening_dropped : (float, float), optional
        Cross-validation sums of squares with prewhitening and with the search used instead.
    fit : LeastSquaresFit
    values, covariance : (1 + k,) array, (1 + k, 1 + k) array
        The constant first.
    biased : str
        How, where the estimate is biased; else empty.
    vif : (k,) array
    conditioning : ConditionIndices
    white_noise_covariance : (1 + k, 1 + k) array
    r2, rms, n
        Of the response itself.
    aliases : tuple of AliasedPair
    cross_validation : CrossValidation or None
    bootstrap : Bootstrap or None
    """

    search: SearchResult
    white_noise: SearchResult
    dependent: tuple[int, ...]
    noise: tuple[ARNoise, ...]
    cluster_robust: bool
    n_blocks: int
    converged: bool
    prewhitening_dropped: tuple[float, float] | None
    fit: LeastSquaresFit
    values: Array
    covariance: Array
    biased: str
    vif: Array
    conditioning: ConditionIndices
    white_noise_covariance: Array
    r2: float
    rms: float
    n: int
    aliases: tuple[AliasedPair, ...]
    cross_validation: CrossValidation | None
    bootstrap: Bootstrap | None


def select_arrays(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    options: SelectOptions,
    include: Sequence[int] = (),
    initial: Sequence[int] = (),
    progress: Progress | None = None,
    *,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
) -> list[ArraySelection]:
    """Select the terms of every response of these manoeuvres.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
    exponents : (p, s) int array
    options : SelectOptions
    include, initial : sequence of int
        Candidates always in the model, and in it at the start.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    scales : (s,) array, (m,) array, optional
        Of base signals and responses, where they are known.
    runner : JobRunner, optional
        Who goes through the data; this process where absent.

    Returns
    -------
    list of ArraySelection
        One per response.
    """
    exponents = np.asarray(exponents)
    data = _EngineData(
        manoeuvres, exponents, options, scales or find_scales(manoeuvres), runner or JobRunner(), progress
    )
    plain = cross_products(
        manoeuvres,
        exponents,
        blocks=data.blocks,
        workers=options.workers,
        progress=data.stage("cross-products"),
        **data.given,
    )
    constraints = SearchConstraints(exponents.sum(axis=1), tuple(include), tuple(initial))
    folds = fold_blocks(plain)
    searches = [Search(plain.of_response(r), options, constraints, folds) for r in range(plain.n_responses)]
    white_noise = [search.run() for search in searches]
    if options.noise == "white":
        chosen = [_Choice(search, result) for search, result in zip(searches, white_noise, strict=True)]
    elif options.noise == "cluster":
        chosen = [_cluster_robust(search) for search in searches]
    else:
        chosen = _iterate_prewhitening(data, searches, white_noise)
    fits = fit_each(
        manoeuvres,
        [exponents[list(c.result.selected)] for c in chosen],
        [c.noise or None for c in chosen],
        range(len(chosen)),
        workers=data.workers,
        progress=data.stage("fit"),
        **data.given,
    )
    return [
        _describe(r, data, searches[r].products, white_noise[r], chosen[r], fits[r]) for r in range(plain.n_responses)
    ]


@dataclass(frozen=True)
class _EngineData:
    """What is read, by whom, with what progress."""

    manoeuvres: Sequence[DataSource]
    exponents: NDArray[np.integer]
    options: SelectOptions
    scales: Scales
    runner: JobRunner
    progress: Progress | None

    @property
    def blocks(self) -> int:
        """How many to keep apart."""
        return MANY_BLOCKS if len(self.exponents) <= MANY_UP_TO else FEW_BLOCKS

    @property
    def workers(self) -> int:
        """Threads for passes over the selected terms."""
        return choose_workers(self.options.workers, sum(m.n for m in self.manoeuvres), FEW_TERMS)

    @property
    def given(self) -> dict[str, Any]:
        """Arguments of every pass."""
        return {"scales": self.scales, "runner": self.runner}

    def stage(self, name: str) -> Callable[[int, int], None] | None:
        """Progress of one pass."""
        progress = self.progress
        return None if progress is None else lambda done, of: progress(name, done, of)


@dataclass(frozen=True)
class _Choice:
    """The search whose result is used; see `ArraySelection` for the other fields."""

    search: Search
    result: SearchResult
    noise: tuple[ARNoise, ...] = ()
    converged: bool = True
    prewhitening_dropped: tuple[float, float] | None = None


def _cluster_robust(plain: Search) -> _Choice:
    """Ordinary least squares with tests between blocks."""
    search = replace(plain, cluster_robust=True)
    return _Choice(search, search.run())


def _iterate_prewhitening(data: _EngineData, plain: list[Search], white_noise: list[SearchResult]) -> list[_Choice]:
    """Fit a noise model to each manoeuvre's residual, prewhiten, search; again until the terms stay the same.

    This is the iteration of Cochrane and Orcutt, with a selection in every round.
    """
    choices = [_Choice(search, result, (), False) for search, result in zip(plain, white_noise, strict=True)]
    pending = list(range(len(plain)))
    for _ in range(ROUNDS):
        noise = _fit_noise(data, [choices[r] for r in pending], pending)
        products = prewhitened_cross_products(
            [SelectedResponses(m, tuple(pending)) for m in data.manoeuvres],
            data.exponents,
            noise,
            blocks=data.blocks,
            workers=data.options.workers,
            progress=data.stage("prewhitened"),
            scales=(data.scales[0], data.scales[1][pending]),
            runner=data.runner,
        )
        for r, models, prewhitened in zip(list(pending), noise, products, strict=True):
            search = replace(plain[r], products=prewhitened)
            result = search.run()
            converged = set(result.selected) == set(choices[r].result.selected)
            choices[r] = _Choice(search, result, models, converged)
            if converged:
                pending.remove(r)
        if not pending:
            break
    return [_check_prewhitening(choice, search) for choice, search in zip(choices, plain, strict=True)]


def _fit_noise(data: _EngineData, choices: Sequence[_Choice], responses: Sequence[int]) -> list[tuple[ARNoise, ...]]:
    """Noise models of the residuals of each choice, manoeuvre by manoeuvre."""
    terms, theta, floors = [], [], []
    for choice in choices:
        products, kept = choice.search.products, list(choice.result.selected)
        scale = products.scale
        theta.append(solve(products.total(), kept) * scale[-1] / scale[[0, *(j + 1 for j in kept)]])
        terms.append(data.exponents[kept])
        floors.append(LEAST_INNOVATION * float(scale[-1]))
    return fit_residual_noise(
        data.manoeuvres,
        terms,
        theta,
        responses,
        data.options.max_ar_order,
        floors,
        workers=data.workers,
        progress=data.stage("noise models"),
        **data.given,
    )


def _check_prewhitening(choice: _Choice, plain: Search) -> _Choice:
    """Drop prewhitening where it describes the response clearly worse than least squares, and predicts it worse.

    With coloured noise both are right; where prewhitening is worse the residual is model error, not noise.
    """
    if not plain.folds:
        return choice
    other = _cluster_robust(plain)
    total = plain.products.total()
    errors = [
        prediction_error(solve(c.search.products.total(), c.result.selected), c.result.selected, total)
        for c in (choice, other)
    ]
    if errors[0] <= max(WORSE * errors[1], ROUNDING * total[-1, -1]):
        return choice
    with_it, without = (cross_validate(c.search, plain.products) for c in (choice, other))
    if with_it is None or without is None or with_it.sse.sum() <= without.sse.sum():
        return choice
    return replace(other, prewhitening_dropped=(float(with_it.sse.sum()), float(without.sse.sum())))


def _describe(
    response: int,
    data: _EngineData,
    plain: CrossProducts,
    white_noise: SearchResult,
    choice: _Choice,
    fit: LeastSquaresFit,
) -> ArraySelection:
    """Values, errors, and how far the terms selected can be trusted."""
    result, search, products = choice.result, choice.search, choice.search.products
    options = search.options
    kept = list(result.selected)
    rows = [0, *(j + 1 for j in kept)]
    values, label = fit.theta, ""
    if choice.noise:
        covariance = fit.covariance
    else:
        covariance = streamed_coloured_covariance(
            data.manoeuvres, data.exponents[kept], fit, response, workers=data.workers, **data.given
        )
    total, scale = plain.total(), plain.scale
    if options.estimate != "least_squares" and kept:
        weights = [weights_without(products, fold) for fold in search.folds]
        pairs = [(products.total(w), products.total(1.0 - w)) for w in weights]
        values, covariance, label = estimate_biased(products.total(), products.samples(), kept, scale, options, pairs)
    sse = prediction_error(values * scale[rows] / scale[-1], kept, total)
    ordinary = project(total, rows)
    s2 = ordinary.rss / max(plain.samples() - len(rows), 1)
    C, searched = centred(total), centred(products.total())
    return ArraySelection(
        search=result,
        white_noise=white_noise,
        dependent=find_dependent(searched, kept),
        noise=choice.noise,
        cluster_robust=search.cluster_robust,
        n_blocks=products.n_blocks,
        converged=choice.converged,
        prewhitening_dropped=choice.prewhitening_dropped,
        fit=fit,
        values=values,
        covariance=covariance,
        biased=label,
        vif=vif(C[np.ix_(kept, kept)]) if kept else np.empty(0),
        conditioning=condition_indices(total[np.ix_(rows, rows)]),
        white_noise_covariance=s2 * ordinary.inverse * scale[-1] ** 2 / np.outer(scale[rows], scale[rows]),
        r2=1.0 - sse / C[-1, -1],
        rms=float(np.sqrt(sse / plain.samples()) * scale[-1]),
        n=int(plain.samples()),
        aliases=tuple(find_aliases(searched, result.selected, result.effective_dof)),
        cross_validation=cross_validate(search, plain),
        bootstrap=bootstrap_selection(search, result, data.stage("bootstrap")),
    )
