"""Selection on arrays: noise models and search in turn, then the fit, aliases, cross-validation and bootstrap.

Candidates are rows of a table of exponents. `structsel.selection.select` puts names on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner
from structsel.numerics.collinearity import condition_indices, vif
from structsel.numerics.coloured_fit import fit_of_products, streamed_coloured_covariance
from structsel.numerics.cross_products import CrossProducts, cross_products
from structsel.numerics.hierarchy import Hierarchy, find_parents
from structsel.numerics.least_squares import LeastSquaresFit, fit_each
from structsel.numerics.normal_equations import project
from structsel.numerics.regressors import DataSource, Scales, find_scales
from structsel.selection.aliases import find_aliases, find_dependent
from structsel.selection.array_selection import ArraySelection
from structsel.selection.biased import estimate_biased
from structsel.selection.causal import constants_of_past, use_past
from structsel.selection.choices import NO_FLOW_ANGLES, Choice, EngineData, FlowAngles, Progress
from structsel.selection.constants import choose_constants
from structsel.selection.heterogeneity import Heterogeneity, find_heterogeneity
from structsel.selection.methods import SearchConstraints
from structsel.selection.parsimony import find_simplest, linear_search
from structsel.selection.prewhitening import cluster_robust, iterate_prewhitening
from structsel.selection.resampling import bootstrap_selection, cross_validate
from structsel.selection.search import (
    Search,
    centred,
    fold_blocks,
    model_products,
    prediction_error,
    solve,
    weights_without,
)
from structsel.selection.search_result import SearchResult
from structsel.selection.settings import SelectOptions


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
    companions: Sequence[DataSource] = (),
    flow_angles: FlowAngles = NO_FLOW_ANGLES,
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
    companions : sequence of DataSource
        The manoeuvres with further responses, whose residuals show what acts on several responses at once.
    flow_angles : FlowAngles
        In which turbulence shows.

    Returns
    -------
    list of ArraySelection
        One per response.
    """
    exponents = np.asarray(exponents)
    data = EngineData(
        manoeuvres,
        exponents,
        options,
        scales or find_scales(manoeuvres),
        runner or JobRunner(),
        progress,
        companions,
        flow_angles,
    )
    plain = cross_products(
        manoeuvres,
        exponents,
        scales=data.scales,
        progress=data.stage("cross-products"),
        **data.block_arguments,
    )
    constraints = SearchConstraints(
        exponents.sum(axis=1), tuple(include), tuple(initial), _hierarchy(exponents, options, include)
    )
    folds = fold_blocks(plain)
    shared = [Search(plain.of_response(r), options, constraints, folds) for r in range(plain.n_responses)]
    searches = [choose_constants(search) for search in shared]
    white_noise = [search.result for search in searches]
    if options.noise == "white":
        chosen = [Choice(search, result) for search, result in zip(searches, white_noise, strict=True)]
    elif options.noise == "cluster":
        chosen = [cluster_robust(search) for search in searches]
    else:
        chosen = iterate_prewhitening(data, searches, white_noise, [s.products for s in shared])
    chosen = use_past(data, [_simplest(choice) for choice in chosen], [s.products for s in shared])
    fits = _fits(data, chosen, [s.products for s in shared])
    return [
        _describe(data, searches[r].products, shared[r].products, white_noise[r], chosen[r], *fits[r])
        for r in range(plain.n_responses)
    ]


def _fits(
    data: EngineData, chosen: Sequence[Choice], shared: Sequence[CrossProducts]
) -> list[tuple[LeastSquaresFit, Array]]:
    """Fit and covariance of the terms chosen for each response, on the rows as sampled or on what the past predicts."""
    passes: dict[str, Any] = {"workers": data.workers, **data.given}
    terms = [choice.result.selected for choice in chosen]
    found: dict[int, tuple[LeastSquaresFit, Array]] = {}
    for r, choice in enumerate(chosen):
        if not choice.noise and choice.past is None:
            known = choice.search.products, shared[r], terms[r]
            fit = fit_of_products(data.manoeuvres, data.exponents, *known, r, progress=data.stage("fit"), **passes)
            if fit is not None:
                found[r] = fit
    fits = _streamed_fits(data, chosen, [r for r in range(len(chosen)) if r not in found and chosen[r].past is None])
    weights = np.array([m.n for m in data.manoeuvres]) / sum(m.n for m in data.manoeuvres)
    for r, choice in enumerate(chosen):
        if choice.past is not None:
            fits[r] = choice.past.fit(constants_of_past(choice, shared[r]), weights)
    for r, one in fits.items():
        if chosen[r].noise:
            found[r] = one, one.covariance
        else:
            exponents = data.exponents[list(terms[r])]
            found[r] = one, streamed_coloured_covariance(data.manoeuvres, exponents, one, r, **passes)
    return [found[r] for r in range(len(chosen))]


