"""Where in time a difference jumps: candidates for events that no channel tells of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Flights, Variant
from structsel.effects.signals import CHANNELS_OF, Column, held, moves
from structsel.numerics.arrays import Array

_BLOCK = 0.2  # s, over which differences are averaged
_EDGE = 1.5  # s, at both ends of a manoeuvre, in which no change is sought
_MEMORY = 1.0  # s between samples that count as independent
_OWN = 0.05  # of a change's variance, that channels must leave unexplained
_LEAST_DISTANCE = 3.0  # s between two changes of one manoeuvre
_SINGLE = 3  # most changes of one manoeuvre alone that are tried
_ALONE = 10  # maximum number of manoeuvres whose single changes are tried
_TOGETHER = 6  # most manoeuvres with the same change
_CLEAR = 4.0  # gain in log likelihood from which a manoeuvre joins others in a change


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
    """

    flight: str
    start: float
    duration: float
    gain: float
    size: Array

    def along(self, flight: Flight) -> Array:
        """From zero to one as it happens; zero in other manoeuvres."""
        if flight.name != self.flight:
            return np.zeros(len(flight))
        return ramp(flight.t, self.start, self.duration)


def ramp(t: Array, start: float, duration: float) -> Array:
    """Zero to one from `start` within `duration`; at once where that is zero."""
    if duration <= 0.0:
        return (t >= start).astype(float)
    return np.clip((t - start) / duration, 0.0, 1.0)


def find_changes(
    flights: Flights, responses: Sequence[str], durations: Sequence[float] = (0.0,), each: int = 2
) -> list[SoughtChange]:
    """Likeliest changes of every manoeuvre, at most `each` per duration, best first.

    What the simulation's linear terms could explain in the same manoeuvre is allowed for, so that wrong values of
    those are not taken for events.
    """
    wanted = held(flights, responses)
    channels = [c for c in dict.fromkeys(c for r in wanted for c in CHANNELS_OF[r]) if moves(flights, c)]
    found = []
    for f in flights:
        if not wanted or any(r not in f.measured for r in wanted):
            continue
        coarse, fine = (_Sought.of(f, wanted, channels, step) for step in (max(1, round(_BLOCK / f.dt)), 1))
        for duration in durations:
            picked = coarse.best(coarse.starts(duration), duration, each)
            if duration == 0.0:  # what happens at once is known to the sample
                near = [fine.t[np.abs(fine.t - one.start) <= _BLOCK] for one in picked]
                picked = [replace(fine.best(t, 0.0, 1)[0], gain=one.gain) for t, one in zip(near, picked)]
            found += picked
    return sorted(found, key=lambda change: -change.gain)


@dataclass(frozen=True, eq=False)
class _Sought:
    """Differences of one manoeuvre in which changes are sought, less what its channels could explain."""

    name: str
    t: Array
    basis: Array
    left: Array

    @classmethod
    def of(cls, flight: Flight, responses: Sequence[str], channels: Sequence[str], step: int) -> _Sought:
        """Averaged over `step` samples."""
        n = len(flight) // step * step

        def prepared(each: list[Array]) -> Array:
            return _centred(_averaged(np.column_stack(each or [np.zeros(n)]), step))

        y = prepared([flight.difference[r][:n] for r in responses])
        basis = _basis(prepared([flight[c][:n] for c in channels]))
        return cls(flight.name, _averaged(flight.t[:n], step), basis, y - basis @ (basis.T @ y))

    def starts(self, duration: float) -> Array:
        """Times at which a change may begin."""
        return self.t[(self.t > self.t[0] + _EDGE) & (self.t < self.t[-1] - _EDGE - 0.5 * duration)]

    def best(self, starts: Array, duration: float, each: int) -> list[SoughtChange]:
        """The likeliest changes from some of the starts, at most `each`, apart from each other."""
        if not len(starts):
            return []
        t, y = self.t, self.left
        S = _centred(np.column_stack([ramp(t, s, duration) for s in starts]))
        total = (S**2).sum(axis=0)
        S = S - self.basis @ (self.basis.T @ S)
        # A change that the channels themselves describe cannot be separated from them.
        norm = np.maximum((S**2).sum(axis=0), _OWN * total)
        size = (S.T @ y) / norm[:, None]
        fraction = np.clip(size**2 * norm[:, None] / np.maximum((y**2).sum(axis=0), 1e-30), 0.0, 1.0 - 1e-9)
        gains = -0.5 * (t[-1] - t[0]) / _MEMORY * np.log1p(-fraction).sum(axis=1)
        level = np.maximum(np.sqrt((y**2).mean(axis=0)), 1e-30)
        found: list[SoughtChange] = []
        for i in np.argsort(-gains):
            if all(abs(starts[i] - one.start) > _LEAST_DISTANCE for one in found):
                found.append(SoughtChange(self.name, float(starts[i]), duration, float(gains[i]), size[i] / level))
            if len(found) == each:
                break
        return found


