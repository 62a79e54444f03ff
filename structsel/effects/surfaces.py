"""Surfaces at other positions than recorded, and the increments of the coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, EffectParameter, Flights
from structsel.effects.signals import CONTROLS, coefficients, mean_slope, moves, signature
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import actuate

Surface = Callable[[Flight], Array]
Operator = Callable[[Array, Flight], Array]
Follow = Callable[[Operator], Callable[[Flight], Columns]]
"""Operator on an input to the columns of what follows it."""

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


def departure(control: str, operator: Operator, per: float = 1.0) -> Surface:
    """Difference between a surface, by an operator on its input, and the input, per unit of `per`."""
    return lambda f: (operator(f[control], f) - f[control]) / per


def followed(control: str, operator: Operator) -> Callable[[Flight], Columns]:
    """Columns of a surface that follows its recorded input by an operator."""
    return displaced((control, 0, departure(control, operator)))


def behind(x: Array, flight: Flight, operator: Callable[[Array, float, float], Array], tau: float) -> Array:
    """Surface that follows its input by an operator with a time."""
    return operator(x, flight.dt, tau)


def actuated(
    x: Array, flight: Flight, rate: float = np.inf, backlash: float = 0.0, start: float = 0.0, lag: float = 0.0
) -> Array:
    """Surface behind an actuator; see `actuate`."""
    return actuate(flight.t, x, lag=lag, rate=rate, backlash=backlash, start=start)


def from_unknown_start(
    at: Callable[[float], Callable[[Flight], Columns]], names: Sequence[str]
) -> Callable[[Flight], Columns]:
    """Columns of a form, and to first order those of its unknown start in each flight.

    Parameters
    ----------
    at : callable
        Start, -1 to 1, to the form's column.
    names : sequence of str
        Of the flights.
    """

    def columns(flight: Flight) -> Columns:
        low, middle, high = (at(start)(flight) for start in (-1.0, 0.0, 1.0))
        mine = np.array([name == flight.name for name in names], dtype=float)
        return {c: np.column_stack([x, 0.5 * (high[c] - low[c]) * mine]) for c, x in middle.items()}

    return columns


def stopped(x: Array, flight: Flight, low: float, high: float) -> Array:
    """Surface between its stops."""
    return np.clip(x, low, high)
