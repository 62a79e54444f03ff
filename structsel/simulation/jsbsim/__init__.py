"""JSBSim's aircraft, in our names, units and signs: trimmed, flown, and asked for their coefficients.

``pip install "structsel[jsbsim]"`` brings JSBSim.
"""

from structsel.simulation.jsbsim.aircraft import JSBSimAircraft, open_jsbsim

__all__ = ["JSBSimAircraft", "open_jsbsim"]
