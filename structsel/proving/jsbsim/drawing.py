"""Concealed cases whose truth is flown by JSBSim, drawn by seed."""

from __future__ import annotations

from typing import cast

import numpy as np

from structsel.errors import AircraftError, SimulationError
from structsel.proving.cases import Case
from structsel.proving.jsbsim.draft import BANDS, Draft, Family, Infeasible, Severity
from structsel.proving.jsbsim.plane import Plane

FLEET = ("c172p", "c172r", "c172x", "pa28", "J3Cub", "t6texan2", "DHC6", "OV10", "global5000", "737", "A320", "B747",
         "MD11", "T37", "A4", "F80C", "f15", "F4N")  # fmt: skip
"""JSBSim's aircraft that trim and fly well."""
_FAMILIES = {"single": 0.62, "pair": 0.12, "null": 0.14, "outside": 0.06, "clutter": 0.06}
_TRIES = 12


def draw_jsbsim_case(
    seed: int,
    *,
    aircraft: str | None = None,
    effect: str | None = None,
    family: Family | None = None,
    severity: Severity | None = None,
) -> Case:
    """A concealed case; what is not asked for is drawn.

    Parameters
    ----------
    seed : int
        The same seed (and wishes) gives the same case.
    aircraft : str, optional
        Of `FLEET`.
    effect : str, optional
        Name of EFFECTS.md, for the families with one main effect.
    family : {"single", "pair", "null", "outside", "clutter"}, optional
    severity : {"easy", "medium", "hard"}, optional

    Returns
    -------
    Case

    Raises
    ------
    SimulationError
        JSBSim is not installed, or twelve draws gave no case of this kind.
    """
    last: Exception | None = None
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, attempt, 0x5B])
        name = aircraft or str(rng.choice(FLEET))
        kind = family or str(rng.choice(list(_FAMILIES), p=list(_FAMILIES.values())))
        how = severity or str(rng.choice(list(BANDS)))
        try:
            return Draft(Plane(name), cast(Family, kind), cast(Severity, how), effect, seed, rng).case()
        except (SimulationError, AircraftError, Infeasible) as error:
            last = error
    raise SimulationError(f"no case of seed {seed} could be made in {_TRIES} draws: {last}")
