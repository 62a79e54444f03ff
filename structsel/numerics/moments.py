"""Second moments of candidates and responses: one pass over the data, additive, in memory that does not grow.

Columns are always ``z = [1, x_1 .. x_p, y_1 .. y_m]``. Each block of consecutive samples contributes ``Z'Z``; blocks
add up to manoeuvres and manoeuvres to the whole, so that leaving one out, or weighting them at random, touches no data
again.

References
----------
The algebra is that of the normal equations, [KM16] ch. 5; whitening each manoeuvre is generalised least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.cutting import cut_blocks
from structsel.numerics.distinct import DistinctMaker, plan_distinct
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.noise_models import ARNoise, pooled_innovation_std, prewhiten
from structsel.numerics.passes import Part, Passes, Progress
from structsel.numerics.rows import CHUNK, RowMaker, Scales, Signals, base_scale, column_scale, plain_products


@dataclass(frozen=True)
class MomentSet:
    """Products ``Z'Z`` of scaled columns, one packed triangle per block.

    Attributes
    ----------
    scale : (1 + p + m,) array
        What each column was divided by.
    n : (B,) int array
        Samples each block contributed.
    manoeuvre, last : (B,) int array
        Which manoeuvre each block belongs to; where it holds several, the first of them, and the last.
    packed : (B, q (q + 1) / 2) array
        Upper triangles, row by row, q = 1 + p + m.
    n_candidates, n_responses : int
    """

    scale: Array
    n: NDArray[np.int64]
    manoeuvre: NDArray[np.int64]
    last: NDArray[np.int64]
    packed: Array
    n_candidates: int
    n_responses: int

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return int(self.n.size)

    def members(self, blocks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Every manoeuvre of which samples are in these blocks."""
        ranges = zip(self.manoeuvre[blocks], self.last[blocks], strict=True)
        return np.unique(np.concatenate([np.arange(first, last + 1) for first, last in ranges]))

    def unpack(self, packed: Array) -> Array:
        """Full symmetric (q, q) matrix of one packed triangle."""
        return np.take(packed, _places(self.scale.size))

    def total(self, weights: Array | None = None) -> Array:
        """Weighted sum of all blocks' products, (q, q)."""
        return self.unpack(self.packed.sum(axis=0) if weights is None else weights @ self.packed)

    def only(self, manoeuvre: int) -> Array:
        """Products of one manoeuvre."""
        return self.total((self.manoeuvre == manoeuvre).astype(float))

    def without(self, manoeuvre: int) -> Array:
        """Products of all manoeuvres but one."""
        return self.total((self.manoeuvre != manoeuvre).astype(float))

    def samples(self, weights: Array | None = None) -> float:
        """Samples behind `total` with the same weights."""
        return float(self.n.sum() if weights is None else weights @ self.n)


@lru_cache(maxsize=8)
def _places(q: int) -> NDArray[np.intp]:
    """(q, q) table of where each entry of a symmetric matrix lies in its packed upper triangle."""
    table = np.zeros((q, q), dtype=np.intp)
    upper = np.triu_indices(q)
    table[upper] = np.arange(upper[0].size)
    table.T[upper] = table[upper]
    return table


@njit(cache=True, nogil=True, error_model="numpy")
def sweep_constant(product: Array) -> Array:  # pragma: no cover - compiled
    """Products with the constant (column 0) regressed out, (q - 1, q - 1): the centred second moments."""
    swept = product[1:, 1:].copy()
    if product[0, 0] > 0.0:
        for i in range(swept.shape[0]):
            share = product[i + 1, 0] / product[0, 0]
            for j in range(swept.shape[1]):
                swept[i, j] -= share * product[0, j + 1]
    return swept


def choose_workers(workers: int | None, n: int, p: int) -> int:
    """One worker where there is little to do, else two; what the caller asks for otherwise."""
    if workers is not None:
        if workers < 1:
            raise SelectionError(f"workers must be 1 or more, not {workers}.")
        return workers
    return 2 if n * p * p > 2e9 else 1


@dataclass(frozen=True)
class Products:
    """The job of `accumulate`: upper triangle of Z'Z.

    Attributes
    ----------
    exponents : (p, s) int array
    scales : (s,) array, (m,) array
    """

    exponents: NDArray[np.integer]
    scales: Scales

    def size(self, part: Part) -> int:
        """Entries of the triangle."""
        return triangle(1 + len(self.exponents) + self.scales[1].size)

    def start(self) -> Callable[[Part], Array]:
        """Through distinct sums where that is cheaper."""
        words = words_of(self.exponents)
        p, m = len(words), self.scales[1].size
        distinct = plan_distinct(words, self.scales[0].size)
        if distinct is not None:
            products = DistinctMaker(words, distinct, self.scales).products
        else:
            maker, q = RowMaker(plan_rows(words), p, self.scales), 1 + p + m
            upper = np.ravel_multi_index(np.triu_indices(q), (q, q))

            def products(signals: Signals, start: int, stop: int) -> Array:
                return plain_products(maker, signals, start, stop).ravel()[upper]

        def one(part: Part) -> Array:
            total = products(part[0].signals, part[0].start, part[0].stop)
            for piece in part[1:]:
                total += products(piece.signals, piece.start, piece.stop)
            return total

        return one


