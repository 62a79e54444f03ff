"""Signatures of wrong readings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.responses import KINEMATIC
from structsel.comparison.sensitivity import misread
from structsel.effects.base import Columns, Flights
from structsel.effects.signals import moves
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

Errors = Mapping[str, Array | float]
AIR, INERTIAL, ATTITUDE = ("V", "alpha", "beta"), ("ax", "ay", "az", "p", "q", "r"), ("phi", "theta")
"""Channels of instruments, by kind."""


def present(flights: Flights, channels: Sequence[str]) -> list[str]:
    """Those of some channels that every flight has and that move."""
    return [c for c in channels if moves(flights, c)]


def cannot_be_shifted(flights: Flights) -> str:
    """What is lacking for a reading's error to be followed."""
    for f in flights:
        if not set(AIRFRAME) <= set(f.channels) or not ({*COEFFICIENTS, *KINEMATIC} & set(f.measured)):
            return "channels V, alpha, ax and az, and simulated coefficients"
    return ""


def wrong_readings(errors: Callable[[Flight], Sequence[Errors]]) -> Callable[[Flight], Columns]:
    """Columns of a signature from what its parameters add to the readings, to first order.

    Parameters
    ----------
    errors : callable
        Flight to, for each parameter, how much each channel reads too much at one unit of it.
    """

    def columns(flight: Flight) -> Columns:
        each = [misread(flight, **one) for one in errors(flight)]
        nothing = np.zeros(len(flight))
        return {r: np.array([one.get(r, nothing) for one in each]).T for r in {r: 0 for one in each for r in one}}

    return columns
