"""Where in time a difference jumps: candidates for events that no channel tells of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.effects.base import Flights
from structsel.effects.operators import shape_of
from structsel.effects.signals import CHANNELS_OF, Column, held, moves
from structsel.numerics.arrays import Array

_BLOCK = 0.2  # s, over which differences are averaged
_EDGE = 1.5  # s, at both ends of a manoeuvre, in which no change is sought
_MEMORY = 1.0  # s between samples that count as independent
_OWN = 0.05  # of a change's variance, that channels must leave unexplained
LEAST_DISTANCE = 3.0  # s between two changes of one manoeuvre
_SINGLE = 3  # most changes of one manoeuvre alone that are tried
_ALONE = 10  # maximum number of manoeuvres whose single changes are tried
_ROUNDS = 2  # in which the proportions of a change are those of the first, and then of all that are alike
_TOGETHER = 8  # most manoeuvres with the same change
_CLEAR = 1.5  # gain in log likelihood from which a manoeuvre joins others in a change of the same proportions


@dataclass(frozen=True, eq=False)
class SoughtChange:
    """A step or ramp in the differences of one manoeuvre.

    Attributes
    ----------
    flight : str
    start, duration : float [s]
    gain : float
        In log likelihood, roughly.
    size : (r,) array
        By response, in units of its residual.
    later : tuple of str
        Manoeuvres flown afterwards in the same flight, in which it is still there.
    until : (str, float), optional
        Manoeuvre and time [s] at which it is undone.
    """

    flight: str
    start: float
    duration: float
    gain: float
    size: Array
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
class ChangeSearch:
    """Manoeuvres in whose differences changes are sought.

    What the simulation's linear terms could explain in the same manoeuvre is allowed for, so that wrong values of
    those are not taken for events.

    Attributes
    ----------
    manoeuvres : sequence of (Sought, Sought)
        Each averaged over blocks, and as it is.
    """

    manoeuvres: Sequence[tuple[Sought, Sought]]

    @classmethod
    def of(cls, flights: Flights, responses: Sequence[str], factor: Column | None = None) -> ChangeSearch:
        """In some responses, of the manoeuvres that have all of them; a change is multiplied by `factor`, if any."""
        wanted = held(flights, responses)
        channels = [c for c in dict.fromkeys(c for r in wanted for c in CHANNELS_OF.get(r, ())) if moves(flights, c)]
        there = [f for f in flights if wanted and all(r in f.measured for r in wanted)]
        return cls(
            [
                (
                    Sought.of([f], wanted, channels, max(1, round(_BLOCK / f.dt)), factor),
                    Sought.of([f], wanted, channels, 1, factor),
                )
                for f in there
            ]
        )

    def find(self, durations: Sequence[float] = (0.0,), each: int = 2) -> list[SoughtChange]:
        """Likeliest changes of every manoeuvre, at most `each` per duration, best first."""
        found = []
        for coarse, fine in self.manoeuvres:
            for duration in durations:
                picked = coarse.best(coarse.starts(duration), duration, each)
                if duration == 0.0:  # what happens at once is known to the sample
                    picked = [replace(fine.best(fine.near(one), 0.0, 1)[0], gain=one.gain) for one in picked]
                found += picked
        return sorted(found, key=lambda change: -change.gain)

    def together(self, changes: Sequence[SoughtChange], *, both_signs: bool = True) -> list[Event]:
        """The clearest change of each duration with those of other manoeuvres that have its proportions.

        The clearest of two, three and more manoeuvres, with their signs. One cause moves the responses in the same
        proportions in every manoeuvre, where it need not be what changes most.

        Parameters
        ----------
        changes : sequence of SoughtChange
            Found by this search, best first.
        both_signs : bool
            Whether a change may have opposite signs in two manoeuvres.
        """
        levels = {coarse.name: coarse.level for coarse, _ in self.manoeuvres}
        made: list[Event] = []
        for duration in dict.fromkeys(change.duration for change in changes):
            first = next(change for change in changes if change.duration == duration)
            if not first.size.any():
                continue
            step, alike, signs = first.size * levels[first.flight], [first], {first.flight: 1.0}
            for _ in range(_ROUNDS):
                alike = [one for pair in self.manoeuvres if (one := _like(*pair, step, duration)) is not None]
                signs = {one.flight: float(np.sign(one.size @ (step / levels[one.flight]))) for one in alike}
                alike = [one for one in alike if one.gain > _CLEAR and (both_signs or signs[one.flight] > 0.0)]
                if not alike:
                    break
                # The proportions as all of them have them, each as far as it is clear.
                step = np.sum([one.gain * signs[one.flight] * one.size * levels[one.flight] for one in alike], axis=0)
            alike.sort(key=lambda one: -one.gain)
            for n in range(2, min(len(alike), _TOGETHER) + 1):
                made.append((tuple(alike[:n]), np.array([signs[one.flight] for one in alike[:n]])))
        return made


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
        return self.t[(self.t > self.t[0] + _EDGE) & (self.t < self.t[-1] - _EDGE - 0.5 * duration)]

    def near(self, change: SoughtChange) -> Array:
        """Times within a block of a change."""
        return self.t[np.abs(self.t - change.start) <= _BLOCK]

    @property
    def level(self) -> Array:
        """Rms of each response."""
        return np.maximum(np.sqrt((self.left**2).mean(axis=0)), 1e-30)

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

    def like(self, step: Array, starts: Array, duration: float) -> SoughtChange | None:
        """The likeliest change whose responses have the proportions of `step`, (r,) in their units; of either sign."""
        if not len(starts):
            return None
        size, norm = self.fitted(starts, duration)
        shape = step / self.level
        factor = (size / self.level) @ shape / float(shape @ shape)
        along = factor[:, None] * step
        gain = self.gains(norm[:, None] * along * (2.0 * size - along))
        k = int(np.argmax(gain))
        return SoughtChange(self.name, float(starts[k]), duration, float(gain[k]), size[k] / self.level)

    def best(self, starts: Array, duration: float, each: int) -> list[SoughtChange]:
        """The likeliest changes from some of the starts, at most `each`, apart from each other."""
        if not len(starts):
            return []
        size, norm = self.fitted(starts, duration)
        gain = self.gains(size**2 * norm[:, None])
        found: list[SoughtChange] = []
        for i in np.argsort(-gain):
            if all(abs(starts[i] - one.start) > LEAST_DISTANCE for one in found):
                found.append(SoughtChange(self.name, float(starts[i]), duration, float(gain[i]), size[i] / self.level))
            if len(found) == each:
                break
        return found


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


Event = tuple[tuple[SoughtChange, ...], Array]
"""Changes that have one cause, and the sign of each."""


def steps(
    flights: Flights, responses: Sequence[str], factor: Column | None = None, singles: int = _ALONE
) -> list[Event]:
    """What begins at once and stays: the clearest step of each manoeuvre alone, and those with one cause and sign.

    Parameters
    ----------
    flights : sequence of Flight
    responses : sequence of str
        In which steps are sought; those that the flights have.
    factor : callable, optional
        What a step is multiplied by.
    singles : int
        Most manoeuvres whose step alone is returned.
    """
    search = ChangeSearch.of(flights, responses, factor)
    found = search.find(each=1)
    return [*alone(found)[:singles], *search.together(found, both_signs=False)]


def when(event: Event) -> str:
    """Recordings and times, in words."""
    return ", ".join(change.when for change in event[0])


def from_then_on(event: Event) -> str:
    """The same of what stays."""
    return ", ".join(
        f"from {one.when} on" if one.later else f"in '{one.flight}' from {one.start:.1f} s on" for one in event[0]
    )


def times_of(event: Event) -> dict[str, float]:
    """Times [s] that were sought, as the shape of a variant."""
    return shape_of({where: when for change in event[0] for where, when in change.times.items()})


def alone(changes: Sequence[SoughtChange]) -> list[Event]:
    """Each of the best changes of every manoeuvre alone."""
    names = list(dict.fromkeys(change.flight for change in changes))[:_ALONE]
    return [((change,), np.ones(1)) for name in names for change in [c for c in changes if c.flight == name][:_SINGLE]]


def _like(coarse: Sought, fine: Sought, step: Array, duration: float) -> SoughtChange | None:
    found = coarse.like(step, coarse.starts(duration), duration)
    if found is None or duration > 0.0:
        return found
    exact = fine.like(step, fine.near(found), 0.0)
    return found if exact is None else replace(exact, gain=found.gain)


def added(changes: Sequence[SoughtChange], signs: Array) -> Column:
    """Sum of changes, each with its sign."""

    def column(flight: Flight) -> Array:
        made = np.zeros(len(flight))
        for sign, change in zip(signs, changes):
            made += sign * change.along(flight)
        return made

    return column
