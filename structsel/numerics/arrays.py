"""Type of the arrays that kernels take and return, and small helpers for them."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of floats of any shape."""

UNCOUNTED: dict[str, Any] = {"cache": True, "_nrt": False, "error_model": "numpy"}
"""Options of `numba.njit` for a function that neither allocates nor returns an array. Its arrays are not
reference-counted, which makes functions that take tuples of arrays several times faster."""

REORDERED: dict[str, Any] = {**UNCOUNTED, "fastmath": {"reassoc", "contract", "nsz", "arcp"}}
"""The same for sums of products whose order does not matter: the processor may add several at once."""


LARGE_PAGE = 1 << 21  # bytes
ASKED_FROM = 1 << 22  # bytes of an array from which numpy asks for large pages


def on_large_pages(rows: int, columns: int) -> Array:
    """Return a matrix, not initialised, that begins on a large page of memory where the system has them.

    On small pages it depends on chance how many rows share places in the cache.
    """
    size = rows * columns * np.dtype(float).itemsize
    memory = np.empty(max(size, ASKED_FROM) + LARGE_PAGE, dtype=np.uint8)
    start = -memory.ctypes.data % LARGE_PAGE
    return memory[start : start + size].view(float).reshape(rows, columns)


def read_only(array: Array) -> Array:
    """Return a contiguous array that cannot be written to."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def centred(arrays: Iterable[Array]) -> Array:
    """Concatenated arrays, each minus its own mean."""
    return np.concatenate([x - x.mean() for x in arrays])


def rms_within(arrays: Iterable[Array]) -> float:
    """Rms of all arrays, each minus its own mean; zero if there are none."""
    given = list(arrays)
    return float(np.sqrt(np.mean(centred(given) ** 2))) if given else 0.0


def least_positive(x: Array, otherwise: float) -> float:
    """The smallest value above zero, or another number if there is none."""
    return float(min(x[x > 0.0], default=otherwise))
