"""What an effect is in a model: terms with values, states with dynamics of their own, or neither."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.comparison.responses import COEFFICIENTS
from structsel.diagnosis.matching import LIFT, exact_terms
from structsel.effects.actuators import ALL
from structsel.effects.base import Estimate, Hypothesis, Variant
from structsel.effects.memory import WHATEVER_THE_LIFT
from structsel.effects.propulsive import AXIAL
from structsel.effects.signals import CONTROLS
from structsel.effects.wording import SURFACES
from structsel.model import Quantity, ResponseModel, State
from structsel.numerics.arrays import Array

Weights = dict[str, dict[Term, Array]]
_CONTROLS = {SURFACES[control]: control for control in CONTROLS}
_ELSEWHERE = {
    "sensor": "lies in what an instrument reads",
    "inertial": "lies in mass, inertia or centre of gravity, which the aircraft file states",
    "atmospheric": "lies in the air",
    "random": "lies in the air",
}


@dataclass(frozen=True, eq=False)
class Addition:
    """One effect as what it is in a model.

    Attributes
    ----------
    effect : str
    theta : (k,) array
        Its linear parameters, in their units.
    covariance : (k, k) array
        Theirs.
    terms : mapping of response to mapping of Term to (k,) array
        Value of each term per unit of the parameters. Responses may be CL and CD beside CX and CZ.
    fixed : mapping of response to mapping of Term to float
        Terms whose values do not depend on the parameters.
    states : mapping of name to State
    replaced : mapping of response to mapping of channel to formula
        What stands in the place of a channel in the terms that the simulation has.
    remark : str
        Empty, or why it is not in the model as what it is.
    """

    effect: str
    theta: Array
    covariance: Array
    terms: Weights = field(default_factory=dict)
    fixed: Mapping[str, Mapping[Term, float]] = field(default_factory=dict)
    states: Mapping[str, State] = field(default_factory=dict)
    replaced: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    remark: str = ""

    @property
    def is_known(self) -> bool:
        """Whether it is terms or states."""
        return bool(self.terms or self.fixed or self.replaced)


@dataclass(frozen=True, eq=False)
class Case:
    """An effect that was taken in, with what its states and terms are made of."""

    variant: Variant
    estimates: Mapping[str, Estimate]
    craft: Aircraft
    base: Mapping[str, ResponseModel]
    flights: Sequence[Flight]

    def quantity(self, name: str, scale: float = 1.0, unit: str | None = None) -> Quantity:
        """A parameter: of the shape as the form has it, else as found."""
        e = self.estimates[name]
        value = self.variant.shape.get(name, e.value)
        return Quantity(float(value) * scale, e.std * abs(scale), e.unit if unit is None else unit)


Made = Addition | None
Parts = dict[str, object]


def addition_of(hypothesis: Hypothesis, case: Case, theta: Array, covariance: Array) -> Addition:
    """An effect as terms or states; with neither, and a remark, where it has none.

    Parameters
    ----------
    hypothesis : Hypothesis
    case : Case
    theta : (k,) array
        Linear parameters, in their units.
    covariance : (k, k) array
    """
    effect = hypothesis.effect
    if hypothesis.kind in _ELSEWHERE:
        return Addition(effect, theta, covariance, remark=f"{effect} {_ELSEWHERE[hypothesis.kind]}: model.json is "
                        "without it")  # fmt: skip
    parts = _STATES[effect](case) if effect in _STATES else None
    if parts is None:
        parts = _scaled(case)
    if parts is None and (terms := exact_terms(case.variant, case.flights)) is not None:
        parts = {"terms": {c: _without_lift(mine, case.base) for c, mine in terms.items() if mine}}
    if parts is None and hypothesis.event:
        remark = f"{effect} is a matter of when it was recorded, which a model does not know: model.json is without it"
        return Addition(effect, theta, covariance, remark=remark)
    return Addition(effect, theta, covariance, **parts) if parts else Addition(effect, theta, covariance)  # type: ignore[arg-type]


# --- surfaces that do not follow ------------------------------------------------------------------


def _surfaces(case: Case) -> list[str]:
    """Controls of an effect of the actuators; none where it is of no surface, or the simulation's terms lack it."""
    about = case.variant.about.split(", ")[0]
    used = {c for model in case.base.values() for c in model.channels}
    return [control for name, control in _CONTROLS.items() if about in (name, ALL) and control in used]


def _following(case: Case, kind: str, suffix: str, parameters: Mapping[str, Quantity]) -> Parts | None:
    controls = _surfaces(case)
    if not controls:
        return None
    given = dict(parameters)
    if "share" in case.estimates:
        given["share"] = case.quantity("share")
    names = {control: f"{control}_{suffix}" for control in controls}
    states = {name: State(kind, control, given) for control, name in names.items()}
    return {"states": states, "replaced": dict.fromkeys(case.base, names)}


