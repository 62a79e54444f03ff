"""From moments to a defended structure: colour, search, refit, rivals, held-out error, bootstrap.

Array-level: candidates are columns of a table of exponents. `structsel.selection.select` puts names on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.collinearity import Conditioning, condition_indices, vif
from structsel.numerics.colour import Colour
from structsel.numerics.least_squares import Fit, refit, residual_colours
from structsel.numerics.moments import MomentSet, accumulate, accumulate_whitened
from structsel.numerics.rows import Array, Signals
from structsel.numerics.uncertainty import coloured_covariance
from structsel.selection.biased import estimate_biased
from structsel.selection.options import Options
from structsel.selection.resampling import Bootstrap, HeldOut, predict_held_out, repeat_selection
from structsel.selection.rivals import Rival, find_rivals
from structsel.selection.search import ROUNDING, Found, Pool, centred, prediction_error, solve
from structsel.selection.signals import SomeResponses
from structsel.selection.way import Way, fold_blocks, without

ROUNDS = 4  # of colour and search; the structure has settled after two almost always
WORSE = 1.25  # squared error of the fit from which whitening is given up, if unseen manoeuvres agree
MANY_BLOCKS, FEW_BLOCKS = 32, 12  # kept apart, for resampling and tests by blocks
MANY_UP_TO = 200  # candidates; above it blocks are dear

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """Everything found out about one response."""

    found: Found
    classical: Found
    colours: tuple[Colour, ...]
    by_blocks: bool
    n_blocks: int
    settled: bool
    whitening_refused: tuple[float, float] | None
    fit: Fit
    values: Array
    covariance: Array
    biased: str
    vif: Array
    conditioning: Conditioning
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
    blocks = MANY_BLOCKS if len(exponents) <= MANY_UP_TO else FEW_BLOCKS
    white = accumulate(manoeuvres, exponents, blocks=blocks, workers=options.workers, progress=stage("moments"))
    folds = fold_blocks(white)
    plain = [Way(one_response(white, r), options, pool, folds) for r in range(white.n_responses)]
    classical = [way.find() for way in plain]
    if options.residuals == "white":
        chosen = [Choice(way, found, ()) for way, found in zip(plain, classical, strict=True)]
    elif options.residuals == "robust":
        chosen = [by_blocks(way) for way in plain]
    else:
        chosen = _settle(manoeuvres, exponents, options, plain, classical, blocks, stage("whitened"))
    return [
        _outcome(r, manoeuvres, exponents, plain[r].moments, classical[r], chosen[r], stage("bootstrap"))
        for r in range(white.n_responses)
    ]


@dataclass(frozen=True)
class Choice:
    """How a response was searched in the end, and what was found.

    ``settled`` is False where structure and colour did not agree after the last round. ``refused`` holds, where
    whitening was tried and given up, the held-out sums of squares it led to and those of the way used instead.
    """

    way: Way
    found: Found
    colours: tuple[Colour, ...]
    settled: bool = True
    refused: tuple[float, float] | None = None


def by_blocks(plain: Way) -> Choice:
    """Plain weighting with tests by blocks."""
    way = replace(plain, by_blocks=True)
    return Choice(way, way.find(), ())


def guard(choice: Choice, plain: Way) -> Choice:
    """Give whitening up where it describes the response clearly worse than plain weighting, and unseen parts agree.

    Coloured noise leaves both right; where whitening does worse the residual is misfit, not noise.
    """
    if not plain.folds:
        return choice
    other = by_blocks(plain)
    total = plain.moments.total()
    fitted = [
        prediction_error(solve(c.way.moments.total(), c.found.selected), c.found.selected, total)
        for c in (choice, other)
    ]
    if fitted[0] <= max(WORSE * fitted[1], ROUNDING * total[-1, -1]):
        return choice
    whitened, robust = (predict_held_out(c.way, plain.moments) for c in (choice, other))
    if whitened is None or robust is None or whitened.sse.sum() <= robust.sse.sum():
        return choice
    return replace(other, refused=(float(whitened.sse.sum()), float(robust.sse.sum())))


def _outcome(
    response: int,
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    plain: MomentSet,
    classical: Found,
    choice: Choice,
    progress: Callable[[int, int], None] | None,
) -> Outcome:
    """Refit what was kept, and find out how far it can be trusted."""
    found, colours, moments, options = choice.found, choice.colours, choice.way.moments, choice.way.options
    kept = list(found.selected)
    rows = [0, *(j + 1 for j in kept)]
    signals = [SomeResponses(m, (response,)) for m in manoeuvres]
    fit = refit(signals, exponents[kept], colours=colours or None)
    values, label = fit.theta, ""
    covariance = fit.covariance if colours else coloured_covariance(signals, exponents[kept], fit)
    total, scale = plain.total(), plain.scale
    if options.estimate != "least_squares" and kept:
        weights = [without(moments, f) for f in choice.way.folds]
        pairs = [(moments.total(w), moments.total(1.0 - w)) for w in weights]
        values, covariance, label = estimate_biased(moments.total(), moments.samples(), kept, scale, options, pairs)
    sse = prediction_error(values * scale[rows] / scale[-1], kept, total)
    plain_sse = prediction_error(solve(total, kept), kept, total)
    C = centred(total)
    return Outcome(
        found=found,
        classical=classical,
        colours=colours,
        by_blocks=choice.way.by_blocks,
        n_blocks=moments.n_blocks,
        settled=choice.settled,
        whitening_refused=choice.refused,
        fit=fit,
        values=values,
        covariance=covariance,
        biased=label,
        vif=vif(C[np.ix_(kept, kept)]) if kept else np.empty(0),
        conditioning=condition_indices(total[np.ix_(rows, rows)]),
        textbook=_textbook(total, kept, plain_sse / max(plain.samples() - len(kept) - 1, 1), scale),
        r2=1.0 - sse / C[-1, -1],
        rms=float(np.sqrt(sse / plain.samples()) * scale[-1]),
        n=int(plain.samples()),
        rivals=tuple(find_rivals(centred(moments.total()), found.selected, found.effective_dof)),
        held_out=predict_held_out(choice.way, plain),
        bootstrap=repeat_selection(choice.way, found, progress),
    )


def one_response(moments: MomentSet, response: int) -> MomentSet:
    """The same moments with a single response."""
    if moments.n_responses == 1:
        return moments
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
    plain: list[Way],
    classical: list[Found],
    blocks: int,
    progress: Callable[[int, int], None] | None,
) -> list[Choice]:
    """Estimate each manoeuvre's residual colour, whiten, search; again until the structure settles."""
    results = [Choice(way, found, (), False) for way, found in zip(plain, classical, strict=True)]
    pending = list(range(len(plain)))
    for _ in range(ROUNDS):
        colours = {}
        for r in pending:
            moments, kept = results[r].way.moments, list(results[r].found.selected)
            scale = moments.scale
            theta = solve(moments.total(), kept) * scale[-1] / scale[[0, *(j + 1 for j in kept)]]
            signals = [SomeResponses(m, (r,)) for m in manoeuvres]
            colours[r] = tuple(
                residual_colours(
                    signals, exponents[kept], theta, max_order=options.max_order, floor=1e-10 * float(scale[-1])
                )
            )
        some = [SomeResponses(m, tuple(pending)) for m in manoeuvres]
        whitened = accumulate_whitened(
            some,
            exponents,
            [colours[r] for r in pending],
            blocks=blocks,
            workers=options.workers,
            progress=progress,
        )
        for r, moments in zip(list(pending), whitened, strict=True):
            way = replace(plain[r], moments=moments)
            found = way.find()
            settled = set(found.selected) == set(results[r].found.selected)
            results[r] = Choice(way, found, colours[r], settled)
            if settled:
                pending.remove(r)
        if not pending:
            break
    return [guard(choice, way) for choice, way in zip(results, plain, strict=True)]


def _textbook(product: Array, kept: list[int], s2: float, scale: Array) -> Array:
    """s^2 inv(X'X) with white residuals, physical units."""
    rows = [0, *(j + 1 for j in kept)]
    A = product[np.ix_(rows, rows)]
    root = np.sqrt(np.diag(A))
    back = scale[-1] / (scale[rows] * root)
    return s2 * np.linalg.pinv(A / np.outer(root, root)) * np.outer(back, back)
