"""Search of the times at which an effect is switched on and off, by evidence that is a sum over the flights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from structsel.diagnosis.scoring import EVENT_COST
from structsel.effects.changes import ramp
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Further

_RISE = 1e-9  # of a log evidence, more than rounding


@dataclass(frozen=True)
class On:
    """When an effect is on in one recording: from `start` until `end` [s]; each takes `duration` [s]."""

    start: float = -np.inf
    end: float = np.inf
    duration: float = 0.0

    def along(self, t: Array) -> Array:
        """From zero to one where it is on."""
        return ramp(t, self.start, self.duration) - ramp(t, self.end, self.duration)

    @property
    def finite(self) -> tuple[str, ...]:
        """Which of start and end are in the recording."""
        return tuple(x for x in ("start", "end") if np.isfinite(getattr(self, x)))

    @property
    def times(self) -> tuple[float, ...]:
        """Start and end that are in the recording."""
        return tuple(getattr(self, x) for x in self.finite)

    @property
    def says(self) -> str:
        """In words, after the name of the recording."""
        words = {"start": "from", "end": "until"}
        return "".join(f" {words[x]} {getattr(self, x):.1f} s" for x in self.finite)


ALWAYS, NEVER = On(), On(np.inf)


@dataclass(frozen=True, eq=False)
class Parts:
    """Products of columns, which are on in one flight by n options, with the rows beyond the tolerances.

    Attributes
    ----------
    inside : (n, k, j) array
        With the tolerances, by the inverse Cholesky factor of their precision.
    own : (n, j, j) array
    with_y : (n, j) array
    cost : (n,) array
        Log of the number of times among which each was chosen.
    """

    inside: Array
    own: Array
    with_y: Array
    cost: Array

    @classmethod
    def of(cls, products: Sequence[Further], tried: Sequence[On], inverse: Array) -> Parts:
        """Of products with the tolerances, which `inverse` multiplies."""
        inside = inverse @ np.stack([p.cross for p in products])
        return cls(inside, np.stack([p.own for p in products]), np.stack([p.with_y for p in products]), costs(tried))

    def take(self, at: Sequence[int]) -> Parts:
        """Some of the options."""
        return Parts(*(x[at] for x in self))

    def __iter__(self) -> Iterator[Array]:
        return iter((self.inside, self.own, self.with_y, self.cost))

    def __add__(self, other: Parts) -> Parts:
        return Parts(*(a + b for a, b in zip(self, other)))

    def __sub__(self, other: Parts) -> Parts:
        return Parts(*(a - b for a, b in zip(self, other)))

    def log_evidence(self, y: Array) -> Array:
        """(n,) over the tolerances alone, minus the cost; `y` (k,) are the rows' products with them, by that factor."""
        turned = np.swapaxes(self.inside, -1, -2)
        held = np.eye(self.own.shape[-1]) + self.own - turned @ self.inside
        s = self.with_y - turned @ y
        if s.shape[-1] == 1:  # most forms; ten times faster
            held = np.maximum(held[:, 0], 1.0)  # rounding may make it smaller
            explained, volume = (s**2 / held)[:, 0], np.log(held[:, 0])
        else:
            explained = (s * np.linalg.solve(held, s[..., None])[..., 0]).sum(axis=-1)
            volume = np.linalg.slogdet(held)[1]
        return np.asarray(0.5 * (explained - volume) - self.cost)


def costs(tried: Sequence[On]) -> Array:
    """Log of the number of times among which each was chosen."""
    return np.array([EVENT_COST * len(one.times) for one in tried])


class Found(NamedTuple):
    """Place of the best option of each flight among those tried, and the log evidence of each of them."""

    at: list[int]
    values: list[Array]

    @property
    def log_evidence(self) -> float:
        """Over the tolerances alone, minus the cost."""
        return float(self.values[0].max())


def search(y: Array, parts: Sequence[Parts], at: Sequence[int]) -> Found:
    """The best option in each flight, by steps that increase the log evidence most.

    Parameters
    ----------
    y : (k,) array
        As for `Parts.log_evidence`.
    parts : sequence of Parts
        By flight.
    at : sequence of int
        Where to begin.
    """
    place, value = list(at), -np.inf
    while True:
        together = sum((p.take([k]) for p, k in zip(parts[1:], place[1:])), parts[0].take(place[:1]))
        values = [(together - p.take([k]) + p).log_evidence(y) for p, k in zip(parts, place)]
        m = int(np.argmax([x.max() for x in values]))
        if values[m].max() <= value + _RISE:
            return Found(place, values)
        place[m], value = int(np.argmax(values[m])), float(values[m].max())


def spreads(tried: Sequence[On], log_evidence: Array, one: On, step: float) -> tuple[float, ...]:
    """Standard deviation [s] of each time from those tried, a step apart, the other one being as it is."""
    made = []
    for time in one.times:
        rest = set(one.times) - {time}
        alike = [k for k, other in enumerate(tried) if len(other.times) == len(one.times) and rest <= set(other.times)]
        t = np.array([next(iter(set(tried[k].times) - rest), time) for k in alike])
        weight = scipy.special.softmax(log_evidence[alike])
        made.append(float(np.sqrt(weight @ (t - time) ** 2 + step**2 / 12.0)))
    return tuple(made)
