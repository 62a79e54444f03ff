"""Readings that are off by more than a free constant: too far, drifting, or from some moment on."""

from __future__ import annotations

from functools import partial

from structsel.comparison.flight import Flight
from structsel.effects.base import EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.readings import AIR, ATTITUDE, INERTIAL, Errors, present, wrong_readings
from structsel.effects.signals import CONTROLS, gathered
from structsel.effects.wording import INSTRUMENTS, capital, shown

_ANGLES = ("alpha", "beta", *ATTITUDE, *CONTROLS)
_SIZE = {**dict.fromkeys(_ANGLES, 0.01), **dict.fromkeys("pqr", 0.005), **dict.fromkeys(("ax", "ay", "az"), 0.15)}
_UNIT = {
    **dict.fromkeys(_ANGLES, "rad"), **dict.fromkeys("pqr", "rad/s"), **dict.fromkeys(("ax", "ay", "az"), "m/s^2"),
    "V": "m/s",
}  # fmt: skip


def bias_variants(flights: Flights) -> list[Variant]:
    """Forms of a bias; a constant in each manoeuvre goes free, so far as it shifts a response by a constant."""
    made = list(constant_biases(flights))
    for channel in present(flights, (*AIR, *INERTIAL, *ATTITUDE, *CONTROLS)):
        sd, unit, name = _sd(flights, channel), _UNIT[channel], INSTRUMENTS[channel]
        drift = EffectParameter("drift", f"{unit}/min" if "/" not in unit else f"{unit} per min", 2.0 * sd)
        columns, words = wrong_readings(partial(_drift, channel=channel)), {"instrument": name}
        made.append(Variant((drift,), columns, about=f"{name}, drifting", words=words))
    return made


def constant_biases(flights: Flights) -> list[Variant]:
    """Of each instrument, one constant in all recordings."""
    made = []
    for channel in present(flights, (*AIR, *INERTIAL, *ATTITUDE, *CONTROLS)):
        sd = _sd(flights, channel)
        constant = EffectParameter("bias", _UNIT[channel], sd, -10.0 * sd, 10.0 * sd)
        columns = wrong_readings(partial(_level, channel=channel))
        name = INSTRUMENTS[channel]
        made.append(Variant((constant,), columns, about=name, words={"instrument": name}))
    return made


def _sd(flights: Flights, channel: str) -> float:
    return 0.02 * float(gathered(flights, "V").mean()) if channel == "V" else _SIZE[channel]


def _level(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: 1.0}]


def _drift(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: (flight.t - flight.t[0]) / 60.0}]


def bias_says(found: FittedEffect) -> str:
    """The sentence of a bias."""
    words = found.variant.words
    instrument = capital(words["instrument"])
    if "drift" in found.estimates:
        return f"{instrument} drifts by {shown(found, 'drift')}."
    when = f", {words['when']}" if "when" in words else ""
    return f"{instrument} is biased by {shown(found, 'bias')}{when}."