def _basis(x: Array) -> Array:
    """Orthonormal columns that span those of x; directions that are but rounding are left out."""
    scaled = x / np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-30)
    U, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return U[:, s > 1e-3]


def _averaged(x: Array, step: int) -> Array:
    return x.reshape(-1, step, *x.shape[1:]).mean(axis=1)


def _centred(x: Array) -> Array:
    return x - x.mean(axis=0)


Event = tuple[tuple[SoughtChange, ...], Array]
"""Changes that have one cause, and the sign of each."""


def alone(changes: Sequence[SoughtChange]) -> list[Event]:
    """Each of the best changes of every manoeuvre alone."""
    names = list(dict.fromkeys(change.flight for change in changes))[:_ALONE]
    return [((change,), np.ones(1)) for name in names for change in [c for c in changes if c.flight == name][:_SINGLE]]


def together(changes: Sequence[SoughtChange], *, both_signs: bool = True) -> list[Event]:
    """The best of several manoeuvres, two, three and more, with their signs.

    Parameters
    ----------
    changes : sequence of SoughtChange
        Best first.
    both_signs : bool
        Whether a change may have opposite signs in two manoeuvres.
    """
    made: list[Event] = []
    for duration in dict.fromkeys(change.duration for change in changes):
        best: dict[str, SoughtChange] = {}
        for change in changes:
            if change.duration == duration and change.gain > _CLEAR:
                best.setdefault(change.flight, change)
        first = next(iter(best.values()), None)
        if first is None:
            continue
        alike = [(c, float(np.sign(c.size @ first.size))) for c in best.values()]
        if not both_signs:
            alike = [(c, sign) for c, sign in alike if sign > 0.0]
        for n in range(2, min(len(alike), _TOGETHER) + 1):
            made.append((tuple(c for c, _ in alike[:n]), np.array([sign for _, sign in alike[:n]])))
    return made


def added(changes: Sequence[SoughtChange], signs: Array) -> Column:
    """Sum of changes, each with its sign."""

    def column(flight: Flight) -> Array:
        made = np.zeros(len(flight))
        for sign, change in zip(signs, changes):
            made += sign * change.along(flight)
        return made

    return column


def confined(flights: Flights, variant: Variant) -> Variant | None:
    """The same, in those manoeuvres only in which the differences have it; None where that is all of them, or one.

    Parameters
    ----------
    flights : sequence of Flight
    variant : Variant
        Of one parameter.
    """
    power = {r: sum(float(f.difference[r].var()) for f in flights) for r in flights[0].difference}
    with_difference, with_itself = np.array([_products(variant, f, power) for f in flights]).T
    sizes = with_difference / np.maximum(with_itself, 1e-30)
    best: tuple[float, tuple[str, ...]] = (0.0, ())
    for sign in (1.0, -1.0):
        order = np.argsort(-sign * sizes)
        explained = np.cumsum(sign * with_difference[order])
        explained = np.maximum(explained, 0.0) ** 2 / np.maximum(np.cumsum(with_itself[order]), 1e-30)
        best_count = int(np.argmax(explained))
        best = max(
            best, (float(explained[best_count]), tuple(sorted(flights[i].name for i in order[: best_count + 1])))
        )
    on = best[1]
    if not 1 < len(on) < len(flights):
        return None
    return replace(variant, columns=lambda flight: variant.columns(flight) if flight.name in on else {}, only_in=on)


def _products(variant: Variant, flight: Flight, power: Mapping[str, float]) -> tuple[float, float]:
    """Sums over responses of a form's column with the difference, and with itself, each over the response's power."""
    total = np.zeros(2)
    for response, column in variant.columns(flight).items():
        x, y = _centred(column[:, 0]), _centred(flight.difference[response])
        total += np.array([x @ y, x @ x]) / max(power[response], 1e-30)
    return float(total[0]), float(total[1])
