"""A way of searching: which moments, which options, and whether tests believe samples or blocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.moments import MomentSet
from structsel.selection.search import Found, Pool, find
from structsel.selection.settings import SelectOptions

FOLDS_WITHIN = 4  # parts held out in turn where there is a single manoeuvre
MOST_FOLDS = 12

Folds = Sequence[NDArray[np.int64]]


@dataclass(frozen=True)
class Way:
    """Everything a search needs, so that it can be repeated on other weights of the same blocks.

    Attributes
    ----------
    moments : MomentSet
        Of one response; whitened, or not.
    options : SelectOptions
    pool : Pool
    folds : sequence of (b,) int array
        Blocks of each manoeuvre (or part) that may be held out.
    by_blocks : bool
        F-tests take the scatter over blocks; methods without F-tests choose by held-out error.
    """

    moments: MomentSet
    options: SelectOptions
    pool: Pool
    folds: Folds
    by_blocks: bool = False

    def find(self, weights: Array | None = None, product: Array | None = None) -> Found:
        """Search the weighted sum of blocks, or the ``product`` that it is; blocks of weight zero are not seen."""
        options = self.options
        if self.by_blocks and options.method != "stepwise" and self.folds:
            options = replace(options, criterion="cv")
        w = np.ones(self.moments.n_blocks) if weights is None else weights
        pairs = []
        if options.criterion_used == "cv":
            for fold in self.folds:
                inside = np.isin(np.arange(w.size), fold)
                if w[inside].any():
                    pairs.append((self.moments.total(w * ~inside), self.moments.total(w * inside)))
        return find(
            self.moments.total(weights) if product is None else product,
            self.moments.samples(weights),
            options,
            self.pool,
            pairs,
            float(self.moments.scale[-1]),
            (self.moments, weights) if self.by_blocks else None,
        )


def fold_blocks(moments: MomentSet) -> list[NDArray[np.int64]]:
    """Blocks to hold out in turn: whole manoeuvres, or parts of the only one; none where there is one block."""
    names = np.unique(moments.manoeuvre)
    if names.size > 1:
        groups = np.array_split(names, min(names.size, MOST_FOLDS))
        return [np.flatnonzero(np.isin(moments.manoeuvre, g)) for g in groups]
    if moments.n_blocks < 2:
        return []
    return np.array_split(np.arange(moments.n_blocks), min(FOLDS_WITHIN, moments.n_blocks))


def without(moments: MomentSet, fold: NDArray[np.int64]) -> Array:
    """Weights that leave the blocks of a fold out."""
    return np.where(np.isin(np.arange(moments.n_blocks), fold), 0.0, 1.0)
