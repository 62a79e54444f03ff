"""The families of cases: one effect, two, none, several small ones beside a main one, and physics without a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from proof.case_files import Case
from proof.keys import EffectKey, Form
from proof.polynomial import effects_aerodynamic, effects_instruments, effects_systems, unmodelled
from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import CRAFTS, craft
from proof.polynomial.effects import Concept, Context, Effect, Entry
from proof.polynomial.flight import fly_truth
from proof.polynomial.handing import assemble, describe, make_single, make_windy, severity_of
from proof.polynomial.instruments import Faults
from proof.polynomial.making import SHARES, Outcome, Scene, draw_scene, find_size, play
from proof.polynomial.single_channel import PLANTS, make_plant
from proof.polynomial.terms import AXES
from proof.scenario.sizing import NotAttainable

SINGLES: tuple[Effect, ...] = effects_aerodynamic.EFFECTS + effects_systems.EFFECTS + effects_instruments.EFFECTS
NAMES = tuple(sorted({e.name for e in SINGLES} | set(PLANTS)))
"""Effects that can be drawn."""
NULLS = ("plain", "biases", "coloured", "turbulence")
_WINDY = ("steady-wind", "wind-shear")
_SMALL = (0.03, 0.06)


def make(family: str, rng: np.random.Generator, seed: int, attempt: int, effect: str | None, severity: str) -> Case:
    """A case of a family; see `proof.generate.draw_case`.

    Raises
    ------
    NotAttainable
        What was drawn cannot be flown or does not show.
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
        case = make_single(chosen, _craft(chosen, rng), severity, seed, "forced", states, attempt)
        verdicts = ("mismatch", "consistent") if "turbulence" in case.key.effects[0].tie else ("mismatch",)
        return replace(case, key=case.key.model_copy(update={"family": "outside", "verdicts": verdicts}))
    name = effect or str(rng.choice(NAMES))
    if name in PLANTS:
        return make_plant(
            name, float(rng.uniform(*SHARES[severity])), seed, attempt, "free" if rng.random() < 0.6 else "forced"
        )
    able = [e for e in SINGLES if e.name == name]
    if not able:
        raise KeyError(f"no effect '{name}' can be drawn; there are {', '.join(NAMES)}")
    chosen = able[int(rng.integers(len(able)))]
    if name in _WINDY:
        return make_windy(chosen, _craft(chosen, rng), severity, seed, attempt)
    if name == "turbulence":
        states = ins.RECONSTRUCTED
    case = make_single(chosen, _craft(chosen, rng), severity, seed, form, states, attempt)
    if name == "turbulence":
        return replace(case, key=case.key.model_copy(update={"verdicts": ("consistent",)}))
    return case


def _craft(effect: Effect, rng: np.random.Generator) -> str:
    return str(rng.choice(effect.crafts or CRAFTS))


def _context(scene: Scene, seed: Sequence[int]) -> Context:
    base = fly_truth(scene.craft, scene.plans, scene.background.physics, scene.settings, scene.rate)
    return Context(
        scene.craft, scene.plans, base, scene.settings, scene.aircraft.tolerances, np.random.default_rng(list(seed))
    )


def _null(rng: np.random.Generator, seed: int, attempt: int, form: Form, states: str) -> Case:
    """Nothing left out: errors within the tolerances, noise, biases, perhaps turbulence."""
    kind = NULLS[int(rng.integers(len(NULLS)))]
    scene = draw_scene([], craft(str(rng.choice(CRAFTS))), seed, states, attempt)
    entry, effects = Entry(), []
    if kind == "biases":
        scene.biases = [{n: 2.0 * b for n, b in held.items()} for held in scene.biases]
    if kind == "coloured":
        entry = Entry(faults=Faults(bias=_coloured(scene, rng)))
    if kind == "turbulence":
        concept = next(e for e in SINGLES if e.name == "turbulence").make(_context(scene, (seed, attempt, 3)))
        entry = concept.at(float(rng.uniform(0.15, 0.9)))
        effects = [
            EffectKey(
                effect="turbulence",
                accept=("turbulence",),
                tie=("unknown",),
                kinds=("random",),
                axes=AXES,
                parameters=entry.parameters,
            )
        ]
    outcome = play(scene, entry)
    case = assemble(scene, outcome, form, effects, "none", "null", ("consistent",))
    return replace(case, key=case.key.model_copy(update={"attainable": dict.fromkeys(AXES, 0.0)}))


