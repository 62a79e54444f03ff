"""Rauch-Tung-Striebel smoother in square-root form, compiled; `unscented_filter` has the equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from structsel.numerics.arrays import Array
from structsel.numerics.square_root import lower_triangle, row_lengths, solve_gain, triangularise


class SmootherSteps(NamedTuple):
    """Results of each filter step that the smoother uses (c steps; none are stored if c = 0).

    predicted (c, L), gain G (c, L, L), and the root (c, L, L) of [S - G O, G [E c N]].
    """

    predicted: Array
    gain: Array
    root: Array


class SmootherOutput(NamedTuple):
    """Smoothed x, std (n, L), and the covariance of every stride-th sample."""

    x: Array
    std: Array
    covariance: Array
    stride: int


@njit(cache=True)
def store_smoother_step(i, S, A, root, mean, D, steps):  # type: ignore[no-untyped-def]
    """Store prediction, gain G = S O' (S- S-')^-1 and root of [S - G O, G [E c N]] of step i; S is still S+."""
    L, G = len(S), steps.gain[i]
    steps.predicted[i] = mean
    for row in range(L):
        for j in range(L):
            total = 0.0
            for m in range(row + 1):
                total += S[row, m] * A[j, m]
            G[row, j] = total
    solve_gain(G, root, L, L)
    D[:, :] = 0.0
    D[:, :L] = S
    for row in range(L):
        for m in range(L):
            weight = G[row, m]
            for column in range(D.shape[1]):
                D[row, column] -= weight * A[m, column]
    triangularise(D, *D.shape)
    steps.root[i] = D[:, :L]


@njit(cache=True)
def smooth_samples(first, last, x, S, filtered, steps, work, output):  # type: ignore[no-untyped-def]
    """Smooth samples last - 2 to first - 1; x and S are those of sample last - 1 and are left as of first - 1.

        x_s = x + G (x_s+ - x-)          S_s = tria [S - G O, G [E c N],  G S_s+]

    `filtered` is (n, L), `work` (L, 2 L) scratch.
    """
    L = len(x)
    later = np.empty(L)
    for k in range(last - 1, first - 1, -1):
        G = steps.gain[k - first]
        later[:] = x - steps.predicted[k - first]
        lower_triangle(steps.root[k - first], work[:, :L])
        work[:, L:] = 0.0
        for i in range(L):
            move = 0.0
            for j in range(L):
                move += G[i, j] * later[j]
            x[i] = filtered[k - 1, i] + move
            for m in range(L):
                weight = G[i, m]
                for j in range(m + 1):
                    work[i, L + j] += weight * S[m, j]
        triangularise(work, L, 2 * L)
        lower_triangle(work, S)
        store_smoothed(k - 1, x, S, output)


@njit(cache=True)
def store_smoothed(k, x, S, output):  # type: ignore[no-untyped-def]
    """Write one smoothed sample, with its covariance at every stride-th sample."""
    output.x[k] = x
    row_lengths(S, output.std[k])
    if k % output.stride == 0:
        output.covariance[k // output.stride] = S @ S.T
