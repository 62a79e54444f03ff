"""Simulation: aerodynamic and linear models flown to Recordings.

`simulate` flies an AeroModel with six degrees of freedom, `trim` finds its steady flights and `linearise` the small
motions about them; `prepare` makes a manoeuvre ready for many parameter sets at once. A `LinearModel` flies by itself.
`ready` gives aircraft from the literature.
"""

from structsel.simulation.air import Air, Gust, Turbulence
from structsel.simulation.instruments import Actuator, Instruments
from structsel.simulation.library import READY, ReadyAircraft, ready
from structsel.simulation.linear import LinearModel
from structsel.simulation.linearising import linearise
from structsel.simulation.preparing import Prepared, prepare
from structsel.simulation.simulate import simulate
from structsel.simulation.trimmed import Trim
from structsel.simulation.trimming import trim

__all__ = [
    "READY",
    "Actuator",
    "Air",
    "Gust",
    "Instruments",
    "LinearModel",
    "Prepared",
    "ReadyAircraft",
    "Trim",
    "Turbulence",
    "linearise",
    "prepare",
    "ready",
    "simulate",
    "trim",
]
