"""Declared effects in the polynomial plant."""

from __future__ import annotations

import numpy as np

from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection
from proof.polynomial.flight import InjectedPhysics
from proof.polynomial.manoeuvres import DT, SETTLING
from proof.polynomial.terms import INDEX
from proof.scenario.declared import DeclaredEffect, Factors, band_noise, strength


def declared_effect(declared: DeclaredEffect) -> Effect:
    """The effect as the polynomial plant draws it."""
    truth = declared.truth

    def make(c: EffectContext) -> EffectDesign:
        schedules = {"clock": _signal(declared, c)} if truth.signals else {}
        terms = [(axis, _text(factors, truth.signals), value) for axis, factors, value in declared.terms]

        def at(size: float) -> Injection:
            scaled = [(axis, text, size * value) for axis, text, value in terms]
            return Injection(
                InjectedPhysics(scaled, schedules=schedules), parameters={f"{a}:{x}": v for a, x, v in scaled}
            )

        return EffectDesign(at, declared.axes, truth.ties, low=truth.sizes[0], high=truth.sizes[1])

    return Effect(declared.name, (declared.kind,), make, declared.manoeuvres(0))


def _text(factors: Factors, signals: object) -> str:
    """A term as the plant writes it; the signal runs as the clock."""
    return "*".join(
        ("clock" if name in signals else name) + (f"^{power}" if power > 1 else "")  # type: ignore[operator]
        for name, power in factors
    )


def _signal(declared: DeclaredEffect, c: EffectContext) -> list[np.ndarray]:
    """The signal through each manoeuvre; its strength is that along the flight without the effect."""
    (signal,) = declared.truth.signals.values()
    made = []
    for manoeuvre, flight in zip(c.manoeuvres, c.base):
        values = {signal.beyond: flight.table[:, INDEX[signal.beyond]]} if signal.beyond else {}
        factor = np.broadcast_to(strength(signal, values), len(flight.t))
        t = DT * np.arange(len(manoeuvre.schedules)) - SETTLING
        made.append(band_noise(signal, t, c.rng) * np.interp(t, flight.t, factor, left=0.0))
    return made