@dataclass(frozen=True)
class WhitenedProducts:
    """The job of `accumulate_whitened`: a triangle for each response, one after another.

    Attributes
    ----------
    exponents : (p, s) int array
    scales : (s,) array, (m,) array
    levels : (m,) sequence of float
        Innovation that each response's rows are weighted to.
    """

    exponents: NDArray[np.integer]
    scales: Scales
    levels: Sequence[float]

    def size(self, part: Part) -> int:
        """Entries of all triangles."""
        return self.scales[1].size * triangle(2 + len(self.exponents))

    def start(self) -> Callable[[Part], Array]:
        """Rows are made once, and filtered for each response."""
        words = words_of(self.exponents)
        p, m = len(words), self.scales[1].size
        plan = plan_rows(words)
        makers: dict[int, RowMaker] = {}
        filtered = np.empty((p + 2, CHUNK))
        product = np.empty((p + 2, p + 2))
        upper = np.ravel_multi_index(np.triu_indices(p + 2), (p + 2, p + 2))

        def one(part: Part) -> Array:
            totals = np.zeros((m, p + 2, p + 2))
            for piece in part:
                reach = max(c.order for c in piece.colours)
                if reach not in makers:
                    makers[reach] = RowMaker(plan, p, self.scales, reach)
                for rows, a, b in makers[reach].chunks(piece.signals, max(piece.start, reach), piece.stop):
                    responses = rows[1 + p :].copy()
                    for r, colour in enumerate(piece.colours):
                        rows[1 + p] = responses[r]
                        into = filtered[:, : b - a]
                        prewhiten(rows[: p + 2], colour.ar, self.levels[r] / colour.sigma, reach, into)
                        np.matmul(into, into.T, out=product)
                        totals[r] += product
            return totals.reshape(m, -1)[:, upper].ravel()

        return one


def triangle(q: int) -> int:
    """Entries of the upper triangle of a (q, q) matrix."""
    return q * (q + 1) // 2


def accumulate(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Progress | None = None,
    scales: Scales | None = None,
    passes: Passes | None = None,
) -> MomentSet:
    """Second moments of [1, candidates, responses] of every manoeuvre in one pass.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : (p, s) int array
        Each candidate's powers of the base signals; the constant is always added.
    blocks : int
        About how many blocks to cut the manoeuvres into, at least one each; very many manoeuvres share blocks.
    workers : int, optional
        Threads, each with accumulators of its own. By default one where there is little to do, else two.
    progress : callable, optional
        Called with blocks done and blocks in all.
    scales : (s,) array, (m,) array, optional
        Of base signals and responses; as `base_scale` finds them where absent.
    passes : Passes, optional
        Who goes through the data; this process where absent.

    Returns
    -------
    MomentSet
        Memory: one (1 + p + m)^2 / 2 triangle per block and a workspace of 512 samples per worker.
    """
    scales = scales or base_scale(manoeuvres)
    p = len(exponents)
    cut = cut_blocks([s.n for s in manoeuvres], blocks, p)
    threads = choose_workers(workers, cut.samples, p)
    made = (passes or Passes()).over(Products(exponents, scales), cut.parts(manoeuvres), threads, progress)
    scale = column_scale(exponents, *scales)
    return MomentSet(scale, cut.n(), cut.first, cut.last, made.table, p, scales[1].size)


def accumulate_whitened(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    colours: Sequence[Sequence[ARNoise]],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Progress | None = None,
    scales: Scales | None = None,
    passes: Passes | None = None,
) -> list[MomentSet]:
    """Second moments after whitening: one MomentSet per response, each through its own filters, in one pass.

    Parameters
    ----------
    colours : sequence over responses of sequences over manoeuvres
        Filter of each response's residual in each manoeuvre. The constant is filtered like every other column; the
        first samples of a manoeuvre, as many as the filter is long, start the filter and do not count.
    blocks, workers, progress, scales, passes
        As for `accumulate`.

    Returns
    -------
    list of MomentSet
        With one response each, rows weighted by pooled_innovation_std / sigma_k.
    """
    scales = scales or base_scale(manoeuvres)
    p, m = len(exponents), scales[1].size
    lengths = [s.n for s in manoeuvres]
    cut = cut_blocks(lengths, blocks, p)
    n = cut.n([max(of[k].order for of in colours) for k in range(len(manoeuvres))])
    threads = choose_workers(workers, int(n.sum()), p)
    parts = cut.parts(manoeuvres, colours)
    job = WhitenedProducts(exponents, scales, [pooled_innovation_std(of, lengths) for of in colours])
    packed = (passes or Passes()).over(job, parts, threads, progress).table.reshape(n.size, m, -1)
    scale = column_scale(exponents, *scales)
    of_response = [np.append(scale[: p + 1], scale[p + 1 + r]) for r in range(m)]
    return [MomentSet(of_response[r], n, cut.first, cut.last, packed[:, r], p, 1) for r in range(m)]
