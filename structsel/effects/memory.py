"""Air that remembers: separation, wakes at the tail, lift that builds up, inflow through a rotor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.effects.base import (
    Columns,
    Effect,
    EffectParameter,
    FittedEffect,
    Flights,
    ModelCase,
    ModelForm,
    Variant,
    Weights,
)
from structsel.effects.latched_stall import LATCH, latched_variants
from structsel.effects.model_forms import add_term, one_hot
from structsel.effects.operators import spaced
from structsel.effects.signals import (
    available,
    coefficients,
    from_lift_and_drag,
    gathered,
    lacking,
    lift,
    moves,
    reach,
    signature,
)
from structsel.model import Quantity, State
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import (
    delayed,
    first_order_lag,
    lift_factor,
    separation_point,
    steady_formula,
    steady_separation_point,
    varying_lag,
)

_HIGH = 0.14  # rad, angle of attack below which wings do not stall
_CHORDS = ((5.0, 4.0), (15.0, 4.0), (15.0, 12.0), (40.0, 10.0))  # tau1, tau2 in chords travelled
# Indicial lift 1 - sum A exp(-b s), s in half chords: Wagner (Jones), and Jones's for finite wings.
_INDICIAL = {
    "a wide wing": ((0.165, 0.0455), (0.335, 0.300)),
    "aspect ratio 6": ((0.361, 0.381),),
    "aspect ratio 3": ((0.283, 0.540),),
}
_LIFT_CHORDS = (2.0, 4.0, 8.0, 16.0, 32.0)
_WHATEVER_THE_LIFT = "beyond attached flow, whatever the lift"
_SHARP = 25.0  # 1/rad, of separation that acts on each coefficient by itself
_TAIL_CHORDS = (2.5, 4.0, 6.0)
_ROTOR_CHANNELS = ("collective", "dcol", "d0", "theta0", "dlon", "dlat", "rotor_rpm", "nr")


# Stall with memory


def _attached(flight: Flight, where: float, sharp: float, tau1: float, tau2: float) -> Array:
    """How much of the flow is attached, with time constants in chords travelled."""
    chord = flight.aircraft.cbar / float(flight["V"].mean())
    return separation_point(flight["alpha"], flight["alpha_dot"], flight.dt, tau1 * chord, tau2 * chord, sharp, where)


def _stalling(flight: Flight, where: float, sharp: float, tau1: float, tau2: float, beyond_steady: bool) -> Columns:
    alpha, X = flight["alpha"], _attached(flight, where, sharp, tau1, tau2)
    kept = lift_factor(X)
    lost, drag = kept - 1.0, 1.0 - X
    if beyond_steady:
        steady = steady_separation_point(alpha, sharp, where)
        lost, drag = kept / lift_factor(steady) - 1.0, steady - X
    parts = from_lift_and_drag(flight, 0, CL=lost * lift(flight)) + from_lift_and_drag(flight, 1, CD=drag)
    return signature(flight, 3, [*parts, ("Cm", 2, -drag)])


def _separated(flight: Flight, where: float, tau1: float, tau2: float) -> Columns:
    """Each coefficient by what is separated, whatever the lift."""
    X = _attached(flight, where, _SHARP, tau1, tau2)
    return signature(flight, 3, [("CZ", 0, 1.0 - X), ("CX", 1, X - 1.0), ("Cm", 2, X - 1.0)])


def _stall_variants(flights: Flights) -> list[Variant]:
    alpha = gathered(flights, "alpha")
    top = float(np.quantile(alpha, 0.998))
    lowest = max(float(np.quantile(alpha, 0.6)), 0.5 * top, 0.8 * _HIGH)
    onsets = np.linspace(lowest, 0.98 * top, 4)
    parameters = (
        EffectParameter("lift lost", "-", 0.7, 0.0, 1.5),
        EffectParameter("drag", "-", 0.2, 0.0, 1.5),
        EffectParameter("nose-down moment", "-", 0.1, -0.1, 0.8),
    )
    units = {"onset": "rad", "sharpness": "1/rad", "tau1": "s", "tau2": "s"}
    chord = flights[0].aircraft.cbar / float(gathered(flights, "V").mean())
    lost = EffectParameter("normal force lost", "-", 0.3, 0.0, 3.0)
    made = []
    for onset in onsets:
        for tau1, tau2 in _CHORDS[:3]:
            shape = {"onset": float(onset), "sharpness": _SHARP, "tau1": tau1 * chord, "tau2": tau2 * chord}
            columns = partial(_separated, where=float(onset), tau1=tau1, tau2=tau2)
            made.append(
                Variant((lost, *parameters[1:]), columns, shape, units, _WHATEVER_THE_LIFT, model=_separated_model)
            )
        for sharp, beyond_steady in ((18.0, False), (40.0, False), (25.0, True)):
            for tau1, tau2 in _CHORDS:
                shape = {"onset": float(onset), "sharpness": sharp, "tau1": tau1 * chord, "tau2": tau2 * chord}
                about = "beyond a steady stall" if beyond_steady else "beyond attached flow"
                made.append(
                    Variant(
                        parameters,
                        partial(
                            _stalling,
                            where=float(onset),
                            sharp=sharp,
                            tau1=tau1,
                            tau2=tau2,
                            beyond_steady=beyond_steady,
                        ),
                        shape,
                        units,
                        about,
                        model=partial(_stalling_model, beyond_steady=beyond_steady),
                    )
                )
    return made + latched_variants(flights, top)


def _separation_state(case: ModelCase) -> State:
    """State of the separation point, which follows the angle of attack."""
    names = {"alpha_star": "onset", "a1": "sharpness", "tau1": "tau1", "tau2": "tau2"}
    return State("separation", "alpha", {name: case.quantity(of) for name, of in names.items()})


def _separated_model(case: ModelCase) -> ModelForm:
    drag = Term("(1 - x_sep)")
    sides = enumerate((("CZ", 1.0), ("CX", -1.0), ("Cm", -1.0)))
    terms = {c: {drag: s * one_hot(j, 3)} for j, (c, s) in sides}
    return ModelForm(states={"x_sep": _separation_state(case)}, terms=terms)


def _stalling_model(case: ModelCase, beyond_steady: bool) -> ModelForm:
    """Lift lost, drag and moment by the point of separation."""
    state = _separation_state(case)
    lost, drag = Term("(0.25*(1 + sqrt(x_sep))^2 - 1)"), Term("(1 - x_sep)")
    if beyond_steady:
        steady = steady_formula("alpha", state["a1"], state["alpha_star"])
        lost = Term(f"((1 + sqrt(x_sep))^2/(1 + sqrt({steady}))^2 - 1)")
        drag = Term(f"({steady} - x_sep)")
    terms: Weights = {}
    for term, value in case.lift():
        add_term(terms, "CL", term * lost, value * one_hot(0, 3))
    add_term(terms, "CD", drag, one_hot(1, 3))
    add_term(terms, "Cm", drag, -one_hot(2, 3))
    return ModelForm(states={"x_sep": state}, terms=terms)


def _stall_needs(flights: Flights) -> str:
    if missing := lacking(flights, ("CZ", "Cm", "CX"), ("alpha",)):
        return missing
    return "" if reach(flights, "alpha")[1] > _HIGH else f"angle of attack above {np.degrees(_HIGH):.0f} deg"


def _stall_says(found: FittedEffect) -> str:
    if found.variant.about == LATCH:
        onset, release = (found.text(name, 180.0 / np.pi, "deg") for name in ("onset", "release"))
        return f"The flow separates at {onset} of angle of attack and attaches again at {release} only."
    return (
        f"The flow separates about {found.text('onset', 180.0 / np.pi, 'deg')} of angle of attack and follows late, "
        f"with time constants of {found.text('tau1')} and {found.text('tau2')}. Lift is less on the way "
        "back than on the way up."
    )


# Wakes at the tail


def _wake(angle: str, length: str, moved: tuple[str, ...], chords: float | None) -> Callable[[Flight], Columns]:
    def columns(flight: Flight) -> Columns:
        x = flight[angle]
        if chords is None:
            hat = flight[f"{angle}_dot_hat"]
        else:
            # The wake of the wing reaches the tail after it has travelled there; per hat like the derivative.
            way = chords * flight.aircraft.cbar / float(flight["V"].mean())
            hat = (x - delayed(x, flight.dt, way)) / way * getattr(flight.aircraft, length) / (2.0 * flight["V"])
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
    for chords in _TAIL_CHORDS:
        columns = _wake(angle, length, moved, chords)
        model = partial(_wake_model, angle=angle, length=length, moved=moved)
        shape, units = {"way": chords}, {"way": "chords"}
        made.append(Variant(parameters, columns, shape, units, "as a delay", term, model=model))
    return made


def _wake_model(case: ModelCase, angle: str, length: str, moved: tuple[str, ...]) -> ModelForm:
    """A wake that reaches the tail after it has travelled there."""
    chords = case.quantity("way")
    way = case.quantity("way", case.aircraft.cbar, "m")
    # The rate is the change over the time that the wake travels; by the hat it is made dimensionless with.
    size = getattr(case.aircraft, length) / (2.0 * chords.value * case.aircraft.cbar)
    term = Term(f"({angle} - {angle}_late)")
    terms = {c: {term: size * one_hot(j, len(moved))} for j, c in enumerate(moved)}
    return ModelForm(states={f"{angle}_late": State("delay", angle, {"distance": way})}, terms=terms)


def _wake_says(found: FittedEffect) -> str:
    moment, force = (p.name for p in found.variant.parameters[:2])
    side = "sidewash" if moment.startswith("Cn") else "downwash"
    return f"The tail feels the {side} late: {found.text(moment)} in {moment}, {found.text(force)} in {force}."


# Lift that builds up


def _building(flight: Flight, parts: tuple[tuple[float, float], ...]) -> Columns:
    rate = flight["alpha_dot"]
    speed = 2.0 * flight["V"] / flight.aircraft.cbar  # half chords per second
    missing = -sum(A * varying_lag(rate, flight.dt, b * speed) for A, b in parts)
    return signature(flight, 3, [(r, k, flight.slope(r, "alpha") * missing) for k, r in enumerate(("CZ", "CX", "Cm"))])


def _lift_variants(flights: Flights) -> list[Variant]:
    # Suction at the leading edge and the tail's moment build up otherwise than the lift, or not at all.
    parameters = (
        EffectParameter("share", "-", 0.7, 0.2, 2.0),
        *(EffectParameter(f"share of the {what}", "-", 0.7, -1.0, 2.0) for what in ("axial force", "moment")),
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
    for chords in _LIFT_CHORDS:
        # A = 1 makes it a lag of all the lift; the share says of how much.
        parts = ((1.0, 0.5 / chords),)
        columns, shape, units = partial(_building, parts=parts), {"lag": chords}, {"lag": "chords"}
        made.append(Variant(parameters, columns, shape, units, "one lag", model=_building_model))
    return made


def _building_model(case: ModelCase, parts: tuple[tuple[float, float], ...] = ()) -> ModelForm:
    """Part of the angle of attack acts late: indicial parts as given, else one lag as estimated."""
    cbar = case.aircraft.cbar
    late = [(A, Quantity(cbar / (2.0 * b), unit="m")) for A, b in parts] or [(1.0, case.quantity("lag", cbar, "m"))]
    states: dict[str, State] = {}
    replaced: dict[str, dict[str, str]] = {}
    for name, what, responses in (
        ("share", "lift", ("CZ", "CL")), ("share of the axial force", "axial", ("CX", "CD")),
        ("share of the moment", "moment", ("Cm",)),
    ):  # fmt: skip
        share, mine = case.quantity(name), []
        for k, (A, way) in enumerate(late, 1):
            mine.append(f"alpha_{what}{k if len(late) > 1 else ''}")
            states[mine[-1]] = State(
                "lag", "alpha", {"distance": way, "fraction": Quantity(share.value * A, share.std * A, share.unit)}
            )
        formula = " + ".join(mine) + f" - {len(mine) - 1}*alpha" * (len(mine) > 1)
        replaced |= {c: {"alpha": formula} for c in responses if c in case.base}
    return ModelForm(states=states, replaced=replaced)


def _lift_says(found: FittedEffect) -> str:
    how = f"over {found.text('lag')} of travel" if "lag" in found.estimates else f"like the {found.variant.about}"
    return f"Lift follows the angle of attack late, {how}: a share of {found.text('share')} builds up with time."


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
        elif r in flight.simulated:
            told = flight.told(r)
            parts.append((r, 0, (first_order_lag(told, flight.dt, tau) - told) / tau))
    return signature(flight, 1, parts)


def _rotor_variants(flights: Flights) -> list[Variant]:
    controls = _rotor_controls(flights)
    return [
        Variant(
            (EffectParameter("lag", "s", tau, 0.5 * tau, 1.5 * tau),),
            partial(_inflow, tau=tau, controls=controls),
            about="all controls",
        )
        for tau in spaced(0.04, 0.5, 8)
    ]


def _rotor_needs(flights: Flights) -> str:
    if not _is_rotor(flights):
        return "a rotor: one of the channels collective, dcol, dlon, dlat, rotor_rpm"
    told = coefficients(flights) or [r for f in flights for r in f.simulated]
    return "" if told else "a simulated response"


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "stall-hysteresis", "memory", "Separated flow that follows late, so that lift differs on the way up and down.",
        _stall_needs, _stall_variants, _stall_says,
        look_alikes=("static-stall", "missing-term", "downwash-lag"),
        separated_by="slow and fast approaches to the stall, with recovery: a static stall does not know the rate",
        check="lift against angle of attack in one slow and one fast stall",
    ),
    Effect(
        "downwash-lag", "memory", "The wing's downwash reaches the tail late.",
        lambda fs: lacking(fs, ("Cm", "CZ"), ("alpha",)), _downwash_variants, _wake_says,
        look_alikes=("wrong-derivative", "sensor-delay", "unsteady-lift"),
        separated_by="manoeuvres in which the angles of attack and pitch change at different rates: turns, plunges",
        check="whether the simulation has derivatives by the rate of the angle of attack",
    ),
    Effect(
        "sidewash-lag", "memory", "The sidewash reaches the fin late.",
        lambda fs: lacking(fs, ("Cn", "CY"), ("beta",)), _sidewash_variants, _wake_says,
        look_alikes=("wrong-derivative", "sensor-delay"),
        separated_by="flat yawing beside rolling into steady turns: the sideslip rate must differ from the yaw rate",
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