def _late(case: Case) -> Parts | None:
    kind = "lag" if "lag" in case.estimates else "delay"
    if case.estimates[kind].value <= 0.0:
        return None
    return _following(case, kind, "late", {"tau": case.quantity(kind)})


def _limited(case: Case) -> Parts | None:
    return _following(case, "rate limit", "limited", {"rate": case.quantity("rate")})


def _played(case: Case) -> Parts | None:
    return _following(case, "backlash", "play", {"width": case.quantity("width")})


def _stopped(case: Case) -> Parts | None:
    stop, side = case.quantity("stop"), case.variant.about.partition(", ")[2]
    low = Quantity(-stop.value, stop.std, stop.unit) if side.startswith("either") else stop
    stops = {"upper side": {"high": stop}, "lower side": {"low": stop}}.get(side, {"low": low, "high": stop})
    return _following(case, "stops", "stopped", stops)


def _fed_back(case: Case) -> Parts | None:
    """A surface that moves with the motion: its own terms once more, by what moves it."""
    how, _, surface = case.variant.about.rpartition(" to ")
    control = _CONTROLS.get(surface)
    if control is None or case.variant.only_in or any("mode" in f.recorded for f in case.flights):
        return None
    states: dict[str, State] = {}
    moved: list[Term] = []
    for p in case.variant.parameters:
        signal = p.name.removeprefix("gain of ")
        if "washed out over" in how:
            tau = float(how.partition("over ")[2].split(" ")[0])
            states[f"{signal}_slow"] = State("lag", signal, {"tau": Quantity(tau, unit="s")})
            moved.append(Term(f"({signal} - {signal}_slow)"))
        else:
            moved.append(Term(signal))
    terms: Weights = {}
    for response, model in case.base.items():
        for term, value in zip(model.terms, model.values.tolist()):
            slope = derivative(term, control)
            if slope is None:
                return None
            for j, signal_term in enumerate(moved):
                for part, factor in slope:
                    _add(terms, response, part * signal_term, factor * value * _unit(j, len(moved)))
    return {"states": states, "terms": terms}


def derivative(term: Term, channel: str) -> list[tuple[Term, float]] | None:
    """Derivative of a term by a channel, as terms with factors; None where the channel is inside a formula."""
    made = []
    for factor, power in term.factors:
        if channel not in factor.channels:
            continue
        if factor.kind not in ("channel", "offset"):
            return None
        powers = dict(term.factors)
        powers[factor] = power - 1
        made.append((Term(powers), float(power)))
    return made


# --- thrust ---------------------------------------------------------------------------------------


def _late_thrust(case: Case) -> Parts | None:
    if case.estimates["lag"].value <= 0.0:
        return None
    line, craft = case.craft.thrust, case.craft
    axial = case.variant.about == AXIAL
    term = Term("(thrust_late - thrust)/qbar")
    sizes = [*line.direction, *(a / length for a, length in zip(line.arm, (craft.b, craft.cbar, craft.b)))]
    fixed = {
        c: {term: float(s) / craft.S} for c, s in zip(COEFFICIENTS, sizes) if s != 0.0 and (c == "CX" or not axial)
    }
    return {"states": {"thrust_late": State("lag", "thrust", {"tau": case.quantity("lag")})}, "fixed": fixed}


# --- air that is late -----------------------------------------------------------------------------


def _wake(case: Case) -> Parts | None:
    """A wake that takes its way to the tail; None where it goes by the rate, which is a term."""
    if "way" not in case.variant.shape:
        return None
    chords = case.quantity("way")
    moment, force = (p.name.split(" ")[0] for p in case.variant.parameters)
    angle, length = ("beta", case.craft.b) if moment == "Cn" else ("alpha", case.craft.cbar)
    way = case.quantity("way", case.craft.cbar, "m")
    # The rate is the change over the time the way takes; by the hat it is made dimensionless with.
    size = length / (2.0 * chords.value * case.craft.cbar)
    term = Term(f"({angle} - {angle}_late)")
    terms = {c: {term: size * _unit(j, 2)} for j, c in enumerate((moment, force))}
    return {"states": {f"{angle}_late": State("delay", angle, {"way": way})}, "terms": terms}


