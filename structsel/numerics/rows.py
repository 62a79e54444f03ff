"""Rows of candidates and responses from any manoeuvre, a cache-sized stretch at a time, and their products.

The regressor matrix is never formed: rows are made for a few hundred samples, used and overwritten.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.monomials import RowPlan, fill_rows

Scales = tuple[Array, Array]
"""Of base signals and of responses."""

CHUNK = 512  # samples a workspace holds: its rows stay in the second-level cache
SLAB = 2048  # samples asked of a manoeuvre at a time


class Signals(Protocol):
    """What the engine asks of a manoeuvre: base signals and responses over any range of samples."""

    @property
    def n(self) -> int:
        """Number of samples."""

    def base(self, start: int, stop: int) -> Array:
        """(s, stop - start) base signals."""

    def responses(self, start: int, stop: int) -> Array:
        """(m, stop - start) responses."""


@dataclass(frozen=True)
class ArraySignals:
    """A manoeuvre held in memory.

    Attributes
    ----------
    base_signals : (s, n) array
    response_signals : (m, n) array
    """

    base_signals: Array
    response_signals: Array

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.base_signals.shape[1])

    def base(self, start: int, stop: int) -> Array:
        """Base signals of these samples."""
        return self.base_signals[:, start:stop]

    def responses(self, start: int, stop: int) -> Array:
        """Responses of these samples."""
        return self.response_signals[:, start:stop]


def base_scale(manoeuvres: Sequence[Signals]) -> Scales:
    """Root mean squares of base signals and responses over a part of each manoeuvre; one where zero."""
    return scale_of([squares_of(m) for m in manoeuvres])


def squares_of(manoeuvre: Signals) -> tuple[Array, Array, int]:
    """Sums of squares of base signals and responses over a part of a manoeuvre, and its samples."""
    parts = []
    for start in np.linspace(0, max(manoeuvre.n - 1024, 0), 4).astype(int).tolist():
        stop = min(start + 1024, manoeuvre.n)
        b, y = manoeuvre.base(start, stop), manoeuvre.responses(start, stop)
        parts.append((np.einsum("ij,ij->i", b, b), np.einsum("ij,ij->i", y, y), stop - start))
    base, response, count = zip(*parts)
    return sum(base), sum(response), sum(count)


def scale_of(squares: Sequence[tuple[Array, Array, int]]) -> Scales:
    """Root mean squares from the sums of all manoeuvres; one where zero."""
    count = sum(s[2] for s in squares)
    roots = [np.sqrt(sum(s[i] for s in squares) / max(count, 1)) for i in (0, 1)]
    base, response = (np.where(np.isfinite(r) & (r > 0), r, 1.0) for r in roots)
    return base, response


def column_scale(exponents: NDArray[np.integer], base: Array, response: Array) -> Array:
    """Scale of [1, candidates, responses] that follows from the base signals' scales."""
    return np.concatenate([[1.0], np.exp(np.asarray(exponents) @ np.log(base)), response])


class RowMaker:
    """Scaled rows [1, x_1 .. x_p, y_1 .. y_m] of any stretch of a manoeuvre, ``chunk`` samples at a time.

    One per worker: it owns its workspace.
    """

    def __init__(self, plan: RowPlan, p: int, scales: Scales, reach: int = 0, chunk: int = CHUNK):
        self.m = scales[1].size
        self.q = 1 + p + self.m
        self.reach, self.chunk = reach, chunk
        shift = np.where(np.arange(plan.n_rows) < p, 1, 1 + self.m).astype(np.int32)
        self.target = plan.target + shift[plan.target]
        self.parent = np.where(plan.parent < 0, -1, plan.parent + shift[plan.parent]).astype(np.int32)
        self.factor = plan.factor
        self.rows = np.ones((plan.n_rows + 1 + self.m, chunk + reach))
        self.base_scale, self.response_scale = scales

    def chunks(self, signals: Signals, start: int, stop: int) -> Iterator[tuple[Array, int, int]]:
        """Rows of [a - reach, b) with the range a, b they are new for; ``start`` is at least ``reach``."""
        p = self.q - 1 - self.m
        for slab in range(start, stop, SLAB):
            end = min(slab + SLAB, stop)
            base = signals.base(slab - self.reach, end) / self.base_scale[:, None]
            response = signals.responses(slab - self.reach, end) / self.response_scale[:, None]
            for a in range(slab, end, self.chunk):
                b = min(a + self.chunk, end)
                inside = slice(a - slab, b - slab + self.reach)
                width = b - a + self.reach
                fill_rows(base[:, inside], self.target, self.parent, self.factor, self.rows)
                self.rows[1 + p : self.q, :width] = response[:, inside]
                yield self.rows[: self.q, :width], a, b


def plain_products(maker: RowMaker, signals: Signals, start: int, stop: int) -> Array:
    """Z'Z of a stretch by plain matrix products."""
    total = np.zeros((maker.q, maker.q))
    part = np.empty_like(total)
    for rows, _, _ in maker.chunks(signals, start, stop):
        np.matmul(rows, rows.T, out=part)
        total += part
    return total
