"""Sums of products of rows in tiles whose sums and rows fill the registers.

For rows that are few beside the samples of a chunk a BLAS spends most of its time on arranging them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.compiling import njit

TALL, WIDE = 4, 3  # size of a tile


class TilePlan(NamedTuple):
    """Groups of products in complete tiles; products of the first row fill the last ones.

    Attributes
    ----------
    rows : int array
        Rows on the left and rows on the right of every part of a group.
    parts : (n, 5) int array
        Of each part: rows on the left and on the right, where they begin in ``rows``, and where its sums begin.
    places : list of (left, right) int array
        Place of each product of each group in the sums.
    n_sums : int
        Those that fill the last tiles included.
    """

    rows: NDArray[np.int32]
    parts: NDArray[np.int64]
    places: list[NDArray[np.intp]]
    n_sums: int


def plan_tiles(groups: Sequence[tuple[Sequence[int], Sequence[int]]]) -> TilePlan:
    """Plan of the products of rows on the left with rows on the right, group by group.

    A group is divided in two parts, the second with its sides exchanged, so that few products fill the last tiles.
    """
    rows: list[int] = []
    parts, places, n_sums = [], [], 0
    for left, right in groups:
        place = np.empty((len(left), len(right)), dtype=np.intp)
        i, j = _divide(*place.shape)
        rest = (slice(i, None), slice(None)) if i < len(left) else (slice(None), slice(j, None))
        for (down, across), turned in (((slice(i), slice(j)), False), (rest, True)):
            one, other = (right[across], left[down]) if turned else (left[down], right[across])
            tall, wide = round_up(len(one), TALL), round_up(len(other), WIDE)
            parts.append((tall, wide, len(rows), len(rows) + tall, n_sums))
            rows += [*one, *[0] * (tall - len(one)), *other, *[0] * (wide - len(other))]
            sums = n_sums + np.arange(tall * wide).reshape(tall, wide)[: len(one), : len(other)]
            place[down, across] = sums.T if turned else sums
            n_sums += tall * wide
        places.append(place)
    return TilePlan(np.array(rows, dtype=np.int32), np.array(parts), places, n_sums)


def _divide(h: int, w: int) -> tuple[int, int]:
    """Rows and columns (i, j) of the first part of an (h, w) group; the second has the other rows or columns."""

    def sums(i: int, j: int) -> int:
        turned = (h - i, w) if i < h else (h, w - j)
        return round_up(i, TALL) * round_up(j, WIDE) + round_up(turned[0], WIDE) * round_up(turned[1], TALL)

    return min([(h, j) for j in range(w, -1, -1)] + [(i, w) for i in range(h)], key=lambda part: sums(*part))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_tiles(
    rows: NDArray[np.float64], left: NDArray[np.int32], right: NDArray[np.int32], c: int, out: NDArray[np.float64]
) -> None:  # pragma: no cover - compiled
    """Add the sums over ``c`` samples of rows ``left`` times rows ``right`` to ``out``; complete tiles only."""
    for i in range(0, out.shape[0], TALL):
        a, b, d, e = rows[left[i]], rows[left[i + 1]], rows[left[i + 2]], rows[left[i + 3]]
        for j in range(0, out.shape[1], WIDE):
            x, y, z = rows[right[j]], rows[right[j + 1]], rows[right[j + 2]]
            ax = ay = az = bx = by = bz = dx = dy = dz = ex = ey = ez = 0.0
            for t in range(c):
                ax += a[t] * x[t]
                ay += a[t] * y[t]
                az += a[t] * z[t]
                bx += b[t] * x[t]
                by += b[t] * y[t]
                bz += b[t] * z[t]
                dx += d[t] * x[t]
                dy += d[t] * y[t]
                dz += d[t] * z[t]
                ex += e[t] * x[t]
                ey += e[t] * y[t]
                ez += e[t] * z[t]
            out[i, j] += ax
            out[i, j + 1] += ay
            out[i, j + 2] += az
            out[i + 1, j] += bx
            out[i + 1, j + 1] += by
            out[i + 1, j + 2] += bz
            out[i + 2, j] += dx
            out[i + 2, j + 1] += dy
            out[i + 2, j + 2] += dz
            out[i + 3, j] += ex
            out[i + 3, j + 1] += ey
            out[i + 3, j + 2] += ez


@njit(cache=True, nogil=True)
def add_parts(
    rows: NDArray[np.float64], sides: NDArray[np.int32], parts: NDArray[np.int64], c: int, out: NDArray[np.float64]
) -> None:  # pragma: no cover - compiled
    """Add the products of the parts of a `TilePlan`, whose ``rows`` are ``sides`` here, to the sums ``out``."""
    for tall, wide, left, right, at in parts:
        sums = out[at : at + tall * wide].reshape((tall, wide))
        add_tiles(rows, sides[left : left + tall], sides[right : right + wide], c, sums)


def round_up(n: int, tile: int) -> int:
    """Next multiple of the tile size."""
    return -(-n // tile) * tile
