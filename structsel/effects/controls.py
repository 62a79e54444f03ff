"""Controls that lose their power: with their own deflection, or as the structure gives way under dynamic pressure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant, of_shape
from structsel.effects.inputs import DrivenChannel, channels_with_input
from structsel.effects.signals import (
    CHANNELS_OF,
    CONTROLS,
    UNITS,
    Column,
    coefficients,
    each_slope,
    gathered,
    held,
    lacking,
    lift_line,
    mean_slope,
    moves,
    reach,
    scaled_coefficients,
    scaled_slopes,
    without_linear_part,
)
from structsel.nomenclature import LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array

_LAWS: dict[str, Callable[[Array], Array]] = {
    "d|d|": lambda d: d * np.abs(d),
    "d^3": lambda d: d**3,
    "d^2": lambda d: d**2,
}
_THRESHOLDS = (0.3, 0.45, 0.6, 0.75)  # of the largest deflection
_STOPS = 0.9  # fraction lost beyond a deflection, above which the surface stops there
_DEAD = (0.03, 0.06, 0.1, 0.15, 0.2, 0.3)  # of the same, within which an input does nothing
_LAW_TERMS = {"d|d|": "{0}*abs({0})", "d^3": "{0}^3", "d^2": "{0}^2"}
_CURVATURES = (0.0, 0.4)  # of the loss of power with dynamic pressure: k q / (1 + c q)
_LOSERS = ("", "lift slope", "stability", *CONTROLS)  # all slopes, or those by a name
_PRESSURES = 0.2  # least range of dynamic pressure over its mean


def _used(flights: Flights) -> list[str]:
    """Controls that move and that the simulation answers to."""
    return [
        c
        for c, responses in CONTROLS.items()
        if moves(flights, c) and any(mean_slope(flights, r, c) != 0.0 for r in held(flights, responses))
    ]


# --- effectiveness that depends on the deflection --------------------------------------------------------------------


def _bends(flights: Flights) -> list[Variant]:
    made = []
    for control in _used(flights):
        largest = max(abs(x) for x in reach(flights, control))
        main = held(flights, CONTROLS[control])[:1]
        for name, law in _LAWS.items():
            column = _power(control, law, largest)
            term = _LAW_TERMS[name].format(control)
            fitted = without_linear_part(flights, column, CHANNELS_OF[main[0]])
            forms = (
                _bent(flights, control, column, name, term),
                _bent(flights, control, column, name, term, main),
                _bent(flights, control, fitted, f"{name}, linear terms fitted without it", term),
            )
            made += [_by_law(one, name) for one in forms]
        for fraction in _THRESHOLDS:
            made += [of_shape(partial(_bent_beyond, flights, control, of), fraction * largest) for of in ((), main)]
    return made + [v for one in channels_with_input(flights) for v in _bent_inputs(flights, one)]


def _bent_beyond(flights: Flights, control: str, only: tuple[str, ...], start: float) -> Variant:
    term, lost = f"sign({control})*(abs({control}) - {start!r})+", _beyond(control, start)
    return _bent(flights, control, lost, "beyond a deflection", term, only, {"beyond": start}, _STOPS)


def _bent_inputs(flights: Flights, one: DrivenChannel) -> list[Variant]:
    """The input of a simulated channel, bent by the same laws; what is no surface counts from its mean."""
    recorded = np.concatenate([f.raw[one.control] for f in flights])
    middle = 0.0 if one.control in CONTROLS else float(recorded.mean())
    largest = float(np.abs(recorded - middle).max())
    made = []
    for name, law in _LAWS.items():
        lost = partial(_fraction_lost, law=law, largest=largest)
        made.append(_by_law(_bent_input(one, lost, middle, name), name))

    def beyond(start: float) -> Variant:
        return _bent_input(one, partial(_excess, start=start), middle, "beyond a deflection", {"beyond": start})

    def within(end: float) -> Variant:
        return _bent_input(one, partial(np.clip, a_min=-end, a_max=end), middle, "dead zone", {"within": end})

    made += [of_shape(beyond, fraction * largest) for fraction in _THRESHOLDS]
    return made + [of_shape(within, fraction * largest) for fraction in _DEAD]


def _by_law(form: Variant, law: str) -> Variant:
    """The form, which states that the sides of a control differ if its law is even."""
    return replace(form, words={**form.words, "sides": law}) if law == "d^2" else form


def _fraction_lost(d: Array, law: Callable[[Array], Array], largest: float) -> Array:
    return largest * law(d / largest)


def _excess(d: Array, start: float) -> Array:
    return np.sign(d) * np.maximum(np.abs(d) - start, 0.0)


def _bent_input(
    one: DrivenChannel,
    lost: Callable[[Array], Array],
    middle: float,
    about: str,
    shape: Mapping[str, float] | None = None,
) -> Variant:
    def columns(flight: Flight) -> Columns:
        if one.response not in flight.measured:
            return {}
        return {one.response: -one.to(flight, lost(flight.raw[one.control] - middle))[:, None]}

    given = shape or {}
    unit = UNITS.get(one.control, "")
    words = {"control": one.control, "law": f"{about} in {one.response}", "where": f" in {one.response}", "unit": unit}
    parameter = EffectParameter(f"{one.control} loss", "-", 0.25, -1.2, 1.2)
    about = f"{one.control}: {words['law']}"
    return Variant((parameter,), columns, given, dict.fromkeys(given, unit), about, words=words)


def _power(control: str, law: Callable[[Array], Array], largest: float) -> Column:
    """Loss of deflection [rad], such that one is the whole of the largest."""
    return lambda flight: _fraction_lost(flight[control], law, largest)


def _beyond(control: str, start: float) -> Column:
    return lambda flight: _excess(flight[control], start)


def _bent(
    flights: Flights,
    control: str,
    lost: Column,
    about: str,
    term: str,
    only: tuple[str, ...] = (),
    shape: Mapping[str, float] | None = None,
    most: float = 1.2,
) -> Variant:
    """Deflection lost, and with it the control's part of its coefficients by one ratio."""
    slopes = {r: mean_slope(flights, r, control) for r in only or held(flights, CONTROLS[control])}
    where = f" in {only[0]} only" if only else ""

    def columns(flight: Flight) -> Columns:
        x = lost(flight)
        return {r: (-s * x)[:, None] for r, s in slopes.items() if s != 0.0 and r in flight.measured}

    parameter = EffectParameter(f"{control} loss", "-", 0.25, -1.2, most)
    given = shape or {}
    words = {"control": control, "law": f"{about}{where}", "where": where}
    units = dict.fromkeys(given, "rad")
    return Variant((parameter,), columns, given, units, f"{control}: {about}{where}", (term,), words=words)


