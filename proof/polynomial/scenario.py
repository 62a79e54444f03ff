"""From effects and a seed to a scenario: aircraft, manoeuvres and errors; simulated, measured and sized."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import Term, TruthAircraft
from proof.polynomial.effects import Effect, EffectDesign, Injection
from proof.polynomial.flight import InjectedPhysics, TruthFlight, settings_of, simulate_truth
from proof.polynomial.manoeuvres import Manoeuvre, draw_manoeuvres
from proof.polynomial.terms import AXES
from proof.scenario.errors import BETWEEN, BIAS, NOISE, OFF_BY, THRUST_NOISE, TIGHT
from proof.scenario.instruments import Channels, InstrumentErrors, coefficients_of
from proof.scenario.sizing import NotAttainable, attainable
from structsel.aircraft import Aircraft, Tolerances

SHARES = {"easy": (0.32, 0.65), "medium": (0.16, 0.29), "hard": (0.06, 0.14)}
"""Attainable in the main axis, by severity."""
_EVENTS = ("configuration-change", "store-release")


@dataclass
class Scenario:
    """All that is drawn before an effect has a size."""

    truth: TruthAircraft
    aircraft: Aircraft
    manoeuvres: list[Manoeuvre]
    settings: dict[str, float]
    ground: float
    rate: float
    states: str
    channels: tuple[str, ...]
    sim_terms: tuple[Term, ...]
    background: Injection
    noise: dict[str, float]
    biases: list[dict[str, float]]
    wrong: dict[str, dict[str, float]]
    seed: int


@dataclass
class ScenarioResult:
    """A scene flown with what enters."""

    injection: Injection
    flights: list[TruthFlight]
    clean: list[Channels]
    faulty: list[Channels]
    readings: list[Channels]
    given: list[Channels]
    before: list[np.ndarray]
    after: list[np.ndarray]
    delta: list[np.ndarray]
    simulated: list[np.ndarray]

    @property
    def attainable(self) -> dict[str, float]:
        """Of all coefficients."""
        return attainable(self.before, self.after)

    def _sizes(self, axes: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Rms of what the effect brings, and of what is there without it."""
        chosen = [AXES.index(a) for a in axes]
        brought, left = (np.sqrt(np.mean(np.concatenate(x)[:, chosen] ** 2, axis=0)) for x in (self.delta, self.after))
        return brought, left

    def expected(self, axes: Sequence[str], stretch: float = 1.0) -> float:
        """Attainable fraction in the main axis if the effect and what is there without it have nothing in common."""
        brought, left = self._sizes(axes)
        return float(np.max(1.0 - left / np.hypot(left, stretch * brought)))

    def fraction(self, axes: Sequence[str]) -> float:
        """What is attainable in the axis where the effect stands out most."""
        return self.attainable[max(axes, key=lambda a: self.expected([a]))]

    def growth(self, axes: Sequence[str], wanted: float) -> float:
        """By how much the effect must grow for that share, between 0.02 and 20."""
        low, high = np.log(0.02), np.log(20.0)
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.expected(axes, np.exp(middle)) < wanted else (low, middle)
        return float(np.exp(middle))


