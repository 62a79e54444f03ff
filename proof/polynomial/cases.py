"""Families of cases: one effect, two, none, several small ones with a main one, and physics without a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from proof.case_files import Case
from proof.keys import EffectKey, Form
from proof.polynomial import effects_aerodynamic, effects_instruments, effects_propulsion, effects_systems, unmodelled
from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import AIRCRAFT_NAMES, truth_aircraft
from proof.polynomial.assembly import assemble, describe, make_single, make_windy
from proof.polynomial.effects import Effect, EffectDesign, Injection
from proof.polynomial.effects_declared import declared_effect
from proof.polynomial.scenario import Scenario, draw_scenario
from proof.polynomial.simulate import (
    AIMED,
    ScenarioResult,
    contribution_of,
    effect_context,
    scale_effect,
    simulate_scenario,
)
from proof.polynomial.single_channel import SINGLE_CHANNEL, make_single_channel
from proof.polynomial.terms import AXES
from proof.scenario.declared import DeclaredEffect
from proof.scenario.errors import EXCLUSIVE, may_combine, severity_of
from proof.scenario.instruments import InstrumentErrors
from proof.scenario.sizing import NotAttainable

_ROOMS = (effects_aerodynamic, effects_propulsion, effects_systems, effects_instruments)
SINGLES: tuple[Effect, ...] = tuple(effect for room in _ROOMS for effect in room.EFFECTS)
NAMES = tuple(sorted({e.name for e in SINGLES} | set(SINGLE_CHANNEL)))
"""Effects that can be drawn."""
NULLS = ("plain", "biases", "coloured", "turbulence")
_WINDY = ("steady-wind", "wind-shear")
_SMALL = (0.03, 0.06)


def make(
    family: str,
    rng: np.random.Generator,
    seed: int,
    attempt: int,
    effect: str | None,
    severity: str,
    declared: Sequence[DeclaredEffect] = (),
) -> Case:
    """A case of a family; see `proof.generate.draw_case`. Declared effects join the singles.

    Raises
    ------
    NotAttainable
        The flights diverge, or the effect is too small to be seen.
    KeyError
        No such effect can be drawn.
    """
    states = ins.RAW if rng.random() < 0.15 else ins.RECONSTRUCTED
    form: Form = "free" if rng.random() < 0.15 else "forced"
    if family == "null":
        return _null(rng, seed, attempt, form, states)
    if family in ("pair", "clutter"):
        return _several("pair" if family == "pair" else "clutter", rng, seed, attempt, form, severity)
    if family == "outside":
        chosen = unmodelled.EFFECTS[int(rng.integers(len(unmodelled.EFFECTS)))]
        case = make_single(chosen, _aircraft_for(chosen, rng), severity, seed, "forced", states, attempt)
        verdicts = ("mismatch", "consistent") if "turbulence" in case.key.effects[0].tie else ("mismatch",)
        return replace(case, key=case.key.model_copy(update={"family": "outside", "verdicts": verdicts}))
    singles = (*SINGLES, *map(declared_effect, declared))
    names = (*NAMES, *(d.name for d in declared))
    name = effect or str(rng.choice(names))
    if name in SINGLE_CHANNEL:
        return make_single_channel(
            name, float(rng.uniform(*AIMED[severity])), seed, attempt, "free" if rng.random() < 0.6 else "forced"
        )
    able = [e for e in singles if e.name == name]
    if not able:
        raise KeyError(f"no effect '{name}' can be drawn; there are {', '.join(names)}")
    chosen = able[int(rng.integers(len(able)))]
    if name in _WINDY:
        return make_windy(chosen, _aircraft_for(chosen, rng), severity, seed, attempt)
    if name == "turbulence":
        states = ins.RECONSTRUCTED
    case = make_single(chosen, _aircraft_for(chosen, rng), severity, seed, form, states, attempt)
    if name == "turbulence":
        return replace(case, key=case.key.model_copy(update={"verdicts": ("consistent",)}))
    return case


def _aircraft_for(effect: Effect, rng: np.random.Generator) -> str:
    return str(rng.choice(effect.aircraft or AIRCRAFT_NAMES))


def _null(rng: np.random.Generator, seed: int, attempt: int, form: Form, states: str) -> Case:
    """Nothing left out: errors within the tolerances, noise, biases, perhaps turbulence."""
    kind = NULLS[int(rng.integers(len(NULLS)))]
    scenario = draw_scenario([], truth_aircraft(str(rng.choice(AIRCRAFT_NAMES))), seed, states, attempt)
    injection, effects = Injection(), []
    if kind == "biases":
        scenario.biases = [{n: 2.0 * b for n, b in held.items()} for held in scenario.biases]
    if kind == "coloured":
        injection = Injection(errors=InstrumentErrors(bias=_autocorrelated(scenario, rng)))
    if kind == "turbulence":
        design = next(e for e in SINGLES if e.name == "turbulence").make(effect_context(scenario, seed, attempt, 3))
        injection = design.at(float(rng.uniform(0.15, 0.9)))
        effects = [
            EffectKey(
                effect="turbulence",
                accept=("turbulence",),
                tie=("unknown",),
                kinds=("random",),
                axes=AXES,
                parameters=injection.parameters,
            )
        ]
    result = simulate_scenario(scenario, injection)
    case = assemble(scenario, result, form, effects, "none", "null", ("consistent",))
    return replace(case, key=case.key.model_copy(update={"attainable": dict.fromkeys(AXES, 0.0)}))


def _autocorrelated(scenario: Scenario, rng: np.random.Generator) -> dict[str, list[np.ndarray]]:
    """Noise that keeps for a fraction of a second, of a size like the white noise's."""
    made: dict[str, list[np.ndarray]] = {}
    for channel in ("ax", "ay", "az", "alpha", "beta", "p", "q", "r"):
        keep = float(np.exp(-1.0 / (scenario.rate * rng.uniform(0.1, 0.5))))
        counts = [round(p.duration * scenario.rate) + 1 for p in scenario.manoeuvres]
        made[channel] = [
            scenario.noise[channel] * np.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], rng.standard_normal(n))
            for n in counts
        ]
    return made


