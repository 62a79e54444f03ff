"""A plant of one response, as a simulation has it: what drives it, how it responds, and where a force acts.

A force is a function of a motion. That motion is recorded in other channels, or it is the response itself where a plant
with inertia lies between the force and the response: the force then acts through the past of the response only.
Anything else would be a response that explains itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
_NEEDED = 0.95  # R2 of a simulated force by a recorded motion, above which the motion needs it, whatever the input
_INERTIA = 0.05  # of the rms of a simulated force, above which its sense is that of the acceleration, not of the speed
_OF_FLIGHT = {"V", "phi", "theta", "psi", "vn", "ve", "vd", "ax", "ay", "az"}
_FLYING = 3  # of these channels, from which a recording is of a vehicle, whose motion is no mechanism's
_HIGHEST = 2.0  # rad per sample, above which a discrete gain is no longer that of the plant
_FALLS = 2.9  # by which a gain falls within an octave: inertia makes it four and more, a lag alone two
_DAMPED = 0.7  # damping ratio from which a plant is a row of lags
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
        Channels of displacement (empty where it is not recorded) and its rate, where the response is what accelerates
        them or the force that they need; without, the measured response is the displacement.
    sense : float
        -1 where a force against the motion lowers the response (what accelerates it), 1 where it raises it (what the
        motion needs).
    """

    response: str
    source: str
    b: Array
    a: Array
    size: float
    motion: float
    speed: float
    along: tuple[str, str] | None = None
    sense: float = -1.0

    def path(self, flight: Flight) -> tuple[Array, Array]:
        """Displacement (zero where it is not recorded) and its rate along a flight."""
        if self.along:
            place, speed = self.along
            return flight.channels[place] if place else np.zeros(len(flight)), flight.channels[speed]
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
    def is_lag(self) -> bool:
        """Whether the response is a speed that an input sets in motion against a damping, without further inertia."""
        return bool(self.source) and not self.along and not self.swings and len(self._slowest(1.0)) > 0

    @property
    def pushes_back(self) -> bool:
        """Whether a force can act on its motion, which is recorded, or lies behind an input and inertia.

        A plant without inertia only passes its input on, delayed or at once. Without an input, a force along the
        measured response would explain the response alone.
        """
        return self.speed > 0.0 and (self.along is not None or (bool(self.source) and self.swings))

    @property
    def is_placed(self) -> bool:
        """Whether the displacement is recorded, so that a force can depend on it."""
        return self.along is None or bool(self.along[0])

    def motion_of(self, flights: Flights) -> frozenset[str]:
        """Channels of displacement, speed and acceleration along which it is a force."""
        if not self.along:
            return frozenset()
        read = [f.measured[self.response] for f in flights if self.response in f.measured]
        return frozenset({*self.along, _accelerated(flights, self.along[1], read) or ""} - {""})

    def under(self, force: Array) -> Array:
        """Response to a force in addition to the input."""
        return force - force.mean() if self.along else self.response_to(force)

    def response_to(self, u: Array) -> Array:
        """Response to an input."""
        return scipy.signal.lfilter(self.b, self.a, u - u.mean())

    def errors(self, flights: Flights) -> dict[str, list[Array]]:
        """Change of the response by an error of 100 % of its stiffness, or its damping, per flight.

        To first order, along the simulated motion; empty where neither can be determined. An error of inertia changes
        the scale.
        """
        simulated = [f.simulated[self.response] for f in flights]
        if self.along and self.source:
            place, speed = self.along
            used = [c for c in (place, speed, self.source) if c]
            X = np.column_stack([centred(f.channels[c] for f in flights) for c in used])
            y = centred(simulated)
            values = scipy.linalg.lstsq(X, y)[0]
            if float(np.sum((y - X @ values) ** 2)) > (1.0 - _LEAST_R2) * float(y @ y):
                return {}
            parts = zip(("stiffness", "damping") if place else ("damping",), used, values)
            return {name: [v * (f.channels[c] - f.channels[c].mean()) for f in flights] for name, c, v in parts}
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
            made[name] = [
                (scipy.signal.lfilter(over, under, y - y.mean()) - (y - y.mean())) / _SLIGHTLY for y in simulated
            ]
        return made

    def frequency(self, dt: float) -> float:
        """Of its slowest poles [Hz]; zero where it has none."""
        poles = self._slowest(dt)
        return float(np.abs(poles).max()) / (2.0 * np.pi) if len(poles) else 0.0

    def time_constant(self, dt: float) -> float:
        """Time constant [s] of a plant of two or more lags in a row; zero of a simpler one, or of one that swings."""
        poles = self._slowest(dt)
        damped = len(poles) == 2 and bool(np.all(-poles.real > _DAMPED * np.abs(poles)))
        return 1.0 / float(np.abs(poles).mean()) if damped and self.source and not self.along else 0.0

    def _slowest(self, dt: float) -> Array:
        """The slowest pole [rad/s] and its conjugate, or where it is real the slowest two that are; fewer of fewer."""
        z = np.roots(self.a).astype(complex)
        poles = np.log(z[np.abs(z) > 0.0]) / dt
        poles = poles[np.argsort(np.abs(poles))]
        swinging = np.abs(poles.imag) > _REAL * np.abs(poles)
        return np.asarray((poles if swinging[:1].any() else poles[~swinging])[:2])


