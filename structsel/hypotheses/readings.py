"""What a wrong reading does to every response, worked out once per flight and channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from structsel.hypotheses.base import Columns, Flights
from structsel.mismatch.flight import AIRFRAME, Flight
from structsel.mismatch.responses import COEFFICIENTS, KINEMATIC
from structsel.numerics.smoothing.result import Array

Errors = Mapping[str, Array | float]
Sensitivity = dict[str, tuple[Array, Array]]

_INERTIAL = ("ax", "ay", "az")
_STEP = 1e-4  # of 1 rad, 1 rad/s or 1 m/s^2, and of 100 m/s: small beside every bend, large beside rounding
_KNOWN: WeakKeyDictionary[Flight, dict[str, Sensitivity]] = WeakKeyDictionary()


def cannot_be_shifted(flights: Flights) -> str:
    """What is lacking for a reading's error to be followed."""
    for f in flights:
        if not set(AIRFRAME) <= set(f.channels) or not ({*COEFFICIENTS, *KINEMATIC} & set(f.measured)):
            return "channels V, alpha, ax and az, and simulated coefficients"
    return ""


def sensitivity(flight: Flight, channel: str) -> Sensitivity:
    """By response, what an error e of a channel adds to the difference: A e + B e'."""
    known = _KNOWN.setdefault(flight, {})
    if channel not in known:
        step = 100.0 * _STEP if channel == "V" else _STEP
        ramp = (flight.t - flight.t.mean()) / np.ptp(flight.t)
        level = {r: x / step for r, x in flight.shift(**{channel: np.full(len(flight), step)}).items()}
        tilted = {r: x / step for r, x in flight.shift(**{channel: step * ramp}).items()}
        known[channel] = {r: (A, (tilted[r] - A * ramp) * np.ptp(flight.t)) for r, A in level.items()}
    return known[channel]


def wrong_readings(errors: Callable[[Flight], Sequence[Errors]]) -> Callable[[Flight], Columns]:
    """Columns of a signature from what its parameters add to the readings, to first order.

    Parameters
    ----------
    errors : callable
        Flight to, for each parameter, how much each channel reads too much at one unit of it.
    """

    def columns(flight: Flight) -> Columns:
        made: dict[str, Array] = {}
        each = errors(flight)
        for j, one in enumerate(each):
            for channel, e in one.items():
                error = np.broadcast_to(np.asarray(e, dtype=float), flight.t.shape)
                rate = flight.rate(error)
                for r, (A, B) in sensitivity(flight, channel).items():
                    held = made.get(r)
                    if held is None:
                        held = made[r] = np.zeros((len(flight), len(each)))
                    held[:, j] += A * error + B * rate
        return made

    return columns


def reading(flight: Flight, channel: str) -> Array:
    """A channel; of an accelerometer what it would read were the simulation right, so that no noise meets itself."""
    return flight.expected[channel] if channel in _INERTIAL and channel in flight.expected else flight[channel]
