"""Effects of propulsion in addition to its declared thrust along its declared line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.effects.base import Effect, EffectParameter, FittedEffect, Flights, ModelCase, ModelForm, Variant
from structsel.effects.operators import spaced
from structsel.effects.propeller import propeller_variants, slipstream_variants
from structsel.effects.signals import Parts, available, gathered, lacking, moves, of_parts, reach
from structsel.effects.wording import percent
from structsel.model import State
from structsel.nomenclature import COEFFICIENTS, FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import first_order_lag

_AXIAL = "along the axis alone"
_CHANGE = 0.2  # least range of the thrust coefficient over its largest value


def _thrust_needs(responses: tuple[str, ...]) -> Callable[[Flights], str]:
    return lambda flights: lacking(flights, responses, ("thrust",))


def _changing_thrust_needs(responses: tuple[str, ...]) -> Callable[[Flights], str]:
    """As `_thrust_needs`, and thrust that changes: with a constant one, every term of it is a derivative."""

    def needs(flights: Flights) -> str:
        if gone := _thrust_needs(responses)(flights):
            return gone
        low, high = reach(flights, "CT")
        if high - low < _CHANGE * max(abs(low), abs(high)):
            return f"a thrust coefficient that changes by {100 * _CHANGE:.0f} % or more"
        return ""

    return needs


def _along_thrust(flight: Flight, CT: Array, part: str = "") -> Parts:
    """A force along the declared thrust line, of coefficient CT, with its moments; or what it does along the axis."""
    direction, arm = flight.aircraft.thrust.direction, flight.aircraft.thrust.arm
    lengths = (flight.aircraft.b, flight.aircraft.cbar, flight.aircraft.b)
    made = [(r, 0, CT * d) for r, d in zip(FORCE_COEFFICIENTS, direction)]
    if part == _AXIAL:
        return made[:1]
    return made + [(r, 0, CT * a / length) for r, a, length in zip(MOMENT_COEFFICIENTS, arm, lengths)]


# Line and size of the thrust


def _line_variants(flights: Flights) -> list[Variant]:
    aircraft = flights[0].aircraft
    down = EffectParameter("offset down", "m", 0.15 * aircraft.cbar, -aircraft.cbar, aircraft.cbar)
    side = EffectParameter("offset right", "m", 0.05 * aircraft.b, -0.3 * aircraft.b, 0.3 * aircraft.b)
    tilt = EffectParameter("tilt up", "rad", 0.04, -0.2, 0.2)
    toe = EffectParameter("toe right", "rad", 0.04, -0.2, 0.2)
    x = aircraft.thrust.offset[0]
    return [
        of_parts((down,), lambda f: [("Cm", 0, f["CT"] / aircraft.cbar)], "below or above the stated line", ("CT",)),
        of_parts((side,), lambda f: [("Cn", 0, -f["CT"] / aircraft.b)], "beside the stated line", ("CT",)),
        of_parts((tilt,), lambda f: [("CZ", 0, -f["CT"]), ("Cm", 0, x * f["CT"] / aircraft.cbar)], "tilted", ("CT",)),
        of_parts((toe,), lambda f: [("CY", 0, f["CT"]), ("Cn", 0, x * f["CT"] / aircraft.b)], "toed", ("CT",)),
    ]


def _line_says(found: FittedEffect) -> str:
    (p,) = found.variant.parameters
    value = found.text(p.name, 180.0 / np.pi, "deg") if p.unit == "rad" else found.text(p.name)
    return f"The thrust does not act along the stated line: {p.name} by {value}."


def _parts(flights: Flights) -> tuple[str, ...]:
    """All of the thrust; and its part along the axis, where its line is stated for a moment, or not as it is flown."""
    return ("", _AXIAL) if any(flights[0].aircraft.thrust.arm) else ("",)


def _scale_variants(flights: Flights) -> list[Variant]:
    fraction = EffectParameter("fraction", "-", 0.15, -0.8, 0.8)
    V, T = float(gathered(flights, "V").mean()), float(np.abs(gathered(flights, "thrust")).max())

    def more(f: Flight, part: str) -> Parts:
        return _along_thrust(f, f["CT"], part)

    return [
        *(
            of_parts((fraction,), partial(more, part=part), f"all of it, {part}" if part else "all of it", ("CT",))
            for part in _parts(flights)
        ),
        of_parts(
            (fraction,), lambda f: _along_thrust(f, f["CT"] * (f["V"] / V - 1.0)), "growing with speed", ("CT*V", "CT")
        ),
        of_parts(
            (fraction,), lambda f: _along_thrust(f, f["CT"] * f["thrust"] / T), "growing with thrust", ("CT*thrust",)
        ),
    ]


def _lag_variants(flights: Flights) -> list[Variant]:
    def behind(f: Flight, tau: float, part: str) -> Parts:
        behind = first_order_lag(f["thrust"], f.dt, tau) - f["thrust"]
        return _along_thrust(f, behind / (f["qbar"] * f.aircraft.S * tau), part)

    return [
        replace(
            of_parts(
                (EffectParameter("lag", "s", tau, 0.4 * tau, 1.7 * tau),), partial(behind, tau=tau, part=part), part
            ),
            model=partial(_lagged_thrust_model, axial=part == _AXIAL),
        )
        for part in _parts(flights)
        for tau in spaced(0.1, 6.0, 11)
    ]


def _lagged_thrust_model(case: ModelCase, axial: bool) -> ModelForm | None:
    if case.estimates["lag"].value <= 0.0:
        return None
    line, aircraft = case.aircraft.thrust, case.aircraft
    term = Term("(thrust_late - thrust)/qbar")
    sizes = [*line.direction, *(a / length for a, length in zip(line.arm, (aircraft.b, aircraft.cbar, aircraft.b)))]
    fixed = {
        c: {term: float(s) / aircraft.S} for c, s in zip(COEFFICIENTS, sizes) if s != 0.0 and (c == "CX" or not axial)
    }
    return ModelForm(states={"thrust_late": State("lag", "thrust", {"tau": case.quantity("lag")})}, fixed=fixed)


# Rotor


def _gyroscopic(f: Flight, momentum: Array | float) -> Parts:
    # A rotor not allowed for is missing from the moment that the motion is said to need.
    qS = f["qbar"] * f.aircraft.S
    return [("Cm", 0, -momentum * f["r"] / (qS * f.aircraft.cbar)), ("Cn", 0, momentum * f["q"] / (qS * f.aircraft.b))]


def _gyroscopic_variants(flights: Flights) -> list[Variant]:
    inertia = flights[0].aircraft.inertia
    size = 0.15 * inertia.Ix if inertia is not None else 1.0
    made = [
        of_parts(
            (EffectParameter("angular momentum", "kg m^2/s", size),),
            lambda f: _gyroscopic(f, 1.0),
            "at a constant speed of the rotor",
            ("r/qbar", "q/qbar"),
        )
    ]
    if available(flights, "rpm"):
        fastest = float(np.abs(gathered(flights, "rpm")).max()) * np.pi / 30.0
        if fastest > 0.0:
            made.append(
                of_parts(
                    (EffectParameter("rotor inertia", "kg m^2", size / fastest),),
                    lambda f: _gyroscopic(f, f["rpm"] * np.pi / 30.0), "with its recorded speed",
                    ("r*rpm/qbar", "q*rpm/qbar"),
                )
            )  # fmt: skip
    if moves(flights, "throttle"):
        made.append(
            of_parts(
                (EffectParameter("angular momentum at full throttle", "kg m^2/s", size),),
                lambda f: _gyroscopic(f, f["throttle"]), "growing with throttle",
                ("r*throttle/qbar", "q*throttle/qbar"),
            )
        )  # fmt: skip
    return made


def _gyroscopic_needs(flights: Flights) -> str:
    if missing := lacking(flights, ("Cm", "Cn"), ("q",)):
        return missing
    return "" if moves(flights, "r") or "Cm" not in flights[0].measured else "yaw rate that changes"


# Thrust that differs from side to side


def _sizes(flights: Flights) -> tuple[EffectParameter, EffectParameter]:
    b = flights[0].aircraft.b
    return (
        EffectParameter("offset", "m", 0.05 * b, -0.4 * b, 0.4 * b),
        EffectParameter("rolling moment per CT", "-", 0.02),
    )


def _off_centre_thrust(flights: Flights) -> list[Variant]:
    def parts(f: Flight) -> list[tuple[str, int, Array]]:
        return [("Cn", 0, -f["CT"] / f.aircraft.b), ("Cl", 1, f["CT"])]

    return [of_parts(_sizes(flights), parts, "in proportion to thrust", ("CT",))]


def _asymmetric_variants(flights: Flights) -> list[Variant]:
    made = _off_centre_thrust(flights)
    if {"thrust_left", "thrust_right"} <= flights[0].recorded:

        def halves(f: Flight) -> list[tuple[str, int, Array]]:
            difference = (f["thrust_left"] - f["thrust_right"]) / (f["qbar"] * f.aircraft.S)
            return [("Cn", 0, difference / f.aircraft.b), ("Cl", 1, difference)]

        made.append(of_parts(_sizes(flights), halves, "as recorded left and right"))
    return made


def _all_parameters(found: FittedEffect) -> str:
    return ", ".join(f"{p.name} {found.text(p.name)}" for p in found.variant.parameters)


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "slipstream", "propulsive", "The propeller's wash raises the dynamic pressure at wing, tail and controls.",
        _changing_thrust_needs(COEFFICIENTS), slipstream_variants,
        lambda found: f"The slipstream acts {found.variant.about}: {_all_parameters(found)}.",
        look_alikes=("thrust-line", "wrong-derivative", "propeller-normal-force"),
        separated_by="throttle steps while the elevator moves: a thrust line does not care for the elevator",
        check="control power and trim at idle and at full power, at one speed",
    ),
    Effect(
        "thrust-line", "propulsive", "The thrust acts along another line than stated.",
        _thrust_needs(("Cm", "Cn", "CZ", "CY")), _line_variants, _line_says,
        look_alikes=("slipstream", "asymmetric-thrust", "cg-shift"),
        separated_by="throttle steps at two speeds, with and without elevator activity",
        check="where the engine's line passes the centre of gravity as loaded",
    ),
    Effect(
        "thrust-scale", "propulsive", "The thrust is larger or smaller than stated.",
        _thrust_needs(("CX",)), _scale_variants,
        lambda found: f"The thrust is off by {percent(found, 'fraction')} of the stated ({found.variant.about}).",
        look_alikes=("thrust-lag", "drag-polar", "mass-error"),
        separated_by="throttle steps at one angle of attack",
        check="the thrust table, or the torque and fuel flow behind it",
    ),
    Effect(
        "thrust-lag", "propulsive", "The thrust follows the throttle, or its recorded position, with a lag.",
        _thrust_needs(("CX",)), _lag_variants, lambda found: f"The thrust follows with a lag of {found.text('lag')}.",
        look_alikes=("thrust-scale", "drag-polar"),
        separated_by="sharp throttle steps up and down",
        check="how the thrust channel is made: from the lever or the engine",
    ),
    Effect(
        "propeller-normal-force", "propulsive", "A propeller in flow across its shaft: force across it, and P-factor.",
        _changing_thrust_needs(("CZ", "CY", "Cm", "Cn")), propeller_variants,
        lambda found: f"The propeller feels flow across its shaft ({found.variant.about}): {_all_parameters(found)}.",
        look_alikes=("slipstream", "wrong-derivative", "cross-coupling"),
        separated_by="angle of attack and sideslip at idle and at full power",
        check="yaw trim against angle of attack at full power",
    ),
    Effect(
        "engine-gyroscopic", "propulsive", "Rotating parts turn a pitch rate into yaw and a yaw rate into pitch.",
        _gyroscopic_needs, _gyroscopic_variants,
        lambda found: f"The rotating parts have angular momentum not allowed for: {_all_parameters(found)}.",
        look_alikes=("cross-coupling", "inertia-error"),
        separated_by="the same yawing at high and at idle rpm",
        check="sense of rotation and inertia of propeller or rotor",
    ),
    Effect(
        "asymmetric-thrust", "propulsive", "Left and right thrust differ.",
        _thrust_needs(("Cn", "Cl")), _asymmetric_variants,
        lambda found: f"Thrust acts off the plane of symmetry by {found.text('offset')} ({found.variant.about}).",
        look_alikes=("asymmetry", "thrust-line", "propeller-normal-force"), log_prior=1.0,
        switched=_off_centre_thrust, may_end=False,
        separated_by="throttle steps with wings level: an asymmetry of the airframe stays",
        check="both engines' instruments",
    ),
)  # fmt: skip
