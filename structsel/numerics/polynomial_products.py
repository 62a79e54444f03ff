"""Cross-products of a complete polynomial pool from their distinct sums.

The product of two monomials of degree up to d is a monomial of degree up to 2 d, and most of those occur many times in
the products of all candidates: 164 candidates of degree 3 in 8 signals make 13,530 entries but 3,002 distinct sums. A
sorted word of length above d splits uniquely into its first d letters and the rest, whose first letter is not below the
last of the prefix; grouping the rests by first letter gives one small matrix product each.

These products are tall and narrow, 45 by 3 to 120 by 3 over some hundred samples. For such shapes NumPy takes 3.6 times
as long as the tiles of `structsel.numerics.tiles` (164 candidates, 200,000 samples; a complete selection then takes
15 % longer).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.regressors import (
    CHUNK,
    READ_AT_ONCE,
    DataSource,
    MonomialPlan,
    Scales,
    Word,
    fill_rows,
    plan_monomials,
)
from structsel.numerics.tiles import TALL, WIDE, add_groups, round_up


@dataclass(frozen=True)
class PolynomialPlan:
    """Rows, and the pairs of rows that are multiplied.

    Attributes
    ----------
    rows : MonomialPlan
        All monomials of degree 1..d, grouped by first letter.
    prefix : (n,) int array
        Rows of the monomials of degree d, grouped by last letter.
    groups : tuple of (n_prefix, start, stop)
        For each first letter: prefixes ``[:n_prefix]`` against rows ``[start:stop]``.
    gather : (p, p) int array
        Index of each entry of X'X in the vector [sums of rows, group products].
    member : (p,) int array
        Row of each candidate.
    """

    rows: MonomialPlan
    prefix: NDArray[np.int32]
    groups: tuple[tuple[int, int, int], ...]
    gather: NDArray[np.int32]
    member: NDArray[np.int32]


@lru_cache(maxsize=8)
def plan_polynomial_products(words: tuple[Word, ...], n_base: int) -> PolynomialPlan | None:
    """Plan of the products through distinct sums, or None where plain matrix products are cheaper.

    Parameters
    ----------
    words : tuple of tuple of int
    n_base : int
        Number of base signals.
    """
    p = len(words)
    degree = max(map(len, words), default=0)
    n_sums = comb(n_base + 2 * degree, n_base) - 1
    # A sum costs less than twice an entry of a blocked product; below that ratio the product is faster.
    if degree < 2 or len(set(words)) < p or 2 * n_sums > p * (p + 1) / 2:
        return None
    letters = range(n_base)
    every = [w for k in range(1, degree + 1) for w in combinations_with_replacement(letters, k)]
    suffixes = sorted(every, key=lambda w: (w[0], len(w), w))
    prefixes = sorted((w for w in every if len(w) == degree), key=lambda w: (w[-1], w))
    position = {w: i for i, w in enumerate(suffixes)}
    prefix = np.array([position[w] for w in prefixes], dtype=np.int32)
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
    return PolynomialPlan(plan_monomials(tuple(suffixes)), prefix, tuple(groups), gather, member)


@lru_cache(maxsize=8)
def _triangle_of(words: tuple[Word, ...], n_base: int, m: int) -> NDArray[np.intp]:
    """Index of each entry of the triangle of Z'Z in [1 and responses, these with rows, products of the groups]."""
    plan = plan_polynomial_products(words, n_base)
    assert plan is not None
    p, rows, above = len(words), plan.rows.target.size, 1 + m
    inner, outside = slice(1, 1 + p), [0, *range(1 + p, above + p)]
    place = np.empty((above + p, above + p), dtype=np.intp)
    place[np.ix_(outside, outside)] = np.arange(above**2).reshape(above, above)
    begins = above**2 + np.arange(above) * rows
    place[outside, inner] = begins[:, None] + plan.member
    place[inner, outside] = place[outside, inner].T
    # Sums of rows are the constant's products with them; the groups' products follow those of the last response.
    place[inner, inner] = plan.gather + np.where(plan.gather < rows, begins[0], begins[-1])
    return place[np.triu_indices(above + p)]


