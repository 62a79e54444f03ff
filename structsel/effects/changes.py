"""Where in time a difference jumps or drifts, that no channel tells of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.effects.base import Flights
from structsel.effects.signals import Column
from structsel.numerics.arrays import Array

EDGE = 1.5  # s, at both ends of a manoeuvre, in which no change is sought
_MEMORY = 1.0  # s between samples that count as independent
_OWN = 0.05  # of a change's variance, that channels must leave unexplained
LEAST_DISTANCE = 3.0  # s between two changes of one manoeuvre


@dataclass(frozen=True, eq=False)
class SoughtChange:
    """A step or ramp in the differences of one manoeuvre.

    Attributes
    ----------
    flight : str
    start, duration : float [s]
    later : tuple of str
        Manoeuvres flown afterwards in the same flight, in which it is still there.
    until : (str, float), optional
        Manoeuvre and time [s] at which it is undone.
    """

    flight: str
    start: float
    duration: float
    later: tuple[str, ...] = ()
    until: tuple[str, float] | None = None

    def along(self, flight: Flight) -> Array:
        """From zero to one as it happens; zero in other manoeuvres than its own and the later ones."""
        if flight.name not in (self.flight, *self.later):
            return np.zeros(len(flight))
        there = ramp(flight.t, self.start, self.duration)
        return there if self.until is None else there - ramp(flight.t, self.until[1], self.duration)

    @property
    def times(self) -> dict[str, float]:
        """Times [s] that were sought, by where they are."""
        back = {} if self.until is None else {f"{self.until[0]}, back": self.until[1]}
        return {self.flight: self.start} | back

    @property
    def when(self) -> str:
        """Recordings and times, in words."""
        if self.until is None:
            return f"{self.flight} at {self.start:.1f} s"
        there = "" if self.until[0] == self.flight else f"in {self.until[0]} "
        return f"{self.flight} at {self.start:.1f} s and back {there}at {self.until[1]:.1f} s"


def ramp(t: Array, start: float | Array, duration: float) -> Array:
    """Zero to one from `start` within `duration`; at once where that is zero."""
    if duration <= 0.0:
        return (t >= start).astype(float)
    return np.clip((t - start) / duration, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Sought:
    """Differences of a manoeuvre, or of several of one flight, in which changes are sought.

    What the channels could explain is taken out.
    """

    name: str
    t: Array
    basis: Array
    left: Array
    factor: Array

    @classmethod
    def of(
        cls,
        flights: Flights,
        responses: Sequence[str],
        channels: Sequence[str],
        step: int,
        factor: Column | None = None,
    ) -> Sought:
        """Averaged over `step` samples; the name is that of the first manoeuvre. A change is multiplied by `factor`."""

        def prepared(columns: Callable[[Flight], Sequence[Array]]) -> Array:
            return np.concatenate(
                [_averaged(np.column_stack([*columns(f)] or [np.zeros(len(f))]), step) for f in flights]
            )

        y = _centred(prepared(lambda f: [f.difference[r] for r in responses]))
        basis = _basis(_centred(prepared(lambda f: [f[c] for c in channels])))
        t = prepared(lambda f: [f.t])[:, 0]
        by = prepared(lambda f: [np.ones(len(f)) if factor is None else factor(f)])
        return cls(flights[0].name, t, basis, y - basis @ (basis.T @ y), by)

    def starts(self, duration: float) -> Array:
        """Times at which a change may begin."""
        return self.t[(self.t > self.t[0] + EDGE) & (self.t < self.t[-1] - EDGE - 0.5 * duration)]

    def fitted(self, starts: Array, duration: float) -> tuple[Array, Array]:
        """(s, r) sizes of changes from each start, and (s,) sums of squares of their columns."""
        S = self._courses(starts, duration)
        norm = _separable((S**2).sum(axis=0), ((self.basis.T @ S) ** 2).sum(axis=0))
        return (S.T @ self.left) / norm[:, None], norm  # what is left is orthogonal to the basis

    def fitted_pairs(
        self, starts: Array, duration: float, first: NDArray[np.intp], last: NDArray[np.intp]
    ) -> tuple[Array, Array]:
        """The same of changes from some of the starts that are undone from others, (p,) places of each."""
        S = self._courses(starts, duration)
        along = self.basis.T @ S
        total, described = (
            (own := (X**2).sum(axis=0))[first] + own[last] - 2.0 * (X.T @ X)[first, last] for X in (S, along)
        )
        norm, products = _separable(total, described), S.T @ self.left
        return (products[first] - products[last]) / norm[:, None], norm

    def _courses(self, starts: Array, duration: float) -> Array:
        """(n, s) changes from each start, centred."""
        return _centred(self.factor * ramp(self.t[:, None], starts, duration))

    def gains(self, explained: Array) -> Array:
        """(s,) gains of changes that take (s, r) of the sums of squares of the responses."""
        fraction = np.minimum(explained / np.maximum((self.left**2).sum(axis=0), 1e-30), 1.0 - 1e-9)
        return np.asarray(-0.5 * (self.t[-1] - self.t[0]) / _MEMORY * np.log1p(-fraction).sum(axis=1))

    def best(self, starts: Array, duration: float) -> SoughtChange:
        """The likeliest change from one of some starts."""
        size, norm = self.fitted(starts, duration)
        likeliest = int(np.argmax(self.gains(size**2 * norm[:, None])))
        return SoughtChange(self.name, float(starts[likeliest]), duration)


def _separable(total: Array, described: Array) -> Array:
    """Sums of squares without the part that channels describe: what they describe completely cannot be separated."""
    return np.maximum(np.maximum(total - described, _OWN * total), 1e-30)


def _basis(x: Array) -> Array:
    """Orthonormal columns that span those of x; directions that are but rounding are left out."""
    scaled = x / np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-30)
    U, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return U[:, s > 1e-3]


def _averaged(x: Array, step: int) -> Array:
    n = len(x) // step * step
    return x[:n].reshape(-1, step, *x.shape[1:]).mean(axis=1)


def _centred(x: Array) -> Array:
    return x - x.mean(axis=0)
