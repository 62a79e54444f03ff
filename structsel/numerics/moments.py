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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from structsel.errors import SelectionError
from structsel.numerics.colour import Colour, reference_sigma, whiten_rows
from structsel.numerics.monomials import plan_distinct, plan_rows, words_of
from structsel.numerics.rows import (
    CHUNK,
    Array,
    DistinctMaker,
    RowMaker,
    Signals,
    base_scale,
    column_scale,
    plain_products,
)


@dataclass(frozen=True)
class Block:
    """Samples ``start`` to ``stop`` of manoeuvre ``manoeuvre``."""

    manoeuvre: int
    start: int
    stop: int


@dataclass(frozen=True)
class MomentSet:
    """Products ``Z'Z`` of scaled columns, one packed triangle per block.

    Attributes
    ----------
    scale : (1 + p + m,) array
        What each column was divided by.
    n : (B,) int array
        Samples each block contributed.
    manoeuvre : (B,) int array
        Which manoeuvre each block belongs to.
    packed : (B, q (q + 1) / 2) array
        Upper triangles, row by row, q = 1 + p + m.
    n_candidates, n_responses : int
    """

    scale: Array
    n: NDArray[np.int64]
    manoeuvre: NDArray[np.int64]
    packed: Array
    n_candidates: int
    n_responses: int

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return int(self.n.size)

    def unpack(self, packed: Array) -> Array:
        """Full symmetric (q, q) matrix of one packed triangle."""
        q = self.scale.size
        full = np.zeros((q, q))
        upper = np.triu_indices(q)
        full[upper] = packed
        full.T[upper] = packed
        return full

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


def sweep_constant(product: Array) -> Array:
    """Products with the constant (column 0) regressed out, (q - 1, q - 1): the centred second moments."""
    if not product[0, 0] > 0.0:
        return product[1:, 1:].copy()
    return product[1:, 1:] - np.outer(product[1:, 0], product[0, 1:]) / product[0, 0]


