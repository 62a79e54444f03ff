"""One search on one set of moments, whichever method: the models it visited, and the one it settled on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from structsel.errors import SelectionError
from structsel.numerics import criteria
from structsel.numerics.arrays import Array
from structsel.numerics.best_subset import best_subset
from structsel.numerics.cluster_stepwise import cluster_stepwise, samples_per_independent_sample
from structsel.numerics.collinearity import drop_correlated
from structsel.numerics.moments import MomentSet, sweep_constant
from structsel.numerics.orthogonal import orthogonal
from structsel.numerics.stepwise import SearchPath, SearchStep, partial_f, refine_subset, stepwise
from structsel.selection.rivals import find_rivals
from structsel.selection.settings import SelectOptions

Fold = tuple[Array, Array]
"""Products [1, x, y] of the samples to fit, and of those to predict."""

PAIRS_UP_TO = 40  # terms; exchanges of pairs in a larger model cost more than they have ever brought
SAME_COLUMN = 0.98  # correlation from which, with a loss under 4 s^2, two terms are one as far as these data go
ROUNDING = 1e-12  # of the response's sum of squares: a residual below it is rounding, and no model is better for it
RANK_AT_FIRST = 100  # orthogonal functions
CONSTANT = 1e-11  # of a column's mean square: what is left of a constant one after rounding


@dataclass(frozen=True)
class Pool:
    """What a search must know of the candidates besides their moments.

    Attributes
    ----------
    degrees : (p,) int array
        Of two terms the data cannot tell apart, the one of lower degree is kept.
    forced, start : tuple of int
        Always in the model; in it at the start.
    """

    degrees: NDArray[np.integer]
    forced: tuple[int, ...] = ()
    start: tuple[int, ...] = ()


@dataclass(frozen=True)
class Found:
    """What one search made of one response under one noise assumption.

    Attributes
    ----------
    selected : tuple of int
        Candidates kept, in order of entry.
    rss, tss : float
        In the (scaled, whitened) units of the moments.
    steps : tuple of SearchStep
    stopped : str
    dof : float
        Samples less one.
    effective_dof : float
        The same, of independent samples; fewer where tests took the scatter over blocks.
    """

    selected: tuple[int, ...]
    rss: float
    tss: float
    steps: tuple[SearchStep, ...]
    stopped: str
    dof: float
    effective_dof: float


def centred(product: Array) -> Array:
    """Swept products with columns that do not vary set to exactly zero."""
    C = sweep_constant(product)
    still = np.diag(C) <= CONSTANT * np.diag(product)[1:]
    C[still] = 0.0
    C[:, still] = 0.0
    return C


def thresholds(options: SelectOptions, p: int, dof: float) -> tuple[float, float, NDArray[np.float64] | None]:
    """F_in, F_out and, for controlled false discovery, the threshold of each entry."""
    if options.F_in == "fdr":
        steps = criteria.fdr_thresholds(p, dof, 0.05)
        return float(steps[0]), options.F_out if options.F_out is not None else float(steps[0]), steps
    F_in = criteria.f_in_from_candidates(p, dof) if options.F_in == "auto" else float(options.F_in)
    F_out = F_in if options.F_out is None else options.F_out
    if F_out > F_in:
        raise SelectionError(
            f"select: F_out={F_out:g} is above the F_in of {F_in:.3g} that {p} candidates give: a term between the "
            "two would enter and leave for ever. Lower F_out, or leave it out."
        )
    return F_in, F_out, None


def sigma_max2(options: SelectOptions, C: Array, dof: float, pool: Pool) -> float:
    """Upper bound of the prediction error's variance that PSE charges for a term."""
    if options.sigma_max == "response":
        return float(C[-1, -1] / (dof + 1.0))
    path = stepwise(C, dof, include=pool.forced, initial=pool.start, max_terms=options.max_terms)
    return 25.0 * path.rss / max(dof - len(path.selected), 1.0)


