"""Cross-products of candidates and responses: one pass over the data, additive, in memory that does not grow.

Columns are always ``z = [1, x_1 .. x_p, y_1 .. y_m]``. Each block of consecutive samples contributes ``Z'Z``; blocks
add up to manoeuvres and manoeuvres to the total, so that leaving one out, or weighting them at random, needs no second
pass.

References
----------
[KM16] ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial, reduce

import numpy as np
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.blocks import (
    JobRunner,
    Progress,
    Samples,
    attach_data,
    choose_workers,
    count_samples,
    cut_blocks,
    first_and_last,
)
from structsel.numerics.compiling import njit
from structsel.numerics.polynomial_products import PolynomialProducts, plan_polynomial_products
from structsel.numerics.rank_update import RowProducts, upper_triangle
from structsel.numerics.regressors import (
    DataSource,
    RegressorChunks,
    Scales,
    Word,
    column_scale,
    find_scales,
    words_of,
)

CONSTANT = 1e-11  # of a column's mean square: rounding of a constant column


@dataclass(frozen=True)
class CrossProducts:
    """Products ``Z'Z`` of scaled columns, one packed triangle per block.

    Attributes
    ----------
    scale : (1 + p + m,) array
        Divisor of each column.
    n : (B,) int array
        Samples each block contributed.
    manoeuvre, last : (B,) int array
        First and last manoeuvre of each block; equal unless it holds several.
    packed : (B, q (q + 1) / 2) array
        Upper triangles, row by row, q = 1 + p + m.
    n_candidates, n_responses : int
    own_constants : bool
        Whether a constant of each manoeuvre has been regressed out; see `within_manoeuvres`.
    """

    scale: Array
    n: NDArray[np.int64]
    manoeuvre: NDArray[np.int64]
    last: NDArray[np.int64]
    packed: Array
    n_candidates: int
    n_responses: int
    own_constants: bool = False

    @property
    def n_blocks(self) -> int:
        """Number of blocks."""
        return int(self.n.size)

    def members(self, blocks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers of the manoeuvres with samples in these blocks."""
        ranges = zip(self.manoeuvre[blocks], self.last[blocks], strict=True)
        return np.unique(np.concatenate([np.arange(first, last + 1) for first, last in ranges]))

    def unpack(self, packed: Array) -> Array:
        """Full symmetric (q, q) matrix of one packed triangle."""
        return np.take(packed, _places(self.scale.size))

    def total(self, weights: Array | None = None) -> Array:
        """Weighted sum of the products of all blocks, (q, q)."""
        return self.unpack(self.packed_total(weights))

    def packed_total(self, weights: Array | None = None) -> Array:
        """The same as a packed triangle."""
        total: Array = self.packed.sum(axis=0) if weights is None else weights @ self.packed
        return total

    def part(self, columns: Sequence[int], weights: Array | None = None) -> Array:
        """The same for some of the columns, without forming the products of the others."""
        if weights is None:
            total: Array = self.parts(columns).sum(axis=0)
            return total
        used = np.flatnonzero(weights)
        blocks = self.parts(columns, used)
        return (weights[used] @ blocks.reshape(used.size, -1)).reshape(blocks.shape[1:])

    def parts(self, columns: Sequence[int], blocks: NDArray[np.integer] | None = None) -> Array:
        """(B, c, c) products of some of the columns in each block, or in some of the blocks."""
        table = places(self.scale.size, columns)
        return self.packed[:, table] if blocks is None else self.packed[blocks[:, None, None], table]

    def only(self, manoeuvre: int) -> Array:
        """Products of one manoeuvre."""
        return self.total((self.manoeuvre == manoeuvre).astype(float))

    def without(self, manoeuvre: int) -> Array:
        """Products of all manoeuvres but one."""
        return self.total((self.manoeuvre != manoeuvre).astype(float))

    def samples(self, weights: Array | None = None) -> float:
        """Number of samples in `total` with the same weights."""
        return float(self.n.sum() if weights is None else weights @ self.n)

    def dof(self, weights: Array | None = None) -> float:
        """Samples behind `total` with the same weights, less one for each constant."""
        constants = 1
        if self.own_constants:
            constants = np.unique(self.manoeuvre if weights is None else self.manoeuvre[weights > 0.0]).size
        return self.samples(weights) - constants

    @property
    def sums(self) -> Array:
        """(B, q) products of every column with the constant, block by block."""
        return self.packed[:, : self.scale.size]

    def sums_of_manoeuvres(self) -> Array:
        """(K, q) products of every column with the constant, manoeuvre by manoeuvre."""
        return np.array([self.sums[self.manoeuvre == k].sum(axis=0) for k in np.unique(self.manoeuvre)])

    def constants(self, theta: Array, columns: Sequence[int]) -> Array:
        """Mean of the response of each manoeuvre less that of ``theta`` (k,) times these columns, (K,); all scaled."""
        totals = self.sums_of_manoeuvres()
        return (totals[:, -1] - totals[:, list(columns)] @ theta) / totals[:, 0]

    def within_manoeuvres(self, columns: Sequence[int] | None = None) -> CrossProducts:
        """The same after regression of every column, or of some, on a constant of each manoeuvre.

        With ``m`` the coefficients of a manoeuvre's columns on its constant column, its products become::

            G_ij - m_i G_0j - G_i0 m_j + m_i m_j G_00

        Least squares on them gives the slopes of least squares with those constants (Frisch, Waugh and Lovell). Blocks
        of a manoeuvre keep its coefficients, so that they still add up. Products of a column that is constant in every
        manoeuvre are zero: what rounding leaves of it could be anything.

        Raises
        ------
        SelectionError
            Blocks hold several manoeuvres.
        """
        if not self.separate:
            raise SelectionError(
                f"a constant of each manoeuvre needs blocks of one manoeuvre each; {self.last.max() + 1} manoeuvres "
                f"share {self.n_blocks} blocks.\nUse constants='shared', or select from fewer recordings."
            )
        packed = np.empty_like(self.packed)
        for k in np.unique(self.manoeuvre):
            blocks = np.flatnonzero(self.manoeuvre == k)
            total = self.sums[blocks].sum(axis=0)
            m = total / total[0] if total[0] > 0.0 else np.zeros(self.scale.size)
            m[0] = 0.0
            if columns is not None:
                m[np.setdiff1d(np.arange(m.size), columns)] = 0.0
            for b in blocks:
                remove_constant(self.packed[b], self.sums[b], m, packed[b])
        diagonal = diagonal_places(self.scale.size)
        still = packed[:, diagonal].sum(axis=0) <= CONSTANT * self.packed[:, diagonal].sum(axis=0)
        packed[:, np.unique(_places(self.scale.size)[still])] = 0.0
        return replace(self, packed=packed, own_constants=columns is None)

    def of_candidates(self, candidates: NDArray[np.integer]) -> CrossProducts:
        """The same with some of the candidates, in their order."""
        responses = 1 + self.n_candidates + np.arange(self.n_responses)
        return self._of_columns(np.concatenate([[0], 1 + candidates, responses]), candidates.size, self.n_responses)

    def among(
        self, candidates: NDArray[np.integer], scale: Array, others: CrossProducts | None = None
    ) -> CrossProducts:
        """These as products of some of more candidates.

        Parameters
        ----------
        candidates : (n_candidates,) int array
            Number of each among all.
        scale : (q,) array
            Divisor of each of all columns.
        others : CrossProducts, optional
            Of all, whose products the others keep; zero where absent.
        """
        packed = np.zeros((self.n_blocks, triangle_size(scale.size))) if others is None else others.packed.copy()
        packed[:, upper_triangle(places(scale.size, columns_of(scale.size, candidates)))] = self.packed
        return replace(self, scale=scale, packed=packed, n_candidates=scale.size - 2)

    @property
    def separate(self) -> bool:
        """Whether every block belongs to one manoeuvre."""
        return bool((self.manoeuvre == self.last).all())

    def of_response(self, response: int) -> CrossProducts:
        """The same with a single response."""
        if self.n_responses == 1:
            return self
        keep = np.append(np.arange(1 + self.n_candidates), 1 + self.n_candidates + response)
        return self._of_columns(keep, self.n_candidates, 1)

    def _of_columns(self, keep: NDArray[np.integer], candidates: int, responses: int) -> CrossProducts:
        inside = upper_triangle(places(self.scale.size, keep))
        scale, packed = self.scale[keep], self.packed[:, inside]
        return replace(self, scale=scale, packed=packed, n_candidates=candidates, n_responses=responses)


