"""Motion and simulated responses as they are compared with a difference that the past predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.sensitivity import asked_wrongly
from structsel.nomenclature import INPUTS, MOMENT_COEFFICIENTS
from structsel.numerics.air_data import Three
from structsel.numerics.arrays import Array

DELAY = 4
"""Samples by which columns of the motion are delayed: the differentiator of the rates uses three samples ahead."""
TIMED = ("de", "da", "dr", "df", "throttle", "thrust")
"""Inputs that may have a time of their own in a flight."""
PLANT_PAST = (0.002, 0.005, 0.01, 0.02, 0.05)  # of a recording, that a plant remembers
_ASKED = ("V", "alpha", "beta", "p", "q", "r", "de", "da", "dr")


def averaged(flight: Flight, response: str, simulated: Array) -> Array:
    """Average of a simulated response over the samples that measure it.

    A measured moment is the differentiator's answer to rates: to the integral of the moment that acted.
    """
    if response not in MOMENT_COEFFICIENTS:
        return simulated
    return flight.rate(scipy.integrate.cumulative_trapezoid(simulated, dx=flight.dt, initial=0.0))


def evaluated_at_readings(flights: Sequence[Flight], responses: Sequence[str]) -> float:
    """Fraction of the noise of the readings that is in the simulated responses: one, or zero for smooth states.

    Third differences leave the noise of what changes slowly.
    """
    products = np.zeros(2)
    for c in responses:
        for f in flights:
            noise, simulated = np.diff(noise_of_readings(f, c), 3), np.diff(f.simulated[c], 3)
            power = float(simulated @ simulated)
            if power > 0.0:
                products += np.array([noise @ simulated, noise @ noise]) / power
    return float(np.clip(products[0] / products[1], 0.0, 1.0)) if products[1] > 0.0 else 0.0


def noise_of_readings(flight: Flight, response: str) -> Array:
    """What a simulated response would contain of the noise of the channels, were it evaluated at the readings."""
    made = np.zeros(len(flight))
    for c in (c for c in _ASKED if c in flight.recorded):
        if (answer := asked_wrongly(flight, c).get(response)) is not None:
            made -= answer * (flight.raw[c] - flight.air.get(c, flight.channels[c]))
    return made


def referred(flight: Flight, response: str, fraction: float) -> Array:
    """Difference of a response, with the simulation referred to the smooth states wherever it was evaluated."""
    simulated = flight.simulated[response] - fraction * noise_of_readings(flight, response)
    return flight.measured[response] - averaged(flight, response, simulated)


def delayed(x: Array, samples: int) -> Array:
    """Samples (n,) or (n, k) as they stood some samples ago; the first is held."""
    samples = min(samples, len(x))
    return np.concatenate([np.repeat(x[:1], samples, axis=0), x[: len(x) - samples]]) if samples else x


def with_motion_delayed(flight: Flight) -> Flight:
    """The flight with the motion of some samples before, and the inputs of each sample."""

    def late(held: Mapping[str, Array]) -> dict[str, Array]:
        return {c: x if c in INPUTS else delayed(x, DELAY) for c, x in held.items()}

    return replace(
        flight, channels=late(flight.channels), raw=late(flight.raw), measured=late(flight.measured),
        simulated=late(flight.simulated), air=late(flight.air),
    )  # fmt: skip


def backward_rates(flight: Flight) -> Three:
    """Angular accelerations from each sample and the one before."""
    p_dot, q_dot, r_dot = (
        np.diff(flight[c], prepend=flight[c][:1]) / flight.dt if c in flight.recorded else flight[f"{c}_dot"]
        for c in "pqr"
    )
    return p_dot, q_dot, r_dot
