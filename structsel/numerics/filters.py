"""Recursive filter and convolution, as `scipy.signal` has them. Arrays only.

Importing `scipy.signal` imports `scipy.stats` and `scipy.interpolate`, which takes longer than most filtering.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy

from structsel.numerics.arrays import UNCOUNTED, Array
from structsel.numerics.compiling import njit


def recursive_filter(b: Array, a: Array, x: Array, start: Array | None = None) -> Array:
    """Response of a recursive filter, `scipy.signal.lfilter`::

        a[0] y[k] = b[0] x[k] + ... + b[m] x[k-m] - a[1] y[k-1] - ... - a[m] y[k-m]

    Parameters
    ----------
    b, a : (m + 1,) array
        Of one order m, at least one.
    x : (n,) array
    start : (m,) array, optional
        Initial state of the transposed direct form II; by default at rest.
    """
    y = np.empty(len(x))
    state = np.zeros(len(a) - 1) if start is None else np.array(start, dtype=float)
    _recur(np.asarray(b, dtype=float) / a[0], np.asarray(a, dtype=float) / a[0], np.ascontiguousarray(x), state, y)
    return y


@njit(**UNCOUNTED)
def _recur(b, a, x, state, y):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    last = len(state) - 1
    for k in range(len(x)):
        y[k] = state[0] + b[0] * x[k]
        for i in range(last):
            state[i] = state[i + 1] + b[i + 1] * x[k] - a[i + 1] * y[k]
        state[last] = b[last + 1] * x[k] - a[last + 1] * y[k]


def convolve(x: Array, weight: Array, mode: Literal["full", "valid"]) -> Array:
    """Convolution of a signal with a shorter one by Fourier transform, `scipy.signal.fftconvolve`."""
    whole = len(x) + len(weight) - 1
    n = scipy.fft.next_fast_len(whole, True)
    made = scipy.fft.irfft(scipy.fft.rfft(x, n) * scipy.fft.rfft(weight, n), n)
    return np.asarray(made[:whole] if mode == "full" else made[len(weight) - 1 : len(x)])