def _streamed_fits(data: EngineData, chosen: Sequence[Choice], sampled: Sequence[int]) -> dict[int, LeastSquaresFit]:
    """The fit of these responses by triangular factors, in one pass."""
    found = (
        fit_each(
            data.manoeuvres,
            [data.exponents[list(chosen[r].result.selected)] for r in sampled],
            [chosen[r].noise or None for r in sampled],
            sampled,
            own_constants=[chosen[r].search.products.own_constants for r in sampled],
            workers=data.workers,
            progress=data.stage("fit"),
            **data.given,
        )
        if sampled
        else []
    )
    return dict(zip(sampled, found, strict=True))


def _hierarchy(exponents: NDArray[np.integer], options: SelectOptions, include: Sequence[int]) -> Hierarchy | None:
    """Parents that the terms need, those included excepted."""
    if options.hierarchy == "none":
        return None
    return Hierarchy(find_parents(exponents), options.hierarchy == "strong").without(include)


def _simplest(choice: Choice) -> Choice:
    """The choice, or a simpler one that predicts as well."""
    options = choice.search.options
    if options.parsimony == "none" or options.criterion is not None:
        return choice
    found = find_simplest(choice.search, choice.result)
    if not found.reason:
        return choice
    result = replace(found.result, stop_reason=f"{found.result.stop_reason}; {found.reason}")
    return replace(choice, search=found.search, result=result)


def _describe(
    data: EngineData,
    plain: CrossProducts,
    shared: CrossProducts,
    white_noise: SearchResult,
    choice: Choice,
    fit: LeastSquaresFit,
    covariance: Array,
) -> ArraySelection:
    """Values, errors, and how far the terms selected can be trusted.

    `plain` are the products of what is described, without a constant of each manoeuvre where each has its own; `shared`
    are those with one constant.
    """
    result, search, products = choice.result, choice.search, choice.search.products
    options = search.options
    kept = list(result.selected)
    rows = [0, *(j + 1 for j in kept)]
    values, label = fit.theta, ""
    total, scale = plain.total(), plain.scale
    if options.estimate != "least_squares" and kept:
        weights = [weights_without(products, fold) for fold in search.folds]
        pairs = [(products.total(w), products.total(1.0 - w)) for w in weights]
        values, covariance, label = estimate_biased(products.total(), products.samples(), kept, scale, options, pairs)
    scaled, constants = values * scale[rows] / scale[-1], fit.constants
    if plain.own_constants:
        if label:
            constants = shared.constants(scaled[1:], rows[1:]) * scale[-1]
            values = np.append(np.average(constants, weights=[m.n for m in data.manoeuvres]), values[1:])
        scaled[0] = 0.0
    sse = prediction_error(scaled, total, kept)
    ordinary = project(total, rows)
    s2 = ordinary.rss / max(plain.dof() - len(kept), 1)
    C, searched = centred(total), centred(products.total())
    linear = linear_search(search)
    return ArraySelection(
        search=result,
        white_noise=white_noise,
        dependent=find_dependent(searched, kept),
        noise=choice.noise,
        causal=choice.past is not None,
        exogeneity=choice.past.test_exogeneity() if choice.past is not None else None,
        instruments=choice.past.test_instruments() if choice.past is not None else None,
        cluster_robust=search.cluster_robust,
        n_blocks=products.n_blocks,
        converged=choice.converged,
        prewhitening_dropped=choice.prewhitening_dropped,
        fit=fit,
        values=values,
        constants=constants,
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
        bootstrap=bootstrap_selection(_searched(search), result, data.stage("bootstrap")),
        linear=cross_validate(linear, plain) if linear is not None else None,
        linear_terms=frozenset(linear.run().selected) if linear is not None else frozenset(),
        heterogeneity=None if label else _heterogeneity(choice),
    )


def _searched(search: Search) -> Search:
    """The search to repeat on resampled blocks: among the linear terms, where all of them were given."""
    return search if search.fixed is None else replace(search, fixed=None, degree=1)


def _heterogeneity(choice: Choice) -> Heterogeneity | None:
    """Values of the kept terms between manoeuvres, in units of the response."""
    products, kept = choice.search.products, choice.result.selected
    scale = products.scale[[j + 1 for j in kept]] / products.scale[-1]
    if choice.past is not None:
        products, kept = choice.past.products, choice.past.terms
    theta = solve(model_products(products, kept))
    rss = choice.result.rss if choice.past is None else choice.past.rss
    s2 = rss / max(products.dof() - len(kept), 1.0)
    found = find_heterogeneity(products, kept, theta, s2)
    if found is None:
        return None
    return replace(found, added_variance=found.added_variance / scale**2, deviation=found.deviation / scale[:, None])
