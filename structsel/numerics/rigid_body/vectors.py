"""What the rigid-body files share: types, the vector product, the check that a quantity is above zero."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import DomainError

Values = float | np.ndarray
"""A number, or an array of them."""
Triple = Sequence[float] | Sequence[Values] | np.ndarray
"""Three components: one array of three rows, or a sequence."""
Three = tuple[np.ndarray, np.ndarray, np.ndarray]
NONE = (0.0, 0.0, 0.0)


def require_positive(name: str, unit: str, values: Values, who: str) -> np.ndarray:
    """Return `values` as an array, or say at which sample it is first not above zero (or not a number).

    Raises
    ------
    DomainError
    """
    array = np.asarray(values, dtype=float)
    bad = ~(array > 0.0)
    if bad.any():
        i = int(np.argmax(bad.ravel()))
        raise DomainError(
            f"{who} needs {name} [{unit}] above zero; sample {i} has {array.ravel()[i]:g}.\n"
            "Cut the recording to the part in flight."
        )
    return array


def cross(a: Triple, b: Triple) -> Three:
    """Vector product of two triples of arrays."""
    a1, a2, a3 = (np.asarray(x, dtype=float) for x in a)
    b1, b2, b3 = (np.asarray(x, dtype=float) for x in b)
    return a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1
