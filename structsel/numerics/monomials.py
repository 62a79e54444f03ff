"""Rows of monomials, built a few hundred samples at a time.

Every candidate is a monomial in *base signals* (a channel, an offset channel, a spline, a user's function), so a
pool is a small table of exponents. Here time runs along the last axis and every row is one candidate: a row is its
parent row times one base signal, so each costs a single multiplication and none is ever held for the whole flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from structsel.errors import TermError

Word = tuple[int, ...]


@dataclass(frozen=True)
class RowPlan:
    """The multiplications that make a set of monomials.

    Attributes
    ----------
    target, parent, factor : (m,) int array
        Row ``target[i]`` is row ``parent[i]`` (or one, where -1) times base signal ``factor[i]``, in this order.
    n_rows : int
        Rows the workspace needs; those past the monomials asked for are parents needed on the way.
    """

    target: NDArray[np.int32]
    parent: NDArray[np.int32]
    factor: NDArray[np.int32]
    n_rows: int


def words_of(exponents: NDArray[np.integer]) -> tuple[Word, ...]:
    """Each row of exponents as a sorted word: alpha^2 de -> (0, 0, 1).

    Raises
    ------
    TermError
        Where exponents are negative, or a row is the constant (which is always there and never a candidate).
    """
    table = np.asarray(exponents)
    if table.size and table.min() < 0:
        raise TermError("words_of needs exponents of zero and above; a negative one is no monomial.")
    words = tuple(tuple(int(v) for v in np.repeat(np.arange(row.size), row)) for row in table)
    if () in words:
        raise TermError(f"words_of: candidate {words.index(())} is the constant, which every pool already holds.")
    return words


@lru_cache(maxsize=32)
def plan_rows(words: tuple[Word, ...]) -> RowPlan:
    """The cheapest way to make these monomials, one multiplication each, parents first.

    Parameters
    ----------
    words : tuple of tuple of int
        Sorted, as from `words_of`; row i of the result is ``words[i]``.
    """
    row_of = {word: i for i, word in enumerate(words)}
    n_rows = len(words)
    pending = sorted(set(words), key=len, reverse=True)
    seen = set(pending)
    while pending:  # add the parents that are not candidates themselves
        word = pending.pop()
        if len(word) > 1 and word[:-1] not in seen:
            seen.add(word[:-1])
            pending.append(word[:-1])
            row_of[word[:-1]] = n_rows
            n_rows += 1
    order = sorted(seen, key=lambda w: (len(w), w))
    steps = [(row_of[w], row_of[w[:-1]] if len(w) > 1 else -1, w[-1]) for w in order]
    # A repeated candidate is made as a copy of its twin's parent times factor, like the twin itself.
    steps += [(i, row_of[w[:-1]] if len(w) > 1 else -1, w[-1]) for i, w in enumerate(words) if row_of[w] != i]
    target, parent, factor = np.array(steps, dtype=np.int32).reshape(-1, 3).T.copy()
    return RowPlan(target, parent, factor, n_rows)


@njit(cache=True, nogil=True, fastmath={"contract"})
def fill_rows(
    base: NDArray[np.float64],
    target: NDArray[np.int32],
    parent: NDArray[np.int32],
    factor: NDArray[np.int32],
    out: NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Write each planned row into ``out``; ``base`` is (s, c), ``out`` (n_rows, >= c)."""
    c = base.shape[1]
    for i in range(target.size):
        row = out[target[i]]
        signal = base[factor[i]]
        if parent[i] < 0:
            for t in range(c):
                row[t] = signal[t]
        else:
            above = out[parent[i]]
            for t in range(c):
                row[t] = above[t] * signal[t]
