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
    stall_hysteresis,
    static,
    structural,
)
from structsel.effects.base import (
    Effect,
    EffectParameter,
    FittedEffect,
    Kind,
    ParameterEstimate,
    Variant,
)
from structsel.effects.truth_case import BandNoise, Delayed, Lag, TruthCase

EFFECTS: tuple[Effect, ...] = (
    *parameters.EFFECTS,
    *static.EFFECTS,
    *controls.EFFECTS,
    *events.EFFECTS,
    *stall_hysteresis.EFFECTS,
    *memory.EFFECTS,
    *sensors.EFFECTS,
    *actuators.EFFECTS,
    *propulsive.EFFECTS,
    *inertial.EFFECTS,
    *atmosphere.EFFECTS,
    *structural.EFFECTS,
    *plants.EFFECTS,
)
"""Every effect that can be named: needs, forms and contributions to the differences."""

__all__ = [
    "EFFECTS",
    "BandNoise",
    "Delayed",
    "Effect",
    "EffectParameter",
    "FittedEffect",
    "Kind",
    "Lag",
    "ParameterEstimate",
    "TruthCase",
    "Variant",
]
