"""Centred products without the rounding of ordinary ones, for the few columns that need it.

Of columns that all but depend on each other the search sees small differences of large products: a Schur complement of
1e-9 leaves seven of the sixteen digits, less those that thousands of additions have lost. These sums lose none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.colour import Colour, reference_sigma, whiten_rows
from structsel.numerics.cutting import cut_blocks
from structsel.numerics.moments import triangle
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.passes import Part, Passes
from structsel.numerics.rows import CHUNK, RowMaker, Scales, Signals

DIGITS = 21  # binary, of the coarse parts: sums of CHUNK products of two are below 2^53, so that none is rounded
assert CHUNK * 2 ** (2 * DIGITS) < 2**53


class ExactProducts:
    """``Z'Z`` of rows given a chunk at a time, added in twice the digits.

    Every row is split into a coarse part of few digits and the rest. Products of coarse parts add up without any
    rounding; those with the rest are a millionth of them, and so is their rounding.

    Parameters
    ----------
    q : int
        Number of rows.
    """

    def __init__(self, q: int):
        self._sum = np.zeros((q, q))
        self._rest = np.zeros((q, q))

    def add(self, rows: Array) -> None:
        """Add the products of (q, c) rows, c no more than ``CHUNK``."""
        above = np.ldexp(1.0, np.frexp(np.abs(rows).max(axis=1))[1])
        far = (1.5 * 2.0 ** (52 - DIGITS) * above)[:, None]
        coarse = (rows + far) - far
        fine = rows - coarse
        across = coarse @ fine.T
        part = coarse @ coarse.T
        total = self._sum + part
        shifted = total - self._sum
        self._rest += (self._sum - (total - shifted)) + (part - shifted) + across + across.T + fine @ fine.T
        self._sum = total

    @property
    def totals(self) -> tuple[Array, Array]:
        """All products so far, (q, q), and what they lack."""
        return self._sum, self._rest


@dataclass(frozen=True)
class ExactSums:
    """The job of `exact_centred`: triangles of Z'Z of a few candidates and one response, whitened where it has colours.

    Attributes
    ----------
    exponents : (p, s) int array
    scales : (s,) array, (m,) array
    response : int
    level : float
        Innovation that whitened rows are weighted to.
    """

    exponents: NDArray[np.integer]
    scales: Scales
    response: int
    level: float

    def size(self, part: Part) -> int:
        """Entries of the triangle, and of what it lacks."""
        return 2 * triangle(2 + len(self.exponents))

    def start(self) -> Callable[[Part], Array]:
        """Row by row: there are few."""
        p = len(self.exponents)
        plan, upper = plan_rows(words_of(self.exponents)), np.triu_indices(p + 2)
        wanted = [*range(1 + p), 1 + p + self.response]

        def one(part: Part) -> Array:
            products = ExactProducts(p + 2)
            for piece in part:
                reach = max((c.order for c in piece.colours), default=0)
                maker = RowMaker(plan, p, self.scales, reach)
                for rows, a, b in maker.chunks(piece.signals, max(piece.start, reach), piece.stop):
                    rows = rows[wanted]
                    if piece.colours:
                        colour, into = piece.colours[self.response], np.empty((p + 2, b - a))
                        whiten_rows(rows, colour.ar, self.level / colour.sigma, reach, into)
                        rows = into
                    products.add(rows)
            return np.concatenate([of[upper] for of in products.totals])

        return one


def exact_centred(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    candidates: Sequence[int],
    response: int,
    colours: Sequence[Sequence[Colour]] = (),
    *,
    blocks: int,
    scales: Scales,
    passes: Passes,
) -> Array:
    """Centred products of some candidates and one response, each rounded once, in one pass.

    Parameters
    ----------
    manoeuvres, exponents, blocks, scales
        As for `accumulate` or `accumulate_whitened`, whose moments they are in place of.
    candidates : sequence of int
        Those that nearly depend on each other, k of them.
    response : int
        Among those of the manoeuvres.
    colours : sequence over responses of sequences over manoeuvres
        Of whitened moments.

    Returns
    -------
    (k + 1, k + 1) array
        In the units of those moments.
    """
    cut = cut_blocks([s.n for s in manoeuvres], blocks, len(exponents))
    level = reference_sigma(colours[response], [s.n for s in manoeuvres]) if colours else 1.0
    job = ExactSums(exponents[list(candidates)], scales, response, level)
    table = passes.over(job, cut.parts(manoeuvres, colours)).table
    q = len(candidates) + 2
    sums = np.empty((q, q), dtype=object)
    sums[np.triu_indices(q)] = [_exactly(entries) for entries in table.reshape(2 * len(table), -1).T]
    C = np.empty((q - 1, q - 1))
    for i, j in zip(*np.triu_indices(q - 1)):
        C[i, j] = C[j, i] = float(sums[i + 1, j + 1] - sums[0, i + 1] * sums[0, j + 1] / sums[0, 0])
    return C


def _exactly(values: Array) -> Fraction:
    """Return their sum."""
    total = math.fsum(values)
    return Fraction(total) + Fraction(math.fsum([*values, -total]))
