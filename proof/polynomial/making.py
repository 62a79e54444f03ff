"""From effects and a seed to a case: flown, sized, read by instruments, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import Craft, Term
from proof.polynomial.effects import Concept, Effect, Entry
from proof.polynomial.flight import Flown, Physics, fly_truth, settings_of
from proof.polynomial.instruments import Channels, Faults
from proof.polynomial.manoeuvres import Plan, draw_plans
from proof.polynomial.terms import AXES
from proof.scenario.measurement import OFF_BY, gains, measured
from proof.scenario.sizing import NotAttainable
from structsel.aircraft import Aircraft, Tolerances

SHARES = {"easy": (0.32, 0.65), "medium": (0.16, 0.29), "hard": (0.06, 0.14)}
"""Attainable in the main axis, by severity."""
_EVENTS = ("configuration-change", "store-release")
_THRUST_NOISE = 0.003  # of its mean
_TIGHT = {
    "main": 0.01,
    "secondary": 0.03,
    "mass": 0.003,
    "inertia": 0.01,
    "cg": 0.001,
    "thrust": 0.01,
    "vane_scale": 0.005,
    "alignment": 0.002,
    "delay": 0.002,
    "lever_arm": 0.05,
}
_BETWEEN = {
    "main": 0.02,
    "secondary": 0.06,
    "mass": 0.005,
    "inertia": 0.02,
    "cg": 0.002,
    "thrust": 0.015,
    "vane_scale": 0.008,
    "alignment": 0.003,
    "delay": 0.003,
    "lever_arm": 0.1,
}


@dataclass
class Scene:
    """All that is drawn before an effect has a size."""

    craft: Craft
    aircraft: Aircraft
    plans: list[Plan]
    settings: dict[str, float]
    ground: float
    rate: float
    states: str
    channels: tuple[str, ...]
    sim_terms: tuple[Term, ...]
    background: Entry
    noise: dict[str, float]
    biases: list[dict[str, float]]
    wrong: dict[str, dict[str, float]]
    seed: int


@dataclass
class Outcome:
    """A scene flown with what enters."""

    entry: Entry
    flown: list[Flown]
    clean: list[Channels]
    faulty: list[Channels]
    readings: list[Channels]
    told: list[Channels]
    before: list[np.ndarray]
    after: list[np.ndarray]
    delta: list[np.ndarray]
    simulated: list[np.ndarray]

    @property
    def attainable(self) -> dict[str, float]:
        """Of all coefficients."""
        return gains(self.before, self.after)

    def _sizes(self, axes: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Rms of what the effect brings, and of what is there without it."""
        chosen = [AXES.index(a) for a in axes]
        brought, left = (np.sqrt(np.mean(np.concatenate(x)[:, chosen] ** 2, axis=0)) for x in (self.delta, self.after))
        return brought, left

    def expected(self, axes: Sequence[str], stretch: float = 1.0) -> float:
        """Attainable share in the main axis if the effect and what is there without it have nothing in common."""
        brought, left = self._sizes(axes)
        return float(np.max(1.0 - left / np.hypot(left, stretch * brought)))

    def share(self, axes: Sequence[str]) -> float:
        """What is attainable in the axis where the effect stands out most."""
        return self.attainable[max(axes, key=lambda a: self.expected([a]))]

    def stretch(self, axes: Sequence[str], wanted: float) -> float:
        """By how much the effect must grow for that share, between 0.02 and 20."""
        low, high = np.log(0.02), np.log(20.0)
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.expected(axes, np.exp(middle)) < wanted else (low, middle)
        return float(np.exp(middle))


