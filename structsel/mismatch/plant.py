"""A plant of one response, as a simulation has it: what drives it, how it answers, and where a force acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq
from scipy.signal import lfilter

from structsel.hypotheses.base import Flights
from structsel.hypotheses.signals import centred, spread, variation
from structsel.mismatch.flight import Flight
from structsel.mismatch.responses import COEFFICIENTS, KINEMATIC
from structsel.numerics.smoothing.result import Array

_SAMPLES = 8000  # of a manoeuvre that are enough to find a linear plant from a simulation without noise
_ORDERS = (0, 1, 2, 3, 4)
_LEAST_R2 = 0.8
_AT_ONCE = 0.2  # share of the answer to an impulse that comes at once, above which a plant has no state of its own
_ACCELERATES, _MOVES = 0.9, 0.95
"""Least correlation of a response with the rate of a speed, and of a speed with the rate of a place."""


def answers(flights: Flights) -> list[str]:
    """Simulated responses that are channels, not coefficients."""
    found = {r for f in flights for r in f.simulated if r not in COEFFICIENTS and r not in KINEMATIC}
    return sorted(found)


@dataclass(frozen=True, eq=False)
class Plant:
    """Linear plant of one response: its input (empty where none was found, the force is then added to the output).

    Attributes
    ----------
    response, source : str
    b, a : (k,) arrays
        Of the discrete transfer function.
    size : float
        Rms of the input; of an accelerated motion, of what accelerates it.
    motion, speed : float
        Rms of the displacement and of its rate.
    along : (str, str), optional
        Channels of displacement and its rate where the response is what accelerates them; without, the measured
        response is the displacement.
    """

    response: str
    source: str
    b: Array
    a: Array
    size: float
    motion: float
    speed: float
    along: tuple[str, str] | None = None

    def path(self, flight: Flight) -> tuple[Array, Array]:
        """Displacement and its rate along a flight."""
        if self.along:
            place, speed = self.along
            return flight.channels[place], flight.channels[speed]
        y = flight.measured[self.response]
        return y, flight.rate(y)

    @property
    def stiffness(self) -> float:
        """Force per displacement, at rest; of an accelerated motion, what accelerates it per displacement."""
        if self.along:
            return self.size / self.motion
        gain = abs(float(self.b.sum() / self.a.sum()))
        return 1.0 / gain if gain > 0.0 else 1.0

    @property
    def pushes_back(self) -> bool:
        """Whether it has a state that a force could act on: a plant that answers at once only passes its input on."""
        if self.speed == 0.0 or self.along:
            return self.speed > 0.0
        answer = lfilter(self.b, self.a, np.concatenate([[1.0], np.zeros(_SAMPLES)]))
        return bool(not self.source or answer[0] ** 2 < _AT_ONCE * float(answer @ answer))

    def under(self, force: Array) -> Array:
        """Response to a force beside the input."""
        return force - force.mean() if self.along else self.driven(force)

    def driven(self, u: Array) -> Array:
        """Response to an input."""
        return lfilter(self.b, self.a, u - u.mean())


def find_plant(flights: Flights, response: str) -> Plant:
    """Linear plant that a simulation is, as far as one channel of the recordings drives it."""
    held = [f for f in flights if response in f.simulated]
    first = held[0]
    told = first.simulated[response][:_SAMPLES]
    y = told - told.mean()
    along = _accelerated(held, response)
    best: tuple[float, str, Array, Array] = (_LEAST_R2, "", np.ones(1), np.ones(1))
    for name in sorted(first.recorded - {"t", *first.simulated, *(along or ())}):
        u = first.raw[name][:_SAMPLES]
        u = u - u.mean()
        if not u.any():
            continue
        for order in _ORDERS:
            b, a = _transfer(u, y, order)
            if np.abs(np.roots(a)).max(initial=0.0) >= 1.0:
                continue
            left = y - lfilter(b, a, u)
            r2 = 1.0 - float(left @ left) / float(y @ y) if y.any() else 0.0
            if r2 > best[0] + 1e-6:
                best = (r2, name, b, a)
    _, source, b, a = best
    u = first.raw[source] if source else told
    moved = variation(held, response)
    if along:
        return Plant(response, source, b, a, moved, spread(held, along[0]), spread(held, along[1]), along)
    speed = np.concatenate([f.rate(f.measured[response]) for f in held])
    return Plant(response, source, b, a, _rms(u - u.mean()), moved, _rms(speed))


def _accelerated(flights: Flights, response: str) -> tuple[str, str] | None:
    """Channels of a displacement and its rate that a response accelerates; None where there are none."""
    speed = _rising(flights, [f.measured[response] for f in flights], _ACCELERATES)
    if speed is None:
        return None
    place = _rising(flights, [f.channels[speed] for f in flights], _MOVES)
    return None if place is None else (place, speed)


def _rising(flights: Flights, rates: Sequence[Array], least: float) -> str | None:
    """The channel whose rate is most like one given."""
    told = centred(rates)
    alike = {}
    for name in sorted(flights[0].recorded - set(flights[0].simulated)):
        if all(name in f.channels for f in flights):
            x = centred(f.rate(f.channels[name]) for f in flights)
            alike[name] = float(x @ told) / max(float(np.linalg.norm(x) * np.linalg.norm(told)), 1e-300)
    best = max(alike, key=lambda c: alike[c], default=None)
    return best if best is not None and alike[best] > least else None


def _transfer(u: Array, y: Array, order: int) -> tuple[Array, Array]:
    n = len(y)
    rows = [-y[order - k : n - k] for k in range(1, order + 1)] + [u[order - k : n - k] for k in range(order + 1)]
    values = lstsq(np.column_stack(rows), y[order:], lapack_driver="gelsy")[0]
    return values[order:], np.concatenate([[1.0], values[:order]])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
