"""Probability that a candidate belongs in the model, from a selected model and its neighbours.

The neighbours of a model have one term less, one more, or one exchanged. The weight of a model is exp(-EBIC / 2), an
approximation of its posterior probability with a prior that makes large pools sparse::

    EBIC = n log rss + k (log n + log p),    P_j = sum of weights of models with j / sum of all weights

Their residual sums of squares follow from the cross-products without another fit. Models further away are not counted,
nor is an error of the noise model.

References
----------
[R95] for weights by BIC, [CC08] for the prior.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.normal_equations import leave_unexplained

DEPENDENT = 1e-9  # of a column's sum of squares: residual of a column that others explain, by rounding
ROUNDING = 1e-12  # of the response's sum of squares: a residual below it is rounding


def inclusion_probabilities(
    C: Array,
    dof: float,
    selected: Sequence[int],
    *,
    include: Iterable[int] = (),
    allowed: Callable[[Iterable[int]], bool] | None = None,
    n_candidates: int | None = None,
) -> Array:
    """Probability of each candidate, by the formulas of this file.

    Parameters
    ----------
    C : (p + 1, p + 1) array
        Centred products of candidates and response.
    dof : float
        Samples less one, or the effective number.
    selected : sequence of int
        The model.
    include : iterable of int
        Terms in every model.
    allowed : callable, optional
        From a model to whether it may be chosen.
    n_candidates : int, optional
        p of the prior, where the products are of some of the candidates.

    Returns
    -------
    (p,) array
    """
    p = C.shape[0] - 1
    kept = np.asarray(list(selected), dtype=int)
    free = np.diag(C)[:p] > 0.0
    free[kept] = False
    outside = np.flatnonzero(free)
    rss, less, more, other = moved_residuals(C, kept, outside)
    n, own = dof + 1.0, max(rss, ROUNDING)
    price = np.log(n) + np.log(n_candidates or p)

    def log_weight(rss: Array, change: int) -> Array:
        return -0.5 * (n * np.log(np.maximum(rss, ROUNDING) / own) + change * price)

    fewer, larger, exchanged = log_weight(less, -1), log_weight(more, 1), log_weight(other, 0)
    always = set(include)
    fixed = [i for i, j in enumerate(kept.tolist()) if j in always]
    fewer[fixed], exchanged[fixed] = -np.inf, -np.inf
    if allowed is not None:
        model = kept.tolist()
        for i, j in enumerate(model):
            rest = [m for m in model if m != j]
            fewer[i] = fewer[i] if allowed(rest) else -np.inf
            exchanged[i] = np.where([allowed([*rest, int(o)]) for o in outside], exchanged[i], -np.inf)
        larger = np.where([allowed([*model, int(o)]) for o in outside], larger, -np.inf)
    top = max(0.0, *(float(w.max(initial=-np.inf)) for w in (fewer, larger, exchanged)))
    fewer, larger, exchanged = (np.exp(w - top) for w in (fewer, larger, exchanged))
    total = np.exp(-top) + fewer.sum() + larger.sum() + exchanged.sum()
    probability = np.zeros(p)
    probability[kept] = 1.0 - (fewer + exchanged.sum(axis=1)) / total
    probability[outside] = (larger + exchanged.sum(axis=0)) / total
    return probability


def moved_residuals(
    C: Array, kept: NDArray[np.integer], outside: NDArray[np.integer]
) -> tuple[float, Array, Array, Array]:
    """1 - R^2 of a model, without each kept term (k,), with each other one (m,), and with one exchanged (k, m)."""
    theta, alone, left, explained, d, b = leave_unexplained(C, kept, outside)
    rss, usable = max(left, 0.0), d > DEPENDENT
    more = np.where(usable, rss - b**2 / np.where(usable, d, 1.0), np.inf)
    return rss, rss + theta**2 / alone, more, rss + exchange_losses(theta, alone, explained, d, b)


@njit(cache=True, nogil=True, error_model="numpy")
def exchange_losses(
    theta: Array, alone: Array, explained: Array, d: Array, b: Array
) -> Array:  # pragma: no cover - compiled
    """Rise of 1 - R^2 if one of the others replaces a kept term, (k, m); infinite where the rest explains it.

    The arguments are fields of `Unexplained`, the first three perhaps of some of the kept terms only.
    """
    losses = np.empty_like(explained)
    for i in range(losses.shape[0]):
        row, loss, back = explained[i], losses[i], theta[i] / alone[i]
        for c in range(d.size):
            free, with_y = d[c] + row[c] * row[c] / alone[i], b[c] + row[c] * back
            loss[c] = theta[i] * back - with_y * with_y / free if free > DEPENDENT else np.inf
    return losses
