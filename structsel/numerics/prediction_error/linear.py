"""Predictions of linear systems from sample to sample."""

from __future__ import annotations

import numpy as np
from numba import njit

_BLOWN = 1e100


def predict_linear(
    Phi: np.ndarray, push: np.ndarray, C: np.ndarray, feed: np.ndarray, x0: np.ndarray, gain: np.ndarray,
    measured: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Outputs expected of each sample, the measurements before it let in.

    Parameters
    ----------
    Phi : (m, s, s) array
        From one sample to the next.
    push : (m, n - 1, s) array
        What inputs and drifts add over each interval.
    C : (m, c, s) array
    feed : (m, n, c) array
        Outputs of a state of zero.
    x0 : (m, s) array
    gain : (m, s, c) array
    measured : (m, n, c) array
        NaN where not sampled: such a sample corrects nothing.

    Returns
    -------
    (m, n, c) array
        NaN from where a set blew up.
    """
    y = np.full(feed.shape, np.nan)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (Phi, push, C, feed, x0, gain, measured)]
    _predict(*arrays, y)  # type: ignore[call-arg]
    return y


@njit(cache=True, nogil=True, error_model="numpy")
def _predict(Phi, push, C, feed, x0, gain, measured, y):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    m, n, c = feed.shape
    s = x0.shape[1]
    x, moved = np.empty(s), np.empty(s)
    for j in range(m):
        x[:] = x0[j]
        for k in range(n):
            for a in range(c):
                total = feed[j, k, a]
                for i in range(s):
                    total += C[j, a, i] * x[i]
                y[j, k, a] = total
            for a in range(c):
                v = measured[j, k, a] - y[j, k, a]
                if np.isfinite(v):
                    for i in range(s):
                        x[i] += gain[j, i, a] * v
            if k == n - 1:
                break
            lost = False
            for i in range(s):
                total = push[j, k, i]
                for l in range(s):
                    total += Phi[j, i, l] * x[l]
                moved[i] = total
                lost = lost or not abs(total) < _BLOWN
            if lost:
                break
            x[:] = moved