def split_blocks(lengths: Sequence[int], wanted: int, shortest: int = 64) -> list[Block]:
    """Cut manoeuvres into about ``wanted`` blocks in all, at least one each and none needlessly short."""
    total = sum(lengths)
    blocks = []
    for k, n in enumerate(lengths):
        pieces = max(1, min(round(wanted * n / max(total, 1)), n // shortest))
        edges = np.linspace(0, n, pieces + 1).round().astype(int)
        blocks += [Block(k, int(a), int(b)) for a, b in pairwise(edges)]
    return blocks


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def _over_blocks(
    blocks: list[Block],
    q: int,
    work: Callable[[], Callable[[Block], list[Array]]],
    n_results: int,
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> list[Array]:
    """Run a worker's function on every block; packed triangles, one (B, ...) array per result."""
    upper = np.ravel_multi_index(np.triu_indices(q), (q, q))
    packed = [np.zeros((len(blocks), upper.size)) for _ in range(n_results)]
    waiting = iter(range(len(blocks)))
    done = 0

    def run() -> None:
        nonlocal done
        one = work()
        for i in waiting:  # shared between workers: each next() is one step of the interpreter
            for store, result in zip(packed, one(blocks[i]), strict=True):
                np.take(result.ravel(), upper, out=store[i])
            done += 1
            if progress is not None:
                progress(done, len(blocks))

    with _blas().limit(limits=1, user_api="blas"):
        if workers == 1:
            run()
        else:
            with ThreadPoolExecutor(workers) as pool:
                for future in [pool.submit(run) for _ in range(workers)]:
                    future.result()
    return packed


def choose_workers(workers: int | None, n: int, p: int) -> int:
    """One worker where there is little to do, else two; what the caller asks for otherwise."""
    if workers is not None:
        if workers < 1:
            raise SelectionError(f"workers must be 1 or more, not {workers}.")
        return workers
    return 2 if n * p * p > 2e9 else 1


def accumulate(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MomentSet:
    """Second moments of [1, candidates, responses] of every manoeuvre in one pass.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : (p, s) int array
        Each candidate's powers of the base signals; the constant is always added.
    blocks : int
        About how many blocks to cut the manoeuvres into, at least one each.
    workers : int, optional
        Threads, each with accumulators of its own. By default one where there is little to do, else two.
    progress : callable, optional
        Called with blocks done and blocks in all.

    Returns
    -------
    MomentSet
        Memory: one (1 + p + m)^2 / 2 triangle per block and a workspace of 512 samples per worker.
    """
    scales = base_scale(manoeuvres)
    words = words_of(exponents)
    p, m = len(words), scales[1].size
    cut = split_blocks([s.n for s in manoeuvres], blocks)
    distinct = plan_distinct(tuple(words), scales[0].size)
    rows = plan_rows(words)

    def work() -> Callable[[Block], list[Array]]:
        if distinct is not None:
            sums = DistinctMaker(distinct, p, scales)
            return lambda block: [sums.products(manoeuvres[block.manoeuvre], block.start, block.stop)]
        maker = RowMaker(rows, p, scales)
        return lambda block: [plain_products(maker, manoeuvres[block.manoeuvre], block.start, block.stop)]

    n = np.array([b.stop - b.start for b in cut])
    threads = choose_workers(workers, int(n.sum()), p)
    (packed,) = _over_blocks(cut, 1 + p + m, work, 1, threads, progress)
    which = np.array([b.manoeuvre for b in cut])
    return MomentSet(column_scale(exponents, *scales), n, which, packed, p, m)


def accumulate_whitened(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    colours: Sequence[Sequence[Colour]],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[MomentSet]:
    """Second moments after whitening: one MomentSet per response, each through its own filters, in one pass.

    Parameters
    ----------
    colours : sequence over responses of sequences over manoeuvres
        Filter of each response's residual in each manoeuvre. The constant is filtered like every other column; the
        first samples of a manoeuvre, as many as the filter is long, start the filter and do not count.

    Returns
    -------
    list of MomentSet
        With one response each, rows weighted by reference_sigma / sigma_k.
    """
    scales = base_scale(manoeuvres)
    words = words_of(exponents)
    p, m = len(words), scales[1].size
    lengths = [s.n for s in manoeuvres]
    cut = split_blocks(lengths, blocks)
    plan = plan_rows(words)
    reach = [max(colours[r][k].order for r in range(m)) for k in range(len(manoeuvres))]
    weight = [[reference_sigma(of, lengths) / c.sigma for c in of] for of in colours]

    def work() -> Callable[[Block], list[Array]]:
        makers = {k: RowMaker(plan, p, scales, k) for k in set(reach)}
        filtered = np.empty((p + 2, CHUNK))
        part = np.empty((p + 2, p + 2))

        def one(block: Block) -> list[Array]:
            k = block.manoeuvre
            totals = [np.zeros((p + 2, p + 2)) for _ in range(m)]
            start = max(block.start, reach[k])
            for rows, a, b in makers[reach[k]].chunks(manoeuvres[k], start, block.stop):
                responses = rows[1 + p :].copy()
                for r in range(m):
                    rows[1 + p] = responses[r]
                    into = filtered[:, : b - a]
                    whiten_rows(rows[: p + 2], colours[r][k].ar, weight[r][k], reach[k], into)
                    np.matmul(into, into.T, out=part)
                    totals[r] += part
            return totals

        return one

    n = np.array([max(b.stop - max(b.start, reach[b.manoeuvre]), 0) for b in cut])
    threads = choose_workers(workers, int(n.sum()), p)
    packed = _over_blocks(cut, p + 2, work, m, threads, progress)
    scale = column_scale(exponents, *scales)
    which = np.array([b.manoeuvre for b in cut])
    return [MomentSet(np.append(scale[: p + 1], scale[p + 1 + r]), n, which, packed[r], p, 1) for r in range(m)]