@lru_cache(maxsize=8)
def _places(q: int) -> NDArray[np.intp]:
    """(q, q) table of where each entry of a symmetric matrix lies in its packed upper triangle."""
    table = np.zeros((q, q), dtype=np.intp)
    upper = np.triu_indices(q)
    table[upper] = np.arange(upper[0].size)
    table.T[upper] = table[upper]
    return table


@njit(cache=True, nogil=True)
def remove_constant(packed: Array, sums: Array, m: Array, out: Array) -> None:  # pragma: no cover - compiled
    """Products of one block after regression on a constant with coefficients m; ``sums`` are its row 0."""
    at = 0
    for i in range(m.size):
        rest, here, others = sums[i] - m[i] * sums[0], sums[i:], m[i:]
        values, row = packed[at : at + here.size], out[at : at + here.size]
        for j in range(row.size):
            row[j] = values[j] - m[i] * here[j] - rest * others[j]
        at += row.size


def places(q: int, columns: Sequence[int] | NDArray[np.integer]) -> NDArray[np.intp]:
    """(c, c) table of where the products of some of the q columns lie in the packed triangle."""
    index = np.asarray(columns, dtype=np.intp)
    return _places(q)[index[:, None], index]


def columns_of(q: int, candidates: Sequence[int] | NDArray[np.integer]) -> list[int]:
    """The constant, these candidates and the response among q columns of one response."""
    return [0, *(1 + int(j) for j in candidates), q - 1]


