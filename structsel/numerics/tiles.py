"""Sums of products of rows in tiles whose sums and rows fill the registers.

For rows that are few beside the samples of a chunk a BLAS spends most of its time on arranging them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.compiling import njit

TALL, WIDE = 4, 3  # size of a tile


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_tiles(
    rows: NDArray[np.float64], left: NDArray[np.int32], right: int, c: int, out: NDArray[np.float64]
) -> None:  # pragma: no cover - compiled
    """Add the sums over ``c`` samples of rows ``left`` times rows from ``right`` on to ``out``; complete tiles only."""
    for i in range(0, out.shape[0], TALL):
        a, b, d, e = rows[left[i]], rows[left[i + 1]], rows[left[i + 2]], rows[left[i + 3]]
        for j in range(0, out.shape[1], WIDE):
            x, y, z = rows[right + j], rows[right + j + 1], rows[right + j + 2]
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
    rows: NDArray[np.float64], left: NDArray[np.int32], groups: NDArray[np.int64], c: int, out: NDArray[np.float64]
) -> None:  # pragma: no cover - compiled
    """Add tiles of each group, (tall, wide, first row on the right, where its sums begin)."""
    for tall, wide, first, at in groups:
        add_tiles(rows, left, first, c, out[at : at + tall * wide].reshape((tall, wide)))


def round_up(n: int, tile: int) -> int:
    """Next multiple of the tile size."""
    return -(-n // tile) * tile
