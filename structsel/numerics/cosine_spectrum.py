"""Cosine transform of the samples of a manoeuvre, with faded ends."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.fft import dct, prev_fast_len

from structsel.numerics.arrays import Array


def spectrum(x: Array, bins: int, edge: int = 0) -> Array:
    """Level and first cosine coefficients of each column, faded at both ends.

    The orthonormal cosine transform (type II) of a stationary process has nearly independent coefficients whose
    variances are its two-sided spectrum, and no leakage from a step between its ends; a relation that holds sample by
    sample holds coefficient by coefficient. Fading matters for what was differentiated: the noise of the first and
    the last reading would enter every coefficient. A constant is faded as well and would leak into them, so it is
    removed first and is the first entry of the result.

    Parameters
    ----------
    x : (n,) or (n, k) array
    bins : int
        Coefficient j has the frequency j / (2 `length_of(n)` dt).
    edge : int
        Samples over which each end is faded.

    Returns
    -------
    (1 + bins,) or (1 + bins, k) array
        The level (times the root of the samples it counts) and coefficients 1 to `bins`.
    """
    n = length_of(len(x))
    fade = fading(n, edge)
    # Columns contiguous in memory: the transform of interleaved columns takes longer.
    faded = np.multiply(np.asarray(x, dtype=float)[:n].T, fade, order="C")
    level = faded @ fade / (fade @ fade)
    made = dct(faded, norm="ortho", overwrite_x=True)[..., : bins + 1]
    made = made - np.multiply.outer(level, _leaked(n, edge)[: bins + 1])
    made[..., 0] = level * np.sqrt(fade @ fade)
    return np.array(made.T, order="C")


@lru_cache(maxsize=256)
def _leaked(n: int, edge: int) -> Array:
    """(n,) coefficients that a faded constant has; not to be written to."""
    return np.asarray(dct(fading(n, edge), norm="ortho"))


@lru_cache(maxsize=256)
def length_of(n: int) -> int:
    """Samples of n that a spectrum uses: a few at the end are left out where that saves much work."""
    return int(prev_fast_len(n, real=True))


@lru_cache(maxsize=256)
def fading(n: int, edge: int) -> Array:
    """(n,) weights that rise from 0 to 1 over `edge` samples and fall again (cosine squared); not to be written to."""
    fade = np.ones(n)
    if edge > 0:
        rise = np.sin(0.5 * np.pi * (np.arange(edge) + 0.5) / edge) ** 2
        fade[:edge] = rise
        fade[n - edge :] = rise[::-1]
    fade.setflags(write=False)
    return fade