def diagonal_places(q: int) -> NDArray[np.intp]:
    """(q,) places of the diagonal in a packed triangle."""
    return _places(q).diagonal()


# ---------------------------------------------------------------- passes over the data


def triangle_size(q: int) -> int:
    """Entries of the upper triangle of a (q, q) matrix."""
    return q * (q + 1) // 2


def cross_products(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Progress | None = None,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
) -> CrossProducts:
    """Cross-products of [1, candidates, responses] of every manoeuvre in one pass.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
    exponents : (p, s) int array
        Each candidate's powers of the base signals; the constant is always added.
    blocks : int
        Approximate number of blocks, at least one for each manoeuvre; if there are very many manoeuvres, they are
        joined in blocks.
    workers : int, optional
        Threads; by default one for a small problem and two for a large one.
    progress : callable, optional
        Called with the number of completed blocks and the total number.
    scales : (s,) array, (m,) array, optional
        Of base signals and responses; by default those of `find_scales`.
    runner : JobRunner, optional
        Executes the pass; by default this process.

    Returns
    -------
    CrossProducts
        Memory: one (1 + p + m)^2 / 2 triangle per block and a workspace of 384 samples per worker.
    """
    scales = scales or find_scales(manoeuvres)
    p, m = len(exponents), scales[1].size
    cut = cut_blocks([s.n for s in manoeuvres], blocks, p)
    n = count_samples(cut)
    packed = (runner or JobRunner()).run_pass(
        partial(_products_of_block, words_of(exponents), scales),
        attach_data(cut, manoeuvres),
        [triangle_size(1 + p + m)] * len(cut),
        choose_workers(workers, int(n.sum()), p),
        progress,
    )
    first, last = first_and_last(cut)
    return CrossProducts(column_scale(exponents, scales), n, first, last, packed.reshape(len(cut), -1), p, m)


def _products_of_block(words: tuple[Word, ...], scales: Scales, block: Sequence[Samples]) -> Array:
    """Upper triangle of Z'Z, from the distinct sums where that is faster."""
    plan = plan_polynomial_products(words, scales[0].size, scales[1].size)
    if plan is not None:
        polynomial = PolynomialProducts(plan, scales)
        return reduce(np.add, (polynomial.over(part.source, part.start, part.stop) for part in block))
    chunks = RegressorChunks(words, scales)
    products = RowProducts(chunks.q)
    for part in block:
        for rows in chunks.over(part.source, part.start, part.stop):
            products.add(rows)
    return products.triangle()
