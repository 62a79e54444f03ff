"""Surfaces whose positions differ from the recorded ones, or that an unrecorded feedback moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.comparison.plant import answers
from structsel.comparison.sensitivity import reading
from structsel.effects import plants
from structsel.effects.base import (
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
from structsel.effects.inputs import DrivenChannel, channels_with_input
from structsel.effects.model_forms import MakeModel, add_term, derivative, one_hot, state_after
from structsel.effects.operators import spaced
from structsel.effects.rate_limits import rate_says, rate_variants
from structsel.effects.signals import CONTROLS, available, coefficients, gathered
from structsel.effects.surfaces import (
    ALL,
    FRACTION,
    Follow,
    actuated,
    behind,
    departure,
    displaced,
    followed,
    from_unknown_start,
    stopped,
    used_controls,
)
from structsel.effects.wording import SURFACES, shown
from structsel.model import Quantity, State
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import delayed, first_order_lag
from structsel.numerics.signal_quality import white_noise_std

# Feedbacks that aircraft have: surface, what is fed back, prior deviation of the gain, unit.
_FEEDBACKS = (
    ("de", "q", 0.3, "s"), ("de", "alpha", 0.3, "-"), ("de", "theta", 0.3, "-"), ("de", "az", 0.005, "rad s^2/m"),
    ("da", "p", 0.15, "s"), ("da", "phi", 0.3, "-"), ("da", "r", 0.3, "s"), ("da", "beta", 0.3, "-"),
    ("dr", "r", 0.3, "s"), ("dr", "beta", 0.3, "-"), ("dr", "p", 0.15, "s"), ("dr", "ay", 0.01, "rad s^2/m"),
)  # fmt: skip
_ABOVE_NOISE = 3.0  # standard deviations of a reading's noise, that a play is wide at least
_WASHOUTS = (1.0, 3.0)  # s, of a damper that leaves steady turns alone


def _needs_control(flights: Flights) -> str:
    if answers(flights):
        return ""
    if not coefficients(flights):
        return "simulated coefficients"
    return _needs_used_control(flights)


def _needs_used_control(flights: Flights) -> str:
    return "" if used_controls(flights) else "a control that moves and that the simulation answers to"


def _needs_input(flights: Flights) -> str:
    return "" if channels_with_input(flights) else _needs_used_control(flights)


# Lag and delay


def _lag_variants(flights: Flights) -> list[Variant]:
    made = []
    dt = flights[0].dt
    used = used_controls(flights)
    # What is recorded may be what all of them were asked, and all have the same servo.
    together = [(ALL, used)] if len(used) > 1 else []
    for about, controls in [*together, *((SURFACES[c], [c]) for c in used)]:
        for name, operator in (("lag", first_order_lag), ("delay", delayed)):
            for tau in spaced(max(0.02, 0.75 * dt), 0.35, 7):
                lagged = partial(behind, operator=operator, tau=tau)
                columns = displaced(*((c, 0, departure(c, lagged, tau)) for c in controls))
                model = _lag_model(tuple(CONTROLS) if about == ALL else tuple(controls), name)
                parameter = EffectParameter(name, "s", tau, 0.5 * tau, 1.5 * tau)
                made.append(Variant((parameter,), columns, about=about, model=model))
    return made + plants.delayed_answers(flights)


def _lag_model(controls: Sequence[str], kind: str) -> MakeModel:
    follows = state_after(controls, kind, "late", lambda case: {"tau": case.quantity(kind)})
    return lambda case: follows(case) if case.estimates[kind].value > 0.0 else None


def _lag_says(found: FittedEffect) -> str:
    about = found.variant.about
    who = "The surfaces follow their inputs" if about == ALL else f"The {about} follows its input"
    if "lag" in found.estimates:
        return f"{who} late, by a first-order lag of {found.text('lag')}."
    return f"{who} late, by a delay of {found.text('delay')}."


# Stops

_SIDES = {"upper": "upper side", "lower": "lower side", "both": "either way"}


def _stops(case: ModelCase, side: str) -> dict[str, Quantity]:
    """Limits of the travel on one side or both."""
    stop = case.quantity("stop")
    return {
        "upper": {"high": stop},
        "lower": {"low": stop},
        "both": {"low": Quantity(-stop.value, stop.std, stop.unit), "high": stop},
    }[side]


def _stop_variants(flights: Flights) -> list[Variant]:
    made = []
    for control in used_controls(flights):
        values = gathered(flights, control)
        low, high = float(values.min()), float(values.max())
        for fraction in (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9):
            # Between what is usual and the extreme: a stop within the usual would have been seen.
            middle = float(np.median(values))
            up, down = middle + fraction * (high - middle), middle + fraction * (low - middle)
            both = fraction * max(abs(low), abs(high))
            made += [
                of_shape(partial(_stopping, control, side), x) for side, x in zip(_SIDES, (up, down, both)) if x != 0.0
            ]
    return made


def _stopping(control: str, side: str, stop: float) -> Variant:
    low, high = {"upper": (-np.inf, stop), "lower": (stop, np.inf), "both": (-stop, stop)}[side]
    return Variant(
        (FRACTION,), followed(control, partial(stopped, low=low, high=high)), {"stop": stop}, {"stop": "rad"},
        f"{SURFACES[control]}, {_SIDES[side]}",
        model=state_after([control], "stops", "stopped", partial(_stops, side=side)),
        words={"surface": SURFACES[control], "side": _SIDES[side]},
    )  # fmt: skip


def _stop_says(found: FittedEffect) -> str:
    words = found.variant.words
    return f"The {words['surface']} stops at {shown(found, 'stop')} ({words['side']}) although the command was larger."


# Play


_START = EffectParameter("start", "-", 1.0 / np.sqrt(3.0), of_beginning=True)  # even between the sides


def _play_variants(flights: Flights) -> list[Variant]:
    made, names = [], [f.name for f in flights]
    for control in used_controls(flights):
        values = gathered(flights, control)
        reach = float(values.max() - values.min())
        # A play as narrow as the reading's noise holds that noise still, as the aircraft does, which never felt it.
        noise = max(float(np.std(f.raw[control] - f[control])) for f in flights)
        narrowest, widest = max(0.02 * reach, _ABOVE_NOISE * noise), 0.5 * reach
        if narrowest >= widest:
            continue
        model = state_after([control], "backlash", "play", lambda case: {"width": case.quantity("width")})
        form = partial(_playing, partial(followed, control), SURFACES[control], "rad", model, names)
        made += [of_shape(form, width) for width in spaced(narrowest, widest, 10)]
    return made + [v for one in channels_with_input(flights) for v in _play_of_input(flights, one)]


def _play_of_input(flights: Flights, one: DrivenChannel) -> list[Variant]:
    """Play between the input of a simulated channel and what it drives."""
    reach = float(np.ptp(np.concatenate([f.raw[one.control] for f in flights])))
    noise = max(white_noise_std(f.raw[one.control]) for f in flights)
    narrowest, widest = max(0.01 * reach, _ABOVE_NOISE * noise), 0.5 * reach
    if narrowest >= widest:
        return []
    form = partial(_playing, one.behind, one.control, "", None, [f.name for f in flights])
    return [of_shape(form, x) for x in spaced(narrowest, widest, 12)]


def _playing(
    follow: Follow, about: str, unit: str, model: MakeModel | None, names: Sequence[str], width: float
) -> Variant:
    """Play, on a side of which each of the named flights may begin."""
    columns = from_unknown_start(lambda x: follow(partial(actuated, backlash=width, start=x)), names)
    starts = (replace(_START, name=f"start in {name}") for name in names)
    return Variant((FRACTION, *starts), columns, {"width": width}, {"width": unit}, about, model=model)


def _play_says(found: FittedEffect) -> str:
    return f"The {found.variant.about} has a dead play of {shown(found, 'width')}: it ignores smaller reversals."


# Augmentation


def _mode(flight: Flight) -> Array | float:
    """Where a recorded autopilot mode is on; everywhere if none is recorded."""
    return (flight["mode"] != 0.0).astype(float) if "mode" in flight.recorded else 1.0


def _felt(flight: Flight, signal: str, washout: float | None = None) -> Array:
    x = reading(flight, signal)
    return (x if washout is None else x - first_order_lag(x, flight.dt, washout)) * _mode(flight)


def _feedback_variants(flights: Flights) -> list[Variant]:
    made = []
    used = used_controls(flights)
    for control, signal, sd, unit in _FEEDBACKS:
        if control not in used or not available(flights, signal):
            continue
        gain = EffectParameter(f"gain of {signal}", unit, sd, -10.0 * sd, 10.0 * sd)
        made.append(_fed_back(control, (gain,), (signal,), f"{signal} to"))
        if signal in ("p", "q", "r"):
            made += [
                _fed_back(control, (gain,), (signal,), f"{signal}, washed out over {tau:g} s, to", tau)
                for tau in _WASHOUTS
            ]
    for control, pair in (("de", ("q", "alpha")), ("de", ("q", "theta")), ("dr", ("r", "beta")), ("da", ("p", "phi"))):
        if control in used and all(available(flights, s) for s in pair):
            deviations = {s: (sd, unit) for c, s, sd, unit in _FEEDBACKS if c == control}
            gains = tuple(
                EffectParameter(f"gain of {s}", unit, sd, -10.0 * sd, 10.0 * sd)
                for s, (sd, unit) in ((s, deviations[s]) for s in pair)
            )
            made.append(_fed_back(control, gains, pair, f"{' and '.join(pair)} to"))
    return made


def _fed_back(
    control: str, gains: tuple[EffectParameter, ...], signals: Sequence[str], about: str, washout: float | None = None
) -> Variant:
    columns = displaced(*((control, j, partial(_felt, signal=s, washout=washout)) for j, s in enumerate(signals)))
    model = partial(_feedback_model, control=control, signals=signals, washout=washout)
    words = {gain.name: signal for gain, signal in zip(gains, signals)}
    return Variant(gains, columns, about=f"{about} {SURFACES[control]}", model=model, words=words)


def _feedback_model(case: ModelCase, control: str, signals: Sequence[str], washout: float | None) -> ModelForm | None:
    """A surface that moves with the motion: its own terms once more, times the signals that move it."""
    if case.variant.only_in or any("mode" in f.recorded for f in case.flights):
        return None
    states: dict[str, State] = {}
    moved: list[Term] = []
    for signal in signals:
        if washout is not None:
            states[f"{signal}_slow"] = State("lag", signal, {"tau": Quantity(washout, unit="s")})
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
                    add_term(terms, response, part * signal_term, factor * value * one_hot(j, len(moved)))
    return ModelForm(states=states, terms=terms)


def _feedback_says(found: FittedEffect) -> str:
    names = [p.name for p in found.variant.parameters]
    gains = " and ".join(f"{found.text(name)} ({found.variant.words[name]})" for name in names)
    return f"Something unrecorded moves a surface with the motion ({found.variant.about}): gain {gains}."


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "actuator-lag", "actuator", "A surface, or a motor, follows its input late.",
        _needs_control, _lag_variants, _lag_says,
        look_alikes=("sensor-delay", "unsteady-lift", "rotor-inflow-lag", "backlash"),
        separated_by="sharp steps of this control alone, small and large",
        check="a ground test of the actuator, and where in the linkage the control is recorded",
    ),
    Effect(
        "actuator-rate-limit", "actuator", "A surface moves no faster than its actuator can.",
        _needs_input,
        rate_variants, rate_says,
        look_alikes=("actuator-lag", "backlash", "actuator-saturation"),
        separated_by="the same input at half and at twice the size: a lag keeps its shape, a rate limit does not",
        check="the actuator's rate under load",
    ),
    Effect(
        "actuator-saturation", "actuator", "A surface stops before it reaches its command.",
        _needs_used_control,
        _stop_variants, _stop_says,
        look_alikes=("control-nonlinearity", "actuator-rate-limit"),
        separated_by="inputs just below and well above the stop, held for a second",
        check="the stops of the surface, and the actuator's stall load",
    ),
    Effect(
        "backlash", "actuator", "A dead play in the linkage: small reversals do not reach the surface.",
        _needs_input,
        _play_variants, _play_says,
        look_alikes=("actuator-lag", "friction", "actuator-rate-limit"),
        separated_by="small and large reversals of the same control: the play keeps its size",
        check="free play of the surface on the ground",
    ),
    Effect(
        "augmentation", "actuator", "An unrecorded autopilot or damper moves a surface with the motion.",
        _needs_used_control,
        _feedback_variants, _feedback_says,
        look_alikes=("wrong-derivative", "downwash-lag", "sidewash-lag"), switched=_feedback_variants,
        separated_by="the same manoeuvre with the damper off",
        check="whether the surface is recorded before or after the autopilot's servo",
    ),
)  # fmt: skip
