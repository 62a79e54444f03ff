"""Mass, its centre and its spread: other than stated, burning away, shifting or swinging.

The measured coefficients depend on the stated mass and inertia. Increments by the true ones are computed from the
*simulated* forces and moments, never the measured ones, whose noise would occur twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Effect, EffectParameter, FittedEffect, Flights, Variant, of_shape
from structsel.effects.lasting_changes import lasting_changes
from structsel.effects.operators import oscillate, peaks, shape_of, spaced
from structsel.effects.signals import Parts, coefficients, held, lacking, of_parts
from structsel.nomenclature import FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS
from structsel.numerics.air_data import cross
from structsel.numerics.arrays import Array, centred
from structsel.numerics.rigid_body import angular_acceleration, inertial_moment, thrust_moment

_SLOSH = (0.25, 2.0)  # Hz
_SLOSH_FREQUENCIES = 12  # 21 % apart
_SLOSH_DAMPINGS = (0.025, 0.08)
_LEAST_SWING = 1e-6  # fraction of its power, of rounding
_DURATIONS = (0.0, 5.0, 10.0)  # s, of a shift: a tank that empties, a passenger who walks
_GROWTH, _RATE = "fraction from first to last", "fraction per min"


# Mass


_MASS = {"fraction": ("%", ""), _GROWTH: ("%", " from first to last"), _RATE: ("% per min", "")}
"""Of a parameter of a mass, how it is given: the unit, and what it is."""


def _heavier(flight: Flight, j: int, fraction: Array | float) -> Parts:
    return [(r, j, -fraction * C) for r, C in zip(FORCE_COEFFICIENTS, flight.forces)]


def _burnt(flight: Flight) -> Array:
    """Minutes since the start, weighted with the thrust where it is known."""
    thrust = flight["thrust"]
    mean = float(thrust.mean())
    rate = thrust / mean if mean > 0.0 else np.ones(len(flight))
    return np.cumsum(rate) * flight.dt / 60.0


def _place_in(flights: Flights) -> Callable[[Flight], float]:
    """Place of a manoeuvre: 0 of the first, 1 of the last and of any flown later."""
    known = {f.name: i / max(1, len(flights) - 1) for i, f in enumerate(flights)}
    return lambda f: known.get(f.name, 1.0)


def _mass_variants(flights: Flights) -> list[Variant]:
    fraction = EffectParameter("fraction", "-", 0.06, -0.5, 0.5, of_outcome=True)
    made = [of_parts((fraction,), lambda f: _heavier(f, 0, 1.0), "in all manoeuvres")]
    if len(flights) > 2:
        place = _place_in(flights)
        growth = EffectParameter(_GROWTH, "-", 0.1, -0.5, 0.5)
        made.append(of_parts((growth,), lambda f: _heavier(f, 0, place(f)), "growing from manoeuvre to manoeuvre"))
        made.append(
            of_parts(
                (fraction, growth), lambda f: [*_heavier(f, 0, 1.0), *_heavier(f, 1, place(f))],
                "off, and growing from manoeuvre to manoeuvre",
            )
        )  # fmt: skip
    if len({float(f.t[0]) for f in flights}) > 1:
        first = min(float(f.t[0]) for f in flights)
        rate = EffectParameter(_RATE, "1/min", 0.005, -0.1, 0.1)
        made.append(of_parts((rate,), lambda f: _heavier(f, 0, (f.t - first) / 60.0), "growing with the time of day"))
    within = EffectParameter(_RATE, "1/min", 0.02, -0.3, 0.3)
    made.append(of_parts((within,), lambda f: _heavier(f, 0, _burnt(f)), "growing within each manoeuvre as fuel burns"))
    return made


def _mass_says(found: FittedEffect) -> str:
    amounts = [found.text(name, 100.0, unit) + more for name, (unit, more) in _MASS.items() if name in found.estimates]
    return f"The mass is off by {' and '.join(amounts)} of what is stated ({found.variant.about})."


# Centre of gravity


def _through(flight: Flight) -> Array:
    """From 0 at a manoeuvre's start to 1 at its end."""
    return (flight.t - flight.t[0]) / np.ptp(flight.t)


