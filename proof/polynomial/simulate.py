"""Simulates a scenario with an injected effect, computes the readings, and finds the size of the effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from proof.polynomial import instruments as ins
from proof.polynomial.effects import EffectContext, EffectDesign, Injection
from proof.polynomial.flight import TruthFlight, simulate_truth
from proof.polynomial.scenario import Scenario
from proof.polynomial.terms import AXES
from proof.scenario.errors import CONTROLS
from proof.scenario.instruments import Channels, InstrumentErrors, coefficients_of
from proof.scenario.sizing import NotAttainable, attainable, bisect

AIMED = {"easy": (0.32, 0.65), "medium": (0.16, 0.29), "hard": (0.06, 0.14)}
"""Attainable fraction aimed at, by severity: well inside `errors.SEVERITIES`, since it is reached to 15 %."""


@dataclass(frozen=True, eq=False)
class ManoeuvreResult:
    """One manoeuvre of a scenario.

    Attributes
    ----------
    flight : TruthFlight
    clean, faulty : Channels
        Without noise; with the errors of the background alone, and with all.
    readings : Channels
        Of the faulty instruments, with noise.
    simulated : (n, 6) array
        Coefficients of the simulation.
    before, after : (n, 6) arrays
        Measured minus simulated, without and with a perfect model of the injected effect.
    """

    flight: TruthFlight
    clean: Channels
    faulty: Channels
    readings: Channels
    simulated: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class ScenarioResult:
    """A scenario simulated with an injected effect."""

    injection: Injection
    manoeuvres: tuple[ManoeuvreResult, ...]

    @property
    def flights(self) -> list[TruthFlight]:
        """Truth flights."""
        return [m.flight for m in self.manoeuvres]

    @property
    def before(self) -> list[np.ndarray]:
        """Measured minus simulated."""
        return [m.before for m in self.manoeuvres]

    @property
    def after(self) -> list[np.ndarray]:
        """Measured minus simulated with a perfect model of the effect."""
        return [m.after for m in self.manoeuvres]

    @property
    def delta(self) -> list[np.ndarray]:
        """Contribution of the injected effect to measured minus simulated."""
        return [m.before - m.after for m in self.manoeuvres]

    @property
    def attainable(self) -> dict[str, float]:
        """Of all coefficients."""
        return attainable(self.before, self.after)

    def expected(self, axes: Sequence[str], growth: float = 1.0) -> float:
        """Attainable fraction in the main axis if the effect, grown, is uncorrelated with the rest."""
        chosen = [AXES.index(a) for a in axes]
        added, left = (np.sqrt(np.mean(np.concatenate(x)[:, chosen] ** 2, axis=0)) for x in (self.delta, self.after))
        return float(np.max(1.0 - left / np.hypot(left, growth * added)))

    def fraction(self, axes: Sequence[str]) -> float:
        """Attainable fraction in the axis where the effect is clearest."""
        return self.attainable[max(axes, key=lambda a: self.expected([a]))]

    def growth(self, axes: Sequence[str], wanted: float) -> float:
        """Factor by which the effect must grow for that fraction, between 0.02 and 20."""
        return bisect(lambda growth: self.expected(axes, growth), wanted, 0.02, 20.0, 30)[0]


def effect_context(scenario: Scenario, *seed: int) -> EffectContext:
    """Context of an effect in the scenario."""
    base = simulate_truth(
        scenario.truth, scenario.manoeuvres, scenario.background.physics, scenario.settings, scenario.rate
    )
    rng = np.random.default_rng(list(seed))
    return EffectContext(
        scenario.truth, scenario.manoeuvres, base, scenario.settings, scenario.aircraft.tolerances, rng
    )


def simulate_scenario(scenario: Scenario, injection: Injection) -> ScenarioResult:
    """Simulate and measure a scenario with an injected effect, and with a perfect model of it.

    Errors within the tolerances are in the data of both.
    """
    background = scenario.background
    physics = background.physics.joined(injection.physics)
    arms = [one.physics.settings.get("arm_x", 0.0) for one in (background, injection)]
    physics.settings["arm_x"] = sum(arms)
    errors = background.errors.joined(injection.errors)
    flights = simulate_truth(scenario.truth, scenario.manoeuvres, physics, scenario.settings, scenario.rate)
    return ScenarioResult(
        injection, tuple(_measure(scenario, injection, errors, flight, k) for k, flight in enumerate(flights))
    )


def _measure(
    scenario: Scenario, injection: Injection, errors: InstrumentErrors, f: TruthFlight, k: int
) -> ManoeuvreResult:
    """Readings and both sides of manoeuvre k."""
    air = scenario.aircraft
    sound = InstrumentErrors(place=scenario.background.errors.place, mix=scenario.background.errors.mix)
    clean, faulty = (ins.channels_of(f, air, scenario.ground, scenario.channels, e, k) for e in (sound, errors))
    noise = {**scenario.noise, "thrust": scenario.noise["thrust"] * float(np.mean(faulty["thrust"]))}
    readings, better = (
        ins.read(f.t, channels, noise, scenario.biases[k], 1000 * scenario.seed + k, scenario.wrong)
        for channels in (faulty, clean)
    )
    if scenario.states == ins.RAW:
        given, ideal = ins.raw_states(readings, air), ins.raw_states(better, air)
    else:
        given, ideal = (
            ins.reconstructed_states(f, clean, read, calm, np.random.default_rng([scenario.seed, 7, k]))
            for read, calm in ((faulty, errors.without_gusts), (clean, False))
        )
    simulated = ins.simulated(scenario.sim_terms, f, air, given, scenario.settings["V0"])
    before = coefficients_of(f.t, readings, air) - simulated
    after = _measured_ideally(scenario, injection, f, readings, better) - _simulated_ideally(scenario, f, ideal)
    return ManoeuvreResult(f, clean, faulty, readings, simulated, before, after)


def _simulated_ideally(scenario: Scenario, f: TruthFlight, states: Channels) -> np.ndarray:
    """Coefficients of the simulation with the true surfaces, the true thrust and the added coefficients."""
    true = {c: states[c] + f.reads[f"{c}_true"] - f.reads[c] for c in CONTROLS}
    states = {**states, **true, "thrust": f.reads["thrust"]}
    # The moment of the background's centre of gravity is no part of the effect.
    added, shift = f.extras.copy(), scenario.background.physics.settings.get("arm_x", 0.0)
    added[:, 4] -= f.coefs[:, 2] * shift / scenario.aircraft.cbar
    added[:, 5] += f.coefs[:, 1] * shift / scenario.aircraft.b
    return ins.simulated(scenario.sim_terms, f, scenario.aircraft, states, scenario.settings["V0"]) + added


def _measured_ideally(
    scenario: Scenario, injection: Injection, f: TruthFlight, readings: Channels, better: Channels
) -> np.ndarray:
    """Coefficients from sound instruments, with mass and inertia as the effect changes them, and the true thrust."""
    air, physics = scenario.aircraft, injection.physics
    mass = (air.mass or 0.0) * f.reads["mass"] / (
        scenario.background.physics.mass * (scenario.truth.aircraft.mass or 1.0)
    )  # fmt: skip
    tensor = air.require_inertia("the proof").tensor.copy()
    for key, value in physics.inertia.items():
        i, j = "xyz".index(key[1]), "xyz".index(key[-1])
        tensor[i, j] *= value
        tensor[j, i] = tensor[i, j]
    thrust = readings["thrust"] + f.reads["thrust"] - f.reads["thrust_model"]
    measured = coefficients_of(f.t, better, air, mass=mass, inertia=tensor, thrust=thrust)
    if physics.after != 1.0:
        gone = f.reads["mass"] < 0.999 * f.reads["mass"][0]
        later = coefficients_of(f.t, better, air, mass=mass, inertia=tensor * physics.after, thrust=thrust)
        measured[gone] = later[gone]
    return measured


def contribution_of(scenario: Scenario, injection: Injection) -> tuple[np.ndarray, ...]:
    """Contribution (n, 6) of effects to measured minus simulated, for instruments without noise."""
    return tuple(simulate_scenario(replace(scenario, noise=dict.fromkeys(scenario.noise, 0.0)), injection).delta)


def scale_effect(
    scenario: Scenario, design: EffectDesign, wanted: float, tries: int = 5, fixed: Sequence[str] = ()
) -> tuple[float, Injection, ScenarioResult]:
    """Size at which the attainable fraction in the main axis is about as wanted, as far as it is plausible.

    Where the simulation's own errors happen to hide the effect or to add to it, their signs are changed (in
    `scenario`), except those of the `fixed` axes.

    Raises
    ------
    NotAttainable
        No size can be simulated without divergence.
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
        raise NotAttainable("the flights diverge at every size")
    _, size, injection, result = best
    return size, injection, _flip_errors(scenario, injection, result, [a for a in design.axes if a not in fixed])


def _flip_errors(
    scenario: Scenario, injection: Injection, result: ScenarioResult, axes: Sequence[str]
) -> ScenarioResult:
    """The outcome, with the sign of the simulation's errors changed in axes where they hide the effect or add to it."""
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