def find_plant(flights: Flights, response: str) -> Plant:
    """Linear plant that a simulation is, as far as one channel of the recordings drives it: the likeliest reading."""
    return find_plants(flights, response)[0]


def find_plants(flights: Flights, response: str) -> list[Plant]:
    """Plants that a simulation may be, one for each motion along which its response may be a force."""
    held = [f for f in flights if response in f.simulated]
    first = held[0]
    motions = _motions(held, response)
    moved = rms_within(f.measured[response] for f in held)
    made = []
    for along, sense, r2_motion in motions:
        _, source, b, a = _input_of(held, response, first.recorded - {"t", *first.simulated, *along})
        if r2_motion >= _NEEDED or not source or _is_at_once(held, response, (source, *along)):
            moves, paces = (rms_within(f.channels[c] for f in held) if c else 0.0 for c in along)
            made.append(Plant(response, source, b, a, moved, moves or paces, paces, along, sense))
    if made:
        return made
    _, source, b, a = _input_of(held, response, first.recorded - {"t", *first.simulated})
    u = first.raw[source] if source else first.simulated[response][:_SAMPLES]
    speed = np.concatenate([f.rate(f.measured[response]) for f in held])
    return [Plant(response, source, b, a, _rms(u - u.mean()), moved, _rms(speed))]


def _is_at_once(flights: Flights, response: str, channels: Iterable[str]) -> bool:
    """Whether a simulated response is a linear function of channels at the same time, without dynamics of its own."""
    X = np.column_stack([centred(f.raw[c] for f in flights) for c in channels if c])
    y = centred(f.simulated[response] for f in flights)
    return _regression(X, y)[1] > _NEEDED


def _input_of(flights: Flights, response: str, channels: Iterable[str]) -> tuple[float, str, Array, Array]:
    """R2, channel and transfer function with the highest R2 for a simulated response; no channel where none fits.

    The flights have one transfer function and one constant, and each has a first state of its own.
    """
    y = [f.simulated[response][:_SAMPLES] for f in flights]
    power = float(np.sum(centred(y) ** 2))
    best: tuple[float, str, Array, Array] = (_LEAST_R2, "", np.ones(1), np.ones(1))
    for name in sorted(channels):
        u = [f.raw[name][:_SAMPLES] for f in flights]
        if not any(np.ptp(x) for x in u) or power == 0.0:
            continue
        for order in _ORDERS:
            b, a, constant = _transfer(u, y, order)
            if np.abs(np.roots(a)).max(initial=0.0) >= 1.0:
                continue
            rest = constant / a.sum()  # of the response to no input
            left = sum(float(np.sum((one - rest - _from_first(b, a, x, one - rest)) ** 2)) for x, one in zip(u, y))
            if 1.0 - left / power > best[0] + 1e-6:
                best = (1.0 - left / power, name, b, a)
    return best


def _from_first(b: Array, a: Array, u: Array, y: Array) -> Array:
    """Response to an input from the state that the first samples of the response have."""
    order = len(a) - 1
    state = scipy.signal.lfiltic(b, a, y[:order][::-1], u[:order][::-1])
    return np.concatenate([y[:order], scipy.signal.lfilter(b, a, u[order:], zi=state)[0]])


def of_vehicle(flights: Flights) -> bool:
    """Whether recordings are of a vehicle that moves freely, not of a mechanism."""
    return len(_OF_FLIGHT & flights[0].recorded) >= _FLYING