def find(
    product: Array,
    samples: float,
    options: SelectOptions,
    pool: Pool,
    folds: Sequence[Fold] = (),
    noise_scale: float = 1.0,
    blocks: tuple[MomentSet, Array | None] | None = None,
) -> Found:
    """Search these moments the way the options say.

    Parameters
    ----------
    product : (p + 2, p + 2) array
        Products of [1, candidates, response].
    samples : float
    pool : Pool
    folds : sequence of Fold
        For the criterion ``"cv"``.
    noise_scale : float
        The response's scale in these products; turns a sigma_max given in its units into theirs.
    blocks : (MomentSet, weights), optional
        The blocks behind ``product``: F-tests then believe blocks, not samples.
    """
    C = centred(product)
    dof = samples - 1.0
    bound = None if isinstance(options.sigma_max, str) else (options.sigma_max / noise_scale) ** 2
    needs_bound = options.criterion_used == "PSE" or (options.method == "stepwise" and options.stopping_rule == "PSE")
    if bound is None and needs_bound:
        bound = sigma_max2(options, C, dof, pool)
    if options.method == "stepwise":
        path = _by_blocks(*blocks, dof, options, pool) if blocks else _by_samples(C, dof, options, pool, bound)
        visited = _visited(path)
    elif options.method == "orthogonal":
        path = _orthogonal(C, dof, options, pool, bound)
        visited = _visited(path)
    else:
        best = best_subset(C, dof, include=pool.forced, max_terms=options.max_terms)
        visited = [(b.selected, b.rss) for b in best]
        path = SearchPath(
            visited[-1][0], np.empty(0), visited[-1][1], (), (), "every size searched", float(C[-1, -1]), dof
        )
    rule = options.criterion_used
    tss = float(C[-1, -1])
    selected, rss, stopped = path.selected, path.rss, path.stopped
    if rule is not None:
        scores = _scores(rule, visited, tss, dof + 1.0, bound, folds)
        selected, rss = visited[int(np.argmin(scores))]
        stopped = f"least {rule.replace('cv', 'held-out error')} of {len(visited)} models visited"
    worth = samples_per_independent_sample(*blocks, selected, dof) if blocks is not None else 1.0
    found = Found(selected, rss, tss, path.steps, stopped, dof, dof / worth)
    return _simplest(_uncorrelated(found, C, options, pool.forced), C, pool)


def _simplest(found: Found, C: Array, pool: Pool) -> Found:
    """Of terms these data cannot tell apart at all, keep the one of lowest degree."""
    kept, steps = list(found.selected), list(found.steps)
    rss = found.rss
    for _ in kept:
        products = [j for j in kept if j not in pool.forced and pool.degrees[j] > 1]
        better = [
            r
            for r in find_rivals(C, kept, found.effective_dof, products)
            if abs(r.correlation) >= SAME_COLUMN and pool.degrees[r.rival] < pool.degrees[r.kept]
        ]
        if not better:
            break
        move = min(better, key=lambda r: (pool.degrees[r.rival], r.loss))
        kept[kept.index(move.kept)] = move.rival
        _, F, rss = partial_f(C, found.dof, kept)
        F_new = float(F[kept.index(move.rival)])
        steps.append(SearchStep("simplify", move.rival, move.kept, F_new, move.correlation, rss, len(kept)))
    return replace(found, selected=tuple(kept), rss=rss, steps=tuple(steps))


def _uncorrelated(found: Found, C: Array, options: SelectOptions, forced: Sequence[int]) -> Found:
    """Apply [H17]'s rule: of two kept terms whose parameters correlate above the limit, the weaker goes."""
    if options.correlation_limit is None or len(found.selected) < 2:
        return found
    kept, dropped = drop_correlated(C, found.dof, found.selected, options.correlation_limit, include=forced)
    steps = list(found.steps)
    remaining = list(found.selected)
    for drop in dropped:
        _, F, _ = partial_f(C, found.dof, remaining)
        at = remaining.index(drop.index)
        remaining.pop(at)
        _, _, rss = partial_f(C, found.dof, remaining)
        steps.append(SearchStep("leave", drop.index, -1, float(F[at]), drop.correlation, rss, len(remaining)))
    rss = steps[-1].rss if dropped else found.rss
    note = f"{found.stopped}; {len(dropped)} dropped, parameters correlated above {options.correlation_limit:g}"
    return replace(found, selected=kept, rss=rss, steps=tuple(steps), stopped=note if dropped else found.stopped)


def _orthogonal(C: Array, dof: float, options: SelectOptions, pool: Pool, bound: float | None) -> SearchPath:
    """Orthogonal functions, ranked far enough: on to the last only if PSE is still falling where they end."""
    most = min(C.shape[0] - 1, options.max_terms or C.shape[0] - 1)
    first = most if options.order == "given" else min(most, max(RANK_AT_FIRST, len(pool.forced)))
    for limit in (first, most):
        path = orthogonal(C, dof, sigma_max2=bound, order=options.order, include=pool.forced, max_terms=limit)
        if len(path.selected) < 0.8 * limit:
            break
    return path


def _by_blocks(moments: MomentSet, weights: Array | None, dof: float, options: SelectOptions, pool: Pool) -> SearchPath:
    """Stepwise search with tests by blocks, from nothing and from the linear terms; the better answer.

    Early on, when most of the response is unexplained, a product can pass for the linear term it resembles, and no
    single move undoes several of those.
    """
    F_in, F_out, _ = thresholds(options, moments.n_candidates, dof)
    linear = tuple(int(j) for j in np.flatnonzero(pool.degrees == 1))
    starts = [pool.start] if pool.start else list(dict.fromkeys([(), linear]))
    paths = [
        cluster_stepwise(
            moments,
            weights,
            dof,
            F_in=F_in,
            F_out=F_out,
            include=pool.forced,
            initial=start,
            max_terms=options.max_terms,
        )
        for start in starts
    ]
    worth = max(samples_per_independent_sample(moments, weights, path.selected, dof) for path in paths)
    n = dof / worth
    return min(paths, key=lambda p: n * np.log(max(p.rss, ROUNDING * p.tss)) + len(p.selected) * np.log(max(n, 2.0)))


