"""Inputs of a simulation that states channels, and how each channel responds to a change of an input."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.plant import Plant, answers, find_plant, of_vehicle
from structsel.effects.base import Columns, Flights
from structsel.effects.signals import moves
from structsel.nomenclature import is_known, list_channels
from structsel.numerics.arrays import Array, centred

_GROUPS = ("controls", "configuration", "propulsion")
_LEAST_R2 = 0.8  # of a simulated channel by all others, for its response to an input to be known
_FELT = 0.02  # of a simulated channel's rms, that an input makes up at least


@dataclass(frozen=True, eq=False)
class DrivenChannel:
    """What a simulated channel makes of one input.

    Attributes
    ----------
    response, control : str
    of : callable
        Change of the input (n,) to that of the simulated channel.
    plant : Plant, optional
        Where the channel responds through dynamics of its own.
    """

    response: str
    control: str
    of: Callable[[Array], Array]
    plant: Plant | None = None

    def behind(self, operator: Callable[[Array, Flight], Array]) -> Callable[[Flight], Columns]:
        """Column of the channel if its input comes through an operator."""

        def columns(flight: Flight) -> Columns:
            x = flight.raw[self.control]
            if self.response not in flight.measured:
                return {}
            return {self.response: self.to(flight, operator(x, flight) - x)[:, None]}

        return columns

    def to(self, flight: Flight, change: Array) -> Array:
        """Change of the simulated channel of one flight; zero where it has none."""
        return self.of(change) if self.response in flight.measured else np.zeros(len(flight))


def channels_with_input(flights: Flights) -> list[DrivenChannel]:
    """Of every simulated channel, its response to the input of its plant, or to each control at once."""
    made = []
    for response in answers(flights):
        plant = find_plant(flights, response)
        if plant.source and not plant.along and not of_vehicle(flights):
            made.append(DrivenChannel(response, plant.source, plant.response_to, plant))
        else:
            made += _at_once(flights, response, plant.motion_of(flights))
    return made


def _at_once(flights: Flights, response: str, motion: Collection[str]) -> list[DrivenChannel]:
    """By regression of the simulated channel on all other channels; one of no known name is an input.

    The channels of a mechanism's motion are none.
    """
    named = {c.name for group in _GROUPS for c in list_channels(group)} - {"mass"}
    channels = sorted(flights[0].recorded - {"t", *answers(flights)})
    used = [c for c in channels if all(c in f.recorded for f in flights) and moves(flights, c)]
    controls = [c for c in used if (c in named or not is_known(c)) and c not in motion]
    if not controls:
        return []
    X = np.column_stack([centred(f.channels[c] for f in flights) for c in used])
    scale = X.std(axis=0)
    y = centred(f.simulated[response] for f in flights)
    values = scipy.linalg.lstsq(X / scale, y)[0]
    left = y - X / scale @ values
    if float(left @ left) > (1.0 - _LEAST_R2) * float(y @ y):
        return []
    felt = {c: v / s for c, v, s in zip(used, values, scale) if abs(v) > _FELT * float(y.std())}
    return [DrivenChannel(response, c, _scaled(felt[c])) for c in controls if c in felt]


def _scaled(slope: float) -> Callable[[Array], Array]:
    return lambda change: slope * change