def _off_centre(
    flight: Flight, j: int, axis: int, on: Callable[[Flight], Array | float] | None = None, pushed: bool = True
) -> Parts:
    """Moments about a centre of gravity that lies 1 m along an axis from the stated one.

    Thrust takes part where its line stays; where that is stated from the centre of gravity, it moves as well.
    """
    arm = cross(np.eye(3)[axis], flight.forces if pushed else [flight.predicted(c) for c in FORCE_COEFFICIENTS])
    lengths = (flight.aircraft.b, flight.aircraft.cbar, flight.aircraft.b)
    much = 1.0 if on is None else on(flight)
    return [(r, j, -much * m / length) for r, m, length in zip(MOMENT_COEFFICIENTS, arm, lengths)]


def _arm(flight: Flight, axis: int, response: str) -> Array:
    """Moment about a centre of gravity that lies 1 m along an axis from the stated one."""
    (made,) = (x for r, _, x in _off_centre(flight, 0, axis) if r == response)
    return made


def _off_centres(flight: Flight, axes: Sequence[int], pushed: bool) -> Parts:
    return [part for j, axis in enumerate(axes) for part in _off_centre(flight, j, axis, pushed=pushed)]


def _off_centre_in(flight: Flight, axis: int, moment: str) -> Parts:
    """One moment of the air's forces alone, where the simulation has a moment about that axis only."""
    return [part for part in _off_centre(flight, 0, axis, pushed=False) if part[0] == moment]


def _shift(flights: Flights, axis: int) -> EffectParameter:
    aircraft = flights[0].aircraft
    sd = (0.03 * aircraft.cbar, 0.01 * aircraft.b, 0.04 * aircraft.cbar)[axis]
    return EffectParameter("xyz"[axis], "m", sd, -8.0 * sd, 8.0 * sd)


def _shift_variants(flights: Flights) -> list[Variant]:
    made = []
    lines = {True: "in all manoeuvres"}
    if any(np.any(f["CT"]) for f in flights):
        lines[False] = "in all manoeuvres, the line of thrust with it"
    for axes in ((0,), (1,), (2,), (0, 2), (0, 1)):
        parameters = tuple(_shift(flights, i) for i in axes)
        for pushed, about in lines.items():
            if pushed or axes != (0,):
                made.append(of_parts(parameters, partial(_off_centres, axes=axes, pushed=pushed), about))
    for axis, moment in ((0, "Cm"), (1, "Cl"), (2, "Cm")):
        columns = partial(_off_centre_in, axis=axis, moment=moment)
        made.append(of_parts((_shift(flights, axis),), columns, f"in all manoeuvres, in {moment} alone"))
    for axis, response in ((0, "Cm"), (1, "Cl"), (2, "Cm")):
        arm = partial(_arm, axis=axis, response=response)
        for change in lasting_changes(flights, (response,), _DURATIONS, factor=arm):
            shape = shape_of(change.times)
            columns = partial(_off_centre, j=0, axis=axis, on=change.along)
            units = dict.fromkeys(shape, "s")
            shifted = of_parts((_shift(flights, axis),), columns, change.when, (), shape, units)
            made.append(replace(shifted, times=tuple(shape)))
        if len(flights) > 2:
            made.append(
                of_parts(
                    (_shift(flights, axis),), partial(_off_centre, j=0, axis=axis, on=_place_in(flights)),
                    "growing from the first manoeuvre to the last",
                )
            )  # fmt: skip
        made.append(
            of_parts(
                (_shift(flights, axis),), partial(_off_centre, j=0, axis=axis, on=_through),
                "growing over each manoeuvre",
            )
        )  # fmt: skip
    return made


def _shifts_in_flight(flights: Flights) -> list[Variant]:
    return [of_parts((_shift(flights, axis),), partial(_off_centre, j=0, axis=axis), "") for axis in range(3)]


def _shift_says(found: FittedEffect) -> str:
    where = ", ".join(f"{found.text(p.name)} along body {p.name}" for p in found.variant.parameters)
    return f"The centre of gravity lies elsewhere than stated, by {where} ({found.variant.about})."


# Moments of inertia


