"""Selections repeated without a manoeuvre, or on reweighted blocks: algebra on stored moments, no data touched."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.moments import MomentSet, choose_workers
from structsel.numerics.noise_models import random_block_weights
from structsel.selection.search import Found, prediction_error, solve
from structsel.selection.way import Way, without

AT_A_TIME = 16  # resampled totals formed together
WORTH = 40  # samples that are gone through in the time of one resampled search


@dataclass(frozen=True)
class HeldOut:
    """Prediction of samples the selection never saw, in the response's own units.

    Attributes
    ----------
    parts : tuple of tuple of int
        Manoeuvres of each fold; of blocks where there was one manoeuvre.
    within : bool
        True where parts of a single manoeuvre were held out, which flatters.
    sse, tss : (F,) array
        Squared prediction error, and squares about the part's own mean.
    n : (F,) array
    """

    parts: tuple[tuple[int, ...], ...]
    within: bool
    sse: Array
    tss: Array
    n: Array

    @property
    def r2(self) -> float:
        """Of all parts together."""
        return float(1.0 - self.sse.sum() / self.tss.sum())

    @property
    def rms(self) -> float:
        """Root mean square prediction error of all parts together."""
        return float(np.sqrt(self.sse.sum() / self.n.sum()))


@dataclass(frozen=True)
class Bootstrap:
    """What repeated selections on reweighted blocks gave.

    Attributes
    ----------
    inclusion : (p,) array
        Share of replicates that kept each candidate.
    spread : (1 + k,) array
        Half the central 68 % range of each kept parameter over the replicates that kept it (a standard deviation
        that a few odd structures do not blow up); nan where fewer than two did.
    replicates, units : int
    by : {"manoeuvre", "block"}
    """

    inclusion: Array
    spread: Array
    replicates: int
    units: int
    by: str


def predict_held_out(way: Way, plain: MomentSet) -> HeldOut | None:
    """Select without each part in turn and predict it.

    Parameters
    ----------
    way : Way
    plain : MomentSet
        Of the response itself, not whitened: what is to be predicted.
    """
    if not way.folds:
        return None
    sse, tss, n = [], [], []
    unit = plain.scale[-1] ** 2
    for held in way.folds:
        weights = without(way.moments, held)
        product = way.moments.total(weights)
        found = way.find(weights, product)
        theta = solve(product, found.selected)
        test = plain.total(1.0 - weights)
        sse.append(prediction_error(theta, found.selected, test) * unit)
        tss.append(float(test[-1, -1] - test[0, -1] ** 2 / test[0, 0]) * unit)
        n.append(test[0, 0])
    within = plain.manoeuvre.min() == plain.last.max()
    parts = tuple(tuple(map(int, held if within else plain.members(held))) for held in way.folds)
    return HeldOut(parts, bool(within), np.array(sse), np.array(tss), np.array(n))


def bootstrap_units(moments: MomentSet, fewest: int = 8) -> NDArray[np.int64]:
    """(B,) unit of each block: its manoeuvre where there are at least ``fewest``, else the block itself."""
    names, unit = np.unique(moments.manoeuvre, return_inverse=True)
    return unit if names.size >= fewest else np.arange(moments.n_blocks)


def repeat_selection(way: Way, found: Found, progress: Callable[[int, int], None] | None) -> Bootstrap | None:
    """Repeat the selection on randomly weighted blocks; no data are touched."""
    options, moments = way.options, way.moments
    if not options.bootstrap or moments.n_blocks < 2:
        return None
    units = bootstrap_units(moments)
    weights = random_block_weights(units, options.bootstrap, np.random.default_rng(options.seed))
    kept = list(found.selected)
    counts = np.zeros(moments.n_candidates)
    values = np.full((options.bootstrap, 1 + len(kept)), np.nan)
    place = {j: i + 1 for i, j in enumerate(kept)}
    scale = moments.scale
    for b, (again, theta) in enumerate(_repeated(way, weights)):
        counts[list(again.selected)] += 1.0
        values[b, 0] = theta[0] * scale[-1]
        for value, j in zip(theta[1:], again.selected, strict=True):
            if j in place:
                values[b, place[j]] = value * scale[-1] / scale[1 + j]
        if progress is not None:
            progress(b + 1, options.bootstrap)
    present = np.isfinite(values).sum(axis=0)
    spread = np.full(1 + len(kept), np.nan)
    low, high = np.nanpercentile(values[:, present > 1], (15.87, 84.13), axis=0)
    spread[present > 1] = (high - low) / 2.0
    by = "manoeuvre" if np.unique(moments.manoeuvre).size == np.unique(units).size > 1 else "block"
    return Bootstrap(counts / options.bootstrap, spread, options.bootstrap, int(units.max()) + 1, by)


def _repeated(way: Way, weights: Array) -> Iterator[tuple[Found, Array]]:
    """What is found with each row of weights, and its parameters, in order; searches let go of the interpreter."""
    moments = way.moments

    def some(start: int) -> list[tuple[Found, Array]]:
        # One product of matrices reads the blocks once for a few.
        few = weights[start : start + AT_A_TIME]
        made = []
        for w, packed in zip(few, few @ moments.packed, strict=True):
            product = moments.unpack(packed)
            again = way.find(w, product)
            made.append((again, solve(product, again.selected)))
        return made

    workers = choose_workers(way.options.workers, WORTH * len(weights), moments.n_candidates)
    starts = range(0, len(weights), AT_A_TIME)
    for made in Parallel(n_jobs=workers, prefer="threads", return_as="generator")(delayed(some)(s) for s in starts):
        yield from made
