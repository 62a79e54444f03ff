"""Simulation of aerodynamic and linear models.

`simulate` simulates an AeroModel with six degrees of freedom. `trim` finds its steady flights, `linearise` the linear
model of small motions about them. `prepare` lays a manoeuvre out for many parameter sets at once. A `LinearModel` has a
`simulate` of its own. `published_aircraft` gives aircraft from the literature.
"""

from structsel.deprecation import renamed_names
from structsel.simulation.atmosphere import Atmosphere, Gust, Turbulence
from structsel.simulation.flight_setup import FlightSetup, prepare, start_from
from structsel.simulation.instruments import Actuator, Instruments
from structsel.simulation.library import PUBLISHED_AIRCRAFT, PublishedAircraft, published_aircraft
from structsel.simulation.linear import LinearModel
from structsel.simulation.linearise import linearise
from structsel.simulation.simulate import simulate
from structsel.simulation.steady_flight import Trim
from structsel.simulation.trim import trim

__getattr__ = renamed_names(
    __name__,
    {
        "Air": "Atmosphere",
        "Prepared": "FlightSetup",
        "READY": "PUBLISHED_AIRCRAFT",
        "ReadyAircraft": "PublishedAircraft",
        "ready": "published_aircraft",
    },
)

__all__ = [
    "PUBLISHED_AIRCRAFT",
    "Actuator",
    "Atmosphere",
    "FlightSetup",
    "Gust",
    "Instruments",
    "LinearModel",
    "PublishedAircraft",
    "Trim",
    "Turbulence",
    "linearise",
    "prepare",
    "published_aircraft",
    "simulate",
    "start_from",
    "trim",
]
