"""Flights whose truth we set: a light single-engined aeroplane in turbulence, seen by imperfect instruments.

A nonlinear six-degree-of-freedom flight with light stability augmentation. The aerodynamics are the
polynomial of the DHC-2 Beaver without flaps, slipstream and sideslip rate, written in our channels (its
pitch-rate coefficients double, because q_hat has the 2 in it); the thrust is a force along its own line.
Rolling, pitching and yawing gusts act on the aeroplane but on no instrument, so the residuals of the
moments are coloured, as in flight.
"""

from structsel.demo.flight import demo_flight, demo_flights
from structsel.demo.plans import FLIGHTS, RATE
from structsel.demo.truth import RESPONSES, TRUTH, demo_aircraft

__all__ = ["FLIGHTS", "RATE", "RESPONSES", "TRUTH", "demo_aircraft", "demo_flight", "demo_flights"]
