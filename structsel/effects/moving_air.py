"""What moving air adds to the differences: to kinematic responses, and to channels that a simulation states.

A simulation in still air knows one motion only. Velocities over the ground gain the wind where they are simulated from
air data. Air data lose it where they are simulated from the motion over the ground. Any other channel loses what the
simulation makes of a velocity over the ground that is as large as the wind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy

from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.plant import answers
from structsel.effects.base import Columns, Flights
from structsel.effects.signals import moves
from structsel.numerics.air_data import body_to_earth, body_velocity, flow_angle_rates
from structsel.numerics.arrays import Array, centred

OVER_GROUND = ("vn", "ve", "vd")
_POSITION = {"x": (0, 1.0), "y": (1, 1.0), "h": (2, -1.0)}
_AIR = ("V", "alpha", "beta")
_ATTITUDE = ("phi", "theta", "psi")
_LEAST_R2 = 0.8  # of a simulated channel by velocities and other channels, for its answer to velocity to be known
_FELT = 0.02  # of a simulated channel's rms, that velocities over the ground make up at least
_SLOWEST = 1e-3  # m/s of velocity over the ground, below which it has no direction

Wind = Callable[[Flight], Sequence[Array]]
"""Flight to (n, 3) velocities of the air [m/s], north, east and down, for one unit of each parameter."""
Added = Callable[[Flight, Array], Array]
"""Flight and an (n, 3) wind to what that adds to measured less simulated."""


def blown(winds: Wind, channels: Mapping[str, Added]) -> Callable[[Flight], Columns]:
    """Columns of winds in kinematic responses and in channels (see `channels_in_wind`)."""

    def columns(flight: Flight) -> Columns:
        each = []
        for wind in winds(flight):
            made = moving_air(flight, wind) if set(AIRFRAME) <= set(flight.channels) else {}
            each.append(made | {r: add(flight, wind) for r, add in channels.items() if r in flight.measured})
        return {r: np.column_stack([made[r] for made in each]) for r in each[0]}

    return columns


def frames(flight: Flight) -> tuple[Array, Array]:
    """(n, 3) air-relative velocity in body axes and (n, 3, 3) body to earth."""
    body = np.stack(body_velocity(flight["V"], flight["alpha"], flight["beta"]), axis=-1)
    return body, body_to_earth(flight["phi"], flight["theta"], flight["psi"])


def moving_air(flight: Flight, wind: Array) -> dict[str, Array]:
    """What a wind that changes in time adds to the kinematic responses.

    Parameters
    ----------
    flight : Flight
    wind : (n, 3) array [m/s]
        Velocity of the air over the ground, north, east, down.
    """
    (u, v, w), frame = (lambda made: (made[0].T, made[1]))(frames(flight))
    # The instruments feel the motion through space; that through the air also loses what the air gains.
    gains = np.column_stack([flight.rate(x) for x in wind.T])
    ud, vd, wd = -np.einsum("nji,nj->in", frame, gains)
    alpha_dot, beta_dot, V_dot = flow_angle_rates(u, v, w, ud, vd, wd)
    made = {
        "k_V": V_dot,
        "k_alpha": alpha_dot,
        "k_beta": beta_dot,
        "k_h": wind[:, 2] * -1.0,
        **{f"k_{name}": x for name, x in zip(OVER_GROUND, wind.T)},
    }
    return {r: x for r, x in made.items() if r in flight.measured}


def channels_in_wind(flights: Flights) -> dict[str, Added]:
    """Simulated channels that a wind changes, and the increment of each."""
    made: dict[str, Added] = {}
    for response in answers(flights):
        if response in OVER_GROUND:
            made[response] = _carried(OVER_GROUND.index(response))
        elif response in _POSITION:
            made[response] = _drifting(*_POSITION[response])
        elif response in _AIR and _has_ground_velocity(flights):
            if response == "V" or _have(flights, _ATTITUDE):
                made[response] = _through_air(response)
        elif _has_ground_velocity(flights) and (felt := _answer(flights, response)) is not None:
            made[response] = felt
    return made


def ground_velocity(flight: Flight) -> Array:
    """(n, 3) velocity over the ground [m/s], north, east, down, as recorded or as the rate of the position."""
    zero = np.zeros(len(flight))
    parts = []
    for name, (place, (_, sign)) in zip(OVER_GROUND, _POSITION.items()):
        if name in flight.recorded:
            parts.append(flight.channels[name])
        else:
            parts.append(sign * flight.rate(flight.channels[place]) if place in flight.recorded else zero)
    return np.column_stack(parts)


def _has_ground_velocity(flights: Flights) -> bool:
    return all(any(_have(flights, (c,)) for c in pair) for pair in (("vn", "x"), ("ve", "y")))


def _have(flights: Flights, channels: Sequence[str]) -> bool:
    return all(c in f.recorded for f in flights for c in channels)


def _carried(axis: int) -> Added:
    """Velocity over the ground that follows from air data."""
    return lambda flight, wind: wind[:, axis]


def _drifting(axis: int, sign: float) -> Added:
    """Position that follows from air data."""
    return lambda flight, wind: sign * scipy.integrate.cumulative_trapezoid(wind[:, axis], dx=flight.dt, initial=0.0)


def _through_air(channel: str) -> Added:
    """Air data that follow from the motion over the ground, to first order in the wind."""

    def added(flight: Flight, wind: Array) -> Array:
        velocity = ground_velocity(flight)
        if channel == "V":
            return -np.sum(wind * velocity, axis=1) / np.maximum(np.linalg.norm(velocity, axis=1), _SLOWEST)
        frame = body_to_earth(*(flight.channels[c] for c in _ATTITUDE))
        u, v, w = np.einsum("nji,nj->in", frame, velocity)
        lost = -np.einsum("nji,nj->in", frame, wind)
        return flow_angle_rates(u, v, w, *lost)[_AIR.index(channel) - 1]

    return added


def _answer(flights: Flights, response: str) -> Added | None:
    """What a simulated channel loses with the wind, by its answer to the velocity over the ground; None without one.

    The answer is found by regression of the simulated channel on velocities along earth and body axes, whichever is
    closer, on the square of the speed, and on the other channels.
    """
    others = [
        c
        for c in sorted(flights[0].recorded - {"t", *OVER_GROUND, *_POSITION, *answers(flights)})
        if _have(flights, (c,)) and moves(flights, c)
    ]
    y = centred(f.simulated[response] for f in flights)
    found = []
    for turned in (False, True) if _have(flights, _ATTITUDE) else (False,):
        parts = [np.column_stack([*_motion(f, turned).T, *(f.channels[c] for c in others)]) for f in flights]
        X = np.vstack([x - x.mean(axis=0) for x in parts])
        scale = np.where(X.any(axis=0), X.std(axis=0), 1.0)
        values = scipy.linalg.lstsq(X / scale, y)[0] / scale
        left = y - X @ values
        found.append((float(left @ left), turned, values[:4], float(np.std(X[:, :4] @ values[:4]))))
    error, turned, values, size = min(found, key=lambda one: one[0])
    if error > (1.0 - _LEAST_R2) * float(y @ y) or size <= _FELT * float(np.sqrt(np.mean(y**2))):
        return None

    def added(flight: Flight, wind: Array) -> Array:
        velocity, along = ground_velocity(flight), wind
        if turned:
            frame = body_to_earth(*(flight.channels[c] for c in _ATTITUDE))
            along = np.einsum("nji,nj->ni", frame, wind)
        return -along @ values[:3] - 2.0 * values[3] * np.sum(velocity * wind, axis=1)

    return added


def _motion(flight: Flight, turned: bool) -> Array:
    """(n, 4) velocity over the ground along earth or body axes, and the square of the speed."""
    velocity = ground_velocity(flight)
    square = np.sum(velocity**2, axis=1)
    if turned:
        velocity = np.einsum("nji,nj->ni", body_to_earth(*(flight.channels[c] for c in _ATTITUDE)), velocity)
    return np.column_stack([velocity, square])
