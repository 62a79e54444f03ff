"""One search of one set of cross-products, and its repetition with other weights of the blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics import criteria
from structsel.numerics.arrays import Array
from structsel.numerics.cluster_stepwise import samples_per_independent_sample
from structsel.numerics.cross_products import CONSTANT, CrossProducts, columns_of, diagonal_places, places
from structsel.numerics.inclusion import DEPENDENT
from structsel.numerics.normal_equations import centre, centre_triangle, project, solve_normal_equations
from structsel.numerics.search_path import SearchStep
from structsel.numerics.stepwise import stepwise
from structsel.selection.methods import METHODS, SearchConstraints, SearchProblem
from structsel.selection.methods.method import Model
from structsel.selection.search_result import SearchResult, drop_correlated_terms, prefer_lower_degree
from structsel.selection.settings import SelectOptions

Fold = tuple[Array, Array]
"""Products [1, x, y] of the samples to fit, and of those to predict."""

ROUNDING = 1e-12  # of the response's sum of squares: a residual below it is rounding, and no model is better for it
FOLDS_WITHIN = 4  # parts left out in turn where there is a single manoeuvre
MAX_FOLDS = 12
SUMS_TOGETHER = 4  # weighted sums of the blocks formed by one matrix product; each has the size of a block


class Repetition(NamedTuple):
    """What a search with other weights of the blocks found: terms, and their parameters, scaled as the products.

    ``C`` are the centred products of the candidates searched, by whose numbers ``result`` has its terms.
    """

    selected: tuple[int, ...]
    theta: Array
    C: Array
    result: SearchResult


@dataclass(frozen=True)
class Search:
    """Everything a search needs, so that it can be repeated with other weights of the same blocks.

    Attributes
    ----------
    products : CrossProducts
        Of one response; prewhitened, or not.
    options : SelectOptions
    constraints : SearchConstraints
    folds : sequence of (b,) int array
        Blocks of each manoeuvre (or part) that may be left out.
    cluster_robust : bool
        F-tests take the scatter between blocks; methods without F-tests choose by cross-validation.
    degree : int, optional
        Candidates up to this degree are searched.
    fixed : tuple of int, optional
        Terms that are given instead of searched.
    pool : (p,) bool array, optional
        Candidates that are searched, of all on whose number thresholds depend: those whose products with one another
        are known. The products of the others with one another may be anything.
    n_candidates : int, optional
        On which thresholds depend; by default all of the products.
    """

    products: CrossProducts
    options: SelectOptions
    constraints: SearchConstraints
    folds: Sequence[NDArray[np.int64]]
    cluster_robust: bool = False
    degree: int | None = None
    fixed: tuple[int, ...] | None = None
    pool: NDArray[np.bool_] | None = None
    n_candidates: int | None = None

    @cached_property
    def _of_degree(self) -> NDArray[np.bool_]:
        """(p,) candidates that may be in a model by their degree."""
        degrees = self.constraints.degrees
        usable = np.ones(degrees.size, dtype=bool) if self.degree is None else degrees <= self.degree
        usable[list(self.constraints.include)] = True
        return usable

    @cached_property
    def hidden(self) -> NDArray[np.bool_]:
        """(p,) candidates that are not searched."""
        return ~self._of_degree if self.pool is None else ~(self._of_degree & self.pool)

    @cached_property
    def result(self) -> SearchResult:
        """Of all blocks."""
        return self.run()

    @cached_property
    def without_folds(self) -> tuple[tuple[Array, tuple[int, ...], Array], ...]:
        """For each fold: weights of the others, the terms selected from them, and their scaled parameters."""
        weights = [weights_without(self.products, fold) for fold in self.folds]
        if not weights:
            return ()
        if self.fixed is None:
            return tuple((w, r.selected, r.theta) for w, r in zip(weights, self.repeat(np.array(weights)), strict=True))
        blocks, found = self.products.parts(columns_of(self.products.scale.size, self.fixed)), []
        for w, part in zip(weights, np.tensordot(np.array(weights), blocks, 1), strict=True):
            columns = _independent(centred(part), self.fixed)
            found.append((w, tuple(self.fixed[i] for i in columns), solve(part, columns)))
        return tuple(found)

    @cached_property
    def visible(self) -> tuple[NDArray[np.int64], Search]:
        """Numbers of the candidates that are searched, and the search among them."""
        numbers = np.flatnonzero(~self.hidden)
        if numbers.size == self.hidden.size:
            return numbers, self
        products, constraints = self.products.of_candidates(numbers), self.constraints.of_candidates(numbers)
        count = int(self._of_degree.sum())
        return numbers, replace(
            self, products=products, constraints=constraints, degree=None, pool=None, n_candidates=count
        )

    def run(self, weights: Array | None = None, C: Array | None = None) -> SearchResult:
        """Search the weighted sum of blocks; blocks of weight zero are not seen.

        C is that sum centred, of `visible`, where it is there already.
        """
        options = self.options
        if self.cluster_robust and self.folds and not METHODS[options.method].cluster_robust:
            options = replace(options, criterion="cv", sigma_max="response")
        w = np.ones(self.products.n_blocks) if weights is None else weights
        pairs = []
        if options.criterion_used == "cv":
            for fold in self.folds:
                inside = np.isin(np.arange(w.size), fold)
                if w[inside].any():
                    pairs.append((self.products.total(w * ~inside), self.products.total(w * inside)))
        if self.fixed is not None:
            part = model_products(self.products, self.fixed, weights)
            return _given(centred(part), self.fixed, self.products.dof(weights))
        if self.hidden.any():
            numbers, visible = self.visible
            return visible.run(weights, C).numbered(numbers)
        if C is None:
            C = centred_triangle(self.products.packed_total(weights), self.products.scale.size)
        problem = _pose(
            C,
            self.products.dof(weights),
            options,
            self.constraints,
            self.n_candidates or self.constraints.degrees.size,
            float(self.products.scale[-1]),
            (self.products, weights) if self.cluster_robust else None,
        )
        result = _choose(problem, pairs)
        return prefer_lower_degree(drop_correlated_terms(result, problem), problem)

    def repeat(self, weights: Array) -> Iterator[Repetition]:
        """Search the sum of blocks with each row of weights, (m, B); the blocks are read once for a few of them."""
        numbers, visible = self.visible
        q = visible.products.scale.size
        for start in range(0, len(weights), SUMS_TOGETHER):
            some = weights[start : start + SUMS_TOGETHER]
            for w, packed in zip(some, some @ visible.products.packed, strict=True):
                C = centred_triangle(packed, q)
                result = visible.run(w, C)
                theta = solve(packed[places(q, columns_of(q, result.selected))])
                yield Repetition(tuple(numbers[list(result.selected)].tolist()), theta, C, result)


def fold_blocks(products: CrossProducts) -> list[NDArray[np.int64]]:
    """Blocks to leave out in turn: whole manoeuvres, or parts of the only one; none where there is one block."""
    names = np.unique(products.manoeuvre)
    if names.size > 1:
        groups = np.array_split(names, min(names.size, MAX_FOLDS))
        return [np.flatnonzero(np.isin(products.manoeuvre, g)) for g in groups]
    if products.n_blocks < 2:
        return []
    return np.array_split(np.arange(products.n_blocks), min(FOLDS_WITHIN, products.n_blocks))


def weights_without(products: CrossProducts, fold: NDArray[np.int64]) -> Array:
    """Weights that leave the blocks of a fold out."""
    weights = np.ones(products.n_blocks)
    weights[fold] = 0.0
    return weights


def centred(product: Array) -> Array:
    """Products about the means; columns that do not vary are exactly zero."""
    C = centre(product)
    still = np.diag(C) <= CONSTANT * np.diag(product)[1:]
    C[still] = 0.0
    C[:, still] = 0.0
    return C


def centred_triangle(packed: Array, q: int) -> Array:
    """The same from the packed triangle of the products of q columns."""
    C = centre_triangle(packed, q)
    still = C.diagonal() <= CONSTANT * packed[diagonal_places(q)[1:]]
    if still.any():
        C[still] = 0.0
        C[:, still] = 0.0
    return C


def _given(C: Array, terms: Sequence[int], dof: float) -> SearchResult:
    """The fit of given terms, whose products C are, without those that are constant or depend on the others."""
    columns = _independent(C, terms)
    rss = project(C, columns).rss if columns else float(C[-1, -1])
    return SearchResult(tuple(terms[i] for i in columns), rss, float(C[-1, -1]), (), "terms as given", dof, dof)


def _independent(C: Array, terms: Sequence[int]) -> list[int]:
    """Places of the given terms, whose products C are, that are not constant and do not depend on the others."""
    columns = [i for i in range(len(terms)) if C[i, i] > 0.0]
    if not columns:
        return []
    root = np.sqrt(np.diag(C)[columns])
    _, pivot, rank, _ = scipy.linalg.lapack.dpstrf(C[np.ix_(columns, columns)] / np.outer(root, root), tol=DEPENDENT)
    return sorted((columns[i - 1] for i in pivot[:rank]), key=lambda i: terms[i])


def _pose(
    C: Array,
    dof: float,
    options: SelectOptions,
    constraints: SearchConstraints,
    n_candidates: int,
    unit: float,
    blocks: tuple[CrossProducts, Array | None] | None,
) -> SearchProblem:
    """The problem with PSE's bound where it is needed; ``unit`` is the response's scale in these products."""
    stops_by_pse = options.stopping_rule == "PSE" and "stopping_rule" in METHODS[options.method].options
    bound = None
    if not isinstance(options.sigma_max, str):
        bound = (options.sigma_max / unit) ** 2
    elif options.criterion_used == "PSE" or stops_by_pse:
        if options.sigma_max == "response":
            bound = float(C[-1, -1] / (dof + 1.0))
        else:
            include, initial = constraints.include, constraints.initial
            path = stepwise(C, dof, include=include, initial=initial, max_terms=options.max_terms)
            bound = 25.0 * path.rss / max(dof - len(path.selected), 1.0)
    return SearchProblem(C, dof, options, constraints, n_candidates, bound, blocks)


def _choose(problem: SearchProblem, folds: Sequence[Fold]) -> SearchResult:
    """Search with the method of the options, and choose by its criterion."""
    criterion, dof = problem.options.criterion_used, problem.dof
    visited = METHODS[problem.options.method].search(problem)
    (selected, rss), stop_reason, steps = visited.last, visited.stop_reason, visited.steps
    if criterion is not None:
        scores = _scores(criterion, visited.models, problem, folds)
        chosen = int(np.argmin(scores))
        selected, rss = visited.models[chosen]
        steps = _until(steps, chosen)
        stop_reason = f"least {criterion.replace('cv', 'held-out error')} of {len(visited.models)} models visited"
    samples_per_one = (
        samples_per_independent_sample(*problem.blocks, selected, dof) if problem.blocks is not None else 1.0
    )
    return SearchResult(selected, rss, problem.tss, steps, stop_reason, dof, dof / samples_per_one)


def _until(steps: tuple[SearchStep, ...], model: int) -> tuple[SearchStep, ...]:
    """The steps to a model visited: every step but a refusal leads to the next one."""
    moves = np.cumsum([step.action != "refuse" for step in steps], dtype=int)
    return tuple(step for step, number in zip(steps, moves, strict=True) if number <= model)


def _scores(criterion: str, models: Sequence[Model], problem: SearchProblem, folds: Sequence[Fold]) -> list[float]:
    """Value of the criterion for each model; less is better."""
    if criterion == "cv":
        if not folds:
            raise SelectionError("select: criterion 'cv' needs parts to hold out; there is only one block.")
        return [
            sum(
                max(prediction_error(solve(fit, kept), test, kept), ROUNDING * float(test[-1, -1]))
                for fit, test in folds
            )
            for kept, _ in models
        ]
    n, tss = problem.dof + 1.0, problem.tss
    values = []
    for kept, rss in models:
        k, floor = len(kept), max(rss, ROUNDING * tss)
        if criterion == "PSE":
            values.append(criteria.pse(floor, tss, n, k, problem.sigma_max2))
        elif criterion == "BIC":
            values.append(criteria.bic(floor, n, k))
        elif criterion == "EBIC":
            values.append(criteria.ebic(floor, n, k, problem.n_candidates))
        elif criterion == "AICc":
            values.append(criteria.aicc(floor, n, k))
        else:
            values.append(-criteria.adjusted_r2(floor, tss, n, k))
    return [float(v) for v in values]


# ---------------------------------------------------------------- of a model, by its cross-products


def model_products(products: CrossProducts, kept: Sequence[int], weights: Array | None = None) -> Array:
    """Products of the constant, the kept terms and the response, (2 + k, 2 + k)."""
    return products.part(columns_of(products.scale.size, kept), weights)


def solve(product: Array, kept: Sequence[int] | None = None) -> Array:
    """Parameters of the constant and the kept terms, or of all, from products of [1, x, y], (1 + k,)."""
    columns = range(len(product) - 1) if kept is None else [0, *(j + 1 for j in kept)]
    return solve_normal_equations(product, columns)


def prediction_error(theta: Array, product: Array, kept: Sequence[int] | None = None) -> float:
    """Sum of squares of y - X theta over the samples behind ``product``, x the kept terms or all."""
    if kept is not None:
        rows = columns_of(len(product), kept)
        product = product[np.ix_(rows, rows)]
    v = np.append(-theta, 1.0)
    return float(max(v @ product @ v, 0.0))
