"""Square root S of a covariance P = S S': sigma points from its columns, and compiled work on triangular factors.

With L states, spread a and beta = 2 [H17]::

    sigma points  x, x +- a sqrt(L) S_i        W_i = 1 / (2 a^2 L)
    W_0 (mean) = 1 - 1/a^2                     W_0 (covariance) = W_0 + 3 - a^2  >= 0  for 0.52 <= a <= 1.93
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from structsel.numerics.arrays import REORDERED, UNCOUNTED
from structsel.numerics.compiling import njit

SMALLEST_SPREAD, LARGEST_SPREAD = 0.52, 1.93
"""Between them the centre point's weight is not negative."""
_BETA = 2.0  # [H17]: best for normal distributions
_LINEAR = 1e-3  # step of the central differences, in standard deviations


class SigmaPoints(NamedTuple):
    """Positions and weights of the sigma points; `linear` for central differences instead."""

    linear: bool
    reach: float  # of a point from the centre, in columns of S
    mean_weight: float
    centre: float  # root of the centre point's weight in the covariance
    odd: float  # factor of the difference of a pair, and of the sum of its deviations


def sigma_points(spread: float, L: int) -> SigmaPoints:
    """Positions and weights for L states; central differences for a spread of 0."""
    if spread == 0.0:
        return SigmaPoints(True, _LINEAR, 0.5, 0.0, 1.0 / (2.0 * _LINEAR))
    weight = 1.0 / (2.0 * spread * spread * L)
    centre = np.sqrt(max(1.0 - 1.0 / (spread * spread) + 1.0 - spread * spread + _BETA, 0.0))
    return SigmaPoints(False, float(spread * np.sqrt(L)), weight, float(centre), float(np.sqrt(0.5 * weight)))


@njit(**REORDERED)
def triangularise(A, rows, columns):  # type: ignore[no-untyped-def]
    """Turn A (rows, columns) in place into [S 0] with S lower triangular and S S' = A A'."""
    for i in range(min(rows, columns)):
        scale = 0.0
        for j in range(i + 1, columns):
            scale += A[i, j] * A[i, j]
        if scale == 0.0:
            continue
        head = A[i, i]
        norm = np.sqrt(head * head + scale)
        alpha = -norm if head > 0.0 else norm
        head -= alpha
        A[i, i] = head
        inverse = 2.0 / (head * head + scale)
        k = i + 1
        while k + 4 <= rows:  # four rows together: four independent sums
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for j in range(i, columns):
                h = A[i, j]
                a += A[k, j] * h
                b += A[k + 1, j] * h
                c += A[k + 2, j] * h
                d += A[k + 3, j] * h
            a, b, c, d = a * inverse, b * inverse, c * inverse, d * inverse
            for j in range(i, columns):
                h = A[i, j]
                A[k, j] -= a * h
                A[k + 1, j] -= b * h
                A[k + 2, j] -= c * h
                A[k + 3, j] -= d * h
            k += 4
        while k < rows:
            a = 0.0
            for j in range(i, columns):
                a += A[k, j] * A[i, j]
            a *= inverse
            for j in range(i, columns):
                A[k, j] -= a * A[i, j]
            k += 1
        A[i, i] = alpha
        for j in range(i + 1, columns):
            A[i, j] = 0.0


@njit(**REORDERED)
def absorb(R, A, Y, S, rows, columns):  # type: ignore[no-untyped-def]
    """Turn [R A; Y S] in place into [R' 0; Y' S'] with R (rows, rows) lower triangular; A (rows, columns) is lost.

    Y and S may have no rows. Each reflection has one column of R and all columns of A, because R has zeros elsewhere.
    """
    for b in range(rows):
        scale = 0.0
        for j in range(columns):
            scale += A[b, j] * A[b, j]
        if scale == 0.0:
            continue
        head = R[b, b]
        norm = np.sqrt(head * head + scale)
        alpha = -norm if head > 0.0 else norm
        head -= alpha
        inverse = 2.0 / (head * head + scale)
        for k in range(b + 1, rows):
            dot = R[k, b] * head
            for j in range(columns):
                dot += A[k, j] * A[b, j]
            dot *= inverse
            R[k, b] -= dot * head
            for j in range(columns):
                A[k, j] -= dot * A[b, j]
        for k in range(len(S)):
            dot = Y[k, b] * head
            for j in range(columns):
                dot += S[k, j] * A[b, j]
            dot *= inverse
            Y[k, b] -= dot * head
            for j in range(columns):
                S[k, j] -= dot * A[b, j]
        R[b, b] = alpha


@njit(**REORDERED)
def solve_gain(cross, S, rows, m):  # type: ignore[no-untyped-def]
    """Make cross (rows, m) := cross (S S')^-1 with S (m, m) lower triangular, in place."""
    for i in range(rows):
        for j in range(m):
            total = cross[i, j]
            for k in range(j):
                total -= cross[i, k] * S[j, k]
            cross[i, j] = total / S[j, j]
        for j in range(m - 1, -1, -1):
            solved = cross[i, j] / S[j, j]
            cross[i, j] = solved
            for k in range(j):
                cross[i, k] -= solved * S[j, k]


@njit(**UNCOUNTED)
def lower_triangle(source, target):  # type: ignore[no-untyped-def]
    """Copy the lower triangle, with zeros above."""
    for i in range(len(target)):
        for j in range(len(target)):
            target[i, j] = source[i, j] if j <= i else 0.0


@njit(**UNCOUNTED)
def row_lengths(S, std):  # type: ignore[no-untyped-def]
    """Standard deviations: lengths of the rows of a lower triangular root."""
    for i in range(len(S)):
        total = 0.0
        for j in range(i + 1):
            total += S[i, j] * S[i, j]
        std[i] = np.sqrt(total)


@njit(**UNCOUNTED)
def copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a vector."""
    for i in range(len(source)):
        target[i] = source[i]
