"""Arrays about their own means."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from structsel.numerics.arrays import Array


def centred(arrays: Iterable[Array]) -> Array:
    """Arrays end to end, each about its own mean."""
    return np.concatenate([x - x.mean() for x in arrays])


def rms_within(arrays: Iterable[Array]) -> float:
    """Rms of arrays, each about its own mean, over all; zero of none."""
    held = list(arrays)
    return float(np.sqrt(np.mean(centred(held) ** 2))) if held else 0.0
