"""Forces that a plant's simulation lacks, along its motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.plant import Plant, answers, find_plants
from structsel.effects.base import Columns, EffectParameter, Flights, Variant
from structsel.numerics.arrays import Array

Force = Callable[[Array, Array], Array]  # of displacement and speed


def forced(
    plant: Plant,
    parameter: EffectParameter,
    force: Force,
    about: str,
    shape: dict[str, float] | None = None,
    unit: str = "of the response's rms",
    alone: bool = False,
) -> Variant:
    """A missing force, with errors of stiffness, damping and gain, unless it is to be alone.

    With inertia as well, forces along the measured motion would give that motion back, and explain anything. A force
    that the motion needs is larger by what acts against it.
    """
    stiffness = EffectParameter("stiffness", "input per response", 0.2 * plant.stiffness)
    damping = EffectParameter("damping", "input per rate", 0.05 * plant.stiffness * plant.motion / plant.speed)
    off = [stiffness, damping] if plant.is_placed else [damping]
    further = off if plant.swings and not alone else []
    # A force that accelerates a motion differs from its own gain by noise only.
    gain = [EffectParameter("gain", "relative", 0.05)] if further and not plant.along else []
    parameters = (parameter, *further, *gain)

    def columns(flight: Flight) -> Columns:
        if plant.response not in flight.measured:
            return {}
        y, v = plant.path(flight)
        forces = [force(y, v), *([y, v] if plant.is_placed else [v])[: len(further)]]
        made = [plant.under(plant.sense * f) for f in forces]
        simulated = flight.simulated[plant.response]
        return {plant.response: np.column_stack([*made, *([simulated - simulated.mean()] if gain else [])])}

    units = dict.fromkeys(shape or {}, unit)
    of = next(filter(None, plant.along)) if plant.along else plant.response
    return Variant(parameters, columns, shape or {}, units, f"{about} of {of}")


def pushed(flights: Flights, placed: bool = False) -> list[Plant]:
    """Plants on whose motion a force can act; `placed` where it depends on the displacement."""
    found = [plant for response in answers(flights) for plant in find_plants(flights, response)]
    return [plant for plant in found if plant.pushes_back and (plant.is_placed or not placed)]
