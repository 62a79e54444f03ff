"""Boosted regression trees on binned columns. Arrays only.

They are those of scikit-learn's `HistGradientBoostingRegressor`, whose import takes longer than a diagnosis fits them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

_BINS = 48  # of a column
_ROUNDS, _RATE = 40, 0.12
_LEAVES, _FEWEST = 8, 25  # of a tree; samples of a leaf


def predict_by_trees(X: Array, y: Array, train: NDArray[np.intp], test: NDArray[np.intp]) -> Array:
    """Predictions of some samples by boosted trees that were fitted to others.

    Each tree is fitted to the residual of those before, and a fraction of it is added. It grows by the split of a leaf
    that reduces the sum of squares most.

    Parameters
    ----------
    X : (n, k) array
    y : (n,) array
    train, test : array of int
    """
    probed = np.linspace(0.0, 1.0, _BINS + 1)[1:-1]
    fitted, asked = X[train], X[test]
    edges = [_edges(x, probed) for x in fitted.T]
    binned, other = (
        np.column_stack([np.searchsorted(e, x) for e, x in zip(edges, part.T)]).astype(np.uint8)
        for part in (fitted, asked)
    )
    middle = y[train].mean()
    return np.asarray(middle + _boosted(binned, y[train] - middle, other, _ROUNDS, _RATE, _LEAVES, _FEWEST, _BINS))


def _edges(x: Array, probed: Array) -> Array:
    """Upper ends of the bins of a column but the last: between its values, or at quantiles where those are many."""
    values = np.unique(x)
    if len(values) <= _BINS:
        return np.asarray(0.5 * (values[:-1] + values[1:]))
    return np.unique(np.quantile(x, probed, method="averaged_inverted_cdf"))


@njit(cache=True, nogil=True, error_model="numpy")
def _boosted(binned, residual, other, rounds, rate, leaves, fewest, bins):  # type: ignore[no-untyped-def]
    """Sums of trees at the rows of `other`."""
    n, k = binned.shape
    left = residual.copy()
    made = np.zeros(len(other))
    leaf, other_leaf = np.empty(n, dtype=np.int64), np.empty(len(other), dtype=np.int64)
    sums, counts = np.empty((leaves, k, bins)), np.empty((leaves, k, bins))
    best, value = np.empty((leaves, 3)), np.empty(leaves)
    for _ in range(rounds):
        leaf[:], other_leaf[:] = 0, 0
        sums[0], counts[0] = 0.0, 0.0
        for i in range(n):
            for j in range(k):
                sums[0, j, binned[i, j]] += left[i]
                counts[0, j, binned[i, j]] += 1.0
        _best_split(sums[0], counts[0], fewest, best[0])
        grown = 1
        while grown < leaves:
            split = int(np.argmax(best[:grown, 0]))
            if best[split, 0] <= 0.0:
                break
            column, last = int(best[split, 1]), int(best[split, 2])
            # The upper part becomes a new leaf.
            sums[grown], counts[grown] = 0.0, 0.0
            for i in range(n):
                if leaf[i] == split and binned[i, column] > last:
                    leaf[i] = grown
                    for j in range(k):
                        sums[grown, j, binned[i, j]] += left[i]
                        counts[grown, j, binned[i, j]] += 1.0
            for i in range(len(other)):
                if other_leaf[i] == split and other[i, column] > last:
                    other_leaf[i] = grown
            sums[split] -= sums[grown]
            counts[split] -= counts[grown]
            _best_split(sums[split], counts[split], fewest, best[split])
            _best_split(sums[grown], counts[grown], fewest, best[grown])
            grown += 1
        for one in range(grown):
            value[one] = rate * sums[one, 0].sum() / counts[one, 0].sum()
        for i in range(n):
            left[i] -= value[leaf[i]]
        for i in range(len(other)):
            made[i] += value[other_leaf[i]]
    return made


@njit(cache=True, nogil=True, error_model="numpy")
def _best_split(sums, counts, fewest, best):  # type: ignore[no-untyped-def]
    """Reduction of the sum of squares by the best split of a leaf, its column, and the last bin of its lower part."""
    k, bins = sums.shape
    total, count = sums[0].sum(), counts[0].sum()
    best[0] = 0.0
    for j in range(k):
        below, number = 0.0, 0.0
        for b in range(bins - 1):
            below += sums[j, b]
            number += counts[j, b]
            if number < fewest:
                continue
            if count - number < fewest:
                break
            gain = below**2 / number + (total - below) ** 2 / (count - number) - total**2 / count
            if gain > best[0]:
                best[0], best[1], best[2] = gain, j, b
