"""Stall with memory: separation that follows the angle of attack with a delay."""

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
    of_shape,
)
from structsel.effects.latched_stall import latched_variants
from structsel.effects.model_forms import MakeModel, add_term, one_hot
from structsel.effects.signals import (
    from_lift_and_drag,
    gathered,
    lacking,
    lift,
    reach,
    signature,
)
from structsel.model import State
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import (
    lift_factor,
    separation_point,
    steady_formula,
    steady_separation_point,
)

_HIGH = 0.14  # rad, angle of attack below which wings do not stall
_CHORDS = ((5.0, 4.0), (15.0, 4.0), (15.0, 12.0), (40.0, 10.0))  # tau1, tau2 in chords travelled
_INDEPENDENT = "beyond attached flow, independent of the lift"
_UNITS = {"onset": "rad", "sharpness": "1/rad", "tau1": "s", "tau2": "s"}
_SHARP = 25.0  # 1/rad, of separation that acts on each coefficient alone


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


def _separated(flight: Flight, where: float, sharp: float, tau1: float, tau2: float) -> Columns:
    """Each coefficient by what is separated, independent of the lift."""
    X = _attached(flight, where, sharp, tau1, tau2)
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
    chord = flights[0].aircraft.cbar / float(gathered(flights, "V").mean())
    lost = EffectParameter("normal force lost", "-", 0.3, 0.0, 3.0)
    independent = partial(_form, (lost, *parameters[1:]), _separated, _separated_model, _INDEPENDENT, chord)
    steady, attached = (
        partial(
            _form, parameters, partial(_stalling, beyond_steady=beyond), partial(_stalling_model, beyond_steady=beyond),
            about, chord,
        )
        for beyond, about in ((True, "beyond a steady stall"), (False, "beyond attached flow"))
    )  # fmt: skip
    made = []
    for onset in onsets.tolist():
        made += [of_shape(independent, onset, _SHARP, a * chord, b * chord) for a, b in _CHORDS[:3]]
        for form, sharp in ((attached, 18.0), (attached, 40.0), (steady, 25.0)):
            made += [of_shape(form, onset, sharp, a * chord, b * chord) for a, b in _CHORDS]
    return made + latched_variants(flights, top)


def _form(
    parameters: tuple[EffectParameter, ...],
    columns: Callable[..., Columns],
    model: MakeModel,
    about: str,
    chord: float,
    *values: float,
) -> Variant:
    """A form by onset [rad], sharpness [1/rad] and two time constants [s]; `chord` is the time to travel one [s]."""
    onset, sharp, tau1, tau2 = values
    shape = dict(zip(_UNITS, values))
    acts = partial(columns, where=onset, sharp=sharp, tau1=tau1 / chord, tau2=tau2 / chord)
    return Variant(parameters, acts, shape, _UNITS, about, model=model)


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
    if "release" in found.estimates:
        onset, release = (found.text(name, 180.0 / np.pi, "deg") for name in ("onset", "release"))
        return f"The flow separates at {onset} of angle of attack and attaches again at {release} only."
    return (
        f"The flow separates about {found.text('onset', 180.0 / np.pi, 'deg')} of angle of attack and follows late, "
        f"with time constants of {found.text('tau1')} and {found.text('tau2')}. Lift is less on the way "
        "back than on the way up."
    )


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "stall-hysteresis", "memory", "Separated flow that follows late, so that lift differs on the way up and down.",
        _stall_needs, _stall_variants, _stall_says,
        look_alikes=("static-stall", "missing-term", "downwash-lag"),
        separated_by="slow and fast approaches to the stall, with recovery: a static stall does not know the rate",
        check="lift against angle of attack in one slow and one fast stall",
    ),
)  # fmt: skip