def _several(
    family: Literal["pair", "clutter"], rng: np.random.Generator, seed: int, attempt: int, form: Form, severity: str
) -> Case:
    """Two effects of like size, or a main one among small ones."""
    base = truth_aircraft(str(rng.choice(AIRCRAFT_NAMES)))
    able = [e for e in SINGLES if (not e.aircraft or base.name in e.aircraft) and e.name not in (*_WINDY, "turbulence")]
    count = 2 if family == "pair" else int(rng.integers(3, 5))
    chosen: list[Effect] = []
    for i in rng.permutation(len(able)):
        if len(chosen) < count and may_combine(able[i].name, [e.name for e in chosen], EXCLUSIVE):
            chosen.append(able[i])
    # Every effect gets the manoeuvres it needs most.
    shortened = [replace(e, needs=e.needs[: 6 // count + 1]) for e in chosen]
    scenario = draw_scenario(shortened, base, seed, ins.RECONSTRUCTED, attempt)
    parts: list[tuple[Effect, EffectDesign, Injection, ScenarioResult]] = []
    taken: tuple[str, ...] = ()
    for i, effect in enumerate(chosen):
        context = effect_context(scenario, seed, attempt, 20 + i)
        design = effect.make(context)
        wanted = rng.uniform(*(AIMED[severity] if i == 0 or family == "pair" else _SMALL))
        _, injection, result = scale_effect(
            scenario, design, float(max(wanted, 0.1) if family == "pair" else wanted), fixed=taken
        )
        if i == 0 or family == "pair":
            # A tolerance may have kept it from being as small as wanted, or plausibility from being as large.
            if result.expected(design.axes) < 0.06:
                raise NotAttainable(effect.name)
        elif result.expected(design.axes) > 0.12:
            raise NotAttainable(f"{effect.name} is not small")
        parts.append((effect, design, injection, result))
        taken += design.axes
    parts = sorted(parts, key=lambda p: -p[3].expected(p[1].axes))
    combined = parts[0][2]
    for _, _, injection, _ in parts[1:]:
        combined = Injection(combined.physics.joined(injection.physics), combined.errors.joined(injection.errors))
    result = simulate_scenario(scenario, combined)
    if max(result.attainable.values()) < 0.05:
        raise NotAttainable("they hide each other")
    keys = [describe(e, c, injection, alone) for e, c, injection, alone in parts]
    case = assemble(scenario, result, form, keys, severity_of(max(result.attainable.values())), family)
    if family == "pair" and case.contribution:
        # To first order: the other effect alone also moves the aircraft otherwise.
        others = [contribution_of(scenario, injection) for _, _, injection, _ in reversed(parts)]
        of_each = tuple(tuple(x - y for x, y in zip(case.contribution, other)) for other in others)
        return replace(case, of_each=of_each)
    return case
