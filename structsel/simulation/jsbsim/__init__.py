"""Aircraft of JSBSim in structsel's names, units and signs: trim, simulation, coefficients.

``pip install "structsel[jsbsim]"`` installs JSBSim.
"""

from structsel.simulation.jsbsim.aircraft import JSBSimAircraft, open_jsbsim

__all__ = ["JSBSimAircraft", "open_jsbsim"]
