"""Sums of products of rows with each other: by tiles where rows are few, by the BLAS of scipy where they are many.

`scipy.linalg.blas.dsyrk` keeps the interpreter's lock, so that two threads take turns, and numpy's product of a matrix
with its own transpose copies one triangle to the other. Here the same routine is called through its address.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any

import numpy as np
import scipy.linalg.cython_blas
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.tiles import WIDE, TilePlan, add_parts, plan_tiles

FEW_ROWS = 256  # up to which tiles are faster; BLAS may have wider registers
_INT, _DOUBLE, _ARRAY = ctypes.POINTER(ctypes.c_int), ctypes.POINTER(ctypes.c_double), ctypes.c_void_p


@cache
def _dsyrk() -> Callable[..., None]:
    """The routine, which releases the lock while it runs."""
    capsule = scipy.linalg.cython_blas.__pyx_capi__["dsyrk"]
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    address = api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))
    kinds: list[Any] = [ctypes.c_char_p] * 2 + [_INT] * 2 + [_DOUBLE, _ARRAY, _INT] + [_DOUBLE, _ARRAY, _INT]
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(address)
    return function


def add_products(rows: Array, total: Array) -> None:
    """Add ``rows @ rows.T`` to the upper triangle of ``total``; the lower one is not written.

    Parameters
    ----------
    rows : (q, n) float64 array
        Samples of a row one after another in memory.
    total : (q, q) float64 array, C-contiguous
    """
    q, n = rows.shape
    if total.shape != (q, q) or not total.flags.c_contiguous or rows.strides[1] != rows.itemsize or not q or not n:
        raise SelectionError(f"add_products needs rows (q, n) and a total (q, q); found {rows.shape}, {total.shape}.")
    size, k, ld, step = (ctypes.c_int(v) for v in (q, n, rows.strides[0] // rows.itemsize, q))
    one = ctypes.c_double(1.0)
    by = ctypes.byref
    # In Fortran's order the rows are columns of a matrix (n, q), and the upper triangle is the lower one. Addresses are
    # plain numbers: `data_as` makes reference cycles, which the garbage collector would have to find.
    _dsyrk()(
        *(b"L", b"T", by(size), by(k), by(one), rows.ctypes.data, by(ld)),
        *(by(one), total.ctypes.data, by(step)),
    )


class RowProducts:
    """Upper triangle of a sum of ``rows @ rows.T``.

    Parameters
    ----------
    q : int
        Number of rows.
    """

    def __init__(self, q: int):
        self.by_tiles = q <= FEW_ROWS
        if self.by_tiles:
            self.tiles, self.gather = _plan_strips(q)
        self.sums = np.zeros(self.tiles.n_sums if self.by_tiles else (q, q))

    def add(self, rows: Array) -> None:
        """Add the products of these rows, (q, n) and contiguous."""
        if self.by_tiles:
            add_parts(rows, self.tiles.rows, self.tiles.parts, rows.shape[1], self.sums)
        else:
            add_products(rows, self.sums)

    def triangle(self) -> Array:
        """The sum so far, row by row."""
        return self.sums[self.gather] if self.by_tiles else upper_triangle(self.sums)


@lru_cache(maxsize=8)
def _plan_strips(q: int) -> tuple[TilePlan, NDArray[np.intp]]:
    """Strips of columns with the rows up to their last column, and the place of each entry of the triangle."""
    columns = [range(at, min(at + WIDE, q)) for at in range(0, q, WIDE)]
    tiles = plan_tiles([(range(strip.stop), strip) for strip in columns])
    table = np.zeros((q, q), dtype=np.intp)
    for strip, place in zip(columns, tiles.places, strict=True):
        table[: strip.stop, strip.start : strip.stop] = place
    return tiles, upper_triangle(table)


@lru_cache(maxsize=8)
def _upper(q: int) -> NDArray[np.intp]:
    """Places of the upper triangle, row by row, in a (q, q) matrix."""
    return np.flatnonzero(np.triu(np.ones((q, q), dtype=bool)))


def upper_triangle(matrix: NDArray[Any]) -> NDArray[Any]:
    """Upper triangle of a square matrix, row by row."""
    return np.take(matrix, _upper(len(matrix)))
