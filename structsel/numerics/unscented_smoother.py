"""Rauch-Tung-Striebel smoother in square-root form, compiled; `unscented_filter` has the equations.

A constant without drift is the same at all samples, so its smoothed value is its last one and its rows of the gain are
those of the unit matrix. Only the rows of the *moving* states are computed. In the order constants, moving states the
smoothed root is lower triangular with the root C of the constants, which never changes:

    S_s = [C 0; B M],    B = G_c C + G_m B+,    M = tria [G_m M+, D],    G = [G_c G_m]

with D the root of the moving states given the next sample, tria [S - G O, G [E c N]].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.square_root import lower_triangle, solve_gain, triangularise


class SmootherSteps(NamedTuple):
    """Results of each filter step that the smoother uses (c steps; none are stored if c = 0).

    order (L,) of the states, the `constants` first; predicted (c, L) and the columns of the gain G (c, m, L) are in
    this order; root D (c, m, m).
    """

    order: NDArray[np.int64]
    constants: int
    predicted: Array
    gain: Array
    root: Array


class SmootherOutput(NamedTuple):
    """Smoothed x, std (n, L), and the covariance of every stride-th sample."""

    x: Array
    std: Array
    covariance: Array
    stride: int


@njit(**UNCOUNTED)
def store_smoother_step(i, S, A, root, mean, gain, D, steps):  # type: ignore[no-untyped-def]
    """Store prediction, gain G = S O' (S- S-')^-1 and root D of step i; S is still S+, `gain` (m, L) scratch."""
    L, first, order, columns = len(S), steps.constants, steps.order, A.shape[1]
    m = L - first
    for j in range(L):
        steps.predicted[i, j] = mean[order[j]]
    for a in range(m):
        row = order[first + a]
        for j in range(L):
            total = 0.0
            for k in range(row + 1):
                total += S[row, k] * A[j, k]
            gain[a, j] = total
    solve_gain(gain, root, m, L)
    for a in range(m):
        row = order[first + a]
        for c in range(columns):
            D[a, c] = S[row, c] if c <= row else 0.0
        for j in range(L):
            weight = gain[a, j]
            for c in range(columns):
                D[a, c] -= weight * A[j, c]
        for j in range(L):
            steps.gain[i, a, j] = gain[a, order[j]]
    triangularise(D, m, columns)
    for a in range(m):
        for b in range(m):
            steps.root[i, a, b] = D[a, b] if b <= a else 0.0


def last_smoothed(full: Array, S: Array, steps: SmootherSteps) -> tuple[Array, Array]:
    """Estimate and root of the last sample in the order of the smoother, from those of the filter."""
    root = S[steps.order].copy()
    triangularise(root, *root.shape)
    return full[steps.order].copy(), np.tril(root)


@njit(cache=True)
def smooth_samples(first, last, x, S, filtered, steps, output):  # type: ignore[no-untyped-def]
    """Smooth samples last - 2 to first - 1; x and S are those of sample last - 1 and are left as of first - 1."""
    order, f, L = steps.order, steps.constants, len(x)
    m = L - f
    later, below, beside = np.empty(L), np.empty((m, f)), np.empty((m, 2 * m))
    for k in range(last - 1, first - 1, -1):
        G = steps.gain[k - first]
        for j in range(L):
            later[j] = x[j] - steps.predicted[k - first, j]
        for a in range(m):
            move = 0.0
            for j in range(L):
                move += G[a, j] * later[j]
            x[f + a] = filtered[k - 1, order[f + a]] + move
            for c in range(f):
                below[a, c] = 0.0
            for c in range(m):
                beside[a, c] = 0.0
                beside[a, m + c] = steps.root[k - first, a, c]
            for j in range(L):
                weight = G[a, j]
                for c in range(min(j + 1, f)):
                    below[a, c] += weight * S[j, c]
                for c in range(j + 1 - f):
                    beside[a, c] += weight * S[j, f + c]
        triangularise(beside, m, 2 * m)
        S[f:, :f] = below
        lower_triangle(beside, S[f:, f:])
        store_smoothed(k - 1, x, S, order, output)


@njit(**UNCOUNTED)
def store_smoothed(k, x, S, order, output):  # type: ignore[no-untyped-def]
    """Write one smoothed sample, with its covariance at every stride-th sample."""
    L = len(x)
    for i in range(L):
        total = 0.0
        for c in range(i + 1):
            total += S[i, c] * S[i, c]
        output.x[k, order[i]] = x[i]
        output.std[k, order[i]] = np.sqrt(total)
    if k % output.stride == 0:
        P = output.covariance[k // output.stride]
        for i in range(L):
            for j in range(i + 1):
                total = 0.0
                for c in range(j + 1):
                    total += S[i, c] * S[j, c]
                P[order[i], order[j]] = total
                P[order[j], order[i]] = total
