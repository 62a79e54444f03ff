"""What changes in flight: configuration, ice, a load let go."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.ice import ice_says, ice_variants
from structsel.effects.lasting_changes import lasting_changes
from structsel.effects.operators import shape_of
from structsel.effects.signals import Column, from_lift_and_drag, lacking, lift_line, moves, signature
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array

_DURATIONS = (0.0, 1.0, 2.5, 5.0, 8.0)  # s, of a change of configuration in a recording
_LASTING = (0.0, 1.0)  # s, of one that may be undone in another recording
_PHRASES = {"lift": "lift coefficient", "drag": "drag coefficient", "pitching moment": "pitching moment coefficient"}


# --- configuration ---------------------------------------------------------------------------------------------------


def _increments(along: Column, slope: float | None, zero: float) -> Callable[[Flight], Columns]:
    k = 3 if slope is None else 4

    def columns(flight: Flight) -> Columns:
        x = along(flight)
        if not x.any():
            return {}
        parts = [*from_lift_and_drag(flight, 0, CL=x), *from_lift_and_drag(flight, 1, CD=x), ("Cm", 2, x)]
        if slope is not None:
            parts += from_lift_and_drag(flight, 3, CL=slope * (flight["alpha"] - zero) * x)
        return signature(flight, k, parts)

    return columns


def _size(sds: Sequence[float], unit: str) -> tuple[EffectParameter, ...]:
    return tuple(EffectParameter(name, unit, sd) for name, sd in zip(_PHRASES, sds))


_UNRECORDED = _size((0.15, 0.03, 0.04), "-")


def _recorded(flights: Flights) -> list[Variant]:
    slope, zero = lift_line(flights)
    made = []
    for channel in _channels(flights):
        unit = "1/rad" if channel in ("df", "flap") else "-"
        sizes = _size((0.6, 0.06, 0.15) if unit == "1/rad" else (0.1, 0.03, 0.05), unit)
        along = _channel(channel)
        made.append(Variant(sizes, _increments(along, None, zero), about=channel, terms=(channel,)))
        more = (*sizes, EffectParameter("lift slope", unit, 0.2, -1.0, 1.0))
        made.append(Variant(more, _increments(along, slope, zero), about=channel, terms=(channel, f"alpha*{channel}")))
    return made


def _channels(flights: Flights) -> list[str]:
    return [c for c in CONFIGURATION if moves(flights, c)]


def _channel(name: str) -> Column:
    return lambda flight: flight[name]


def _unrecorded(flights: Flights) -> list[Variant]:
    return [Variant(_UNRECORDED, _increments(_all_of_it, None, 0.0))]


def _lasting(flights: Flights) -> list[Variant]:
    """Over the recordings of one flight."""
    made = []
    for change in lasting_changes(flights, LONGITUDINAL_COEFFICIENTS, _LASTING):
        took = change.duration
        times = shape_of(change.times)
        shape = times | {"duration": took}
        about = f"in {change.when}{f', within {took:g} s' if took else ''}"
        columns = _increments(change.along, None, 0.0)
        units = dict.fromkeys(shape, "s")
        made.append(Variant(_UNRECORDED, columns, shape, units, about, times=tuple(times)))
    return made


def _all_of_it(flight: Flight) -> Array:
    return np.ones(len(flight))


def _says_configuration(found: FittedEffect) -> str:
    if not found.variant.terms:
        changes = [f"{phrase} by {found.text(name)}" for name, phrase in _PHRASES.items()]
        return f"The configuration changed, unrecorded, {found.variant.about}: {', '.join(changes)}."
    values = [f"{p.name} {found.text(p.name)}" for p in found.variant.parameters]
    return f"Forces follow {found.variant.about} otherwise than in the simulation: {', '.join(values)}."


# --- a load let go ---------------------------------------------------------------------------------------------------


_RELEASE = (
    EffectParameter("mass", "of the rest", 0.08, 0.01, 0.8),
    EffectParameter("drag", "-", 0.006, 0.0, 0.2),
    EffectParameter("dx", "of cbar", 0.02, -0.3, 0.3),
    EffectParameter("dy", "of b", 0.005, -0.1, 0.1),
    EffectParameter("trim", "-", 0.005, -0.1, 0.1),
    EffectParameter("roll trim", "-", 0.002, -0.1, 0.1),
    EffectParameter("yaw trim", "-", 0.001, -0.1, 0.1),
)
_WHERE = {"near the middle": 0.0, "along the span": 1.2}
"""Fraction of the inertia about x and z that goes with a fraction of mass; of that about y half as much."""


def _releases(flights: Flights) -> list[Variant]:
    return [Variant(_RELEASE, _released(inertia), about=f"from {place}") for place, inertia in _WHERE.items()]


def _released(inertia: float) -> Callable[[Flight], Columns]:
    def columns(flight: Flight) -> Columns:
        x = _all_of_it(flight)
        simulated = {r: flight.predicted(r) if r in flight.simulated else np.zeros(len(flight)) for r in COEFFICIENTS}
        tilt, CT = flight.aircraft.thrust.inclination, flight["CT"]
        # Weighed as before, the aircraft seems to feel more force, and more moment, than it does.
        parts = [
            ("CX", 0, x * (simulated["CX"] + CT * np.cos(tilt))),
            ("CY", 0, x * simulated["CY"]),
            ("CZ", 0, x * (simulated["CZ"] - CT * np.sin(tilt))),
            ("Cl", 0, inertia * x * simulated["Cl"]),
            ("Cm", 0, 0.5 * inertia * x * simulated["Cm"]),
            ("Cn", 0, inertia * x * simulated["Cn"]),
            *from_lift_and_drag(flight, 1, CD=-x),
            ("Cm", 2, x * simulated["CZ"]),
            ("Cn", 2, -x * simulated["CY"] * flight.aircraft.cbar / flight.aircraft.b),
            ("Cl", 3, -x * simulated["CZ"]),
            ("Cn", 3, x * simulated["CX"]),
            ("Cm", 4, x),
            ("Cl", 5, x),
            ("Cn", 6, x),
        ]
        return signature(flight, len(_RELEASE), parts)

    return columns


def _says_release(found: FittedEffect) -> str:
    mass, drag = found.text("mass", 100.0, "%"), found.text("drag", 1e4, "counts")
    forward, sideways = found.text("dx", 100.0, "% cbar"), found.text("dy", 100.0, "% of the span")
    return (
        f"A load left the aircraft ({found.variant.about}): mass falls by {mass} of the rest, drag by {drag}, and the "
        f"centre of gravity moves by {forward} and {sideways} to the side."
    )


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "configuration-change",
        "static",
        "Flap, gear, brake or spoiler changes lift, drag and moment together: as its channel tells, or unrecorded.",
        lambda flights: lacking(flights, LONGITUDINAL_COEFFICIENTS),
        lambda flights: [*_recorded(flights), *_lasting(flights)],
        _says_configuration,
        look_alikes=("store-release", "icing", "ground-effect"),
        separated_by="The device moved again in steady flight at two speeds, with its position recorded.",
        check="The flight log at that time: flap, gear, brakes, doors; increments of the device in the simulation.",
        log_prior=-1.0,
        event=True,
        switched=_unrecorded,
        durations=_DURATIONS,
    ),
    Effect(
        "icing",
        "static",
        "Drag grows and the lift slope falls, slowly, with time.",
        lambda flights: lacking(flights, ("CX", "CZ")),
        ice_variants,
        ice_says,
        look_alikes=("mass-error", "configuration-change", "drag-polar"),
        separated_by="The first manoeuvre flown again at the end, and out of the cloud.",
        check="Temperature and moisture along the flight; the airframe after landing.",
        event=True,
    ),
    Effect(
        "store-release",
        "inertial",
        "A load leaves the aircraft: mass, drag and trim jump at one instant.",
        lambda flights: lacking(flights, ("CX", "CZ")),
        lambda flights: (),
        _says_release,
        look_alikes=("configuration-change", "mass-error", "cg-shift"),
        separated_by="Pull-ups before and after: a lighter aircraft has a larger load factor at the same lift.",
        check="The flight log at that time; mass by weighing after landing.",
        log_prior=-2.0,
        event=True,
        switched=_releases,
        may_end=False,
    ),
)
