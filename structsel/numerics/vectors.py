"""Triples of arrays in body axes: types, vector product, rotation to earth axes."""

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


def body_to_earth(phi: Values, theta: Values, psi: Values) -> np.ndarray:
    """Rotation matrix from body axes to north, east, down.

    Parameters
    ----------
    phi, theta, psi : (n,) array [rad]
        Euler angles, yaw then pitch then roll.

    Returns
    -------
    R : (n, 3, 3) array
        Its last two axes transposed it turns earth vectors into body ones.

    References
    ----------
    [M86] (its L_EB), [KM16] ch. 3.
    """
    phi, theta, psi = np.broadcast_arrays(phi, theta, psi)
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    rows = (
        (ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp),
        (ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp),
        (-st, sf * ct, cf * ct),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
