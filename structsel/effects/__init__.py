"""The physics that may be missing, one small file per family."""

from __future__ import annotations

from structsel.effects import (
    actuators,
    atmosphere,
    controls,
    events,
    inertial,
    memory,
    parameters,
    plants,
    propulsive,
    sensors,
    static,
    structural,
)
from structsel.effects.base import BandNoise, Estimate, Found, Hypothesis, Kind, Parameter, TruthCase, Variant

HYPOTHESES: tuple[Hypothesis, ...] = (
    *parameters.HYPOTHESES,
    *static.HYPOTHESES,
    *controls.HYPOTHESES,
    *events.HYPOTHESES,
    *memory.HYPOTHESES,
    *sensors.HYPOTHESES,
    *actuators.HYPOTHESES,
    *propulsive.HYPOTHESES,
    *inertial.HYPOTHESES,
    *atmosphere.HYPOTHESES,
    *structural.HYPOTHESES,
    *plants.HYPOTHESES,
)
"""Every effect that can be named, with what it needs and what it does to the differences."""

__all__ = ["HYPOTHESES", "BandNoise", "Estimate", "Found", "Hypothesis", "Kind", "Parameter", "TruthCase", "Variant"]