def _motions(flights: Flights, response: str) -> list[tuple[tuple[str, str], float, float]]:
    """Displacement and rate that a response accelerates, or that need it, best first.

    With the sense of a force against them, and the R2 of the simulated response by them; zero where it is no force.
    """
    if of_vehicle(flights):
        return []
    read = [f.measured[response] for f in flights]
    speed = _rising(flights, read, _ACCELERATES)
    # Where another channel is more like the acceleration, the response is the force that this needs.
    if speed is not None and _accelerated(flights, speed, read) is None:
        place = _rising(flights, [f.channels[speed] for f in flights], _MOVES)
        return [((place or "", speed), -1.0, 0.0)]
    places = {c: _rising(flights, [f.channels[c] for f in flights], _ACCELERATES) for c in _others(flights)}
    pairs = [(place, c) for c, place in places.items() if place is not None and places[place] is None]
    # Two channels of a chain are displacement and speed, or speed and acceleration: both are tried.
    pairs += [("", place) for place, c in pairs if c not in places.values()]
    needed = [(*_needed(flights, response, pair), pair) for pair in pairs]
    return [(pair, sense, r2) for r2, sense, pair in sorted(needed, reverse=True) if r2 > _LEAST_R2]


def _needed(flights: Flights, response: str, along: tuple[str, str]) -> tuple[float, float]:
    """R2 of a simulated force by displacement, rate and acceleration, and the sense of a force against the motion."""
    place, speed = along
    parts = [centred(f.rate(f.channels[speed]) for f in flights), centred(f.channels[speed] for f in flights)]
    X = np.column_stack([*parts, *([centred(f.channels[place] for f in flights)] if place else [])])
    y = centred(f.simulated[response] for f in flights)
    values, r2 = _regression(X, y)
    by = values[0] if abs(values[0]) > _INERTIA * _rms(y) else values[1]
    return r2, 1.0 if by >= 0.0 else -1.0


def _regression(X: Array, y: Array) -> tuple[Array, float]:
    """Coefficients of centred columns, each of rms one, and the R2."""
    unit = X / _rms_of(X)
    values = scipy.linalg.lstsq(unit, y)[0]
    left = y - unit @ values
    return values, 1.0 - float(left @ left) / max(float(y @ y), 1e-300)


def _rms_of(X: Array) -> Array:
    """Rms of each column, one where it is zero."""
    size = np.sqrt(np.mean(X**2, axis=0))
    return np.where(size > 0.0, size, 1.0)


def _others(flights: Flights) -> list[str]:
    """Channels of all recordings that are not simulated."""
    return [
        c for c in sorted(flights[0].recorded - {"t", *flights[0].simulated}) if all(c in f.channels for f in flights)
    ]


def _rising(flights: Flights, rates: Sequence[Array], least: float) -> str | None:
    """The channel whose rate is most like one given."""
    simulated = centred(rates)
    alike = {c: _alike(simulated, centred(f.rate(f.channels[c]) for f in flights)) for c in _others(flights)}
    best = max(alike, key=lambda c: alike[c], default=None)
    return best if best is not None and alike[best] > least else None


def _accelerated(flights: Flights, speed: str, response: Sequence[Array]) -> str | None:
    """The channel that is most like the rate of a speed, if it is more like it than a response."""
    rate = centred(f.rate(f.channels[speed]) for f in flights)
    alike = {c: _alike(rate, centred(f.channels[c] for f in flights)) for c in _others(flights)}
    best = max(alike, key=lambda c: alike[c])
    return best if alike[best] > _alike(rate, centred(response)) else None


def _alike(x: Array, y: Array) -> float:
    """Correlation of two centred signals."""
    return float(x @ y) / max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-300)


def _transfer(u: Sequence[Array], y: Sequence[Array], order: int) -> tuple[Array, Array, float]:
    """Discrete transfer function of an order and a constant, by least squares over all flights."""
    rows = []
    for x, one in zip(u, y):
        n = len(one)
        past = [-one[order - k : n - k] for k in range(1, order + 1)]
        rows.append(np.column_stack([*past, *(x[order - k : n - k] for k in range(order + 1)), np.ones(n - order)]))
    goal = np.concatenate([one[order:] for one in y])
    values = scipy.linalg.lstsq(np.vstack(rows), goal, lapack_driver="gelsy")[0]
    return values[order:-1], np.concatenate([[1.0], values[:order]]), float(values[-1])


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))
