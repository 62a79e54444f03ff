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
