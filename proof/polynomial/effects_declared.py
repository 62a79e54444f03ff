"""Declared effects in the polynomial plant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from proof.polynomial.aircraft import AIRCRAFT_NAMES, truth_aircraft
from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection
from proof.polynomial.flight import InjectedPhysics
from proof.polynomial.manoeuvres import DT, SETTLING
from proof.polynomial.terms import INDEX, SIGNALS
from proof.scenario.declared import DeclaredEffect, Factors, band_noise, strength


def declared_effect(declared: DeclaredEffect) -> Effect:
    """The effect as the polynomial plant draws it."""
    truth = declared.truth
    own = dict.fromkeys(declared.noise, "clock") | dict(zip((s.name for s in declared.following), SIGNALS))
    following = tuple((s.of, s.time_constant, s.delay) for s in declared.following)
    flapped = tuple(n for n in AIRCRAFT_NAMES if truth_aircraft(n).value("CZ", "df")) if declared.needs_flap else ()

    def make(c: EffectContext) -> EffectDesign:
        schedules = {"clock": _noise(declared, c)} if declared.noise else {}
        terms = [(axis, _text(factors, {}), _text(factors, own), value) for axis, factors, value in declared.terms]

        def at(size: float) -> Injection:
            scaled = [(axis, text, size * value) for axis, _, text, value in terms]
            return Injection(
                InjectedPhysics(scaled, schedules=schedules, signals=following),
                parameters={f"{axis}:{text}": size * value for axis, text, _, value in terms},
            )

        return EffectDesign(at, declared.axes, truth.ties, low=truth.sizes[0], high=truth.sizes[1])

    channels = ("df",) if declared.needs_flap else ()
    return Effect(declared.name, (declared.kind,), make, declared.manoeuvres(0), flapped, channels=channels)


def _text(factors: Factors, own: Mapping[str, str]) -> str:
    """A term, with the plant's names of some factors."""
    return "*".join(own.get(name, name) + (f"^{power}" if power > 1 else "") for name, power in factors)


def _noise(declared: DeclaredEffect, c: EffectContext) -> list[np.ndarray]:
    """The random signal through each manoeuvre; its strength is that along the flight without the effect."""
    (signal,) = declared.noise.values()
    made = []
    for manoeuvre, flight in zip(c.manoeuvres, c.base):
        values = {signal.beyond: flight.table[:, INDEX[signal.beyond]]} if signal.beyond else {}
        factor = np.broadcast_to(strength(signal, values), len(flight.t))
        t = DT * np.arange(len(manoeuvre.schedules)) - SETTLING
        made.append(band_noise(signal, t, c.rng) * np.interp(t, flight.t, factor, left=0.0))
    return made