def draw_scene(effects: Sequence[Effect], base: Craft, seed: int, states: str, attempt: int = 0) -> Scene:
    """Aircraft, manoeuvres, instruments and errors within the tolerances."""
    rng = np.random.default_rng([seed, attempt, 1])
    truth = base.sister(rng)
    choice = rng.choice(3, p=[0.5, 0.25, 0.25])
    tolerances = Tolerances(**[_TIGHT, _BETWEEN, {}][choice])  # type: ignore[arg-type]
    ground = float(rng.uniform(0.0, 800.0))
    rate = float(rng.choice([25.0, 50.0]))
    duration = float(rng.integers(22, 36))
    needed: list[str] = []
    for effect in effects:
        needed += list(effect.needs)
    low, high = base.heights
    bands = None
    if max((e.bands for e in effects), default=1) > 1:
        bands = [(low, low + 0.1 * (high - low)), (high - 0.1 * (high - low), high)]
    plans = draw_plans(truth, needed[:7], rng, duration=duration, ground=ground, bands=bands)
    stated = base.aircraft
    seat = (float(rng.uniform(-0.8, 1.1)), 0.0, float(rng.uniform(-0.1, 0.1)))
    boom = (float(rng.uniform(2.0, 4.5)) * stated.cbar * 0.8, 0.0, 0.0)
    content = stated.model_dump(mode="json", by_alias=True, exclude_none=True)
    content |= {
        "name": f"aircraft {seed}",
        "tolerances": tolerances.model_dump(),
        "sensors": {"accelerometer": {"position": seat}, "vane": {"position": boom}},
        "simulation": {"states": states} if rng.random() < 0.5 else {},
    }
    aircraft = Aircraft.from_dict(content)
    level = float(rng.uniform(1.0, 1.7))
    share = float(rng.choice(OFF_BY))
    half = 0.5 * share
    factor = lambda key: 1.0 + half * float(getattr(tolerances, key)) * float(rng.standard_normal())  # noqa: E731
    wrong = {
        "scale": {n: factor("vane_scale") - 1.0 for n in ("alpha", "beta")},
        "delay": {n: abs(factor("delay") - 1.0) for n in ("alpha", "beta", "V")},
    }
    shift = [half * float(tolerances.lever_arm) * float(z) * 0.5 for z in rng.standard_normal(3)]  # type: ignore[arg-type]
    entry = Entry(
        Physics(
            mass=factor("mass"),
            inertia={k: factor("inertia") for k in ("Ix", "Iy", "Iz")},
            settings={"arm_x": half * float(tolerances.cg) * float(rng.standard_normal()) * stated.cbar},  # type: ignore[arg-type]
        ),
        Faults(
            place={"accelerometer": (shift[0], 0.0, 0.0)},
            mix=[("ax", "az", half * float(tolerances.alignment) * float(rng.standard_normal()))],
        ),
    )
    biases = [{n: s * float(rng.standard_normal()) for n, s in ins.BIAS.items()} for _ in plans]
    terms = truth.off(rng, share * float(tolerances.main), share * float(tolerances.secondary))  # type: ignore[arg-type]
    extra = {c for e in effects for c in e.channels}
    # Channels that an effect needs are there at other times as well.
    if truth.propeller or rng.random() < 0.3:
        extra.add("rpm")
    if rng.random() < 0.2:
        extra.add("vn")
    if truth.value("CZ", "df") and rng.random() < 0.4 and not any(e.name in _EVENTS for e in effects):
        # A flap that the simulation knows.
        extra.add("df")
        for k in rng.choice(len(plans), 2, replace=False):
            if plans[k].purpose not in ("stall", "low-pass"):
                start = float(rng.uniform(0.3, 0.6)) * duration
                plans[k].ramp("df", start, start + 3.0, 0.12)
    return Scene(
        truth,
        aircraft,
        plans,
        settings_of(truth, plans, ground),
        ground,
        rate,
        states,
        tuple(sorted(extra)),
        terms,
        entry,
        {n: s * level for n, s in ins.NOISE.items()} | {"thrust": _THRUST_NOISE},
        biases,
        wrong,
        seed,
    )


