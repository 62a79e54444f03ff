"""Selections repeated without a manoeuvre, or on reweighted blocks: algebra on cross-products, without the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, choose_workers
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.inclusion import inclusion_probabilities
from structsel.numerics.noise_models import random_block_weights
from structsel.selection.search import (
    Search,
    model_products,
    prediction_error,
)
from structsel.selection.search_result import SearchResult

AT_A_TIME = 16  # resampled searches of one job
CALIBRATION = 0.46, 1.11
"""Logistic regression of truth on the logit of the posterior above 0.02: 160 records of "signals", 80 replicates, in
benchmarks/inclusion.py; standard errors 0.09 and 0.05. Checked on the other generator there."""
LEAST = 1e-4  # probability that is not extrapolated
SAMPLES_PER_SEARCH = 40  # passed over in the time of one resampled search


@dataclass(frozen=True)
class CrossValidation:
    """Prediction of samples by models selected and fitted without them, in the units of the response.

    Attributes
    ----------
    folds : tuple of tuple of int
        Manoeuvres of each fold; of blocks where there was one manoeuvre.
    within : bool
        True where parts of a single manoeuvre were left out; the error is then too small.
    sse, tss : (F,) array
        Squared prediction error, and squares about the fold's own mean.
    n : (F,) array
    """

    folds: tuple[tuple[int, ...], ...]
    within: bool
    sse: Array
    tss: Array
    n: Array

    @property
    def r2(self) -> float:
        """Of all folds together."""
        return float(1.0 - self.sse.sum() / self.tss.sum())

    @property
    def rms(self) -> float:
        """Root mean square prediction error of all folds together."""
        return float(np.sqrt(self.sse.sum() / self.n.sum()))


@dataclass(frozen=True)
class Bootstrap:
    """Results of selections repeated on reweighted blocks.

    Attributes
    ----------
    inclusion : (p,) array
        Fraction of replicates that kept each candidate.
    posterior : (p,) array
        Mean over the replicates of the probability that each candidate belongs in the model [HM23]; see
        `structsel.numerics.inclusion`.
    std : (1 + k,) array
        Half the central 68 % range of each kept parameter over the replicates that kept it (a standard deviation
        on which a few odd structures have little influence); nan where fewer than two did.
    replicates, units : int
    by : {"manoeuvre", "block"}
    """

    inclusion: Array
    posterior: Array
    std: Array
    replicates: int
    units: int
    by: str

    @property
    def probability(self) -> Array:
        """The posterior, calibrated: of candidates with 0.8 about 80 % belong in the model.

        Resampled records scatter about the record as this does about the truth, so the mean is too cautious.
        """
        shift, slope = CALIBRATION
        inner = np.clip(self.posterior, LEAST, 1.0 - LEAST)
        value = scipy.special.expit(shift + slope * scipy.special.logit(inner))
        return np.where(self.posterior > 0.0, value, 0.0)


def cross_validate(search: Search, plain: CrossProducts) -> CrossValidation | None:
    """Select without each fold in turn and predict it.

    Parameters
    ----------
    search : Search
    plain : CrossProducts
        Of the response itself, not prewhitened: what is to be predicted.
    """
    if not search.folds:
        return None
    sse, tss, n = [], [], []
    unit = plain.scale[-1] ** 2
    for weights, kept, theta in search.without_folds:
        test = model_products(plain, kept, 1.0 - weights)
        sse.append(prediction_error(theta, test) * unit)
        tss.append(float(test[-1, -1] - test[0, -1] ** 2 / test[0, 0]) * unit)
        n.append(test[0, 0])
    within = plain.manoeuvre.min() == plain.last.max()
    folds = tuple(tuple(map(int, fold if within else plain.members(fold))) for fold in search.folds)
    return CrossValidation(folds, bool(within), np.array(sse), np.array(tss), np.array(n))


def bootstrap_units(products: CrossProducts, fewest: int = 8) -> NDArray[np.int64]:
    """(B,) unit of each block: its manoeuvre where there are at least ``fewest``, else the block itself."""
    names, unit = np.unique(products.manoeuvre, return_inverse=True)
    return unit if names.size >= fewest else np.arange(products.n_blocks)


def bootstrap_selection(
    search: Search, result: SearchResult, progress: Callable[[int, int], None] | None
) -> Bootstrap | None:
    """Repeat the selection on randomly weighted blocks."""
    options, products = search.options, search.products
    if not options.bootstrap or products.n_blocks < 2:
        return None
    units = bootstrap_units(products)
    weights = random_block_weights(units, options.bootstrap, np.random.default_rng(options.seed))
    kept = list(result.selected)
    counts, posterior = np.zeros((2, products.n_candidates))
    values = np.full((options.bootstrap, 1 + len(kept)), np.nan)
    place = {j: i + 1 for i, j in enumerate(kept)}
    scale = products.scale

    numbers, visible = search.visible
    constraints = visible.constraints

    def several(some: Array) -> list[tuple[tuple[int, ...], Array, Array]]:
        """Terms, parameters and probabilities for each row of weights."""
        found = []
        for repetition in search.repeat(some):
            probabilities = inclusion_probabilities(
                repetition.C,
                repetition.result.effective_dof,
                repetition.result.selected,
                include=constraints.include,
                allowed=None if constraints.hierarchy is None else constraints.allow,
                n_candidates=products.n_candidates,
            )
            found.append((repetition.selected, repetition.theta, probabilities))
        return found

    workers = choose_workers(options.workers, SAMPLES_PER_SEARCH * len(weights), numbers.size)
    batches = [weights[i : i + AT_A_TIME] for i in range(0, len(weights), AT_A_TIME)]
    replicates = (one for batch in JobRunner().map(several, batches, workers) for one in batch)
    for b, (selected, theta, of) in enumerate(replicates):
        counts[list(selected)] += 1.0
        posterior[numbers] += of
        values[b, 0] = theta[0] * scale[-1]
        for value, j in zip(theta[1:], selected, strict=True):
            if j in place:
                values[b, place[j]] = value * scale[-1] / scale[1 + j]
        if progress is not None:
            progress(b + 1, options.bootstrap)
    present = np.isfinite(values).sum(axis=0)
    std = np.full(1 + len(kept), np.nan)
    low, high = np.nanpercentile(values[:, present > 1], (15.87, 84.13), axis=0)
    std[present > 1] = (high - low) / 2.0
    by = "manoeuvre" if np.unique(products.manoeuvre).size == np.unique(units).size > 1 else "block"
    n = options.bootstrap
    return Bootstrap(counts / n, posterior / n, std, n, int(units.max()) + 1, by)
