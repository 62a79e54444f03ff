"""Moves and result of a structure search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from structsel.numerics.arrays import Array

ACTIONS = ("enter", "leave", "swap", "refuse")
STOPS = (
    "no term outside reaches F_in",
    "perfect fit",
    "max_terms reached",
    "no degrees of freedom left",
    "move limit reached",
    "constant response",
    "the best term outside gains too little",
    "no candidate left",
    "no move lowers the criterion",
)


@dataclass(frozen=True)
class SearchStep:
    """One move of a search.

    Attributes
    ----------
    action : {"enter", "leave", "swap", "refuse"}
        Included and initial terms enter too. "refuse": such a term that is constant or that the terms already in
        explain.
    index : int
        Candidate (column of C) that moved; of a swap the one that came in.
    other : int
        Candidate a swap put out, else -1.
    F : float [-]
        Partial F of the candidate given the other terms; inf if it leaves nothing unexplained.
    partial_r : float [-]
        Its partial correlation with the response, given the other terms.
    rss : float [response^2]
        Residual sum of squares after the move.
    n_terms : int
        Terms in the model after the move, the constant not counted.
    """

    action: str
    index: int
    other: int
    F: float
    partial_r: float
    rss: float
    n_terms: int


@dataclass(frozen=True)
class SearchPath:
    """What a search kept, and how it came to it.

    Attributes
    ----------
    selected : tuple of int
        Candidates kept, in order of entry.
    theta : (k,) array [response per candidate]
        Their least-squares coefficients, in that order.
    rss : float [response^2]
    steps : tuple of SearchStep
    refused : tuple of int
        Candidates outside that are constant, or aliased with the kept ones within the tolerance.
    stopped : str
        Why the search ended, in words.
    tss : float [response^2]
        Sum of squares of the response about its mean.
    dof : float [-]
        Degrees of freedom before any term; dof - k are left.
    """

    selected: tuple[int, ...]
    theta: Array
    rss: float
    steps: tuple[SearchStep, ...]
    refused: tuple[int, ...]
    stopped: str
    tss: float
    dof: float

    @property
    def r2(self) -> float:
        """Fraction of the response's variance explained, R^2 [-]."""
        return 1.0 - self.rss / self.tss


def search_path(answer: Any, trace: Array, tss: float, dof: float) -> SearchPath:
    """Path of a kernel's answer and trace."""
    chosen, theta, rss, refused, why, moves = answer
    theta.setflags(write=False)
    steps = tuple(
        SearchStep(ACTIONS[int(a)], int(i), int(o), float(F), float(r), float(left) * tss, int(k))
        for a, i, o, F, r, left, k in trace[:moves]
    )
    kept = tuple(int(j) for j in chosen)
    out = tuple(int(j) for j in np.flatnonzero(refused))
    return SearchPath(kept, theta, float(rss), steps, out, STOPS[why], tss, dof)


def run_kernel(kernel: Any, C: Array, *arguments: Any) -> tuple[Any, Array]:
    """Call a kernel with a trace long enough for its moves."""
    rows = 4 * C.shape[0] + 200
    while True:
        trace = np.empty((rows, 7))
        answer = kernel(C, *arguments, trace)
        if answer[-1] <= rows:
            return answer, trace
        rows = answer[-1]