def turning(flight: Flight) -> tuple[Array, ...]:
    """Angular acceleration that the simulated moments would give; measured about the other axes."""
    aircraft = flight.aircraft
    assert aircraft.inertia is not None
    rates = (flight["p"], flight["q"], flight["r"])
    qS = flight["qbar"] * aircraft.S
    read = inertial_moment(
        rates, tuple(flight[f"{c}_dot"] for c in "pqr"), aircraft.inertia.tensor, aircraft.engine.angular_momentum
    )
    thrust_moments = thrust_moment(flight["thrust"], aircraft.thrust.offset, aircraft.thrust.inclination)
    moment = [
        flight.predicted(r) * qS * length + T if r in flight.simulated else M
        for r, length, T, M in zip(MOMENT_COEFFICIENTS, (aircraft.b, aircraft.cbar, aircraft.b), thrust_moments, read)
    ]
    return angular_acceleration(rates, moment, aircraft.inertia.tensor, aircraft.engine.angular_momentum)


def _stiffer_to_turn(flight: Flight, more: list[np.ndarray]) -> Parts:
    """Moments that more inertia needs for the same motion, which the stated inertia leaves out."""
    rates = (flight["p"], flight["q"], flight["r"])
    qS, aircraft = flight["qbar"] * flight.aircraft.S, flight.aircraft
    faster = turning(flight)
    made = []
    for j, change in enumerate(more):
        moment = inertial_moment(rates, faster, change)
        made += [
            (r, j, -m / (qS * length))
            for r, m, length in zip(MOMENT_COEFFICIENTS, moment, (aircraft.b, aircraft.cbar, aircraft.b))
        ]
    return made


def _inertia_variants(flights: Flights) -> list[Variant]:
    inertia = flights[0].aircraft.inertia
    assert inertia is not None
    sizes = {"Ix": (0, 0, inertia.Ix), "Iy": (1, 1, inertia.Iy), "Iz": (2, 2, inertia.Iz)}
    units = {}
    for name, (i, j, size) in sizes.items():
        units[name] = np.zeros((3, 3))
        units[name][i, j] = size
    units["Ixz"] = np.zeros((3, 3))
    units["Ixz"][0, 2] = units["Ixz"][2, 0] = -inertia.Iz
    made = []
    parameters = {n: EffectParameter(n, "-", 0.12, -0.6, 1.5, of_outcome=True) for n in sizes}
    parameters["Ixz"] = EffectParameter("Ixz", "of Iz", 0.03, -0.6, 1.5)
    groups = [("Ix",), ("Iy",), ("Iz",), ("Ixz",), ("Ix", "Iz", "Ixz"), ("Ix", "Iy", "Iz")]
    for group in groups:
        parts = [units[n] for n in group]
        made.append(
            of_parts(tuple(parameters[n] for n in group), partial(_stiffer_to_turn, more=parts), "in all manoeuvres")
        )
    return made


def _inertia_needs(flights: Flights) -> str:
    if flights[0].aircraft.inertia is None:
        return "moments of inertia"
    return lacking(flights, MOMENT_COEFFICIENTS)


def _inertia_says(found: FittedEffect) -> str:
    off = [
        f"{p.name} by {found.text(p.name, 100.0, '% of Iz' if p.name == 'Ixz' else '%')}"
        for p in found.variant.parameters
    ]
    return f"Moments of inertia are larger than stated: {', '.join(off)}."


# Fuel or loads that swing


def _swung(flight: Flight, axis: int, frequency: float, damping: float) -> tuple[Array, Array]:
    """Force on the aircraft along an axis [N], and that of a spring which held all of its mass."""
    force = flight.forces[axis] * flight["qbar"] * flight.aircraft.S
    return force, flight["mass"] * oscillate(force / flight["mass"], flight.dt, frequency, damping)


def _swinging(flight: Flight, axis: int, rides: bool, frequency: float, damping: float) -> Parts:
    force, spring = _swung(flight, axis, frequency, damping)
    # A mass on a pendulum does not go with the aircraft: its part of the force is delayed and oscillates.
    swinging = (force - spring if rides else spring) / (flight["qbar"] * flight.aircraft.S)
    if axis == 1:
        return [("CY", 0, swinging), ("Cl", 1, swinging / flight.aircraft.b), ("Cn", 2, swinging / flight.aircraft.b)]
    return [(FORCE_COEFFICIENTS[axis], 0, swinging), ("Cm", 1, swinging / flight.aircraft.cbar)]


