"""Shapes of control inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

DOUBLET, THREE_TWO_ONE_ONE, ONE_TWO_ONE = (1, -1), (3, -2, 1, -1), (1, -2, 1)
"""Lengths of alternating pulses in units, with sign."""


def pulses(t: np.ndarray, pattern: Sequence[int], start: float, unit: float) -> tuple[np.ndarray, float]:
    """(n,) alternating pulses of unit size from a start, and when they end [s].

    Parameters
    ----------
    t : (n,) array [s]
    pattern : sequence of int
        Lengths in units, with sign.
    start, unit : float [s]
    """
    made, edge = np.zeros_like(t), start
    for units in pattern:
        end = edge + abs(units) * unit
        made[(t >= edge) & (t < end)] += np.sign(units)
        edge = end
    return made, edge


def ramp(t: np.ndarray, *points: tuple[float, float]) -> np.ndarray:
    """(n,) linear interpolation between points (time [s], value), constant beyond the first and the last."""
    return np.interp(t, [p[0] for p in points], [p[1] for p in points])
