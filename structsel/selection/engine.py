"""From moments to a defended structure: colour, search, refit, rivals, held-out error, bootstrap.

Array-level: candidates are columns of a table of exponents. `structsel.selection.select` puts names on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.collinearity import vif
from structsel.numerics.colour import Colour
from structsel.numerics.least_squares import Fit, refit, residual_colours
from structsel.numerics.moments import MomentSet, accumulate, accumulate_whitened
from structsel.numerics.rows import Array, Signals
from structsel.numerics.uncertainty import coloured_covariance
from structsel.selection.biased import estimate_biased
from structsel.selection.options import Options
from structsel.selection.resampling import (
    Bootstrap,
    HeldOut,
    find_in,
    fold_blocks,
    predict_held_out,
    repeat_selection,
    split_products,
)
from structsel.selection.rivals import Rival, find_rivals
from structsel.selection.search import Found, Pool, centred, prediction_error, solve
from structsel.selection.signals import SomeResponses

ROUNDS = 4  # of colour and search; the structure has settled after two almost always
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """Everything found out about one response."""

    found: Found
    classical: Found
    colours: tuple[Colour, ...]
    settled: bool
    fit: Fit
    values: Array
    covariance: Array
    biased: str
    vif: Array
    textbook: Array
    r2: float
    rms: float
    n: int
    rivals: tuple[Rival, ...]
    held_out: HeldOut | None
    bootstrap: Bootstrap | None


def select_arrays(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    options: Options,
    forced: Sequence[int] = (),
    start: Sequence[int] = (),
    progress: Progress | None = None,
) -> list[Outcome]:
    """Select a structure for every response of these manoeuvres.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : (p, s) int array
    options : Options
    forced, start : sequence of int
        Candidates always in, and in at the start.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.

    Returns
    -------
    list of Outcome
        One per response.
    """

    def stage(name: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, of: progress(name, done, of)

    pool = Pool(np.asarray(exponents).sum(axis=1), tuple(forced), tuple(start))
    white = accumulate(manoeuvres, exponents, workers=options.workers, progress=stage("moments"))
    folds = fold_blocks(white)
    plain = [one_response(white, r) for r in range(white.n_responses)]
    classical = [find_in(m, options, pool, folds) for m in plain]
    if options.residuals == "white":
        coloured: list[tuple[MomentSet, Found, tuple[Colour, ...], bool]] = [
            (m, f, (), True) for m, f in zip(plain, classical)
        ]
    else:
        coloured = _settle(manoeuvres, exponents, options, pool, plain, classical, folds, stage("whitened"))
    return [
        _outcome(
            r,
            manoeuvres,
            exponents,
            options,
            pool,
            plain[r],
            classical[r],
            *rest,
            folds,
            stage("bootstrap"),
        )
        for r, rest in enumerate(coloured)
    ]


def _outcome(
    response: int,
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    options: Options,
    pool: Pool,
    plain: MomentSet,
    classical: Found,
    moments: MomentSet,
    found: Found,
    colours: tuple[Colour, ...],
    settled: bool,
    folds: Sequence[NDArray[np.int64]],
    progress: Callable[[int, int], None] | None,
) -> Outcome:
    """Refit what was kept, and find out how far it can be trusted."""
    kept = list(found.selected)
    rows = [0, *(j + 1 for j in kept)]
    signals = [SomeResponses(m, (response,)) for m in manoeuvres]
    fit = refit(signals, exponents[kept], colours=colours or None)
    values, label = fit.theta, ""
    covariance = fit.covariance if colours else coloured_covariance(signals, exponents[kept], fit)
    total, scale = plain.total(), plain.scale
    if options.estimate != "least_squares" and kept:
        pairs = [split_products(moments, f)[:2] for f in folds]
        values, covariance, label = estimate_biased(moments.total(), moments.samples(), kept, scale, options, pairs)
    sse = prediction_error(values * scale[rows] / scale[-1], kept, total)
    plain_sse = prediction_error(solve(total, kept), kept, total)
    C = centred(total)
    return Outcome(
        found=found,
        classical=classical,
        colours=colours,
        settled=settled,
        fit=fit,
        values=values,
        covariance=covariance,
        biased=label,
        vif=vif(C[np.ix_(kept, kept)]) if kept else np.empty(0),
        textbook=_textbook(total, kept, plain_sse / max(plain.samples() - len(kept) - 1, 1), scale),
        r2=1.0 - sse / C[-1, -1],
        rms=float(np.sqrt(sse / plain.samples()) * scale[-1]),
        n=int(plain.samples()),
        rivals=tuple(find_rivals(centred(moments.total()), found.selected, found.dof)),
        held_out=predict_held_out(moments, plain, options, pool, folds),
        bootstrap=repeat_selection(moments, found, options, pool, folds, progress),
    )


def one_response(moments: MomentSet, response: int) -> MomentSet:
    """The same moments with a single response."""
    q = moments.scale.size
    p = moments.n_candidates
    keep = np.append(np.arange(1 + p), 1 + p + response)
    upper = np.array(np.triu_indices(q))
    inside = np.isin(upper, keep).all(axis=0)
    return MomentSet(moments.scale[keep], moments.n, moments.manoeuvre, moments.packed[:, inside], p, 1)


def _settle(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    options: Options,
    pool: Pool,
    plain: list[MomentSet],
    classical: list[Found],
    folds: Sequence[NDArray[np.int64]],
    progress: Callable[[int, int], None] | None,
) -> list[tuple[MomentSet, Found, tuple[Colour, ...], bool]]:
    """Estimate each manoeuvre's residual colour, whiten, search; again until the structure settles."""
    results: list[tuple[MomentSet, Found, tuple[Colour, ...], bool]] = [
        (m, f, (), False) for m, f in zip(plain, classical)
    ]
    pending = list(range(len(plain)))
    for _ in range(ROUNDS):
        colours = {}
        for r in pending:
            moments, found, _, _ = results[r]
            kept = list(found.selected)
            scale = moments.scale
            theta = solve(moments.total(), kept) * scale[-1] / scale[[0, *(j + 1 for j in kept)]]
            floor = 1e-10 * float(scale[-1])
            signals = [SomeResponses(m, (r,)) for m in manoeuvres]
            colours[r] = tuple(
                residual_colours(signals, exponents[kept], theta, max_order=options.max_order, floor=floor)
            )
        some = [SomeResponses(m, tuple(pending)) for m in manoeuvres]
        whitened = accumulate_whitened(
            some, exponents, [colours[r] for r in pending], workers=options.workers, progress=progress
        )
        for r, moments in zip(list(pending), whitened):
            found = find_in(moments, options, pool, folds)
            settled = set(found.selected) == set(results[r][1].selected)
            results[r] = (moments, found, colours[r], settled)
            if settled:
                pending.remove(r)
        if not pending:
            break
    return results


def _textbook(product: Array, kept: list[int], s2: float, scale: Array) -> Array:
    """s^2 inv(X'X) with white residuals, physical units."""
    rows = [0, *(j + 1 for j in kept)]
    A = product[np.ix_(rows, rows)]
    root = np.sqrt(np.diag(A))
    back = scale[-1] / (scale[rows] * root)
    return s2 * np.linalg.pinv(A / np.outer(root, root)) * np.outer(back, back)
