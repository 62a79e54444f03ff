"""The simulation under test on its own: open loop with the recorded inputs from the same start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proof.jsbsim.aircraft import JSBSimPlant
from proof.jsbsim.flight import Additions, Manoeuvre, TruthFlight, simulate_manoeuvre
from proof.jsbsim.functions import AeroFunction
from proof.jsbsim.instruments import channels_of
from structsel.aircraft import Aircraft
from structsel.errors import SimulationError
from structsel.numerics.rigid_body import STATES

_FAR = {"alpha": 0.12, "beta": 0.12, "phi": 1.0, "theta": 0.4}
_CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "ax", "ay", "az", "de", "da", "dr",
             "throttle", "thrust", "qbar", "mach")  # fmt: skip


def simulate_open_loop(
    plant: JSBSimPlant, flights: Sequence[TruthFlight], functions: tuple[AeroFunction, ...], truth: Aircraft
) -> dict[str, dict[str, np.ndarray]] | None:
    """Channels per manoeuvre; None where one departs too far from its truth."""
    try:
        other = JSBSimPlant(plant.name, functions)
    except SimulationError:
        return None
    made = {}
    for flight in flights:
        state = np.array([flight[c][0] for c in STATES])
        controls = {c: float(flight[c][0]) for c in flight.manoeuvre.controls}
        moving = {c: flight[c] - controls[c] if c in ("de", "da", "dr", "throttle") else flight[c] for c in controls}
        again = Manoeuvre(flight.manoeuvre.name, "free", flight.t, state, controls, moving, {})
        try:
            simulated = simulate_manoeuvre(other, again, Additions(pilot=False))
        except SimulationError:
            return None
        if any(np.abs(simulated[c] - flight[c]).max() > limit for c, limit in _FAR.items()):
            return None
        channels = channels_of(simulated, truth)
        channels |= {"qbar": 0.5 * channels["rho"] * channels["V"] ** 2, "mach": channels["V"] / channels["sound"]}
        made[flight.manoeuvre.name] = {"t": simulated.t, **{c: channels[c] for c in _CHANNELS if c in channels}}
    return made