def _slosh_variants(flights: Flights) -> list[Variant]:
    made = []
    for axis, name in ((1, "sideways"), (0, "fore and aft")):
        seen = peaks(flights, (FORCE_COEFFICIENTS[axis],), 3, *_SLOSH)
        rest = [x for x in spaced(*_SLOSH, _SLOSH_FREQUENCIES) if all(abs(np.log(x / y)) > 0.1 for y in seen)]
        for rides in (True, False):
            form = partial(_slosh, flights, name, axis, rides)
            made += [of_shape(form, f, damping) for f in [*seen, *rest] for damping in _SLOSH_DAMPINGS]
    return made


def _slosh(flights: Flights, direction: str, axis: int, rides: bool, frequency: float, damping: float) -> Variant:
    aircraft, of_swing = flights[0].aircraft, 1.0
    if not rides:
        # What is proportional to the force is that of any mass, and its error one of the derivatives.
        force, spring = (centred(x) for x in zip(*(_swung(f, axis, frequency, damping) for f in flights)))
        power = float(force @ force) * float(spring @ spring)
        alike = float(force @ spring) ** 2 / power if power > 0.0 else 0.0
        of_swing = float(np.sqrt(max(_LEAST_SWING, 1.0 - alike)))
    arms = {"roll arm": 0.03 * aircraft.b, "yaw arm": 0.03 * aircraft.b}
    if axis == 0:
        arms = {"pitch arm": 0.05 * aircraft.cbar}
    parameters = (
        EffectParameter("fraction of the mass", "-", 0.05 * of_swing, -0.3, 0.3),
        *(EffectParameter(arm, "m", sd * of_swing) for arm, sd in arms.items()),
    )
    parts = partial(_swinging, axis=axis, rides=rides, frequency=frequency, damping=damping)
    shape = {"frequency": frequency, "damping": damping}
    without = "" if rides else ", without which it is simulated"
    form = of_parts(parameters, parts, direction + without, (), shape, {"frequency": "Hz", "damping": "-"})
    return replace(form, words={"direction": direction, "simulated": without})


def _slosh_says(found: FittedEffect) -> str:
    words, mass = found.variant.words, found.text("fraction of the mass", 100.0, "%")
    return f"A mass swings {words['direction']} at {found.text('frequency')}, {mass} of all{words['simulated']}."


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "mass-error", "inertial", "The mass is not as stated, or changes as fuel burns.",
        lambda fs: "" if len(held(fs, FORCE_COEFFICIENTS)) > 1 else "two simulated force coefficients", _mass_variants,
        _mass_says,
        look_alikes=("position-error", "wrong-derivative", "sensor-scale", "thrust-scale"),
        separated_by="throttle steps and moments: both know the dynamic pressure, neither the weight",
        check="weighing, and the fuel state of each manoeuvre",
    ),
    Effect(
        "cg-shift", "inertial", "The centre of gravity is not where stated, or moves.",
        lambda fs: lacking(fs, MOMENT_COEFFICIENTS) or lacking(fs, FORCE_COEFFICIENTS), _shift_variants, _shift_says,
        look_alikes=("wrong-derivative", "thrust-line"), switched=_shifts_in_flight,
        may_end=False, durations=_DURATIONS,
        separated_by="force changes that angle of attack does not cause: flap, throttle, sideslip, stall",
        check="loading sheet and fuel distribution; weighing on three points",
    ),
    Effect(
        "inertia-error", "inertial", "A moment or product of inertia is not as stated.",
        _inertia_needs, _inertia_variants, _inertia_says,
        look_alikes=("wrong-derivative", "sensor-delay", "engine-gyroscopic"),
        separated_by="a known moment, as of a throttle step, or fast rolling with pitch and yaw rates",
        check="loading of the wings and a swing test",
    ),
    Effect(
        "slosh", "inertial", "Fuel or a slung load swings, lightly damped.",
        lambda fs: "" if {"CY", "CX"} & set(coefficients(fs)) else "a simulated CY or CX", _slosh_variants,
        _slosh_says,
        look_alikes=("structural-mode", "wrong-derivative"),
        separated_by="the same manoeuvre with full and with half-full tanks",
        check="baffles, and the fill of the tanks",
    ),
)  # fmt: skip
