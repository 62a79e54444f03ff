"""Square root S of a covariance P = S S': sigma points from its columns, and compiled work on triangular factors.

With L states, spread a and beta = 2 [H17]::

    sigma points  x, x +- a sqrt(L) S_i        W_i = 1 / (2 a^2 L)
    W_0 (mean) = 1 - 1/a^2                     W_0 (covariance) = W_0 + 3 - a^2  >= 0  for 0.52 <= a <= 1.93
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from structsel.numerics.arrays import REORDERED, UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.tiles import round_up

SMALLEST_SPREAD, LARGEST_SPREAD = 0.52, 1.93
"""Between them the centre point's weight is not negative."""
LANES = 16
"""Numbers that a compiled loop handles at once; scratch is padded with zeros to a multiple, so none is left over."""
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


def padded(n: int) -> int:
    """The next multiple of `LANES`."""
    return round_up(n, LANES)


def aligned_zeros(rows: int, columns: int) -> Array:
    """Zeros (rows, columns) that begin at a cache line: a read of what was just written across two lines is slow."""
    line = 64 // 8
    values = np.zeros(rows * columns + line)
    first = -values.ctypes.data // 8 % line
    return values[first : first + rows * columns].reshape(rows, columns)


@njit(**REORDERED)
def add_rows(total, sign, weights, rows, count, width):  # type: ignore[no-untyped-def]
    """Add sign (weights[0] rows[0] + ...), of `count` rows, to the first `width` entries of `total`."""
    k = 0
    while k + 4 <= count:  # four rows together: the total is read and written once
        a, b, c, d = sign * weights[k], sign * weights[k + 1], sign * weights[k + 2], sign * weights[k + 3]
        for i in range(width):
            total[i] += (a * rows[k, i] + b * rows[k + 1, i]) + (c * rows[k + 2, i] + d * rows[k + 3, i])
        k += 4
    while k < count:
        a = sign * weights[k]
        for i in range(width):
            total[i] += a * rows[k, i]
        k += 1


@njit(**REORDERED)
def triangularise(A, first, rows, columns, width, total):  # type: ignore[no-untyped-def]
    """Turn `rows` rows of a matrix, from `first` on, into [S 0] with S lower triangular and the same S S', in place.

    Its `columns` columns are the rows of A (C, width); its other rows are rotated too. `total` (width,) is scratch.
    """
    for i in range(min(rows, columns)):
        pivot = first + i
        scale = 0.0
        for c in range(i + 1, columns):
            scale += A[c, pivot] * A[c, pivot]
        if scale == 0.0:
            continue
        head = A[i, pivot]
        norm = np.sqrt(head * head + scale)
        alpha = -norm if head > 0.0 else norm
        head -= alpha
        A[i, pivot] = head
        inverse = 2.0 / (head * head + scale)
        for k in range(width):
            total[k] = 0.0
        add_rows(total, inverse, A[i:, pivot], A[i:], columns - i, width)
        for c in range(i, columns):
            h = A[c, pivot]
            for k in range(width):
                A[c, k] -= h * total[k]
        A[i, pivot] = alpha
        for c in range(i + 1, columns):
            A[c, pivot] = 0.0


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


@njit(**UNCOUNTED)
def copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a vector."""
    for i in range(len(source)):
        target[i] = source[i]
