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
    inside : (n, j, k) array
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
        inside = np.stack([p.cross.T for p in products]) @ inverse.T
        return cls(inside, np.stack([p.own for p in products]), np.stack([p.with_y for p in products]), costs(tried))

    def take(self, k: int) -> Parts:
        """One of the options."""
        return Parts(*(x[k] for x in self))

    def less_tolerances(self, y: Array) -> Parts:
        """With what the tolerances do not explain; `y` (k,) are the products of the rows with them, by that factor."""
        own = self.own - self.inside @ np.swapaxes(self.inside, -1, -2)
        return Parts(self.inside, own, self.with_y - self.inside @ y, self.cost)

    def __iter__(self) -> Iterator[Array]:
        return iter((self.inside, self.own, self.with_y, self.cost))

    def __add__(self, other: Parts) -> Parts:
        return Parts(*(a + b for a, b in zip(self, other)))

    def __sub__(self, other: Parts) -> Parts:
        return Parts(*(a - b for a, b in zip(self, other)))


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
        As for `Parts.less_tolerances`.
    parts : sequence of Parts
        By flight.
    at : sequence of int
        Where to begin.
    """
    place, value = list(at), -np.inf
    alone = [p.less_tolerances(y) for p in parts]
    ends = np.cumsum([len(p.cost) for p in parts])[:-1]
    while True:
        chosen = [p.take(k) for p, k in zip(parts, place)]
        together = sum(chosen[1:], chosen[0])
        each = [_beside(one, (together - here).less_tolerances(y)) for one, here in zip(alone, chosen)]
        values = np.split(_log_evidence(*(np.concatenate(x) for x in zip(*each))), ends)
        m = int(np.argmax([x.max() for x in values]))
        if values[m].max() <= value + _RISE:
            return Found(place, values)
        place[m], value = int(np.argmax(values[m])), float(values[m].max())


def _beside(options: Parts, others: Parts) -> tuple[Array, Array, Array]:
    """Products of each option together with what is on in the other flights: with itself, with y, and the cost."""
    shared = np.tensordot(options.inside, others.inside, axes=(2, 1))
    own = options.own + others.own - shared - np.swapaxes(shared, -1, -2)
    return own, options.with_y + others.with_y, options.cost + others.cost


def _log_evidence(own: Array, with_y: Array, cost: Array) -> Array:
    """(n,) log evidence over the tolerances alone, minus the cost."""
    held = np.eye(own.shape[-1]) + own
    if own.shape[-1] == 1:  # most forms; ten times faster
        held = np.maximum(held[:, 0], 1.0)  # rounding may make it smaller
        explained, volume = (with_y**2 / held)[:, 0], np.log(held[:, 0])
    else:
        explained = (with_y * np.linalg.solve(held, with_y[..., None])[..., 0]).sum(axis=-1)
        volume = np.linalg.slogdet(held)[1]
    return np.asarray(0.5 * (explained - volume) - cost)


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