def play(scene: Scene, entry: Entry) -> Outcome:
    """Fly and read the scene with what enters, beside a perfect account of it."""
    # What the tolerances cover is in the perfect account's data too, so it is laid under both.
    physics, faults = scene.background.physics.joined(entry.physics), scene.background.faults.joined(entry.faults)
    arm = scene.background.physics.settings.get("arm_x", 0.0) + entry.physics.settings.get("arm_x", 0.0)
    physics.settings["arm_x"] = arm
    flown = fly_truth(scene.craft, scene.plans, physics, scene.settings, scene.rate)
    out = Outcome(entry, flown, [], [], [], [], [], [], [], [])
    air, V0 = scene.aircraft, scene.settings["V0"]
    tensor = air.require_inertia("play").tensor
    under = scene.background.physics
    for k, f in enumerate(flown):
        quiet = Faults(place=scene.background.faults.place, mix=scene.background.faults.mix)
        clean = ins.channels_of(f, air, scene.ground, scene.channels, quiet, k)
        faulty = ins.channels_of(f, air, scene.ground, scene.channels, faults, k)
        seed = 1000 * scene.seed + k
        noise = {**scene.noise, "thrust": scene.noise["thrust"] * float(np.mean(faulty["thrust"]))}
        readings = ins.read(f.t, faulty, noise, scene.biases[k], seed, scene.wrong)
        better = ins.read(f.t, clean, noise, scene.biases[k], seed, scene.wrong)
        rng = np.random.default_rng([scene.seed, 7, k])
        if scene.states == ins.RAW:
            told, ideal = ins.told_raw(readings, air), ins.told_raw(better, air)
        else:
            told = ins.told_smooth(f, clean, faulty, faults.calm, rng)
            ideal = ins.told_smooth(f, clean, clean, False, np.random.default_rng([scene.seed, 7, k]))
        for control in ("de", "da", "dr"):
            ideal[control] = ideal[control] + f.reads[f"{control}_true"] - f.reads[control]
        ideal["thrust"] = f.reads["thrust"]
        # The moment that the background's centre of gravity brings is no part of the effect.
        extras, shift = f.extras.copy(), scene.background.physics.settings.get("arm_x", 0.0)
        extras[:, 4] -= f.coefs[:, 2] * shift / air.cbar
        extras[:, 5] += f.coefs[:, 1] * shift / air.b
        S0 = ins.simulated(scene.sim_terms, f, air, told, V0)
        S1 = ins.simulated(scene.sim_terms, f, air, ideal, V0) + extras
        M0 = measured(f.t, readings, air, mass=air.mass or 0.0, inertia=tensor, thrust=readings["thrust"])
        # The perfect account: true mass and inertia as far as the effect changes them, true thrust, sound instruments.
        mass = (air.mass or 0.0) * f.reads["mass"] / (under.mass * (scene.craft.aircraft.mass or 1.0))
        real = tensor.copy()
        for key, value in entry.physics.inertia.items():
            i, j = "xyz".index(key[1]), "xyz".index(key[-1])
            real[i, j] *= value
            real[j, i] = real[i, j]
        thrust = readings["thrust"] + f.reads["thrust"] - f.reads["thrust_model"]
        M1 = measured(f.t, better, air, mass=mass, inertia=real, thrust=thrust)
        if entry.physics.after != 1.0:
            gone = f.reads["mass"] < 0.999 * f.reads["mass"][0]
            later = measured(f.t, better, air, mass=mass, inertia=real * entry.physics.after, thrust=thrust)
            M1[gone] = later[gone]
        out.clean.append(clean)
        out.faulty.append(faulty)
        out.readings.append(readings)
        out.told.append(told)
        out.simulated.append(S0)
        out.before.append(M0 - S0)
        out.after.append(M1 - S1)
        out.delta.append((M0 - S0) - (M1 - S1))
    return out


def contribution_of(scene: Scene, outcome: Outcome) -> tuple[np.ndarray, ...]:
    """What an outcome's effects add to measured less simulated (n, 6), as instruments without noise would show it."""
    return tuple(play(replace(scene, noise=dict.fromkeys(scene.noise, 0.0)), outcome.entry).delta)


def find_size(
    scene: Scene, concept: Concept, wanted: float, tries: int = 5, fixed: Sequence[str] = ()
) -> tuple[float, Entry, Outcome]:
    """Size at which the attainable share in the main axis is about as wanted, as far as it is plausible.

    Where the simulation's own errors happen to hide the effect or to add to it, they are turned round (in
    `scene`), but for those of the `fixed` axes.

    Raises
    ------
    NotAttainable
        Where it cannot be flown.
    """
    size = float(np.clip(1.0, concept.low, concept.high))
    best: tuple[float, float, Entry, Outcome] | None = None
    for _ in range(tries):
        entry = concept.at(size)
        try:
            outcome = play(scene, entry)
        except NotAttainable:
            size *= 0.6
            if size < concept.low:
                break
            continue
        if best is None or abs(outcome.expected(concept.axes) - wanted) < best[0]:
            best = (abs(outcome.expected(concept.axes) - wanted), size, entry, outcome)
        if best[0] < 0.15 * wanted:
            break
        new = float(np.clip(size * outcome.stretch(concept.axes, wanted), concept.low, concept.high))
        if abs(new - size) < 0.02 * size:
            break
        size = new
    if best is None:
        raise NotAttainable("no size could be flown")
    _, size, entry, outcome = best
    return size, entry, _turned(scene, entry, outcome, [a for a in concept.axes if a not in fixed])


def _turned(scene: Scene, entry: Entry, outcome: Outcome, axes: Sequence[str]) -> Outcome:
    """The outcome with the simulation's own errors of an axis turned round where they hide the effect or add to it."""
    miss = {a: abs(outcome.attainable[a] - outcome.expected([a])) for a in axes}
    doubtful = {a for a in axes if miss[a] > 0.25 * outcome.expected([a])}
    kept = scene.sim_terms
    for _ in range(2):
        if not doubtful:
            break
        scene.sim_terms = tuple(
            (a, w, 2.0 * v - x if a in doubtful else x) for (a, w, v), (_, _, x) in zip(scene.craft.terms, kept)
        )
        other = play(scene, entry)
        worse = {a for a in doubtful if abs(other.attainable[a] - other.expected([a])) > miss[a]}
        if not worse:
            return other
        doubtful -= worse
    scene.sim_terms = kept
    return outcome