def _needs_bend(flights: Flights) -> str:
    if channels_with_input(flights):
        return ""
    gone = lacking(flights)
    if gone:
        return f"{gone}, or a simulated channel that an input drives"
    return "" if _used(flights) else "a control (de, da, dr) that moves"


def _says_bend(found: FittedEffect) -> str:
    variant = found.variant
    name = variant.parameters[0].name
    control, law = variant.words["control"], variant.words["law"]
    percent = found.text(name, 100.0, "%")
    if "beyond" in variant.shape:
        angle = variant.words.get("unit", "rad") == "rad"
        start = f"{np.rad2deg(variant.shape['beyond']):.1f} deg" if angle else found.text("beyond")
        return f"Beyond {start} the slope of {control} falls by {percent}{variant.words['where']}."
    if "within" in variant.shape:
        return f"Within {found.text('within')} of its middle {control} has lost {percent} of its effect."
    if "sides" in variant.words:
        return f"The effect of {control} differs between its two sides by {percent} at the largest deflection ({law})."
    return f"At its largest deflection {control} has lost {percent} of its effect ({law})."


# --- structure that gives way ----------------------------------------------------------------------------------------


def _mean_pressure(flights: Flights) -> float:
    return float(gathered(flights, "qbar").mean())


def _falls(flights: Flights) -> list[tuple[Column, str, str]]:
    """What slopes lose with dynamic pressure, one being all of them at its mean, in words and as a model's term.

    From none, and about the mean.
    """
    mean = _mean_pressure(flights)
    made = [
        (
            _fall(mean, c),
            f"rigid at rest{f', levelling off ({c:g})' if c else ''}",
            f"(qbar/(1 + {c / mean!r}*qbar))" if c else "qbar",
        )
        for c in _CURVATURES
    ]
    return [*made, (_fall_about(mean), "right at the mean dynamic pressure", "qbar")]


def _fall(mean: float, curvature: float) -> Column:
    def column(flight: Flight) -> Array:
        q = flight["qbar"] / mean
        return -(1.0 + curvature) * q / (1.0 + curvature * q)

    return column


def _fall_about(mean: float) -> Column:
    def column(flight: Flight) -> Array:
        return 1.0 - flight["qbar"] / mean

    return column


