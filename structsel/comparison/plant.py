"""A plant of one response, as a simulation has it: what drives it, how it answers, and where a force acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.responses import KINEMATIC
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array, centred, rms_within

Flights = Sequence[Flight]

_SAMPLES = 8000  # of a manoeuvre that are enough to find a linear plant from a simulation without noise
_ORDERS = (0, 1, 2, 3, 4)
_LEAST_R2 = 0.8
_ACCELERATES, _MOVES = 0.9, 0.95
"""Least correlation of a response with the rate of a speed, and of a speed with the rate of a place."""
_HIGHEST = 2.0  # rad per sample, above which a discrete gain is no longer that of what it stands for
_FALLS = 2.9  # by which a gain falls within an octave: inertia makes it four and more, a lag alone two
_SLIGHTLY = 1e-3  # by which a parameter is changed to see what that does
_REAL = 1e-6  # of a pole's size, below which its imaginary part is rounding


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
    def swings(self) -> bool:
        """Whether a force sets its speed in motion, not at once the response itself: whether inertia is in between.

        Its gain then falls with the square of the frequency, above its slowest poles.
        """
        if self.along:
            return True
        poles = self._slowest(1.0)
        if len(poles) < 2:
            return False
        high = min(4.0 * float(np.abs(poles).max()), _HIGHEST)
        gains = np.abs(scipy.signal.freqz(self.b, self.a, worN=[0.5 * high, high])[1])
        return bool(gains[0] > _FALLS * gains[1])

    @property
    def pushes_back(self) -> bool:
        """Whether a force can act on its motion: a plant without inertia only passes its input on, late or at once."""
        return self.speed > 0.0 and (not self.source or self.swings)

    def under(self, force: Array) -> Array:
        """Response to a force beside the input."""
        return force - force.mean() if self.along else self.driven(force)

    def driven(self, u: Array) -> Array:
        """Response to an input."""
        return scipy.signal.lfilter(self.b, self.a, u - u.mean())

    def errors(self, flights: Flights) -> dict[str, list[Array]]:
        """What an error of its stiffness and damping by all of each adds to the response, per flight.

        To first order, along the simulated motion; empty where neither can be told. That of inertia is one of all.
        """
        told = [f.simulated[self.response] for f in flights]
        if self.along and self.source:
            place, speed = self.along
            X = np.column_stack([centred(f.channels[c] for f in flights) for c in (place, speed, self.source)])
            y = centred(told)
            values = scipy.linalg.lstsq(X, y)[0]
            if float(np.sum((y - X @ values) ** 2)) > (1.0 - _LEAST_R2) * float(y @ y):
                return {}
            names = zip(("stiffness", "damping"), (place, speed), values)
            return {name: [v * (f.channels[c] - f.channels[c].mean()) for f in flights] for name, c, v in names}
        dt = flights[0].dt
        was = self._slowest(dt)
        if self.along or not self.source or not len(was):
            return {}
        denominator = np.real(np.poly(was))  # s^2 + c s + k, or s + c, by inertia
        made = {}
        for name, at in zip(("damping", "stiffness"), range(1, len(denominator))):
            other = denominator.copy()
            other[at] *= 1.0 + _SLIGHTLY
            over, under = (np.real(np.poly(np.exp(poles * dt))) for poles in (was, np.roots(other)))
            made[name] = [(scipy.signal.lfilter(over, under, y - y.mean()) - (y - y.mean())) / _SLIGHTLY for y in told]
        return made

    def _slowest(self, dt: float) -> Array:
        """The slowest pole [rad/s] and its conjugate, or where it is real the slowest two that are; fewer of fewer."""
        z = np.roots(self.a).astype(complex)
        poles = np.log(z[np.abs(z) > 0.0]) / dt
        poles = poles[np.argsort(np.abs(poles))]
        swinging = np.abs(poles.imag) > _REAL * np.abs(poles)
        return np.asarray((poles if swinging[:1].any() else poles[~swinging])[:2])


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
            left = y - scipy.signal.lfilter(b, a, u)
            r2 = 1.0 - float(left @ left) / float(y @ y) if y.any() else 0.0
            if r2 > best[0] + 1e-6:
                best = (r2, name, b, a)
    _, source, b, a = best
    u = first.raw[source] if source else told
    moved = rms_within(f.measured[response] for f in held)
    if along:
        moves, paces = (rms_within(f.channels[c] for f in held) for c in along)
        return Plant(response, source, b, a, moved, moves, paces, along)
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
    values = scipy.linalg.lstsq(np.column_stack(rows), y[order:], lapack_driver="gelsy")[0]
    return values[order:], np.concatenate([[1.0], values[:order]])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