def _by_samples(C: Array, dof: float, options: SelectOptions, pool: Pool, bound: float | None) -> SearchPath:
    """Modified stepwise regression whose F-tests take samples as independent."""
    F_in, F_out, entry = thresholds(options, C.shape[0] - 1, dof)
    path = stepwise(
        C,
        dof,
        F_in=F_in,
        F_out=F_out,
        include=pool.forced,
        initial=pool.start,
        max_terms=options.max_terms,
        min_gain=_least_gain(options, bound, float(C[-1, -1])),
        entry_thresholds=entry,
    )
    if options.stopping_rule == "F" and entry is None:
        return _polished(path, C, F_in, pool.forced, options.max_terms)
    return path


def _least_gain(options: SelectOptions, bound: float | None, tss: float) -> float:
    """Fraction of the sum of squares that an entering term must explain besides its F."""
    if options.stopping_rule == "R2":
        return options.min_r2_gain
    return bound / tss if options.stopping_rule == "PSE" and bound is not None else 0.0


def _polished(path: SearchPath, C: Array, F_in: float, forced: Sequence[int], max_terms: int | None) -> SearchPath:
    """Escape where one term stands in for two, or two for one, which single exchanges cannot."""
    if len(path.selected) > PAIRS_UP_TO:
        return path
    better = refine_subset(C, path.dof, path.selected, F_in, include=forced, max_terms=max_terms)
    moves = better.steps[len(path.selected) :]
    return replace(better, steps=(*path.steps, *moves), stopped=path.stopped) if moves else path


def _visited(path: SearchPath) -> list[tuple[tuple[int, ...], float]]:
    """Every model along a path, from the constant alone."""
    inside: list[int] = []
    models: list[tuple[tuple[int, ...], float]] = [((), path.tss)]
    for step in path.steps:
        if step.action in ("enter", "swap"):
            inside.append(step.index)
        if step.action in ("leave", "swap"):
            inside.remove(step.index if step.action == "leave" else step.other)
        if step.action != "refuse":
            models.append((tuple(inside), step.rss))
    return models


def _scores(
    rule: str,
    visited: list[tuple[tuple[int, ...], float]],
    tss: float,
    n: float,
    bound: float | None,
    folds: Sequence[Fold],
) -> list[float]:
    if rule == "cv":
        if not folds:
            raise SelectionError("select: criterion 'cv' needs parts to hold out; there is only one block.")
        return [
            sum(
                max(prediction_error(solve(fit, kept), kept, test), ROUNDING * float(test[-1, -1]))
                for fit, test in folds
            )
            for kept, _ in visited
        ]
    values = []
    for kept, rss in visited:
        k, floor = len(kept), max(rss, ROUNDING * tss)
        if rule == "PSE":
            values.append(criteria.pse(floor, tss, n, k, bound))
        elif rule == "BIC":
            values.append(criteria.bic(floor, n, k))
        elif rule == "AICc":
            values.append(criteria.aicc(floor, n, k))
        else:
            values.append(-criteria.adjusted_r2(floor, tss, n, k))
    return [float(v) for v in values]


def solve(product: Array, kept: Sequence[int]) -> Array:
    """Parameters of the constant and the kept terms by the normal equations of scaled columns, (1 + k,)."""
    rows = np.concatenate([[0], np.asarray(kept, dtype=int) + 1])
    A = product[np.ix_(rows, rows)]
    root = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    return linalg.lstsq(A / np.outer(root, root), product[rows, -1] / root, check_finite=False)[0] / root


def prediction_error(theta: Array, kept: Sequence[int], product: Array) -> float:
    """Sum of squares of y - X theta over the samples behind ``product``."""
    rows = np.concatenate([[0], np.asarray(kept, dtype=int) + 1, [product.shape[0] - 1]])
    v = np.append(-theta, 1.0)
    return float(max(v @ product[np.ix_(rows, rows)] @ v, 0.0))


def dependent(C: Array, kept: Sequence[int], tol: float = 1e-9) -> tuple[int, ...]:
    """Candidates that are constant, or that the kept ones explain but for a share ``tol``."""
    size = np.diag(C)[:-1]
    left = size.copy()
    if kept:
        rows = list(kept)
        factor = linalg.cho_factor(C[np.ix_(rows, rows)])
        left = size - np.einsum("ij,ij->j", C[rows, :-1], linalg.cho_solve(factor, C[rows, :-1]))
    inside = np.isin(np.arange(size.size), kept)
    return tuple(int(j) for j in np.flatnonzero(~inside & (left <= tol * np.where(size > 0, size, 1.0))))
