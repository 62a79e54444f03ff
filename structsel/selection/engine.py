"""From moments to a defended structure: colour, search, refit, rivals, held-out error, bootstrap.

Array-level: candidates are columns of a table of exponents. `structsel.selection.select` puts names on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.collinearity import ConditionIndices, condition_indices, vif
from structsel.numerics.least_squares import Fit, colours_each, refit_each
from structsel.numerics.moments import MomentSet, accumulate, accumulate_whitened, choose_workers
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.passes import Passes
from structsel.numerics.rows import Scales, Signals, base_scale
from structsel.numerics.uncertainty import streamed_coloured_covariance
from structsel.selection.biased import estimate_biased
from structsel.selection.resampling import Bootstrap, HeldOut, predict_held_out, repeat_selection
from structsel.selection.rivals import Rival, find_rivals
from structsel.selection.search import ROUNDING, Found, Pool, centred, dependent, prediction_error, solve
from structsel.selection.settings import SelectOptions
from structsel.selection.signals import SomeResponses
from structsel.selection.way import Way, fold_blocks, without

ROUNDS = 4  # of colour and search; the structure has settled after two almost always
WORSE = 1.25  # squared error of the fit from which whitening is given up, if unseen manoeuvres agree
MANY_BLOCKS, FEW_BLOCKS = 32, 12  # kept apart, for resampling and tests by blocks
MANY_UP_TO = 200  # candidates; above it blocks are dear
FEW_TERMS = 30  # that a pass over kept terms is reckoned to be worth

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """Everything found out about one response; ``dependent`` candidates are constant, or explained by the kept ones."""

    found: Found
    dependent: tuple[int, ...]
    classical: Found
    colours: tuple[ARNoise, ...]
    by_blocks: bool
    n_blocks: int
    settled: bool
    whitening_refused: tuple[float, float] | None
    fit: Fit
    values: Array
    covariance: Array
    biased: str
    vif: Array
    conditioning: ConditionIndices
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
    options: SelectOptions,
    forced: Sequence[int] = (),
    start: Sequence[int] = (),
    progress: Progress | None = None,
    *,
    scales: Scales | None = None,
    passes: Passes | None = None,
) -> list[Outcome]:
    """Select a structure for every response of these manoeuvres.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : (p, s) int array
    options : SelectOptions
    forced, start : sequence of int
        Candidates always in, and in at the start.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    scales : (s,) array, (m,) array, optional
        Of base signals and responses, where they are known.
    passes : Passes, optional
        Who goes through the data; this process where absent.

    Returns
    -------
    list of Outcome
        One per response.
    """

    def stage(name: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, of: progress(name, done, of)

    exponents = np.asarray(exponents)
    pool = Pool(exponents.sum(axis=1), tuple(forced), tuple(start))
    data = Data(manoeuvres, exponents, options, scales or base_scale(manoeuvres), passes or Passes(), stage)
    white = accumulate(
        manoeuvres, exponents, blocks=data.blocks, workers=options.workers, progress=stage("moments"), **data.given
    )
    folds = fold_blocks(white)
    plain = [Way(one_response(white, r), options, pool, folds) for r in range(white.n_responses)]
    classical = [way.find() for way in plain]
    if options.noise == "white":
        chosen = [Choice(way, found, ()) for way, found in zip(plain, classical, strict=True)]
    elif options.noise == "cluster":
        chosen = [by_blocks(way) for way in plain]
    else:
        chosen = _settle(data, plain, classical)
    fits = refit_each(
        manoeuvres,
        [exponents[list(c.found.selected)] for c in chosen],
        [c.colours or None for c in chosen],
        range(len(chosen)),
        workers=data.workers,
        progress=stage("refit"),
        **data.given,
    )
    return [_outcome(r, data, plain[r].moments, classical[r], chosen[r], fits[r]) for r in range(white.n_responses)]


@dataclass(frozen=True)
class Data:
    """What is gone through, by whom, and who is told."""

    manoeuvres: Sequence[Signals]
    exponents: NDArray[np.integer]
    options: SelectOptions
    scales: Scales
    passes: Passes
    stage: Callable[[str], Callable[[int, int], None] | None]

    @property
    def blocks(self) -> int:
        """How many to keep apart."""
        return MANY_BLOCKS if len(self.exponents) <= MANY_UP_TO else FEW_BLOCKS

    @property
    def workers(self) -> int:
        """Threads for passes over the kept terms."""
        return choose_workers(self.options.workers, sum(m.n for m in self.manoeuvres), FEW_TERMS)

    @property
    def given(self) -> dict[str, Any]:
        """What every pass is given."""
        return {"scales": self.scales, "passes": self.passes}


@dataclass(frozen=True)
class Choice:
    """How a response was searched in the end, and what was found.

    ``settled`` is False where structure and colour did not agree after the last round. ``refused`` holds, where
    whitening was tried and given up, the held-out sums of squares it led to and those of the way used instead.
    """

    way: Way
    found: Found
    colours: tuple[ARNoise, ...]
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


def _outcome(response: int, data: Data, plain: MomentSet, classical: Found, choice: Choice, fit: Fit) -> Outcome:
    """Find out how far what was kept, and refitted, can be trusted."""
    found, colours, moments, options = choice.found, choice.colours, choice.way.moments, choice.way.options
    kept = list(found.selected)
    rows = [0, *(j + 1 for j in kept)]
    values, label = fit.theta, ""
    if colours:
        covariance = fit.covariance
    else:
        covariance = streamed_coloured_covariance(
            data.manoeuvres, data.exponents[kept], fit, response, workers=data.workers, **data.given
        )
    total, scale = plain.total(), plain.scale
    if options.estimate != "least_squares" and kept:
        weights = [without(moments, f) for f in choice.way.folds]
        pairs = [(moments.total(w), moments.total(1.0 - w)) for w in weights]
        values, covariance, label = estimate_biased(moments.total(), moments.samples(), kept, scale, options, pairs)
    sse = prediction_error(values * scale[rows] / scale[-1], kept, total)
    plain_sse = prediction_error(solve(total, kept), kept, total)
    C = centred(total)
    searched = centred(moments.total())
    return Outcome(
        found=found,
        dependent=dependent(searched, kept),
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
        rivals=tuple(find_rivals(searched, found.selected, found.effective_dof)),
        held_out=predict_held_out(choice.way, plain),
        bootstrap=repeat_selection(choice.way, found, data.stage("bootstrap")),
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
    packed = moments.packed[:, inside]
    return replace(moments, scale=moments.scale[keep], packed=packed, n_responses=1)


def _settle(data: Data, plain: list[Way], classical: list[Found]) -> list[Choice]:
    """Estimate each manoeuvre's residual colour, whiten, search; again until the structure settles."""
    results = [Choice(way, found, (), False) for way, found in zip(plain, classical, strict=True)]
    pending = list(range(len(plain)))
    for _ in range(ROUNDS):
        kept, theta, floors = [], [], []
        for r in pending:
            moments, inside = results[r].way.moments, list(results[r].found.selected)
            scale = moments.scale
            theta.append(solve(moments.total(), inside) * scale[-1] / scale[[0, *(j + 1 for j in inside)]])
            kept.append(data.exponents[inside])
            floors.append(1e-10 * float(scale[-1]))
        colours = colours_each(
            data.manoeuvres,
            kept,
            theta,
            pending,
            data.options.max_ar_order,
            floors,
            workers=data.workers,
            progress=data.stage("residual colours"),
            **data.given,
        )
        responses = [SomeResponses(m, tuple(pending)) for m in data.manoeuvres]
        scales = data.scales[0], data.scales[1][pending]
        whitened = accumulate_whitened(
            responses,
            data.exponents,
            colours,
            blocks=data.blocks,
            workers=data.options.workers,
            progress=data.stage("whitened"),
            scales=scales,
            passes=data.passes,
        )
        for r, own, moments in zip(list(pending), colours, whitened, strict=True):
            way = replace(plain[r], moments=moments)
            found = way.find()
            settled = set(found.selected) == set(results[r].found.selected)
            results[r] = Choice(way, found, own, settled)
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
