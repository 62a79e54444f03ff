"""Declared effects as forces added to a JSBSim aircraft."""

from __future__ import annotations

import numpy as np

from proof.jsbsim.added_force import AddedForceSpec, Formula, Memory, Now, Six, delayed, lagged
from proof.keys import COEFFICIENTS
from proof.scenario.declared import DeclaredEffect, band_noise, product, strength
from structsel.aircraft import Aircraft

_CLOCK = np.arange(0.0, 40.0, 0.01)  # s, longer than any manoeuvre


def declared_force(declared: DeclaredEffect) -> AddedForceSpec:
    """The effect as a force that is added in flight."""
    truth = declared.truth

    def make(
        rng: np.random.Generator, aircraft: Aircraft, events: dict[int, float]
    ) -> tuple[Formula, dict[str, float]]:
        seed = int(rng.integers(2**31))
        noise: dict[int, dict[str, np.ndarray]] = {}

        def formula(now: Now, memory: Memory, dt: float) -> Six:
            values = _values(now, aircraft)
            number = int(now["number"])
            if declared.noise and number not in noise:
                own = np.random.default_rng([seed, number])
                noise[number] = {name: band_noise(signal, _CLOCK, own) for name, signal in declared.noise.items()}
            for name, signal in declared.noise.items():
                at = min(max(round(now["t"] / 0.01), 0), len(_CLOCK) - 1)
                values[name] = float(noise[number][name][at] * strength(signal, values))
            for s in declared.following:
                follow, by = (delayed, s.delay) if s.delay else (lagged, s.time_constant)
                values[s.name] = follow(memory, s.name, values[s.of], dt, by)
            made = [0.0] * 6
            for axis, factors, value in declared.terms:
                made[COEFFICIENTS.index(axis)] += value * float(product(factors, values))
            return tuple(made)

        return formula, {}

    low, high = truth.sizes
    return AddedForceSpec(
        make, declared.kind, declared.manoeuvres(1), truth.ties, largest=high, smallest=low,
    )  # fmt: skip


def _values(now: Now, aircraft: Aircraft) -> dict[str, float]:
    """Variables of a formula at one step."""
    per_rate = 0.5 / now["V"]
    made = {"1": 1.0, "CT": now["thrust"] / (now["qbar"] * aircraft.S)}
    made |= {name: now.get(name, 0.0) for name in ("alpha", "beta", "de", "da", "dr", "df")}
    lengths = {"p": aircraft.b, "q": aircraft.cbar, "r": aircraft.b}
    made |= {f"{rate}_hat": now[rate] * length * per_rate for rate, length in lengths.items()}
    made |= {f"abs_{name}": abs(made[name]) for name in ("alpha", "beta", "de", "da", "dr")}
    made["CL"] = -now["CZ"]
    return made
