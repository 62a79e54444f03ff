"""Candidates that could stand in a kept term's place: what these data cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.numerics.arrays import Array

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
    R = C[kept] / np.outer(size[kept], size)  # only these rows, and everybody's with the response, are looked at
    response = C[p] / (size * size[p])
    outside = np.setdiff1d(np.flatnonzero(np.diag(C)[:p] > 0), kept)
    inverse = np.linalg.inv(R[:, kept])
    theta, explained = inverse @ R[:, p], inverse @ R[:, outside]
    rss = max(response[p] - R[:, p] @ theta, 1e-28)
    s2 = rss / max(dof - len(kept), 1.0)
    # What all kept terms leave of the candidates outside, and of their products with the response.
    d = 1.0 - np.einsum("ij,ij->j", R[:, outside], explained)
    b = response[outside] - R[:, p] @ explained
    for j in kept if among is None else among:
        at = kept.index(j)
        # The same without j: what it takes from each comes back, by its row of the inverse.
        back, alone = explained[at], inverse[at, at]
        free, with_y = d + back**2 / alone, b + back * theta[at] / alone
        usable = free > 1e-9
        loss = np.full(outside.size, np.inf)
        loss[usable] = (theta[at] ** 2 / alone - with_y[usable] ** 2 / free[usable]) / s2
        for i in np.flatnonzero(loss < SAME_FIT):
            alike = float(back[i] / np.sqrt(max(alone * free[i], 1e-300)))
            if abs(alike) >= ALIKE:
                out.append(Rival(j, int(outside[i]), float(loss[i]), float(np.clip(alike, -1.0, 1.0))))
    return sorted(out, key=lambda a: (kept.index(a.kept), a.loss))