def draw_scenario(effects: Sequence[Effect], base: TruthAircraft, seed: int, states: str, attempt: int = 0) -> Scenario:
    """Aircraft, manoeuvres, instruments and errors within the tolerances."""
    rng = np.random.default_rng([seed, attempt, 1])
    truth = base.perturbed_copy(rng)
    choice = rng.choice(3, p=[0.5, 0.25, 0.25])
    tolerances = Tolerances(**[TIGHT, BETWEEN, {}][choice])  # type: ignore[arg-type]
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
    manoeuvres = draw_manoeuvres(truth, needed[:7], rng, duration=duration, ground=ground, bands=bands)
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
    fraction = float(rng.choice(OFF_BY))
    half = 0.5 * fraction
    factor = lambda key: 1.0 + half * float(getattr(tolerances, key)) * float(rng.standard_normal())  # noqa: E731
    wrong = {
        "scale": {n: factor("vane_scale") - 1.0 for n in ("alpha", "beta")},
        "delay": {n: abs(factor("delay") - 1.0) for n in ("alpha", "beta", "V")},
    }
    shift = [half * float(tolerances.lever_arm) * float(z) * 0.5 for z in rng.standard_normal(3)]  # type: ignore[arg-type]
    injection = Injection(
        InjectedPhysics(
            mass=factor("mass"),
            inertia={k: factor("inertia") for k in ("Ix", "Iy", "Iz")},
            settings={"arm_x": half * float(tolerances.cg) * float(rng.standard_normal()) * stated.cbar},  # type: ignore[arg-type]
        ),
        InstrumentErrors(
            place={"accelerometer": (shift[0], 0.0, 0.0)},
            mix=(("ax", "az", half * float(tolerances.alignment) * float(rng.standard_normal())),),
        ),
    )
    biases = [{n: s * float(rng.standard_normal()) for n, s in BIAS.items()} for _ in manoeuvres]
    terms = truth.with_parameter_errors(rng, fraction * float(tolerances.main), fraction * float(tolerances.secondary))  # type: ignore[arg-type]
    extra = {c for e in effects for c in e.channels}
    # Channels that an effect needs are there at other times as well.
    if truth.propeller or rng.random() < 0.3:
        extra.add("rpm")
    if rng.random() < 0.2:
        extra.add("vn")
    if truth.value("CZ", "df") and rng.random() < 0.4 and not any(e.name in _EVENTS for e in effects):
        # A flap that the simulation knows.
        extra.add("df")
        for k in rng.choice(len(manoeuvres), 2, replace=False):
            if manoeuvres[k].purpose not in ("stall", "low-pass"):
                start = float(rng.uniform(0.3, 0.6)) * duration
                manoeuvres[k].ramp("df", start, start + 3.0, 0.12)
    return Scenario(
        truth,
        aircraft,
        manoeuvres,
        settings_of(truth, manoeuvres, ground),
        ground,
        rate,
        states,
        tuple(sorted(extra)),
        terms,
        injection,
        {n: s * level for n, s in NOISE.items()} | {"thrust": THRUST_NOISE},
        biases,
        wrong,
        seed,
    )


def simulate_scenario(scenario: Scenario, injection: Injection) -> ScenarioResult:
    """Fly and read the scene with what enters, beside a perfect account of it."""
    # What the tolerances cover is in the perfect account's data too, so it is laid under both.
    physics, errors = (
        scenario.background.physics.joined(injection.physics),
        scenario.background.errors.joined(injection.errors),
    )
    arm = scenario.background.physics.settings.get("arm_x", 0.0) + injection.physics.settings.get("arm_x", 0.0)
    physics.settings["arm_x"] = arm
    flights = simulate_truth(scenario.truth, scenario.manoeuvres, physics, scenario.settings, scenario.rate)
    out = ScenarioResult(injection, flights, [], [], [], [], [], [], [], [])
    air, V0 = scenario.aircraft, scenario.settings["V0"]
    tensor = air.require_inertia("play").tensor
    under = scenario.background.physics
    for k, f in enumerate(flights):
        quiet = InstrumentErrors(place=scenario.background.errors.place, mix=scenario.background.errors.mix)
        clean = ins.channels_of(f, air, scenario.ground, scenario.channels, quiet, k)
        faulty = ins.channels_of(f, air, scenario.ground, scenario.channels, errors, k)
        seed = 1000 * scenario.seed + k
        noise = {**scenario.noise, "thrust": scenario.noise["thrust"] * float(np.mean(faulty["thrust"]))}
        readings = ins.read(f.t, faulty, noise, scenario.biases[k], seed, scenario.wrong)
        better = ins.read(f.t, clean, noise, scenario.biases[k], seed, scenario.wrong)
        rng = np.random.default_rng([scenario.seed, 7, k])
        if scenario.states == ins.RAW:
            given, ideal = ins.raw_states(readings, air), ins.raw_states(better, air)
        else:
            given = ins.reconstructed_states(f, clean, faulty, errors.without_gusts, rng)
            ideal = ins.reconstructed_states(f, clean, clean, False, np.random.default_rng([scenario.seed, 7, k]))
        for control in ("de", "da", "dr"):
            ideal[control] = ideal[control] + f.reads[f"{control}_true"] - f.reads[control]
        ideal["thrust"] = f.reads["thrust"]
        # The moment that the background's centre of gravity brings is no part of the effect.
        extras, shift = f.extras.copy(), scenario.background.physics.settings.get("arm_x", 0.0)
        extras[:, 4] -= f.coefs[:, 2] * shift / air.cbar
        extras[:, 5] += f.coefs[:, 1] * shift / air.b
        S0 = ins.simulated(scenario.sim_terms, f, air, given, V0)
        S1 = ins.simulated(scenario.sim_terms, f, air, ideal, V0) + extras
        M0 = coefficients_of(f.t, readings, air)
        # The perfect account: true mass and inertia as far as the effect changes them, true thrust, sound instruments.
        mass = (air.mass or 0.0) * f.reads["mass"] / (under.mass * (scenario.truth.aircraft.mass or 1.0))
        real = tensor.copy()
        for key, value in injection.physics.inertia.items():
            i, j = "xyz".index(key[1]), "xyz".index(key[-1])
            real[i, j] *= value
            real[j, i] = real[i, j]
        thrust = readings["thrust"] + f.reads["thrust"] - f.reads["thrust_model"]
        M1 = coefficients_of(f.t, better, air, mass=mass, inertia=real, thrust=thrust)
        if injection.physics.after != 1.0:
            gone = f.reads["mass"] < 0.999 * f.reads["mass"][0]
            later = coefficients_of(f.t, better, air, mass=mass, inertia=real * injection.physics.after, thrust=thrust)
            M1[gone] = later[gone]
        out.clean.append(clean)
        out.faulty.append(faulty)
        out.readings.append(readings)
        out.given.append(given)
        out.simulated.append(S0)
        out.before.append(M0 - S0)
        out.after.append(M1 - S1)
        out.delta.append((M0 - S0) - (M1 - S1))
    return out


