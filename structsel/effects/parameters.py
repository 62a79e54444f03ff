"""Values and terms of the simulation itself: a wrong one, a missing one, one of the other family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.responses import KINEMATIC
from structsel.effects.base import (
    Columns,
    Effect,
    EffectParameter,
    FittedEffect,
    Flights,
    ModelCase,
    ModelForm,
    Variant,
)
from structsel.effects.model_forms import one_hot
from structsel.effects.signals import (
    CHANNELS_OF,
    Column,
    coefficients,
    held,
    lacking,
    mean_slope,
    moves,
    per_unit,
    product,
    spread,
    term_sd,
    term_text,
    variation,
    without_linear_part,
)
from structsel.nomenclature import COEFFICIENTS, LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array

_KNOWN_FRACTION = 0.01  # of a response's variation, that a linear term of the simulation carries at least
_POWERS = (("alpha", "alpha"), ("alpha", "alpha", "alpha"))
_LONGITUDINAL_PRODUCTS = (("alpha", "q_hat"), ("alpha", "de"), ("de", "de"), ("alpha", "alpha", "de"))
_SIDE_POWERS = (("beta", "beta", "beta"),)
_SIDE_PRODUCTS = (("p_hat", "p_hat", "p_hat"), ("r_hat", "r_hat", "r_hat"), ("beta", "beta", "r_hat"))
_CROSS_FLOW = (("beta", "|beta|"), ("r_hat", "|r_hat|"), ("beta", "|r_hat|"), ("r_hat", "|beta|"))
"""Drag of a slender body across its axis: of hulls and fuselages."""
_EVEN = (
    ("beta", "beta"), ("|beta|",), ("p_hat", "r_hat"), ("beta", "p_hat"), ("beta", "r_hat"), ("p_hat", "p_hat"),
    ("beta",), ("p_hat",), ("r_hat",), ("beta", "beta", "de"),
)  # fmt: skip
_ACROSS = (
    ("alpha", "beta"), ("alpha", "p_hat"), ("alpha", "r_hat"), ("alpha", "da"), ("alpha", "dr"), ("q_hat",),
    ("alpha",), ("beta", "q_hat"),
)  # fmt: skip
_GROUPS = (
    (("beta", "beta"), LONGITUDINAL_COEFFICIENTS), (("|beta|",), LONGITUDINAL_COEFFICIENTS),
    (("alpha", "beta"), LATERAL_COEFFICIENTS),
    (("alpha", "p_hat"), ("Cl", "Cn")), (("alpha", "r_hat"), ("Cl", "Cn")),
)  # fmt: skip
_ORDINARY = 6  # maximum number of channels of other plants whose powers and products are tried


def _others(flights: Flights) -> tuple[str, ...]:
    """Responses that are neither coefficients nor kinematics."""
    names = dict.fromkeys(r for f in flights for r in f.measured)
    return tuple(r for r in names if r not in COEFFICIENTS and r not in KINEMATIC)


def _inputs(flights: Flights, response: str) -> tuple[str, ...]:
    """Channels that a response of any plant may depend on."""
    shared = [c for c in flights[0].raw if all(c in f.recorded for f in flights)]
    taken = (response, *_others(flights), "t")
    return tuple(c for c in shared if c not in taken and moves(flights, c))[:_ORDINARY]


def _one(response: str, column: Column, parameter: EffectParameter, about: str, terms: tuple[str, ...]) -> Variant:
    def columns(flight: Flight) -> Columns:
        return {response: column(flight)[:, None]} if response in flight.measured else {}

    return Variant((parameter,), columns, about=about, terms=terms)


def _term(flights: Flights, response: str, channels: Sequence[str], fraction: float = 0.3) -> Variant:
    text, column = term_text(channels), product(channels)
    if response not in COEFFICIENTS:
        column = _about_its_mean(flights, column)
    parameter = EffectParameter(f"{response}: {text}", per_unit(channels), term_sd(flights, response, column, fraction))
    return _one(response, column, parameter, f"{text} in {response}", (text,))


def _about_its_mean(flights: Flights, column: Column) -> Column:
    """The column less its mean over all flights: a channel that hardly moves is no level of the response."""
    mean = float(np.concatenate([column(f) for f in flights]).mean())
    return lambda flight: column(flight) - mean


def _refitted(flights: Flights, response: str, channels: Sequence[str]) -> Variant:
    text = term_text(channels)
    column = without_linear_part(flights, product(channels), CHANNELS_OF.get(response, tuple(dict.fromkeys(channels))))
    if response not in COEFFICIENTS:
        column = _about_its_mean(flights, column)
    parameter = EffectParameter(f"{response}: {text}", per_unit(channels), term_sd(flights, response, column, 0.3))
    return _one(response, column, parameter, f"{text} in {response}, linear terms fitted without it", (text,))


def _several(flights: Flights, responses: Sequence[str], channels: Sequence[str]) -> Variant:
    text, column = term_text(channels), product(channels)
    parameters = tuple(
        EffectParameter(f"{r}: {text}", per_unit(channels), term_sd(flights, r, column, 0.3)) for r in responses
    )

    def columns(flight: Flight) -> Columns:
        x = column(flight)
        return {r: np.outer(x, np.eye(len(responses))[j]) for j, r in enumerate(responses) if r in flight.measured}

    return Variant(parameters, columns, about=f"{text} in {', '.join(responses)}", terms=(text,))


def _tried(flights: Flights, channels: Sequence[str]) -> bool:
    return all(moves(flights, c.strip("|")) for c in channels)


def _asks(flights: Flights, response: str, channel: str) -> bool:
    """Whether the simulation has a linear term that can be seen."""
    linear = abs(mean_slope(flights, response, channel)) * spread(flights, channel)
    return linear > _KNOWN_FRACTION * variation(flights, response)


# --- a wrong value ---------------------------------------------------------------------------------------------------


def _wrong_values(flights: Flights) -> list[Variant]:
    made = []
    # What flaps do is a configuration's, and tried as that.
    every = tuple(c for c in dict.fromkeys((*CHANNELS_OF["CZ"], *CHANNELS_OF["CY"])) if c != "df")
    for response in coefficients(flights):
        for channel in every:
            if not moves(flights, channel):
                continue
            if _asks(flights, response, channel):
                made.append(_wrong_value(flights, response, channel))
                if (scaled := _scaled_response(flights, response, channel)) is not None:
                    made.append(scaled)
    for response in _others(flights):
        made += [_term(flights, response, (c,)) for c in _inputs(flights, response)]
    return made


def _wrong_value(flights: Flights, response: str, channel: str) -> Variant:
    slope = mean_slope(flights, response, channel)
    sd = max(0.3 * abs(slope), term_sd(flights, response, channel, 0.05))
    parameter = EffectParameter(f"{response}_{channel}", per_unit((channel,)), sd)
    return _one(response, product((channel,)), parameter, f"{channel} in {response}", (channel,))


def _scaled_response(flights: Flights, response: str, channel: str) -> Variant | None:
    """All terms of a channel by one factor; None where these are nearly its linear term."""
    if flights[0].surrogate is None:
        return None

    def part(flight: Flight) -> Array:
        s = flight.surrogate
        if s is None or response not in s.terms:
            return np.zeros(len(flight))
        parts = [
            v * s.column(flight, term)
            for term, v in zip(s.terms[response], s.values[response])
            if channel in map(s.channel_of, term)
        ]
        return np.sum(parts, axis=0) if parts else np.zeros(len(flight))

    if spread(flights, without_linear_part(flights, part, (channel,))) < 0.1 * spread(flights, part):
        return None
    parameter = EffectParameter(f"{response}_{channel} relative", "-", 0.3, -1.5, 1.5)
    variant = _one(response, part, parameter, f"all of {channel} in {response}", (channel,))
    model = partial(_scaled_response_model, response=response, channel=channel)
    return replace(variant, model=model, words={"scaled": f"{channel} in {response}"})


def _scaled_response_model(case: ModelCase, response: str, channel: str) -> ModelForm | None:
    """Every term of the response that contains the channel, by one factor."""
    if response not in case.base:
        return None
    model = case.base[response]
    terms = {t: v * one_hot(0, 1) for t, v in zip(model.terms, model.values.tolist()) if channel in t.channels}
    return ModelForm(terms={response: terms}) if terms else None


def _says_value(found: FittedEffect) -> str:
    name = found.variant.parameters[0].name
    value = found.text(name)
    if scaled := found.variant.words.get("scaled"):
        return f"The simulated effect of {scaled} is off by {found.text(name, 100.0, '%')}."
    return f"The simulation has a wrong value for {found.variant.about}: it should be changed by {value}."


# --- a missing term --------------------------------------------------------------------------------------------------


def _missing_terms(flights: Flights) -> list[Variant]:
    made = []
    for response in coefficients(flights):
        powers, products = (
            (_POWERS, _LONGITUDINAL_PRODUCTS)
            if response in LONGITUDINAL_COEFFICIENTS
            else (_SIDE_POWERS, (*_SIDE_PRODUCTS, *_CROSS_FLOW))
        )
        for channels in (*powers, *products):
            if _tried(flights, channels):
                made.append(_term(flights, response, channels))
        made += [_refitted(flights, response, channels) for channels in powers if _tried(flights, channels)]
        absent = [c for c in CHANNELS_OF[response] if c != "df" and moves(flights, c)]
        made += [_term(flights, response, (c,)) for c in absent if not _asks(flights, response, c)]
    for response in _others(flights):
        inputs = _inputs(flights, response)
        for i, c in enumerate(inputs):
            made += [_term(flights, response, (c, c)), _refitted(flights, response, (c, c))]
            made += [_term(flights, response, (c, c, c)), _refitted(flights, response, (c, c, c))]
            made += [_term(flights, response, (c, other)) for other in inputs[i + 1 :]]
            made += [_term(flights, response, (c, f"|{other}|")) for other in inputs]
    return made


# --- terms of the other family ---------------------------------------------------------------------------------------


def _couplings(flights: Flights) -> list[Variant]:
    made = []
    for response in coefficients(flights):
        for channels in _EVEN if response in LONGITUDINAL_COEFFICIENTS else _ACROSS:
            if not _tried(flights, channels):
                continue
            if len(channels) > 1 or channels[0].startswith("|") or not _asks(flights, response, channels[0]):
                made.append(_term(flights, response, channels))
    for channels, wanted in _GROUPS:
        responses = held(flights, wanted)
        if len(responses) > 1 and _tried(flights, channels):
            made.append(_several(flights, responses, channels))
    return made


def _needs_coupling(flights: Flights) -> str:
    return lacking(flights, (*LONGITUDINAL_COEFFICIENTS, *LATERAL_COEFFICIENTS)) or (
        "" if moves(flights, "beta") or moves(flights, "p") or moves(flights, "r") else "lateral motion"
    )


def _says_term(found: FittedEffect) -> str:
    names = [p.name for p in found.variant.parameters]
    if len(names) == 1:
        return f"The simulation lacks {found.variant.about}: {found.text(names[0])}."
    values = "; ".join(f"{name} {found.text(name)}" for name in names)
    return f"The simulation lacks {found.variant.about} ({values})."


def _needs_any(flights: Flights) -> str:
    return "" if coefficients(flights) or any(_inputs(flights, r) for r in _others(flights)) else "responses to explain"


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "wrong-derivative",
        "parameter",
        "A term the simulation has, with a wrong value.",
        _needs_any,
        _wrong_values,
        _says_value,
        look_alikes=("sensor-scale", "cg-shift", "inertia-error", "missing-term"),
        separated_by="Manoeuvres at other speeds and angles of attack: a wrong value stays the same there.",
        check="The derivative's source in the simulation's data, and its sign and reference length.",
    ),
    Effect(
        "missing-term",
        "parameter",
        "An ordinary power or product of channels is absent from the simulation.",
        _needs_any,
        _missing_terms,
        _says_term,
        look_alikes=("static-stall", "wrong-derivative", "control-nonlinearity", "drag-polar"),
        separated_by="Slow sweeps over the whole range of the channel, at constant speed and power.",
        check="Whether the simulation's tables hold this dependence at all.",
        log_prior=-1.0,  # the same term with physics to its name is likelier
    ),
    Effect(
        "cross-coupling",
        "static",
        "A longitudinal coefficient depends on sideslip, roll or yaw; a lateral one on angle of attack or pitch rate.",
        _needs_coupling,
        _couplings,
        _says_term,
        look_alikes=("missing-term", "engine-gyroscopic", "asymmetry", "sensor-misalignment"),
        separated_by="Steady sideslips to both sides, and rudder and aileron doublets at several angles of attack.",
        check="Whether the simulation keeps longitudinal and lateral motion apart.",
    ),
)
