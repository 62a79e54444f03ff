"""Surfaces at other positions than recorded, and the increments of the coefficients."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, EffectParameter, Flights, Variant
from structsel.effects.model_forms import MakeModel
from structsel.effects.signals import CONTROLS, coefficients, mean_slope, moves, signature
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import actuate

Surface = Callable[[Flight], Array]

ALL = "all surfaces"
"""What a form is about that takes each alike."""
FRACTION = EffectParameter("fraction", "-", 1.0, 0.5, 1.5)


def used_controls(flights: Flights) -> list[str]:
    """Controls that move and that the simulation answers to."""
    wanted = coefficients(flights)
    return [c for c in CONTROLS if moves(flights, c) and any(mean_slope(flights, r, c) != 0.0 for r in wanted)]


def displaced(*extras: tuple[str, int, Surface]) -> Callable[[Flight], Columns]:
    """Columns of surfaces at other positions than recorded: control, place of the parameter, and displacement."""
    places = 1 + max(j for _, j, _ in extras)

    def columns(flight: Flight) -> Columns:
        moved = [(control, j, extra(flight)) for control, j, extra in extras]
        there = [r for r in flight.measured if r in COEFFICIENTS]
        return signature(flight, places, ((r, j, flight.slope(r, c) * x) for c, j, x in moved for r in there))

    return columns


def departure(control: str, operator: Callable[[Array, Flight], Array], per: float = 1.0) -> Surface:
    """Difference between a surface, by an operator on its input, and the input, per unit of `per`."""
    return lambda f: (operator(f[control], f) - f[control]) / per


def followed(control: str, operator: Callable[[Array, Flight], Array]) -> Callable[[Flight], Columns]:
    """Columns of a surface that follows its recorded input by an operator."""
    return displaced((control, 0, departure(control, operator)))


def behind(x: Array, flight: Flight, operator: Callable[[Array, float, float], Array], tau: float) -> Array:
    """Surface that follows its input by an operator with a time."""
    return operator(x, flight.dt, tau)


def actuated(x: Array, flight: Flight, rate: float = np.inf, backlash: float = 0.0, lag: float = 0.0) -> Array:
    """Surface behind an actuator; see `actuate`."""
    return actuate(flight.t, x, lag=lag, rate=rate, backlash=backlash)


def of_actuator(
    behind: Callable[[Callable[[Array, Flight], Array]], Callable[[Flight], Columns]],
    about: str,
    setting: str,
    name: str,
    unit: str,
    model: MakeModel | None,
    value: float,
) -> Variant:
    """Form of an input that comes through an actuator: `setting` of `actuated` is the only value of its shape.

    `behind` makes the columns from the operator on the input.
    """
    settings: dict[str, Any] = {setting: value}
    columns = behind(partial(actuated, **settings))
    return Variant((FRACTION,), columns, {name: value}, {name: unit}, about, model=model)


def stopped(x: Array, flight: Flight, low: float, high: float) -> Array:
    """Surface between its stops."""
    return np.clip(x, low, high)
