"""Readings that are off by more than a free constant: too far, drifting, or from some moment on."""

from __future__ import annotations

from functools import partial

from structsel.comparison.flight import Flight
from structsel.effects.base import EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.changes import ChangeSearch, SoughtChange
from structsel.effects.lasting_changes import lasting_changes
from structsel.effects.operators import changes, onsets_in_words, shape_of, since
from structsel.effects.readings import AIR, ATTITUDE, INERTIAL, Errors, present, wrong_readings
from structsel.effects.signals import CONTROLS, gathered
from structsel.effects.wording import INSTRUMENTS, capital, shown
from structsel.nomenclature import LATERAL_COEFFICIENTS

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
    single = [dict([change]) for change in changes(flights, flights[0].responses, _CLEAREST)]
    for channel in present(flights, (*AIR, *INERTIAL, *ATTITUDE, *CONTROLS)):
        sd, unit, name = _sd(flights, channel), _UNIT[channel], INSTRUMENTS[channel]
        constant = EffectParameter("bias", unit, sd, -10.0 * sd, 10.0 * sd)
        drift = EffectParameter("drift", f"{unit}/min" if "/" not in unit else f"{unit} per min", 2.0 * sd)
        made += [
            Variant((constant,), wrong_readings(partial(_level, channel=channel)), about=name),
            Variant((drift,), wrong_readings(partial(_drift, channel=channel)), about=f"{name}, drifting"),
        ]
        search = ChangeSearch.of(flights, _SHOWS.get(channel, ()))
        several = search.together(search.find(), both_signs=False)
        for times in (*single, *({one.flight: one.start for one in jumped} for jumped, _ in several)):
            errors = partial(_since, channel=channel, times=times)
            shape = shape_of(times)
            name_and_times = f"{name}, {onsets_in_words(times)}"
            made.append(Variant((constant,), wrong_readings(errors), shape, dict.fromkeys(shape, "s"), name_and_times))
        for change in lasting_changes(flights, _SHOWS.get(channel, ()), undone=False):
            shape = shape_of(change.times)
            errors = partial(_changed, channel=channel, change=change)
            name_and_times = f"{name}, from {change.when} on"
            made.append(Variant((constant,), wrong_readings(errors), shape, dict.fromkeys(shape, "s"), name_and_times))
    return made


def _sd(flights: Flights, channel: str) -> float:
    return 0.02 * float(gathered(flights, "V").mean()) if channel == "V" else _SIZE[channel]


def _level(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: 1.0}]


def _drift(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: (flight.t - flight.t[0]) / 60.0}]


def _since(flight: Flight, channel: str, times: dict[str, float]) -> list[Errors]:
    return [{channel: since(flight, times)}]


def _changed(flight: Flight, channel: str, change: SoughtChange) -> list[Errors]:
    return [{channel: change.along(flight)}]


def bias_says(found: FittedEffect) -> str:
    """The sentence of a bias."""
    instrument, comma, times = capital(found).partition(",")
    if "drift" in found.estimates:
        return f"{instrument} drifts by {shown(found, 'drift')}."
    return f"{instrument} is biased by {shown(found, 'bias')}{comma}{times}."
