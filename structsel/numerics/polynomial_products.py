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

import threading
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array, on_large_pages
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
from structsel.numerics.tiles import TilePlan, add_parts, plan_tiles


@dataclass(frozen=True)
class PolynomialPlan:
    """Rows, and the pairs of rows that are multiplied.

    Attributes
    ----------
    rows : MonomialPlan
        All monomials of degree 1..d, grouped by first letter; the constant and the responses are above them.
    tiles : TilePlan
        Products of [1, responses] with one another, then for each first letter of [1, responses, prefixes] with rows.
    gather : int array
        Place of each entry of the upper triangle of Z'Z in the sums, row by row.
    """

    rows: MonomialPlan
    tiles: TilePlan
    gather: NDArray[np.intp]


@lru_cache(maxsize=8)
def plan_polynomial_products(words: tuple[Word, ...], n_base: int, n_responses: int) -> PolynomialPlan | None:
    """Plan of the products through distinct sums, or None where plain matrix products are cheaper.

    Parameters
    ----------
    words : tuple of tuple of int
    n_base, n_responses : int
        Number of base signals and of responses.
    """
    p, degree = len(words), max(map(len, words), default=0)
    n_sums = comb(n_base + 2 * degree, n_base) - 1
    # A sum costs less than twice an entry of a blocked product; below that ratio the product is faster.
    if degree < 2 or len(set(words)) < p or 2 * n_sums > p * (p + 1) / 2:
        return None
    letters = range(n_base)
    every = [w for k in range(1, degree + 1) for w in combinations_with_replacement(letters, k)]
    suffixes = sorted(every, key=lambda w: (w[0], len(w), w))
    prefixes = sorted((w for w in every if len(w) == degree), key=lambda w: (w[-1], w))
    responses = [(n_base + r,) for r in range(n_responses)]  # further letters; the constant is the empty word
    above: list[Word] = [(), *responses]
    groups = [(above, above)] + [
        ([*above, *(w for w in prefixes if w[-1] <= letter)], [w for w in suffixes if w[0] == letter])
        for letter in letters
    ]
    row_of = {w: i for i, w in enumerate([*above, *suffixes])}
    tiles = plan_tiles([([row_of[w] for w in left], [row_of[w] for w in right]) for left, right in groups])
    place: dict[Word, int] = {}
    for (left, right), table in zip(groups, tiles.places, strict=True):
        place |= {_product(u, v): at for u, row in zip(left, table.tolist()) for v, at in zip(right, row)}
    columns = combinations_with_replacement([(), *words, *responses], 2)
    gather = np.array([place[_product(u, v)] for u, v in columns], dtype=np.intp)
    return PolynomialPlan(plan_monomials(tuple(suffixes)), tiles, gather)


def _product(u: Word, v: Word) -> Word:
    """The product of two monomials."""
    return tuple(sorted(u + v))


@njit(cache=True, nogil=True)
def _add_samples(
    base: NDArray[np.float64],
    responses: NDArray[np.float64],
    weight: NDArray[np.float64],
    target: NDArray[np.int32],
    parent: NDArray[np.int32],
    factor: NDArray[np.int32],
    rows: NDArray[np.float64],
    sides: NDArray[np.int32],
    parts: NDArray[np.int64],
    sums: NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Add the products of rows [1, responses, monomials] of all samples to ``sums``, chunk by chunk."""
    above = 1 + responses.shape[0]
    for first in range(0, base.shape[1], CHUNK):
        c = min(CHUNK, base.shape[1] - first)
        rows[1:above, :c] = responses[:, first : first + c]
        fill_rows(base, first, c, weight, target, parent, factor, rows[above:])
        add_parts(rows, sides, parts, c, sums)


class _Workspace(threading.local):
    """Rows that a thread fills for one block after another."""

    rows = np.empty((0, CHUNK))

    def of(self, n_rows: int) -> Array:
        """The first rows."""
        if len(self.rows) < n_rows:
            self.rows = on_large_pages(n_rows, CHUNK)
        return self.rows[:n_rows]


_WORKSPACE = _Workspace()


class PolynomialProducts:
    """Upper triangle of Z'Z of any range of a manoeuvre, from the distinct sums.

    The constant and the responses are the rows above the monomials; the same products have their sums.

    Parameters
    ----------
    plan : PolynomialPlan
    scales : (s,) array, (m,) array
    """

    def __init__(self, plan: PolynomialPlan, scales: Scales):
        self.plan, self.weight, self.response_scale = plan, 1.0 / scales[0], scales[1][:, None]
        self.rows = _WORKSPACE.of(1 + scales[1].size + plan.rows.n_rows)
        self.rows[0] = 1.0

    def over(self, source: DataSource, start: int, stop: int) -> Array:
        """Upper triangle of Z'Z of these samples, row by row."""
        plan, tiles = self.plan.rows, self.plan.tiles
        monomials, sums = (plan.target, plan.parent, plan.factor), np.zeros(tiles.n_sums)
        for slab in range(start, stop, READ_AT_ONCE):
            end = min(slab + READ_AT_ONCE, stop)
            base = np.ascontiguousarray(source.base(slab, end), dtype=float)
            response = source.responses(slab, end) / self.response_scale
            _add_samples(base, response, self.weight, *monomials, self.rows, tiles.rows, tiles.parts, sums)
        return sums.take(self.plan.gather)