class Groups(NamedTuple):
    """Products of groups of rows in complete tiles.

    Attributes
    ----------
    left : int array
        Rows on the left.
    sizes : tuple of (int, int)
        Products of each group; those of [1, responses] with one another are the first.
    tiles : (groups, 4) int array
        See `structsel.numerics.tiles.add_groups`.
    n_sums : int
        Those that fill the last tiles included.
    """

    left: NDArray[np.int32]
    sizes: tuple[tuple[int, int], ...]
    tiles: NDArray[np.int64]
    n_sums: int


@lru_cache(maxsize=8)
def _plan_groups(words: tuple[Word, ...], n_base: int, m: int) -> Groups:
    """Groups of a plan with the constant and m responses above its rows."""
    plan = plan_polynomial_products(words, n_base)
    assert plan is not None
    above = 1 + m
    left = np.concatenate([np.arange(above), above + plan.prefix, np.zeros(TALL - 1)]).astype(np.int32)
    sizes = ((above, above), *((above + n, stop - start) for n, start, stop in plan.groups))
    # Rows of the next group, or of ones, fill the last tiles.
    padded = [(round_up(tall, TALL), round_up(wide, WIDE)) for tall, wide in sizes]
    ends = np.cumsum([0, *(tall * wide for tall, wide in padded)])
    first = [0, *(above + start for _, start, _ in plan.groups)]
    return Groups(left, sizes, np.column_stack([np.array(padded), first, ends[:-1]]), int(ends[-1]))


@njit(cache=True, nogil=True)
def _add_samples(
    base: NDArray[np.float64],
    responses: NDArray[np.float64],
    weight: NDArray[np.float64],
    target: NDArray[np.int32],
    parent: NDArray[np.int32],
    factor: NDArray[np.int32],
    rows: NDArray[np.float64],
    left: NDArray[np.int32],
    groups: NDArray[np.int64],
    sums: NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Add the products of rows [1, responses, monomials] of all samples to ``sums``, chunk by chunk."""
    above = 1 + responses.shape[0]
    for first in range(0, base.shape[1], CHUNK):
        c = min(CHUNK, base.shape[1] - first)
        rows[1:above, :c] = responses[:, first : first + c]
        fill_rows(base, first, c, weight, target, parent, factor, rows[above:])
        add_groups(rows, left, groups, c, sums)


class PolynomialProducts:
    """Upper triangle of Z'Z of any range of a manoeuvre, from the distinct sums; owns its workspace.

    The constant and the responses are the rows above the monomials; the same products have their sums.

    Parameters
    ----------
    words : tuple of tuple of int
        The candidates, for which there is a plan.
    scales : (s,) array, (m,) array
    """

    def __init__(self, words: tuple[Word, ...], scales: Scales):
        n_base, m = scales[0].size, scales[1].size
        plan = plan_polynomial_products(words, n_base)
        assert plan is not None
        self.plan, self.weight, self.response_scale = plan, 1.0 / scales[0], scales[1][:, None]
        self.gather, self.groups = _triangle_of(words, n_base, m), _plan_groups(words, n_base, m)
        self.above = 1 + m
        self.rows = np.empty((self.above + plan.rows.n_rows + WIDE - 1, CHUNK))
        self.rows[0] = 1.0
        self.rows[self.above + plan.rows.n_rows :] = 1.0

    def over(self, source: DataSource, start: int, stop: int) -> Array:
        """Upper triangle of Z'Z of these samples, row by row."""
        above, plan, groups = self.above, self.plan.rows, self.groups
        monomials, sums = (plan.target, plan.parent, plan.factor), np.zeros(groups.n_sums)
        for slab in range(start, stop, READ_AT_ONCE):
            end = min(slab + READ_AT_ONCE, stop)
            base = np.ascontiguousarray(source.base(slab, end), dtype=float)
            response = source.responses(slab, end) / self.response_scale
            _add_samples(base, response, self.weight, *monomials, self.rows, groups.left, groups.tiles, sums)
        own, *each = (
            sums[at : at + tall * wide].reshape(tall, wide)[:n, :m]
            for (tall, wide, _, at), (n, m) in zip(groups.tiles, groups.sizes, strict=True)
        )
        cross = np.concatenate([s[:above] for s in each], axis=1)
        return np.concatenate([own.ravel(), cross.ravel(), *(s[above:].ravel() for s in each)]).take(self.gather)
