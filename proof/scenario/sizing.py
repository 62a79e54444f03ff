"""Sizes of effects: the gain of a perfect model of the effect, and the size that has a wanted gain."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from proof.keys import COEFFICIENTS


class NotAttainable(Exception):
    """A draw gives no case: a flight diverges, or the effect does not reach the wanted size."""


def attainable(before: Sequence[np.ndarray], after: Sequence[np.ndarray]) -> dict[str, float]:
    """Fraction by which the rms of measured minus simulated falls, for each coefficient, over all manoeuvres.

    Parameters
    ----------
    before, after : sequence of (n, 6) arrays
        Without and with a perfect model of the effect.
    """
    b, a = (np.sqrt(np.mean(np.concatenate(list(x)) ** 2, axis=0)) for x in (before, after))
    return {axis: float(1.0 - a[k] / b[k]) if b[k] > 0 else 0.0 for k, axis in enumerate(COEFFICIENTS)}


def bisect(
    reached: Callable[[float], float], target: float, low: float, high: float, steps: int
) -> tuple[float, float]:
    """Size between `low` and `high` at which a growing function reaches a target, by bisection of its logarithm.

    Returns
    -------
    last, high : float
        The size tried last, and the end of the bracket at which the target is reached.
    """
    last = high
    for _ in range(steps):
        last = math.sqrt(low * high)
        low, high = (last, high) if reached(last) < target else (low, last)
    return last, high