def _coloured(scene: Scene, rng: np.random.Generator) -> dict[str, list[np.ndarray]]:
    """Noise that keeps for a fraction of a second, of a size like the white noise's."""
    made: dict[str, list[np.ndarray]] = {}
    for channel in ("ax", "ay", "az", "alpha", "beta", "p", "q", "r"):
        keep = float(np.exp(-1.0 / (scene.rate * rng.uniform(0.1, 0.5))))
        counts = [round(p.duration * scene.rate) + 1 for p in scene.plans]
        made[channel] = [
            scene.noise[channel] * np.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], rng.standard_normal(n))
            for n in counts
        ]
    return made


def _several(
    family: Literal["pair", "clutter"], rng: np.random.Generator, seed: int, attempt: int, form: Form, severity: str
) -> Case:
    """Two effects of like size, or a main one among small ones."""
    base = craft(str(rng.choice(CRAFTS)))
    able = [e for e in SINGLES if (not e.crafts or base.name in e.crafts) and e.name not in (*_WINDY, "turbulence")]
    count = 2 if family == "pair" else int(rng.integers(3, 5))
    chosen: list[Effect] = []
    for i in rng.permutation(len(able)):
        if len(chosen) < count and all(_apart(able[i], other) for other in chosen):
            chosen.append(able[i])
    # Every effect gets the manoeuvres it needs most.
    shortened = [replace(e, needs=e.needs[: 6 // count + 1]) for e in chosen]
    scene = draw_scene(shortened, base, seed, ins.RECONSTRUCTED, attempt)
    parts: list[tuple[Effect, Concept, Entry, Outcome]] = []
    taken: tuple[str, ...] = ()
    for i, effect in enumerate(chosen):
        context = _context(scene, (seed, attempt, 20 + i))
        concept = effect.make(context)
        wanted = rng.uniform(*(SHARES[severity] if i == 0 or family == "pair" else _SMALL))
        _, entry, outcome = find_size(
            scene, concept, float(max(wanted, 0.1) if family == "pair" else wanted), fixed=taken
        )
        if i == 0 or family == "pair":
            # A tolerance may have kept it from being as small as wanted, or plausibility from being as large.
            if outcome.expected(concept.axes) < 0.06:
                raise NotAttainable(effect.name)
        elif outcome.expected(concept.axes) > 0.12:
            raise NotAttainable(f"{effect.name} is not small")
        parts.append((effect, concept, entry, outcome))
        taken += concept.axes
    parts = sorted(parts, key=lambda p: -p[3].expected(p[1].axes))
    whole = parts[0][2]
    for _, _, entry, _ in parts[1:]:
        whole = Entry(whole.physics.joined(entry.physics), whole.faults.joined(entry.faults))
    outcome = play(scene, whole)
    if max(outcome.attainable.values()) < 0.05:
        raise NotAttainable("they hide each other")
    keys = [describe(e, c, entry, alone) for e, c, entry, alone in parts]
    return assemble(scene, outcome, form, keys, severity_of(max(outcome.attainable.values())), family)


def _apart(one: Effect, other: Effect) -> bool:
    """Two effects that do not enter by the same door."""
    same = {
        "static-stall": 1,
        "stall-hysteresis": 1,
        "configuration-change": 2,
        "store-release": 2,
        "mass-error": 2,
        "asymmetric-thrust": 3,
        "actuator-lag": 4,
        "actuator-rate-limit": 4,
        "actuator-saturation": 4,
        "backlash": 4,
        "augmentation": 4,
        "gust": 5,
        "sensor-scale": 6,
        "position-error": 6,
        "sensor-bias": 7,
        "structural-mode": 7,
        "thrust-scale": 8,
        "thrust-lag": 8,
        "compressibility": 9,
        "flexibility": 9,
        "control-stretch": 9,
        "reynolds": 9,
    }
    return one.name != other.name and (same.get(one.name) is None or same.get(one.name) != same.get(other.name))
