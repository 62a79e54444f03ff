"""Candidates that could replace a term of a model, and those that depend on its terms, by cross-products."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.inclusion import DEPENDENT, exchange_losses
from structsel.numerics.normal_equations import leave_unexplained, project

ALIASED = 0.7  # correlation given the other terms from which two terms are aliased, not merely both weak
SAME_FIT = 4.0  # an alias within this of the kept term's residual, in units of s^2, is as good: likelihood ratio e^2


@dataclass(frozen=True)
class AliasedPair:
    """A kept term, and a candidate that could replace it.

    Attributes
    ----------
    kept, other : int
    loss : float [-]
        Rise of the residual sum of squares on the exchange, in units of s^2; under 4 the data cannot decide.
    correlation : float [-]
        Of the two, given the other kept terms.
    """

    kept: int
    other: int
    loss: float
    correlation: float


def find_aliases(
    C: Array,
    selected: Sequence[int],
    dof: float,
    among: Sequence[int] | None = None,
    others: NDArray[np.bool_] | None = None,
) -> list[AliasedPair]:
    """Candidates like a kept term that, put in its place, raise the residual by less than 4 s^2.

    Parameters
    ----------
    C : (p + 1, p + 1) array
        Centred products of candidates and response.
    selected : sequence of int
    dof : float
        Samples less one.
    among : sequence of int, optional
        The kept terms to find aliases of; all where absent.
    others : (p,) bool array, optional
        Candidates that may be aliases; all where absent.
    """
    p = C.shape[0] - 1
    kept = list(selected)
    if not kept or (among is not None and not among):
        return []
    varies = C.diagonal()[:p] > 0
    varies[kept] = False
    if others is not None:
        varies &= others
    outside = np.flatnonzero(varies)
    # What all kept terms leave of the candidates outside, and of their products with the response.
    theta, alone, rss, explained, d, b = leave_unexplained(C, np.array(kept), outside)
    s2 = max(rss, 1e-28) / max(dof - len(kept), 1.0)
    at = np.array([kept.index(j) for j in (kept if among is None else among)], dtype=int)
    loss = exchange_losses(theta[at], alone[at], explained[at], d, b) / s2
    pairs = []
    for i, j in np.argwhere(loss < SAME_FIT):
        # Without one kept term, what it takes from each comes back, by its row of the inverse.
        back, own = explained[at[i], j], alone[at[i]]
        correlation = float(np.clip(back / np.sqrt(max(own * d[j] + back**2, 1e-300)), -1.0, 1.0))
        if abs(correlation) >= ALIASED:
            pairs.append(AliasedPair(kept[at[i]], int(outside[j]), float(loss[i, j]), correlation))
    return sorted(pairs, key=lambda a: (kept.index(a.kept), a.loss))


def find_dependent(C: Array, kept: Sequence[int]) -> tuple[int, ...]:
    """Candidates that are constant, or that the kept ones explain."""
    size, left = np.diag(C)[:-1], project(C, kept).remaining[:-1]
    inside = np.isin(np.arange(size.size), kept)
    return tuple(int(j) for j in np.flatnonzero(~inside & (left <= DEPENDENT * np.where(size > 0, size, 1.0))))