def contribution_of(scenario: Scenario, result: ScenarioResult) -> tuple[np.ndarray, ...]:
    """What an outcome's effects add to measured less simulated (n, 6), as instruments without noise would show it."""
    return tuple(simulate_scenario(replace(scenario, noise=dict.fromkeys(scenario.noise, 0.0)), result.injection).delta)


def scale_effect(
    scenario: Scenario, design: EffectDesign, wanted: float, tries: int = 5, fixed: Sequence[str] = ()
) -> tuple[float, Injection, ScenarioResult]:
    """Size at which the attainable fraction in the main axis is about as wanted, as far as it is plausible.

    Where the simulation's own errors happen to hide the effect or to add to it, they are turned round (in
    `scenario`), but for those of the `fixed` axes.

    Raises
    ------
    NotAttainable
        Where it cannot be flown.
    """
    size = float(np.clip(1.0, design.low, design.high))
    best: tuple[float, float, Injection, ScenarioResult] | None = None
    for _ in range(tries):
        injection = design.at(size)
        try:
            result = simulate_scenario(scenario, injection)
        except NotAttainable:
            size *= 0.6
            if size < design.low:
                break
            continue
        if best is None or abs(result.expected(design.axes) - wanted) < best[0]:
            best = (abs(result.expected(design.axes) - wanted), size, injection, result)
        if best[0] < 0.15 * wanted:
            break
        new = float(np.clip(size * result.growth(design.axes, wanted), design.low, design.high))
        if abs(new - size) < 0.02 * size:
            break
        size = new
    if best is None:
        raise NotAttainable("no size could be flown")
    _, size, injection, result = best
    return size, injection, _flip_errors(scenario, injection, result, [a for a in design.axes if a not in fixed])


def _flip_errors(
    scenario: Scenario, injection: Injection, result: ScenarioResult, axes: Sequence[str]
) -> ScenarioResult:
    """The outcome with the simulation's own errors of an axis turned round where they hide the effect or add to it."""
    miss = {a: abs(result.attainable[a] - result.expected([a])) for a in axes}
    doubtful = {a for a in axes if miss[a] > 0.25 * result.expected([a])}
    kept = scenario.sim_terms
    for _ in range(2):
        if not doubtful:
            break
        scenario.sim_terms = tuple(
            (a, w, 2.0 * v - x if a in doubtful else x) for (a, w, v), (_, _, x) in zip(scenario.truth.terms, kept)
        )
        other = simulate_scenario(scenario, injection)
        worse = {a for a in doubtful if abs(other.attainable[a] - other.expected([a])) > miss[a]}
        if not worse:
            return other
        doubtful -= worse
    scenario.sim_terms = kept
    return result
