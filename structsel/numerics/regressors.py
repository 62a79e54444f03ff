"""Rows of regressors of a manoeuvre, in chunks of a few hundred samples.

Every candidate is a monomial in *base signals* (a channel, an offset channel, a spline, a user's function), so that a
pool is a small table of exponents. Time runs along the last axis: a row is one candidate, computed from its parent
row by one multiplication with a base signal. The regressor matrix is never formed: rows are computed for a few hundred
samples, used and overwritten.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from structsel.errors import TermError
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

Scales = tuple[Array, Array]
"""Root mean squares of base signals and of responses."""

Word = tuple[int, ...]
"""A monomial as the sorted numbers of its base signals: alpha^2 de is (0, 0, 1)."""

CHUNK = 384  # samples of a workspace: its rows fit in the second-level cache; a power of two would share cache sets
SLAB = 4000  # samples of a workspace with few rows
READ_AT_ONCE = 16384  # samples read from a manoeuvre in one call: 1 MiB of eight signals


class DataSource(Protocol):
    """Base signals and responses of a manoeuvre over any range of samples."""

    @property
    def n(self) -> int:
        """Number of samples."""

    def base(self, start: int, stop: int) -> Array:
        """(s, stop - start) base signals."""

    def responses(self, start: int, stop: int) -> Array:
        """(m, stop - start) responses."""


@dataclass(frozen=True)
class ArrayData:
    """A manoeuvre held in memory.

    Attributes
    ----------
    base_signals : (s, n) array
    response_signals : (m, n) array
    """

    base_signals: Array
    response_signals: Array

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.base_signals.shape[1])

    def base(self, start: int, stop: int) -> Array:
        """Base signals of these samples."""
        return self.base_signals[:, start:stop]

    def responses(self, start: int, stop: int) -> Array:
        """Responses of these samples."""
        return self.response_signals[:, start:stop]


# ---------------------------------------------------------------- scales


def find_scales(manoeuvres: Sequence[DataSource]) -> Scales:
    """Root mean squares of base signals and responses over a part of each manoeuvre; one where zero."""
    return scales_of([sums_of_squares(m) for m in manoeuvres])


def sums_of_squares(manoeuvre: DataSource) -> tuple[Array, Array, int]:
    """Sums of squares of base signals and responses over a part of a manoeuvre, and its samples."""
    parts = []
    for start in np.linspace(0, max(manoeuvre.n - 1024, 0), 4).astype(int).tolist():
        stop = min(start + 1024, manoeuvre.n)
        b, y = manoeuvre.base(start, stop), manoeuvre.responses(start, stop)
        parts.append((np.einsum("ij,ij->i", b, b), np.einsum("ij,ij->i", y, y), stop - start))
    base, response, count = zip(*parts)
    return sum(base), sum(response), sum(count)


def scales_of(squares: Sequence[tuple[Array, Array, int]]) -> Scales:
    """Root mean squares from the sums of all manoeuvres; one where zero."""
    count = sum(s[2] for s in squares)
    roots = [np.sqrt(sum(s[i] for s in squares) / max(count, 1)) for i in (0, 1)]
    base, response = (np.where(np.isfinite(r) & (r > 0), r, 1.0) for r in roots)
    return base, response


def column_scale(exponents: NDArray[np.integer], scales: Scales) -> Array:
    """Scales of [1, candidates, responses] from those of the base signals."""
    base, response = scales
    return np.concatenate([[1.0], np.exp(np.asarray(exponents) @ np.log(base)), response])


# ---------------------------------------------------------------- monomials


@dataclass(frozen=True)
class MonomialPlan:
    """Multiplications that compute a set of monomials.

    Attributes
    ----------
    target, parent, factor : (m,) int array
        Row ``target[i]`` is row ``parent[i]`` times row ``factor[i]`` or, where the parent is -1, base signal
        ``factor[i]``, in this order.
    n_rows : int
        Rows of the workspace; those after the monomials are factors that are not candidates.
    """

    target: NDArray[np.int32]
    parent: NDArray[np.int32]
    factor: NDArray[np.int32]
    n_rows: int


def words_of(exponents: NDArray[np.integer]) -> tuple[Word, ...]:
    """Each row of exponents as a sorted word.

    Raises
    ------
    TermError
        Where exponents are negative, or a row is the constant (which is always there and never a candidate).
    """
    table = np.asarray(exponents)
    if table.size and table.min() < 0:
        raise TermError("words_of needs exponents of zero and above; a negative one is no monomial.")
    signals = np.arange(table.shape[-1])
    words = tuple(tuple(np.repeat(signals, row).tolist()) for row in table)
    if () in words:
        raise TermError(f"words_of: candidate {words.index(())} is the constant, which every pool already holds.")
    return words


@lru_cache(maxsize=32)
def plan_monomials(words: tuple[Word, ...]) -> MonomialPlan:
    """Plan with one multiplication for each monomial, its factors first.

    Parameters
    ----------
    words : tuple of tuple of int
        Sorted, as from `words_of`; row i of the result is ``words[i]``.
    """
    row_of = {word: i for i, word in enumerate(words)}
    n_rows = len(words)
    pending = sorted(set(words), key=len, reverse=True)
    seen = set(pending)
    while pending:  # add the factors that are not candidates themselves
        word = pending.pop()
        for part in (word[:-1], word[-1:]):
            if part and part not in seen:
                seen.add(part)
                pending.append(part)
                row_of[part] = n_rows
                n_rows += 1
    factors = {w: (row_of[w[:-1]], row_of[w[-1:]]) if len(w) > 1 else (-1, w[0]) for w in seen}
    steps = [(row_of[w], *factors[w]) for w in sorted(seen, key=lambda w: (len(w), w))]
    # A repeated candidate is computed like its first occurrence.
    steps += [(i, *factors[w]) for i, w in enumerate(words) if row_of[w] != i]
    target, parent, factor = np.array(steps, dtype=np.int32).reshape(-1, 3).T.copy()
    return MonomialPlan(target, parent, factor, n_rows)


@njit(cache=True, nogil=True, fastmath={"contract"})
def fill_rows(
    base: NDArray[np.float64],
    first: int,
    c: int,
    weight: NDArray[np.float64],
    target: NDArray[np.int32],
    parent: NDArray[np.int32],
    factor: NDArray[np.int32],
    out: NDArray[np.float64],
) -> None:  # pragma: no cover - compiled
    """Write ``c`` samples of each planned row: of the base signals times ``weight``, from sample ``first``.

    Products are of rows, not of base signals, which may compete for places in the cache.
    """
    for i in range(target.size):
        row = out[target[i]]
        if parent[i] < 0:
            signal, unit = base[factor[i], first : first + c], weight[factor[i]]
            for t in range(c):
                row[t] = unit * signal[t]
        else:
            above, other = out[parent[i]], out[factor[i]]
            for t in range(c):
                row[t] = above[t] * other[t]


# ---------------------------------------------------------------- rows


class RegressorChunks:
    """Scaled rows [1, x_1 .. x_p, y_1 .. y_m] of any range of a manoeuvre, in chunks.

    It owns its workspace, so every job creates its own.

    Parameters
    ----------
    words : tuple of tuple of int
        The candidates.
    scales : (s,) array, (m,) array
    reach : int
        Past samples that every chunk has in addition, for a filter.
    chunk : int
        Samples of a chunk.
    """

    def __init__(self, words: tuple[Word, ...], scales: Scales, reach: int = 0, chunk: int = CHUNK):
        plan, p = plan_monomials(words), len(words)
        self.m = scales[1].size
        self.q = 1 + p + self.m
        self.reach, self.chunk = reach, chunk
        shift = np.where(np.arange(plan.n_rows) < p, 1, 1 + self.m).astype(np.int32)
        self.target, self.parent, self.factor = plan.target + shift[plan.target], plan.parent.copy(), plan.factor.copy()
        for rows in (self.parent, self.factor):
            rows[plan.parent >= 0] += shift[rows[plan.parent >= 0]]
        self.n_rows = plan.n_rows + 1 + self.m
        self.workspace = np.empty(self.n_rows * (chunk + reach))
        self.weight, self.response_scale = 1.0 / scales[0], scales[1][:, None]

    def over(self, source: DataSource, start: int, stop: int) -> Iterator[Array]:
        """Rows (q, reach + c) of c samples each, from ``start``, which is at least ``reach``, to ``stop``.

        They are contiguous, for which compiled loops are vectorised.
        """
        p = self.q - 1 - self.m
        at_once = max(READ_AT_ONCE, self.chunk)
        for slab in range(start, stop, at_once):
            end = min(slab + at_once, stop)
            base = np.ascontiguousarray(source.base(slab - self.reach, end), dtype=float)
            response = source.responses(slab - self.reach, end) / self.response_scale
            for a in range(slab, end, self.chunk):
                width = min(a + self.chunk, end) - a + self.reach
                rows = self.workspace[: self.n_rows * width].reshape(self.n_rows, width)
                rows[0] = 1.0
                fill_rows(base, a - slab, width, self.weight, self.target, self.parent, self.factor, rows)
                rows[1 + p : self.q] = response[:, a - slab : a - slab + width]
                yield rows[: self.q]
