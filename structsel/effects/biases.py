"""Readings that are off by more than a free constant: too far, drifting, or from some moment on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from structsel.comparison.flight import Flight
from structsel.effects.base import EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.changes import ChangeSearch, Event, added, alone, from_then_on, steps, times_of
from structsel.effects.lasting_changes import lasting_changes
from structsel.effects.readings import AIR, ATTITUDE, INERTIAL, Errors, present, wrong_readings
from structsel.effects.signals import CONTROLS, Column, gathered
from structsel.effects.wording import INSTRUMENTS, capital, shown
from structsel.nomenclature import COEFFICIENTS, LATERAL_COEFFICIENTS

_ANGLES = ("alpha", "beta", *ATTITUDE, *CONTROLS)
_SIZE = {**dict.fromkeys(_ANGLES, 0.01), **dict.fromkeys("pqr", 0.005), **dict.fromkeys(("ax", "ay", "az"), 0.15)}
_UNIT = {
    **dict.fromkeys(_ANGLES, "rad"), **dict.fromkeys("pqr", "rad/s"), **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    "V": "m/s",
}  # fmt: skip
_SHOWS = {
    "V": ("CX", "CZ"), "alpha": ("CZ", "Cm", "CX"), "beta": LATERAL_COEFFICIENTS, "ax": ("CX",), "ay": ("CY",),
    "az": ("CZ",), "de": ("CZ", "Cm"), "da": ("Cl", "Cn"), "dr": ("CY", "Cn"),
}  # fmt: skip
"""Responses in which a reading that jumps stands out."""
_CLEAREST = 2  # jumps of one manoeuvre alone that are tried


def bias_variants(flights: Flights) -> list[Variant]:
    """Forms of a bias; a constant in each manoeuvre goes free, so far as it shifts a response by a constant."""
    made = []
    anywhere = alone(ChangeSearch.of(flights, COEFFICIENTS).find(each=1))[:_CLEAREST]
    for channel in present(flights, (*AIR, *INERTIAL, *ATTITUDE, *CONTROLS)):
        sd, unit, name = _sd(flights, channel), _UNIT[channel], INSTRUMENTS[channel]
        constant = EffectParameter("bias", unit, sd, -10.0 * sd, 10.0 * sd)
        drift = EffectParameter("drift", f"{unit}/min" if "/" not in unit else f"{unit} per min", 2.0 * sd)
        made += [
            Variant((constant,), wrong_readings(partial(_level, channel=channel)), about=name),
            Variant((drift,), wrong_readings(partial(_drift, channel=channel)), about=f"{name}, drifting"),
        ]
        for event in _jumps(flights, _SHOWS[channel]) if channel in _SHOWS else anywhere:
            shape = times_of(event)
            jumped = partial(_changed, channel=channel, along=added(*event))
            about_and_times = f"{name}, {from_then_on(event)}"
            made.append(Variant((constant,), wrong_readings(jumped), shape, dict.fromkeys(shape, "s"), about_and_times))
    return made


def _jumps(flights: Flights, responses: Sequence[str]) -> list[Event]:
    """When a reading may have jumped that shows in some responses."""
    return [
        *steps(flights, responses, singles=_CLEAREST),
        *alone(lasting_changes(flights, responses, undone=False)),
    ]


def _sd(flights: Flights, channel: str) -> float:
    return 0.02 * float(gathered(flights, "V").mean()) if channel == "V" else _SIZE[channel]


def _level(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: 1.0}]


def _drift(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: (flight.t - flight.t[0]) / 60.0}]


def _changed(flight: Flight, channel: str, along: Column) -> list[Errors]:
    return [{channel: along(flight)}]


def bias_says(found: FittedEffect) -> str:
    """The sentence of a bias."""
    instrument, comma, times = capital(found).partition(",")
    if "drift" in found.estimates:
        return f"{instrument} drifts by {shown(found, 'drift')}."
    return f"{instrument} is biased by {shown(found, 'bias')}{comma}{times}."
