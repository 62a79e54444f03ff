"""Selections repeated without a manoeuvre, or on reweighted blocks: algebra on stored moments, no data touched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.moments import MomentSet
from structsel.numerics.rows import Array
from structsel.numerics.uncertainty import bootstrap_units, bootstrap_weights
from structsel.selection.options import Options
from structsel.selection.search import Found, Pool, find, prediction_error, solve

FOLDS_WITHIN = 4  # parts held out in turn where there is a single manoeuvre
MOST_FOLDS = 12


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


def fold_blocks(moments: MomentSet) -> list[NDArray[np.int64]]:
    """Blocks to hold out in turn: whole manoeuvres, or parts of the only one; none where there is one block."""
    names = np.unique(moments.manoeuvre)
    if names.size > 1:
        groups = np.array_split(names, min(names.size, MOST_FOLDS))
        return [np.flatnonzero(np.isin(moments.manoeuvre, g)) for g in groups]
    if moments.n_blocks < 2:
        return []
    return np.array_split(np.arange(moments.n_blocks), min(FOLDS_WITHIN, moments.n_blocks))


def split_products(moments: MomentSet, held: NDArray[np.int64]) -> tuple[Array, Array, float]:
    """Products of all blocks but the held ones, of the held ones, and the samples behind the first."""
    weights = np.ones(moments.n_blocks)
    weights[held] = 0.0
    return moments.total(weights), moments.total(1.0 - weights), moments.samples(weights)


def only_blocks(moments: MomentSet, blocks: NDArray[np.int64]) -> Array:
    """Products of these blocks."""
    return moments.total(np.isin(np.arange(moments.n_blocks), blocks).astype(float))


def find_in(
    moments: MomentSet,
    options: Options,
    pool: Pool,
    folds: Sequence[NDArray[np.int64]],
    weights: Array | None = None,
) -> Found:
    """Search the sum of all blocks, weighted where asked."""
    pairs = [split_products(moments, f)[:2] for f in folds] if options.rule == "manoeuvre" else ()
    return find(
        moments.total(weights),
        moments.samples(weights),
        options,
        pool,
        pairs,
        float(moments.scale[-1]),
    )


def predict_held_out(
    moments: MomentSet,
    plain: MomentSet,
    options: Options,
    pool: Pool,
    folds: Sequence[NDArray[np.int64]],
) -> HeldOut | None:
    """Select without each part in turn and predict it."""
    if not folds:
        return None
    sse, tss, n = [], [], []
    for held in folds:
        train, _, samples = split_products(moments, held)
        others = [only_blocks(moments, f) for f in folds if f is not held] if options.rule == "manoeuvre" else ()
        pairs = [(train - part, part) for part in others]
        found = find(train, samples, options, pool, pairs, float(moments.scale[-1]))
        theta = solve(train, found.selected)
        test = only_blocks(plain, held)
        unit = plain.scale[-1] ** 2
        sse.append(prediction_error(theta, found.selected, test) * unit)
        tss.append(float(test[-1, -1] - test[0, -1] ** 2 / test[0, 0]) * unit)
        n.append(test[0, 0])
    names = np.unique(moments.manoeuvre)
    within = names.size == 1
    parts = tuple(tuple(int(i) for i in (held if within else np.unique(moments.manoeuvre[held]))) for held in folds)
    return HeldOut(parts, within, np.array(sse), np.array(tss), np.array(n))


def repeat_selection(
    moments: MomentSet,
    found: Found,
    options: Options,
    pool: Pool,
    folds: Sequence[NDArray[np.int64]],
    progress: Callable[[int, int], None] | None,
) -> Bootstrap | None:
    """Repeat the selection on randomly weighted blocks; no data are touched."""
    if not options.bootstrap or moments.n_blocks < 2:
        return None
    units = bootstrap_units(moments)
    weights = bootstrap_weights(units, options.bootstrap, np.random.default_rng(options.seed))
    p = moments.n_candidates
    kept = list(found.selected)
    counts = np.zeros(p)
    values = np.full((options.bootstrap, 1 + len(kept)), np.nan)
    place = {j: i + 1 for i, j in enumerate(kept)}
    scale = moments.scale
    for b, w in enumerate(weights):
        again = find_in(moments, options, pool, folds if options.rule == "manoeuvre" else (), w)
        counts[list(again.selected)] += 1.0
        theta = solve(moments.total(w), again.selected)
        values[b, 0] = theta[0] * scale[-1]
        for value, j in zip(theta[1:], again.selected):
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
