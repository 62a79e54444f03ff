"""Moves of a search and where they end, from the results and the trace of a compiled search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.search_model import ACTIONS, STOPS


@dataclass(frozen=True)
class SearchStep:
    """One move of a search.

    Attributes
    ----------
    action : {"enter", "leave", "swap", "refuse"}
        Included and initial terms enter too. "refuse": such a term is constant or depends on the terms before.
    index : int
        Candidate (column of C); of a swap the one that enters.
    other : int
        Candidate that leaves in a swap, else -1.
    F : float [-]
        Partial F of the candidate given the other terms; inf for a perfect fit.
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
    """Selected terms of a search, and its steps.

    Attributes
    ----------
    selected : tuple of int
        Candidates in the model, in order of entry.
    theta : (k,) array [response per candidate]
        Their least-squares coefficients, in that order.
    rss : float [response^2]
    steps : tuple of SearchStep
    refused : tuple of int
        Other candidates that are constant, or aliased with the selected ones within the tolerance.
    stopped : str
        Reason why the search ended.
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
    """Path from the results and the trace of a kernel."""
    chosen, theta, rss, refused, why, moves = answer
    theta.setflags(write=False)
    steps = tuple(
        SearchStep(ACTIONS[int(a)], int(i), int(o), F, r, left * tss, int(k))
        for a, i, o, F, r, left, k in trace[:moves].tolist()
    )
    kept, out = tuple(chosen.tolist()), tuple(np.flatnonzero(refused).tolist())
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
