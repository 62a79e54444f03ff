"""Flights whose truth we set: a light single-engined aeroplane in turbulence, seen by imperfect instruments.

A nonlinear six-degree-of-freedom flight with light stability augmentation. The aerodynamics are the
polynomial of the DHC-2 Beaver without flaps, slipstream and sideslip rate, written in our channels (its
pitch-rate coefficients double, because q_hat has the 2 in it); the thrust is a force along its own line.
Rolling, pitching and yawing gusts act on the aeroplane but on no instrument, so the residuals of the
moments are coloured, as in flight. `demo_instruments` flies the same in calm air, for flight-path
reconstruction: exact, and as read by instruments with constant errors.
"""

from structsel.demo.aircraft import RESPONSES, TRUTH, demo_aircraft
from structsel.demo.commands import FLIGHTS, RATE
from structsel.demo.flights import demo_flight, demo_flights
from structsel.demo.instruments import INSTRUMENT_ERRORS, InstrumentedFlight, demo_instruments
from structsel.demo.missing_physics import MissingPhysics, demo_missing_physics

__all__ = [
    "FLIGHTS",
    "INSTRUMENT_ERRORS",
    "RATE",
    "RESPONSES",
    "TRUTH",
    "InstrumentedFlight",
    "MissingPhysics",
    "demo_aircraft",
    "demo_flight",
    "demo_flights",
    "demo_instruments",
    "demo_missing_physics",
]