def _linkage_variants(flights: Flights) -> list[Variant]:
    made = []
    for control in _used(flights):
        moved = held(flights, CONTROLS[control])
        parameter = EffectParameter(_loss_of(control), "-", 0.15, 0.0, 1.0)
        for fall, about, law in _falls(flights):
            made.append(scaled_slopes(flights, moved, (control,), fall, parameter, about, law=law))
            only = f"{about}, in {moved[0]} only"
            made.append(scaled_slopes(flights, moved[:1], (control,), fall, parameter, only, law=law))
    return [v for v in made if v is not None]


def _flexes(flights: Flights) -> list[Variant]:
    every = coefficients(flights)
    parameter = EffectParameter(_loss_of(""), "-", 0.15, 0.0, 1.0)
    zero = lift_line(flights)[1]
    made = []
    for fall, about, law in _falls(flights):
        made += [
            scaled_slopes(flights, responses, channels, fall, parameter, f"{which}; {about}", at, law)
            for responses, channels, which, at in (
                (every, None, "all slopes", 0.0),
                (every, None, "all slopes, angle of attack from that of no lift", zero),
                (held(flights, LONGITUDINAL_COEFFICIENTS), ("alpha",), "the slopes with alpha", 0.0),
                (held(flights, LATERAL_COEFFICIENTS), None, "the lateral slopes", 0.0),
            )
        ]
        made.append(scaled_coefficients(flights, every, fall, parameter, f"all coefficients but CX; {about}"))
        # The wing gives way otherwise than the tail, and may bring its lift forward as well as back.
        made += [
            each_slope(flights, fall, _own_loss, f"each slope by its own{which}; {about}", at, law)
            for which, at in (("", 0.0), (", angle of attack from that of no lift", zero))
        ]
    return [v for v in made if v is not None]


def _own_loss(what: str) -> EffectParameter:
    return EffectParameter(_loss_of(what), "-", 0.15, -1.0 if what == "stability" else 0.0, 1.0)


def _loss_of(what: str) -> str:
    return f"{what} loss at mean qbar".strip()


def _needs_pressure(flights: Flights) -> str:
    gone = lacking(flights)
    if gone:
        return gone
    low, high = reach(flights, "qbar")
    if high - low < _PRESSURES * _mean_pressure(flights):
        return f"dynamic pressure that changes by {100 * _PRESSURES:.0f} % or more"
    return ""


def _needs_linkage(flights: Flights) -> str:
    return _needs_pressure(flights) or ("" if _used(flights) else "a control (de, da, dr) that moves")


def _says_loss(found: FittedEffect) -> str:
    losses = {what: found.text(_loss_of(what), 100.0, "%") for what in _LOSERS if _loss_of(what) in found.estimates}
    fractions = [f"{what} {text}".strip() for what, text in losses.items()]
    first = next(iter(losses))
    who = f"Effectiveness of {first} falls" if first in CONTROLS else "Slopes fall"
    return f"{who} with dynamic pressure: lost at its mean {', '.join(fractions)} ({found.variant.about})."


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "control-nonlinearity",
        "static",
        "The effectiveness of a control falls or grows with its own deflection.",
        _needs_bend,
        _bends,
        _says_bend,
        look_alikes=("actuator-saturation", "wrong-derivative", "slipstream", "missing-term"),
        separated_by="The same input at three amplitudes, up to full deflection, with the surface itself measured.",
        check="Control derivative against deflection in the wind-tunnel data; gaps and separation at the hinge.",
    ),
    Effect(
        "control-stretch",
        "structural",
        "The linkage of a control gives way, so that its effectiveness falls with dynamic pressure.",
        _needs_linkage,
        _linkage_variants,
        _says_loss,
        look_alikes=("compressibility", "flexibility", "wrong-derivative", "control-nonlinearity"),
        separated_by="The same control input over a sweep of speed, and at one Mach number at two heights.",
        check="Where the deflection is measured: at the surface or at the stick; stiffness of cables and rods.",
    ),
    Effect(
        "flexibility",
        "structural",
        "The structure bends under load: all slopes fall with dynamic pressure.",
        _needs_pressure,
        _flexes,
        _says_loss,
        look_alikes=("compressibility", "control-stretch", "wrong-derivative"),
        separated_by="The same manoeuvres at one Mach number at two heights.",
        check="Flexible-to-rigid ratios of the derivatives against dynamic pressure.",
    ),
)
