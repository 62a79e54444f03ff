"""Rauch-Tung-Striebel smoother in square-root form, compiled; `unscented_filter` has the filter and the notation.

A constant without drift is the same at all samples, so its smoothed value is its last one. Only the rows of the m
moving states are computed. With their rows [B A] of the root, [B' FA] one step later, and [B' A'] with noise,

    tria [FA E c N; A 0] = [A' 0; X D]        G_m = X A'^-1        G_c = (B - G_m B') C^-1

D has the columns that are left; if they are more than m, it is triangularised. Backward, with the root C of the
constants, which never changes,

    S_s = [C 0; B_s M],    B_s = G_c C + G_m B_s+,    M = tria [G_m M+ D]

The attitude is a quaternion: its deviations are rotation vectors in earth axes, and the smoothed one is the filtered
one turned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import REORDERED, UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.rotations import angles_of, cosines_of, to_body, to_earth, turn, vector_between
from structsel.numerics.square_root import add_rows, aligned_zeros, copy, padded, triangularise

_PHI, _PSI = 3, 5  # of `kinematics.STATES`


class SmootherSteps(NamedTuple):
    """Results of each filter step that the smoother uses (c steps; none are stored if c = 0).

    predicted (c, m) of the moving states, its attitude quaternion (c, 4); transposed gain (c, L, m); columns (c,) of D,
    which are the first rows of root (c, m, m).
    """

    predicted: Array
    quaternion: Array
    columns: NDArray[np.int64]
    gain: NDArray[np.float32]
    root: NDArray[np.float32]


class SmootherOutput(NamedTuple):
    """Smoothed x, std (n, l), and the covariance (c, l, l) of every stride-th sample.

    `place` (L,) is the column of each state of the filter, -1 if it is not wanted.
    """

    place: NDArray[np.int64]
    x: Array
    std: Array
    covariance: Array
    stride: int


@njit(**UNCOUNTED)
def attitude_roots(T, states, x, C, out):  # type: ignore[no-untyped-def]
    """Fill out (3, L), the rows of the root for phi, theta and psi, from those of the rotation vector.

    T (L, L) has the columns of the root as rows; x is the full vector, C (3, 3) its attitude. At
    the vertical those of phi and psi have no limit; the cosine is kept above 1e-6.
    """
    sf, cf = np.sin(x[3]), np.cos(x[3])
    secant, tangent = 1.0 / max(np.cos(x[4]), 1e-6), np.sin(x[4]) / max(np.cos(x[4]), 1e-6)
    L = len(states)
    north, east, down = -1, -1, -1
    for i in range(L):
        if states[i] == _PHI:
            north = i
        elif states[i] == _PHI + 1:
            east = i
        elif states[i] == _PSI:
            down = i
    for j in range(L):
        d0 = T[j, north] if north >= j else 0.0
        d1 = T[j, east] if east >= j else 0.0
        d2 = T[j, down] if down >= j else 0.0
        d0, d1, d2 = to_body(C, d0, d1, d2)
        about = sf * d1 + cf * d2
        out[0, j], out[1, j], out[2, j] = d0 + tangent * about, cf * d1 - sf * d2, secant * about


@njit(**UNCOUNTED)
def triangularise_with_root(columns, data, estimate, work):  # type: ignore[no-untyped-def]
    """Triangularise [FA E c N; A 0]; `estimate` still has the root of the sample before."""
    T, A, f, P = estimate.T, work.A, data.constants, work.gain.shape[1]
    m = len(T) - f
    for c in range(columns):
        for a in range(m):
            A[c, P + a] = T[f + c, f + a] if c <= a else 0.0
    triangularise(A, 0, m, columns, 2 * P, work.total)


@njit(**REORDERED)
def store_smoother_step(i, columns, data, estimate, work, steps):  # type: ignore[no-untyped-def]
    """Store prediction, gain and D of step i; `estimate` still has the root of the sample before."""
    T, A, N, gain, P = estimate.T, work.A, work.N, work.gain, work.gain.shape[1]
    L, f, states = len(T), data.constants, data.states
    m = L - f
    copy(work.q1, steps.quaternion[i])
    for a in range(m):
        steps.predicted[i, a] = work.middle[states[f + a]]
    # G_m from G_m A' = X, and G_c from G_c C = B - G_m B', from the last column.
    for c in range(m - 1, -1, -1):
        row = gain[f + c]
        for a in range(P):
            row[a] = A[c, P + a]
        add_rows(row, -1.0, A[c, c + 1 :], gain[f + c + 1 :], m - c - 1, P)
        for a in range(P):
            row[a] /= A[c, c]
    for c in range(f - 1, -1, -1):
        row = gain[c]
        for a in range(m):
            row[a] = T[c, f + a]
        for a in range(m, P):
            row[a] = 0.0
        add_rows(row, -1.0, N[c], gain[f:], m, P)
        add_rows(row, -1.0, T[c, c + 1 :], gain[c + 1 :], f - c - 1, P)
        for a in range(P):
            row[a] /= T[c, c]
    for j in range(L):
        for a in range(m):
            steps.gain[i, j, a] = gain[j, a]
    rest = columns - m
    if rest > m:
        triangularise(A[m:], P, m, rest, 2 * P, work.total)
        rest = m
    steps.columns[i] = rest
    for c in range(rest):
        for a in range(m):
            steps.root[i, c, a] = A[m + c, P + a]


def smoother_workspace(L: int, f: int) -> tuple[Array, Array, Array]:
    """Gain (L, P), columns of the root (L + m, P) and (P,) total: scratch of `smooth_samples`."""
    P = padded(L - f)
    return aligned_zeros(L, P), aligned_zeros(2 * L - f, P), aligned_zeros(1, P)[0]


@njit(cache=True)
def smooth_samples(first, last, f, states, x, quaternion, T, filtered, quaternions, turns, steps, work, output):  # type: ignore[no-untyped-def]
    """Smooth samples last - 2 to first - 1; x, quaternion and T are those of sample last - 1 and are updated.

    x (L,) in the order of `states`, T (L, L) has the columns of the root as rows; filtered (n, L) and quaternions
    (n, 4) are the filter's; turns (n, 4) receives the smoothed ones. `work` is scratch, from `smoother_workspace`.
    """
    L = len(x)
    m = L - f
    later, move = np.empty(L), np.zeros(3)
    gain, moved, total = work
    scratch = (np.empty((L, L)), np.empty((3, L)), np.zeros(6), np.empty((3, 3)), np.empty(L))
    for k in range(last - 1, first - 1, -1):
        for j in range(L):
            for a in range(m):
                gain[j, a] = steps.gain[k - first, j, a]
        for j in range(f):
            later[j] = x[j] - filtered[k - 1, j]
        d = vector_between(steps.quaternion[k - first], quaternion)
        cosines_of(steps.quaternion[k - first], scratch[3])
        d = to_earth(scratch[3], d[0], d[1], d[2])
        for a in range(m):
            state = states[f + a]
            if _PHI <= state <= _PSI:
                later[f + a] = d[0] if state == _PHI else (d[1] if state == _PHI + 1 else d[2])
            else:
                later[f + a] = x[f + a] - steps.predicted[k - first, a]
        move[:] = 0.0
        total[:] = 0.0
        add_rows(total, 1.0, later, gain, L, len(total))
        for a in range(m):
            state = states[f + a]
            if _PHI <= state <= _PSI:
                move[state - _PHI] = total[a]
            else:
                x[f + a] = filtered[k - 1, f + a] + total[a]
        _back_roots(f, gain, steps.root[k - first, : steps.columns[k - first]], T, moved, total)
        cosines_of(quaternions[k - 1], scratch[3])
        d = to_body(scratch[3], move[0], move[1], move[2])
        turn(quaternions[k - 1], d[0], d[1], d[2], quaternion)
        copy(quaternion, turns[k - 1])
        _store(k - 1, states, x, quaternion, T, scratch, output)


@njit(**REORDERED)
def _back_roots(f, gain, D, T, moved, total):  # type: ignore[no-untyped-def]
    """Replace the entries of the moving states in the columns T of the root by those one sample before.

    gain (L, P) is transposed; moved (C, P), as many columns as in T and D together, and total (P,) are scratch.
    """
    L, P = gain.shape
    m, columns = L - f, len(D)
    for j in range(L):
        for a in range(P):
            moved[j, a] = 0.0
        add_rows(moved[j], 1.0, T[j, j:], gain[j:], L - j, P)
    for c in range(columns):
        for a in range(m):
            moved[L + c, a] = D[c, a]
    triangularise(moved[f:], 0, m, m + columns, P, total)
    for j in range(L):
        for a in range(max(j - f, 0), m):
            T[j, f + a] = moved[j, a]


@njit(cache=True)
def store_last(states, x, quaternion, T, output):  # type: ignore[no-untyped-def]
    """Write the last sample, which the filter has."""
    L = len(x)
    scratch = (np.empty((L, L)), np.empty((3, L)), np.zeros(6), np.empty((3, 3)), np.empty(L))
    _store(len(output.x) - 1, states, x, quaternion, T, scratch, output)


@njit(**UNCOUNTED)
def _store(k, states, x, quaternion, root, scratch, output):  # type: ignore[no-untyped-def]
    """Write one smoothed sample, with its covariance at every stride-th sample."""
    T, euler, full, C, variance = scratch
    L = len(x)
    for i in range(L):
        for j in range(L):
            T[i, j] = root[i, j]
    cosines_of(quaternion, C)
    full[3], full[4], full[5] = angles_of(C)
    attitude_roots(T, states, full, C, euler)
    for i in range(L):
        if _PHI <= states[i] <= _PSI:
            x[i] = full[states[i]]
            for j in range(L):
                T[j, i] = euler[states[i] - _PHI, j]
    for i in range(L):
        variance[i] = 0.0
    for j in range(L):
        for i in range(L):
            variance[i] += T[j, i] * T[j, i]
    place = output.place
    for i in range(L):
        if place[i] >= 0:
            output.x[k, place[i]] = x[i]
            output.std[k, place[i]] = np.sqrt(variance[i])
    if k % output.stride == 0:
        P = output.covariance[k // output.stride]
        for i in range(L):
            for h in range(i + 1):
                total = 0.0
                for j in range(L):
                    total += T[j, i] * T[j, h]
                if place[i] >= 0 and place[h] >= 0:
                    P[place[i], place[h]] = total
                    P[place[h], place[i]] = total
