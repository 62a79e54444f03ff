"""Candidates that could stand in a kept term's place: what these data cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.numerics.rows import Array

ALIKE = 0.7  # correlation, the other terms removed, from which two terms are rivals, not merely both weak
SAME_FIT = 4.0  # a rival within this of the kept term's residual, in units of s^2, is as good: likelihood ratio e^2


@dataclass(frozen=True)
class Rival:
    """A candidate that could stand in a kept term's place.

    Attributes
    ----------
    kept, rival : int
    loss : float [-]
        Rise of the residual sum of squares on the exchange, in units of s^2; under 4 the data cannot decide.
    correlation : float [-]
        Of the two, the other kept terms removed.
    """

    kept: int
    rival: int
    loss: float
    correlation: float


def find_rivals(C: Array, selected: Sequence[int], dof: float, among: Sequence[int] | None = None) -> list[Rival]:
    """Candidates like a kept term that, put in its place, raise the residual by less than 4 s^2.

    Parameters
    ----------
    C : (p + 1, p + 1) array
        Centred products of candidates and response.
    selected : sequence of int
    dof : float
        Samples less one.
    among : sequence of int, optional
        The kept terms to find rivals of; all where absent.
    """
    p = C.shape[0] - 1
    kept = list(selected)
    if not kept:
        return []
    out: list[Rival] = []
    size = np.sqrt(np.diag(C))
    size[size == 0] = 1.0
    R = C / np.outer(size, size)
    inside = R[np.ix_(kept, kept)]
    rss = max(R[p, p] - R[kept, p] @ np.linalg.solve(inside, R[kept, p]), 1e-28)
    s2 = rss / max(dof - len(kept), 1.0)
    outside = np.setdiff1d(np.flatnonzero(np.diag(R)[:p] > 0), kept)
    for j in kept if among is None else among:
        others = [i for i in kept if i != j]
        columns = [j, *outside.tolist(), p]
        left = R[np.ix_(columns, columns)]
        if others:
            cross = R[np.ix_(others, columns)]
            left = left - cross.T @ np.linalg.solve(R[np.ix_(others, others)], cross)
        d, b = np.diag(left)[1:-1], left[1:-1, -1]
        usable = d > 1e-9
        loss = np.full(outside.size, np.inf)
        loss[usable] = (left[-1, -1] - b[usable] ** 2 / d[usable] - rss) / s2
        for i in np.flatnonzero(loss < SAME_FIT):
            alike = float(left[0, 1 + i] / np.sqrt(max(left[0, 0] * d[i], 1e-300)))
            if abs(alike) >= ALIKE:
                out.append(Rival(j, int(outside[i]), float(loss[i]), float(np.clip(alike, -1.0, 1.0))))
    return sorted(out, key=lambda a: (kept.index(a.kept), a.loss))
