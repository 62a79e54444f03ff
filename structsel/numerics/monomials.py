"""Rows of monomials, built a few hundred samples at a time.

Every candidate is a monomial in *base signals* (a channel, an offset channel, a spline, a user's function), so a
pool is a small table of exponents. Here time runs along the last axis and every row is one candidate: a row is its
parent row times one base signal, so each costs a single multiplication and none is ever held for the whole flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from math import comb

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


@dataclass(frozen=True)
class DistinctPlan:
    """A complete pool's Gram through its few distinct sums.

    The product of two monomials of degree up to d is a monomial of degree up to 2 d, and most of those occur many
    times in the Gram: 164 candidates of degree 3 in 8 signals make 13,530 entries but 3,003 distinct sums. A sorted
    word of length above d splits uniquely into its first d letters and the rest, whose first letter is not below
    the last of the prefix; grouping the rests by first letter gives one small matrix product each.

    Attributes
    ----------
    suffix, prefix : RowPlan
        All monomials of degree 1..d grouped by first letter; those of degree d grouped by last letter.
    groups : tuple of (n_prefix, start, stop)
        For each first letter: prefixes ``[:n_prefix]`` against suffix rows ``[start:stop]``.
    gather : (p, p) int array
        Where each entry of the Gram lies in the vector [suffix sums, group products].
    member : (p,) int array
        Suffix row of each candidate.
    n_sums : int
    """

    suffix: RowPlan
    prefix: RowPlan
    groups: tuple[tuple[int, int, int], ...]
    gather: NDArray[np.int32]
    member: NDArray[np.int32]
    n_sums: int


@lru_cache(maxsize=8)
def plan_distinct(words: tuple[Word, ...], n_base: int) -> DistinctPlan | None:
    """Plan a Gram through distinct sums, or None where the plain product is cheaper.

    Parameters
    ----------
    words : tuple of tuple of int
    n_base : int
        Number of base signals.
    """
    p = len(words)
    degree = max(map(len, words), default=0)
    n_sums = comb(n_base + 2 * degree, n_base) - 1
    # A sum costs about three times an entry of a well-blocked product; below that ratio the product wins.
    if degree < 2 or len(set(words)) < p or 3 * n_sums > p * (p + 1) / 2:
        return None
    letters = range(n_base)
    every = [w for k in range(1, degree + 1) for w in combinations_with_replacement(letters, k)]
    suffixes = sorted(every, key=lambda w: (w[0], len(w), w))
    prefixes = sorted((w for w in every if len(w) == degree), key=lambda w: (w[-1], w))
    position = {w: i for i, w in enumerate(suffixes)}
    groups, offset = [], len(suffixes)
    for letter in letters:
        n_prefix = sum(w[-1] <= letter for w in prefixes)
        rows = [i for i, w in enumerate(suffixes) if w[0] == letter]
        start, stop = rows[0], rows[-1] + 1
        for i in range(n_prefix):
            for j in range(start, stop):
                position[prefixes[i] + suffixes[j]] = offset + i * (stop - start) + j - start
        groups.append((n_prefix, start, stop))
        offset += n_prefix * (stop - start)
    gather = np.empty((p, p), dtype=np.int32)
    for i, left in enumerate(words):
        for j in range(i + 1):
            gather[i, j] = gather[j, i] = position[tuple(sorted(left + words[j]))]
    member = np.array([position[w] for w in words], dtype=np.int32)
    return DistinctPlan(plan_rows(tuple(suffixes)), plan_rows(tuple(prefixes)), tuple(groups), gather, member, offset)
