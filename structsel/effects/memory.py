"""Unsteady air: wakes at the tail, lift that builds up with time, inflow through a rotor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.comparison.plant import answers
from structsel.effects.base import (
    Columns,
    Effect,
    EffectParameter,
    FittedEffect,
    Flights,
    ModelCase,
    ModelForm,
    Variant,
    of_shape,
)
from structsel.effects.model_forms import one_hot
from structsel.effects.operators import spaced
from structsel.effects.plants import delayed_answers
from structsel.effects.signals import (
    available,
    coefficients,
    lacking,
    moves,
    signature,
)
from structsel.model import Quantity, State
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.dynamic_elements import (
    delayed,
    first_order_lag,
    varying_lag,
)

# Indicial lift 1 - sum A exp(-b s), s in half chords: Wagner (Jones), and Jones's for finite wings.
_INDICIAL = {
    "a wide wing": ((0.165, 0.0455), (0.335, 0.300)),
    "aspect ratio 6": ((0.361, 0.381),),
    "aspect ratio 3": ((0.283, 0.540),),
}
_LIFT_CHORDS = (2.0, 4.0, 8.0, 16.0, 32.0)
_TAIL_CHORDS = (2.5, 4.0, 6.0)
_ROTOR_CHANNELS = ("collective", "dcol", "d0", "theta0", "dlon", "dlat", "rotor_rpm", "nr")


# Wakes at the tail


def _wake(angle: str, length: str, moved: tuple[str, ...], chords: float | None) -> Callable[[Flight], Columns]:
    def columns(flight: Flight) -> Columns:
        x = flight[angle]
        if chords is None:
            hat = flight[f"{angle}_dot_hat"]
        else:
            # The wake of the wing reaches the tail after it has travelled there; per hat like the derivative.
            time = chords * flight.aircraft.cbar / float(flight["V"].mean())
            hat = (x - delayed(x, flight.dt, time)) / time * getattr(flight.aircraft, length) / (2.0 * flight["V"])
        return signature(flight, len(moved), [(r, j, hat) for j, r in enumerate(moved)])

    return columns


def _downwash_variants(flights: Flights) -> list[Variant]:
    parameters = (
        # The tail carries more while the angle grows: up, and nose down. Lift that itself comes late is the other way.
        EffectParameter("Cm per alpha_dot_hat", "-", 6.0, -40.0, 1.0),
        EffectParameter("CZ per alpha_dot_hat", "-", 2.0, -20.0, 0.5),
    )
    return _wakes(parameters, "alpha", "cbar", ("Cm", "CZ"))


def _sidewash_variants(flights: Flights) -> list[Variant]:
    parameters = (
        EffectParameter("Cn per beta_dot_hat", "-", 0.05, -0.5, 0.5),
        EffectParameter("CY per beta_dot_hat", "-", 0.1, -1.0, 1.0),
    )
    # A fin stands above the axis.
    rolling = EffectParameter("Cl per beta_dot_hat", "-", 0.03, -0.3, 0.3)
    fin = ("Cn", "CY", "Cl")
    return [
        *_wakes(parameters, "beta", "b", fin[:2]),
        Variant((*parameters, rolling), _wake("beta", "b", fin, None), about="by its rate", terms=("beta_dot_hat",)),
    ]


def _wakes(parameters: tuple[EffectParameter, ...], angle: str, length: str, moved: tuple[str, ...]) -> list[Variant]:
    term = (f"{angle}_dot_hat",)
    made = [Variant(parameters, _wake(angle, length, moved, None), about="by its rate", terms=term)]

    def delayed_wake(chords: float) -> Variant:
        columns = _wake(angle, length, moved, chords)
        model = partial(_wake_model, angle=angle, length=length, moved=moved)
        return Variant(
            parameters, columns, {"distance": chords}, {"distance": "chords"}, "as a delay", term, model=model
        )

    return made + [of_shape(delayed_wake, chords) for chords in _TAIL_CHORDS]


def _wake_model(case: ModelCase, angle: str, length: str, moved: tuple[str, ...]) -> ModelForm:
    """A wake that reaches the tail after it has travelled there."""
    chords = case.quantity("distance")
    distance = case.quantity("distance", case.aircraft.cbar, "m")
    # The rate is the change over the time that the wake travels; by the hat it is made dimensionless with.
    size = getattr(case.aircraft, length) / (2.0 * chords.value * case.aircraft.cbar)
    term = Term(f"({angle} - {angle}_late)")
    terms = {c: {term: size * one_hot(j, len(moved))} for j, c in enumerate(moved)}
    return ModelForm(states={f"{angle}_late": State("delay", angle, {"distance": distance})}, terms=terms)


def _wake_says(found: FittedEffect, wake: str) -> str:
    moment, force = (p.name for p in found.variant.parameters[:2])
    return f"The tail feels the {wake} late: {found.text(moment)} in {moment}, {found.text(force)} in {force}."


# Lift that builds up


def _building(flight: Flight, parts: tuple[tuple[float, float], ...]) -> Columns:
    rate = flight["alpha_dot"]
    speed = 2.0 * flight["V"] / flight.aircraft.cbar  # half chords per second
    missing = -sum(A * varying_lag(rate, flight.dt, b * speed) for A, b in parts)
    return signature(flight, 3, [(r, k, flight.slope(r, "alpha") * missing) for k, r in enumerate(("CZ", "CX", "Cm"))])


def _lift_variants(flights: Flights) -> list[Variant]:
    # Suction at the leading edge and the tail's moment build up otherwise than the lift, or not at all.
    parameters = (
        EffectParameter("fraction", "-", 0.7, 0.2, 2.0),
        *(EffectParameter(f"fraction of the {what}", "-", 0.7, -1.0, 2.0) for what in ("axial force", "moment")),
    )
    made = [
        Variant(
            parameters,
            partial(_building, parts=parts),
            about=f"indicial lift of {name}",
            model=partial(_building_model, parts=parts),
        )
        for name, parts in _INDICIAL.items()
    ]
    return made + [of_shape(partial(_one_lag, parameters), chords) for chords in _LIFT_CHORDS]


def _one_lag(parameters: tuple[EffectParameter, ...], chords: float) -> Variant:
    # A = 1 makes it a lag of all the lift; the fraction says of how much.
    columns = partial(_building, parts=((1.0, 0.5 / chords),))
    return Variant(parameters, columns, {"lag": chords}, {"lag": "chords"}, "one lag", model=_building_model)


def _building_model(case: ModelCase, parts: tuple[tuple[float, float], ...] = ()) -> ModelForm:
    """Part of the angle of attack acts late: indicial parts as given, else one lag as estimated."""
    cbar = case.aircraft.cbar
    lags = [(A, Quantity(cbar / (2.0 * b), unit="m")) for A, b in parts] or [(1.0, case.quantity("lag", cbar, "m"))]
    states: dict[str, State] = {}
    replaced: dict[str, dict[str, str]] = {}
    for name, what, responses in (
        ("fraction", "lift", ("CZ", "CL")), ("fraction of the axial force", "axial", ("CX", "CD")),
        ("fraction of the moment", "moment", ("Cm",)),
    ):  # fmt: skip
        fraction, mine = case.quantity(name), []
        for k, (A, distance) in enumerate(lags, 1):
            mine.append(f"alpha_{what}{k if len(lags) > 1 else ''}")
            states[mine[-1]] = State(
                "lag",
                "alpha",
                {"distance": distance, "fraction": Quantity(fraction.value * A, fraction.std * A, fraction.unit)},
            )
        formula = " + ".join(mine) + f" - {len(mine) - 1}*alpha" * (len(mine) > 1)
        replaced |= {c: {"alpha": formula} for c in responses if c in case.base}
    return ModelForm(states=states, replaced=replaced)


def _lift_says(found: FittedEffect) -> str:
    how = f"over {found.text('lag')} of travel" if "lag" in found.estimates else f"like the {found.variant.about}"
    fraction = found.text("fraction")
    return f"Lift follows the angle of attack with a delay, {how}: a fraction of {fraction} builds up with time."


# Rotor inflow


def _is_rotor(flights: Flights) -> bool:
    return any(c in f.recorded for f in flights for c in _ROTOR_CHANNELS)


def _rotor_controls(flights: Flights) -> list[str]:
    return [c for c in ("de", "da", "dr", *_ROTOR_CHANNELS[:6]) if available(flights, c) and moves(flights, c)]


def _inflow(flight: Flight, tau: float, controls: list[str]) -> Columns:
    parts = []
    for r in flight.measured:
        if r in COEFFICIENTS:
            behind = {c: (first_order_lag(flight[c], flight.dt, tau) - flight[c]) / tau for c in controls}
            parts += [(r, 0, flight.slope(r, c) * x) for c, x in behind.items()]
    return signature(flight, 1, parts)


def _rotor_variants(flights: Flights) -> list[Variant]:
    controls, about = _rotor_controls(flights), "all controls"
    if answers(flights):
        return delayed_answers(flights, about, ("lag",))
    return [
        Variant(
            (EffectParameter("lag", "s", tau, 0.5 * tau, 1.5 * tau),),
            partial(_inflow, tau=tau, controls=controls),
            about=about,
        )
        for tau in spaced(0.04, 0.5, 8)
    ]


def _rotor_needs(flights: Flights) -> str:
    if not _is_rotor(flights):
        return "a rotor: one of the channels collective, dcol, dlon, dlat, rotor_rpm"
    responses = coefficients(flights) or [r for f in flights for r in f.simulated]
    return "" if responses else "a simulated response"


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "downwash-lag", "memory", "The wing's downwash reaches the tail late.",
        lambda fs: lacking(fs, ("Cm", "CZ"), ("alpha",)), _downwash_variants, partial(_wake_says, wake="downwash"),
        look_alikes=("wrong-derivative", "sensor-delay", "unsteady-lift"),
        separated_by="manoeuvres in which the angles of attack and pitch change at different rates: turns, plunges",
        check="whether the simulation has derivatives by the rate of the angle of attack",
    ),
    Effect(
        "sidewash-lag", "memory", "The sidewash reaches the fin late.",
        lambda fs: lacking(fs, ("Cn", "CY"), ("beta",)), _sidewash_variants, partial(_wake_says, wake="sidewash"),
        look_alikes=("wrong-derivative", "sensor-delay"),
        separated_by="flat yawing, and rolling into steady turns: the sideslip rate must differ from the yaw rate",
        check="whether the simulation has derivatives by the rate of sideslip",
    ),
    Effect(
        "unsteady-lift", "memory", "Lift needs some chords of travel to build up, at any angle of attack.",
        lambda fs: lacking(fs, ("CZ",), ("alpha",)), _lift_variants, _lift_says,
        look_alikes=("downwash-lag", "sensor-delay", "actuator-lag"),
        separated_by="fast inputs at low speed, with a second source of the angle of attack",
        check="the reduced frequency of the manoeuvres, and whether the vane's delay is known",
    ),
    Effect(
        "rotor-inflow-lag", "memory", "A rotor's flapping and inflow follow the controls late.",
        _rotor_needs, _rotor_variants, lambda found: f"The rotor follows all controls late, by {found.text('lag')}.",
        look_alikes=("actuator-lag", "sensor-delay"),
        separated_by="the actuators' own positions, recorded",
        check="the lag the actuators alone explain",
    ),
)  # fmt: skip
