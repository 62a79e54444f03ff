"""Physics that follows a similarity number: Mach, or Reynolds."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.signals import (
    CONTROLS,
    Column,
    available,
    coefficients,
    each_slope,
    from_lift_and_drag,
    gathered,
    held,
    lacking,
    lift,
    lift_line,
    reach,
    scaled_coefficients,
    scaled_slopes,
    signature,
)
from structsel.nomenclature import LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.atmosphere import standard_atmosphere

_LEAST_MACH = 0.25
_LEAST_RANGE = 0.03  # of Mach
_LEAST_REYNOLDS = 0.15  # range of ln Re
_RISES = (0.05, 0.25, 0.5, 0.7, 0.85)  # where the drag rise starts, as quantiles of Mach
_POWERS = (1, 2, 3)
_GLAUERT = "(1/sqrt(1 - mach^2))"

# --- Mach number -----------------------------------------------------------------------------------------------------


def glauert(mach: Array) -> Array:
    """1 / sqrt(1 - M^2), held below M = 0.97."""
    return 1.0 / np.sqrt(1.0 - np.minimum(mach, 0.97) ** 2)


def _growths(flights: Flights) -> list[tuple[Column, str]]:
    mean = float(gathered(flights, "mach").mean())
    return [(_growth(0.0), "right at rest"), (_growth(mean), f"right at Mach {mean:.2f}")]


def _growth(right: float) -> Column:
    """By how much slopes have grown since the Mach number at which they are right."""
    then = float(glauert(np.array(right)))

    def column(flight: Flight) -> Array:
        return glauert(flight["mach"]) / then - 1.0

    return column


def _since(right: float) -> Column:
    def column(flight: Flight) -> Array:
        return flight["mach"] - right

    return column


def _machs(flights: Flights) -> list[Variant]:
    mach = gathered(flights, "mach")
    mean = float(mach.mean())
    rises = [float(x) for x in np.quantile(mach, _RISES)]
    made: list[Variant | None] = [_drag_rise(start, power) for start in rises for power in _POWERS]
    parameter = EffectParameter("slope growth", "-", 0.6, -2.0, 2.0)
    responses = coefficients(flights)
    wing = held(flights, LONGITUDINAL_COEFFICIENTS)
    for growth, about in _growths(flights):
        made += [_wing(flights, growth, about, start) for start in rises[:4]]
        made += [
            _wing(flights, growth, about, rises[1], about_axis=True, all_lift=all_lift) for all_lift in (False, True)
        ]
        made.append(scaled_coefficients(flights, responses, growth, parameter, f"all coefficients but CX; {about}"))
        made.append(scaled_slopes(flights, responses, None, growth, parameter, f"all slopes; {about}", law=_GLAUERT))
        made.append(
            scaled_slopes(flights, wing, ("alpha",), growth, parameter, f"slopes with alpha; {about}", law=_GLAUERT)
        )
        made += [
            scaled_slopes(flights, (r,), None, growth, parameter, f"all slopes of {r}; {about}", law=_GLAUERT)
            for r in responses
        ]
    # Right at rest, each slope by its own would be any wrong value of each.
    about = f"each slope by its own, in proportion to Mach; right at Mach {mean:.2f}"
    made.append(each_slope(flights, _since(mean), _own_growth, about, law="mach"))
    for control, moved in CONTROLS.items():
        for right in (0.0, mean):
            about = f"effect of {control} in proportion to Mach; right at Mach {right:.2f}"
            moves = held(flights, moved)
            made.append(scaled_slopes(flights, moves, (control,), _since(right), parameter, about, law="mach"))
    return [v for v in made if v is not None]


def _own_growth(what: str) -> EffectParameter:
    return EffectParameter(f"{what} growth", "-", 0.6, -2.0, 2.0)


def _drag_rise(start: float, power: int) -> Variant:
    def columns(flight: Flight) -> Columns:
        return signature(flight, 1, from_lift_and_drag(flight, 0, CD=np.maximum(flight["mach"] - start, 0.0) ** power))

    sd = {1: 0.1, 2: 0.5, 3: 4.0}[power]
    parameter = EffectParameter("drag rise", "-", sd, 0.0, 20.0 * sd)
    return Variant(
        (parameter,), columns, {"drag rise from Mach": start}, {"drag rise from Mach": "-"}, f"power {power}",
        (f"(mach - {start!r})+^{power}",),
    )  # fmt: skip


def _wing(
    flights: Flights, growth: Column, about: str, start: float, about_axis: bool = False, all_lift: bool = False
) -> Variant:
    """Lift slope, aerodynamic centre and drag rise together; a lift growth of one is that of Prandtl and Glauert.

    The angle of attack counts from that of no lift, or from the body's axis; `all_lift`: all of the lift grows.
    """
    slope, zero = lift_line(flights)
    zero = 0.0 if about_axis else zero
    parameters = (
        EffectParameter("lift growth", "-", 0.6, 0.0, 2.0),
        EffectParameter("centre shift", "of cbar", 0.15, -0.8, 0.8),
        EffectParameter("drag rise", "-", 0.5, 0.0, 10.0),
    )

    def columns(flight: Flight) -> Columns:
        x = growth(flight)
        turned = x * slope * (flight["alpha"] - zero)
        grown = x * lift(flight) if all_lift else turned
        rise = np.maximum(flight["mach"] - start, 0.0) ** 2
        return signature(
            flight,
            3,
            [*from_lift_and_drag(flight, 0, CL=grown), ("Cm", 1, -turned), *from_lift_and_drag(flight, 2, CD=rise)],
        )

    shape = {"drag rise from Mach": start}
    terms = (f"alpha*{_GLAUERT}", _GLAUERT, "alpha", f"(mach - {start!r})+^2", "1")
    of = "all of the lift" if all_lift else "lift from the body's axis" if about_axis else "lift"
    about = f"{of}, centre and drag; {about}"
    return Variant(parameters, columns, shape, {"drag rise from Mach": "-"}, about, terms)


def _needs_mach(flights: Flights) -> str:
    gone = lacking(flights)
    if gone:
        return gone
    if not available(flights, "mach"):
        return "channel mach, or h to work it out"
    low, high = reach(flights, "mach")
    if high < _LEAST_MACH:
        return f"Mach numbers above {_LEAST_MACH:g}"
    return "" if high - low > _LEAST_RANGE else f"Mach numbers {_LEAST_RANGE:g} apart"


def _says_mach(found: FittedEffect) -> str:
    values = [f"{p.name} {found.text(p.name)}" for p in found.variant.parameters]
    start = found.variant.shape.get("drag rise from Mach")
    above = f" above Mach {start:.2f}" if start is not None else ""
    return f"Coefficients follow the Mach number{above} ({found.variant.about}): {', '.join(values)}."


# --- Reynolds number -------------------------------------------------------------------------------------------------


def log_reynolds(flight: Flight) -> Array:
    """Logarithm of the Reynolds number of the mean chord."""
    temperature = standard_atmosphere(flight["h"] if "h" in flight.channels else np.zeros(len(flight)))[0]
    viscosity = 1.458e-6 * temperature**1.5 / (temperature + 110.4)  # Sutherland
    return np.log(flight["rho"] * flight["V"] * flight.aircraft.cbar / viscosity)


def _reynolds(flights: Flights) -> list[Variant]:
    mean = float(gathered(flights, log_reynolds).mean())
    high = float(np.quantile(gathered(flights, "alpha"), 0.7))
    _, zero = lift_line(flights)
    drag = EffectParameter("drag per ln Re", "-", 0.006, -0.05, 0.0)

    def variant(
        about: str, increments: Callable[[Flight, Array], Iterable[dict[str, Array]]], *more: EffectParameter
    ) -> Variant:
        def columns(flight: Flight) -> Columns:
            x = log_reynolds(flight) - mean
            parts = from_lift_and_drag(flight, 0, CD=x)
            for j, increment in enumerate(increments(flight, x), 1):
                parts += from_lift_and_drag(flight, j, **increment)
            return signature(flight, 1 + len(more), parts)

        return Variant((drag, *more), columns, about=about)

    level = EffectParameter("drag at the mean", "-", 0.003, -0.02, 0.02)
    slope = EffectParameter("slope per ln Re", "1/rad", 0.4, 0.0, 4.0)
    elsewhere = "right at another Reynolds number"
    return [
        variant("drag", lambda f, x: []),
        # A simulation that is right at a Reynolds number not flown, as of a tunnel, is off by a level here.
        variant(f"drag, {elsewhere}", lambda f, x: [{"CD": np.ones(len(f))}], level),
        variant("drag and lift", lambda f, x: [{"CL": x}], EffectParameter("lift per ln Re", "-", 0.05, 0.0, 1.0)),
        variant("drag and lift slope", lambda f, x: [{"CL": x * (f["alpha"] - zero)}], slope),
        variant(
            f"drag and lift slope, {elsewhere}",
            lambda f, x: [{"CD": np.ones(len(f))}, {"CL": x * f["alpha"]}, {"CL": f["alpha"]}],
            level,
            slope,
            EffectParameter("slope at the mean", "1/rad", 0.2, -2.0, 2.0),
        ),
        variant(
            "drag and greatest lift",
            lambda f, x: [{"CL": x * np.maximum(f["alpha"] - high, 0.0)}],
            EffectParameter("high slope per ln Re", "1/rad", 1.0, 0.0, 8.0),
        ),
    ]


def _needs_reynolds(flights: Flights) -> str:
    gone = lacking(flights, ("CX", "CZ"))
    if gone:
        return gone
    low, high = reach(flights, log_reynolds)
    return "" if high - low > _LEAST_REYNOLDS else "Reynolds numbers that differ by 15 % or more"


def _says_reynolds(found: FittedEffect) -> str:
    drag = found.text("drag per ln Re", 1e4 * np.log(1.1), "drag counts")
    values = [f"{p.name} {found.text(p.name)}" for p in found.variant.parameters[1:]]
    return f"Drag falls with Reynolds number: {drag} for each 10 %{''.join(f'; {x}' for x in values)}."


SIMILARITY: tuple[Effect, ...] = (
    Effect(
        "compressibility",
        "static",
        "Slopes grow as 1/sqrt(1 - M^2), the aerodynamic centre moves, and drag rises with Mach number.",
        _needs_mach,
        _machs,
        _says_mach,
        look_alikes=("flexibility", "reynolds", "control-stretch", "wrong-derivative"),
        separated_by="The same dynamic pressure at two heights, or level accelerations at both.",
        check="Whether the simulation's coefficients ask for Mach.",
    ),
    Effect(
        "reynolds",
        "static",
        "Drag falls and the greatest lift grows with the logarithm of the Reynolds number.",
        _needs_reynolds,
        _reynolds,
        _says_reynolds,
        look_alikes=("compressibility", "wrong-derivative", "flexibility"),
        separated_by="The same Mach numbers at two heights.",
        check="The Reynolds number of the wind-tunnel data behind the simulation.",
    ),
)
