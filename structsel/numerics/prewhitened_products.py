"""Cross-products of prewhitened candidates and responses: generalised least squares, in one pass over the data.

References
----------
[KM16] ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

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
from structsel.numerics.cross_products import CrossProducts, columns_of, diagonal_places, places, triangle_size
from structsel.numerics.noise_models import ARNoise, pooled_innovation_std, prewhiten
from structsel.numerics.rank_update import RowProducts
from structsel.numerics.regressors import (
    CHUNK,
    DataSource,
    RegressorChunks,
    Scales,
    Word,
    column_scale,
    find_scales,
    words_of,
)


def prewhitened_cross_products(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    noise: Sequence[Sequence[ARNoise]],
    *,
    blocks: int = 12,
    workers: int | None = None,
    progress: Progress | None = None,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
    terms: Sequence[Sequence[int]] | None = None,
) -> list[CrossProducts]:
    """Cross-products after prewhitening: one set per response, each through its own filters, in one pass.

    Parameters
    ----------
    noise : sequence over responses of sequences over manoeuvres
        Model of each response's residual in each manoeuvre. The constant is filtered like every other column. The
        first samples of a manoeuvre, as many as the filter has coefficients, start the filter and are not counted.
    blocks, workers, progress, scales, runner
        As for `cross_products`.
    terms : sequence over responses of sequences of int, optional
        Form only the products of these candidates, of the constant and of the response with every column, and the
        squares of the others; the products of the others with one another are zero.

    Returns
    -------
    list of CrossProducts
        With one response each, rows weighted by the pooled innovation over that of their manoeuvre.
    """
    scales = scales or find_scales(manoeuvres)
    p, m = len(exponents), scales[1].size
    lengths = [s.n for s in manoeuvres]
    cut = cut_blocks(lengths, blocks, p)
    n = count_samples(cut, [max(of[k].order for of in noise) for k in range(len(manoeuvres))])
    levels = [pooled_innovation_std(of, lengths) for of in noise]
    values = (runner or JobRunner()).run_pass(
        partial(_prewhitened_products_of_block, words_of(exponents), scales, levels, terms),
        attach_data(cut, manoeuvres, noise),
        [m * triangle_size(2 + p)] * len(cut),
        choose_workers(workers, int(n.sum()), p),
        progress,
    )
    packed = values.reshape(len(cut), m, -1)
    scale = column_scale(exponents, scales)
    of_response = [np.append(scale[: p + 1], scale[p + 1 + r]) for r in range(m)]
    first, last = first_and_last(cut)
    return [CrossProducts(of_response[r], n, first, last, packed[:, r], p, 1) for r in range(m)]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _add_squares(rows: Array, squares: Array) -> None:  # pragma: no cover - compiled
    """Add the sum of squares of each row to ``squares``; several times as fast as numpy's einsum."""
    for i in range(rows.shape[0]):
        row, total = rows[i], 0.0
        for t in range(row.size):
            total += row[t] * row[t]
        squares[i] += total


class ProductsWithSome:
    """Sums of the products of some rows with all, and of the square of every row.

    Parameters
    ----------
    q : int
        Number of rows.
    some : sequence of int
    """

    def __init__(self, q: int, some: Sequence[int]):
        self.some = np.asarray(some)
        self.sums, self.squares = np.zeros((len(some), q)), np.zeros(q)

    def add(self, rows: Array) -> None:
        """Add the products of these rows, (q, n)."""
        self.sums += rows[self.some] @ rows.T
        _add_squares(rows, self.squares)

    def triangle(self) -> Array:
        """The sum so far, row by row; zero where it is not formed."""
        q = self.squares.size
        packed = np.zeros(triangle_size(q))
        packed[diagonal_places(q)] = self.squares
        packed[places(q, range(q))[self.some]] = self.sums
        return packed


def _prewhitened_products_of_block(
    words: tuple[Word, ...],
    scales: Scales,
    levels: Sequence[float],
    terms: Sequence[Sequence[int]] | None,
    block: Sequence[Samples],
) -> Array:
    """Upper triangles of all responses; rows are made once, and filtered for each response."""
    q, m = 2 + len(words), scales[1].size
    workspace = np.empty(q * CHUNK)
    products = [RowProducts(q) if terms is None else ProductsWithSome(q, columns_of(q, terms[r])) for r in range(m)]
    chunks: dict[int, RegressorChunks] = {}
    for part in block:
        reach = max(model.order for model in part.noise)
        if reach not in chunks:
            chunks[reach] = RegressorChunks(words, scales, reach)
        for rows in chunks[reach].over(part.source, max(part.start, reach), part.stop):
            responses = rows[q - 1 :].copy()
            n = rows.shape[1] - reach
            filtered = workspace[: q * n].reshape(q, n)
            for r, model in enumerate(part.noise):
                rows[q - 1] = responses[r]
                prewhiten(rows[:q], model.ar, levels[r] / model.sigma, reach, filtered)
                products[r].add(filtered)
    return np.concatenate([of.triangle() for of in products])