def _building(case: Case) -> Parts | None:
    """Lift that builds up: part of the incidence is felt late."""
    if "lag" in case.variant.shape:
        parts = [(1.0, case.quantity("lag", case.craft.cbar, "m"))]
    else:
        decays = getattr(case.variant.columns, "keywords", {}).get("parts", ())
        parts = [(A, Quantity(case.craft.cbar / (2.0 * b), unit="m")) for A, b in decays]
    states: dict[str, State] = {}
    replaced: dict[str, dict[str, str]] = {}
    for name, what, responses in (
        ("share", "lift", ("CZ", "CL")), ("share of the axial force", "axial", ("CX", "CD")),
        ("share of the moment", "moment", ("Cm",)),
    ):  # fmt: skip
        share, mine = case.quantity(name), []
        for k, (A, way) in enumerate(parts, 1):
            mine.append(f"alpha_{what}{k if len(parts) > 1 else ''}")
            states[mine[-1]] = State(
                "lag", "alpha", {"way": way, "share": Quantity(share.value * A, share.std * A, share.unit)}
            )
        formula = " + ".join(mine) + f" - {len(mine) - 1}*alpha" * (len(mine) > 1)
        replaced |= {c: {"alpha": formula} for c in responses if c in case.base}
    return {"states": states, "replaced": replaced} if parts else None


def _stalled(case: Case) -> Parts | None:
    """Separation that follows late: lift lost, drag and moment by the point of separation."""
    names = {"onset": "onset", "sharpness": "sharpness", "tau1": "tau1", "tau2": "tau2"}
    state = State("separation", "alpha", {mine: case.quantity(theirs) for mine, theirs in names.items()})
    lost, drag = Term("(0.25*(1 + sqrt(x_sep))^2 - 1)"), Term("(1 - x_sep)")
    if case.variant.about == WHATEVER_THE_LIFT:
        sides = enumerate((("CZ", 1.0), ("CX", -1.0), ("Cm", -1.0)))
        return {"states": {"x_sep": state}, "terms": {c: {drag: s * _unit(j, 3)} for j, (c, s) in sides}}
    if case.variant.about == "beyond a steady stall":
        steady = f"0.5*(1 - tanh({state['sharpness']!r}*(alpha - {state['onset']!r})))"
        lost = Term(f"((1 + sqrt(x_sep))^2/(1 + sqrt({steady}))^2 - 1)")
        drag = Term(f"({steady} - x_sep)")
    terms: Weights = {}
    for term, value in _lift(case.base):
        _add(terms, "CL", term * lost, value * _unit(0, 3))
    _add(terms, "CD", drag, _unit(1, 3))
    _add(terms, "Cm", drag, -_unit(2, 3))
    return {"states": {"x_sep": state}, "terms": terms}


def _lift(base: Mapping[str, ResponseModel]) -> list[tuple[Term, float]]:
    if "CL" in base:
        return list(zip(base["CL"].terms, base["CL"].values.tolist()))
    made = []
    for c, turned, sign in (("CX", Term("sin(alpha)"), 1.0), ("CZ", Term("cos(alpha)"), -1.0)):
        if c in base:
            made += [(t * turned, sign * v) for t, v in zip(base[c].terms, base[c].values.tolist())]
    return made


def _without_lift(terms: Mapping[Term, Array], base: Mapping[str, ResponseModel]) -> dict[Term, Array]:
    """Terms with the simulated lift written in the simulation's own terms."""
    made: Weights = {}
    for term, weights in terms.items():
        powers = {f: p for f, p in term.factors if f.channels != (LIFT,)}
        parts: list[tuple[Term, float]] = [(Term(powers), 1.0)]
        for _ in range(term.degree - sum(powers.values())):
            parts = [(t * more, v * value) for t, v in parts for more, value in _lift(base)]
        for t, v in parts:
            _add(made, "", t, v * weights)
    return made.get("", {})


# --- what the simulation has, by a factor ---------------------------------------------------------


def _scaled(case: Case) -> Parts | None:
    """All of a channel in a response by one factor."""
    about = case.variant.about
    if not about.startswith("all of ") or " in " not in about:
        return None
    channel, response = about.removeprefix("all of ").split(" in ")
    if response not in case.base:
        return None
    model, terms = case.base[response], {}
    for term, value in zip(model.terms, model.values.tolist()):
        if channel in term.channels:
            terms[term] = value * _unit(0, 1)
    return {"terms": {response: terms}} if terms else None


_STATES: dict[str, Callable[[Case], Parts | None]] = {
    "actuator-lag": _late,
    "actuator-rate-limit": _limited,
    "actuator-saturation": _stopped,
    "backlash": _played,
    "augmentation": _fed_back,
    "thrust-lag": _late_thrust,
    "downwash-lag": _wake,
    "sidewash-lag": _wake,
    "unsteady-lift": _building,
    "stall-hysteresis": _stalled,
}


def _unit(j: int, k: int) -> Array:
    return np.eye(k)[j]


def _add(terms: Weights, response: str, term: Term, weights: Array) -> None:
    held = terms.setdefault(response, {})
    held[term] = held.get(term, np.zeros_like(weights)) + weights
