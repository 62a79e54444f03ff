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
        Rows on the left and rows on the right of every group.
    groups : (g, 5) int array
        Of each group: rows on the left and on the right, where they begin in ``rows``, and where its sums begin.
    places : list of (left, right) int array
        Place of each product of each group in the sums.
    n_sums : int
        Those that fill the last tiles included.
    """

    rows: NDArray[np.int32]
    groups: NDArray[np.int64]
    places: list[NDArray[np.intp]]
    n_sums: int


def plan_tiles(groups: Sequence[tuple[Sequence[int], Sequence[int]]]) -> TilePlan:
    """Plan of the products of rows on the left with rows on the right, group by group.

    A group is turned where fewer products then fill its last tiles.
    """
    rows: list[int] = []
    table, places, n_sums = [], [], 0
    for sides in groups:
        turned = np.prod(_sums_of(*sides)) > np.prod(_sums_of(*sides[::-1]))
        left, right = sides[::-1] if turned else sides
        tall, wide = _sums_of(left, right)
        table.append((tall, wide, len(rows), len(rows) + tall, n_sums))
        rows += [*left, *[0] * (tall - len(left)), *right, *[0] * (wide - len(right))]
        place = n_sums + np.arange(tall * wide).reshape(tall, wide)[: len(left), : len(right)]
        places.append(place.T if turned else place)
        n_sums += tall * wide
    return TilePlan(np.array(rows, dtype=np.int32), np.array(table), places, n_sums)


def _sums_of(left: Sequence[int], right: Sequence[int]) -> tuple[int, int]:
    """Sums of the complete tiles of a group, down and across."""
    return round_up(len(left), TALL), round_up(len(right), WIDE)


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
def add_groups(
    rows: NDArray[np.float64], sides: NDArray[np.int32], groups: NDArray[np.int64], c: int, out: NDArray[np.float64]
) -> None:  # pragma: no cover - compiled
    """Add the products of each group of a `TilePlan`, whose ``rows`` are ``sides`` here, to the sums ``out``."""
    for tall, wide, left, right, at in groups:
        sums = out[at : at + tall * wide].reshape((tall, wide))
        add_tiles(rows, sides[left : left + tall], sides[right : right + wide], c, sums)


def round_up(n: int, tile: int) -> int:
    """Next multiple of the tile size."""
    return -(-n // tile) * tile
