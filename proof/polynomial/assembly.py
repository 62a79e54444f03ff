"""Assembles a case: recordings, a simulation along them or of its own, and the key; cases with one effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from proof.case_files import Case
from proof.keys import EffectKey, Family, Form, Intervals, Key, Severity, Verdict
from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import truth_aircraft
from proof.polynomial.effects import Effect, EffectDesign, Injection, name
from proof.polynomial.flight import simulate_model
from proof.polynomial.scenario import Scenario, draw_scenario
from proof.polynomial.simulate import (
    AIMED,
    ScenarioResult,
    contribution_of,
    effect_context,
    scale_effect,
    simulate_scenario,
)
from proof.polynomial.terms import AXES
from proof.scenario.errors import severity_of
from proof.scenario.instruments import Channels, InstrumentErrors
from proof.scenario.intervals import intervals_of
from proof.scenario.sizing import NotAttainable, bisect
from structsel.recording import Recording


def find_active(
    result: ScenarioResult, axis: str, region: str
) -> tuple[Intervals, dict[str, tuple[float, float]] | None]:
    """Intervals in which the effect exceeds a quarter of its maximum, and the range of a channel there."""
    i = AXES.index(axis)
    largest = max(float(np.quantile(np.abs(d[:, i]), 0.995)) for d in result.delta)
    made: Intervals = {}
    seen = []
    for k, (d, flight) in enumerate(zip(result.delta, result.flights)):
        on = np.abs(d[:, i]) > 0.25 * largest
        found = intervals_of(flight.t, on, gap=0.599, shortest=0.15)
        made[name(k)] = [(round(a, 2), round(b, 2)) for a, b in found]
        if region:
            seen.append(result.manoeuvres[k].clean[region][on])
    if not region or not any(len(s) for s in seen):
        return made, None
    values = np.concatenate(seen)
    return made, {region: (float(values.min()), float(values.max()))}


def describe(effect: Effect, design: EffectDesign, injection: Injection, result: ScenarioResult) -> EffectKey:
    """Entry of one effect in the key, axes ordered by their attainable fractions."""
    fraction = result.attainable
    axes = sorted((a for a in design.axes if fraction[a] > 0.01), key=lambda a: -fraction[a]) or [design.axes[0]]
    intervals, region = None if isinstance(design.intervals, str) else design.intervals, None
    if design.intervals == "active":
        intervals, region = find_active(result, axes[0], design.region)
    parameters: dict[str, float | str] = {"what": effect.label} if effect.label else {}
    return EffectKey(
        effect=effect.name,
        accept=(effect.name, *design.accept),
        tie=design.tie,
        kinds=effect.kinds,
        axes=tuple(axes),
        region=region,
        parameters={**parameters, **injection.parameters},
        intervals=intervals,
    )


def recordings_of(scenario: Scenario, result: ScenarioResult) -> list[Recording]:
    """Recordings of the case."""
    made = []
    for k, f in enumerate(result.flights):
        held = dict(result.manoeuvres[k].readings)
        held["mach"] = held["V"] / (f.reads["V"] / f.reads["mach"])
        made.append(Recording(name(k), f.t, held))
    return made


def forced(result: ScenarioResult) -> dict[str, Channels]:
    """Simulated coefficients at the states that the simulation is given."""
    return {
        name(k): {"t": f.t, **dict(zip(AXES, result.manoeuvres[k].simulated.T))} for k, f in enumerate(result.flights)
    }


def free(scenario: Scenario, result: ScenarioResult, wind: Mapping[str, float] | None = None) -> dict[str, Channels]:
    """Open-loop simulation with the recorded controls, from the first recorded state.

    Raises
    ------
    NotAttainable
    """
    made = {}
    for k, f in enumerate(result.flights):
        faulty = result.manoeuvres[k].faulty
        controls = {n: faulty[n] for n in ("de", "da", "dr")}
        if "df" in scenario.channels:
            controls["df"] = faulty["df"]
        stated = replace(scenario.truth, aircraft=scenario.aircraft, terms=scenario.sim_terms)
        run = simulate_model(
            stated,
            scenario.sim_terms,
            f,
            f.states[0],
            controls,
            faulty["thrust"],
            {**scenario.settings, **(wind or {})},
            scenario.rate,
        )
        extra = tuple(c for c in scenario.channels if c not in ("df", "rpm"))
        held = ins.channels_of(run, scenario.aircraft, scenario.ground, extra, InstrumentErrors(), k)
        held["thrust"], held["throttle"] = faulty["thrust"], faulty["throttle"]
        held["qbar"] = 0.5 * held["rho"] * held["V"] ** 2
        held["mach"] = run.reads["mach"]
        # An open-loop simulation that diverges is no case.
        if (
            np.abs(held["phi"]).max() > 1.5
            or abs(held["V"] / f.reads["V"] - 1.0).max() > 0.4
            or held["alpha"].max() > 0.5
        ):
            raise NotAttainable("free")
        made[name(k)] = {"t": f.t, **{n: x for n, x in held.items() if n not in ("rho", "h_agl")}}
    return made


def make_single(
    effect: Effect, aircraft_name: str, severity: str, seed: int, form: Form, states: str, attempt: int = 0
) -> Case:
    """A case with one effect.

    Raises
    ------
    NotAttainable
        The flights diverge, or the effect is too small to be seen.
    """
    scenario = draw_scenario([effect], truth_aircraft(aircraft_name), seed, states, attempt)
    context = effect_context(scenario, seed, attempt, 2)
    design = effect.make(context)
    _, injection, result = scale_effect(scenario, design, float(context.rng.uniform(*AIMED[severity])))
    key = describe(effect, design, injection, result)
    fraction = result.fraction(design.axes)
    if fraction < 0.05:
        raise NotAttainable(f"{effect.name} does not show")
    severity = severity_of(max(result.attainable[a] for a in design.axes))
    return assemble(scenario, result, form, [key], severity, "single")


def assemble(
    scenario: Scenario,
    result: ScenarioResult,
    form: Form,
    effects: Sequence[EffectKey],
    severity: Severity,
    family: Family,
    verdicts: tuple[Verdict, ...] = ("mismatch",),
) -> Case:
    """The case and its key."""
    if form == "free":
        try:
            simulated = free(scenario, result)
        except NotAttainable:
            form = "forced"
    if form == "forced":
        simulated = forced(result)
    key = Key(
        verdicts=verdicts,
        form=form,
        severity=severity,
        attainable=result.attainable,
        effects=tuple(effects),
        source=f"polynomial/{scenario.truth.name}",
        family=family,
        seed=scenario.seed,
    )  # type: ignore[arg-type]
    shown = any(a in AXES for e in effects for a in e.axes)  # an effect on velocities changes no coefficient
    return Case(
        f"case-{scenario.seed:05d}",
        scenario.aircraft,
        recordings_of(scenario, result),
        simulated,
        key,
        contribution=contribution_of(scenario, result.injection) if shown else (),
    )


def make_windy(effect: Effect, aircraft_name: str, severity: str, seed: int, attempt: int = 0) -> Case:
    """A case of wind, which an open-loop simulation lacks: it changes the velocities over the ground.

    Raises
    ------
    NotAttainable
        The flights diverge, or the wind is too small to be seen.
    """
    scenario = draw_scenario([effect], truth_aircraft(aircraft_name), seed, ins.RECONSTRUCTED, attempt)
    context = effect_context(scenario, seed, attempt, 2)
    design = effect.make(context)

    def tried(size: float) -> tuple[Injection, ScenarioResult, dict[str, float]]:
        injection = design.at(size)
        result = simulate_scenario(scenario, injection)
        still, blown = free(scenario, result), free(scenario, result, injection.physics.settings)
        return injection, result, {c: _explained(result, still, blown, c) for c in ("vn", "ve", "vd", "V", "h")}

    def reached(size: float) -> float:
        fractions = tried(size)[2]
        return max(fractions["vn"], fractions["ve"])

    size, _ = bisect(reached, float(context.rng.uniform(*AIMED[severity])), design.low, design.high, 6)
    injection, result, fractions = tried(size)
    fraction = max(fractions["vn"], fractions["ve"])
    if fraction < 0.05:
        raise NotAttainable(f"{effect.name} does not show")
    axes = tuple(sorted((c for c in fractions if fractions[c] > 0.03), key=lambda c: -fractions[c]))
    key = EffectKey(
        effect=effect.name, accept=(effect.name,), tie=design.tie, kinds=effect.kinds, axes=axes,
        parameters=injection.parameters,
    )  # fmt: skip
    case = assemble(scenario, result, "free", [key], severity_of(max(fractions.values())), "single")
    return replace(case, key=case.key.model_copy(update={"attainable": {**dict.fromkeys(AXES, 0.0), **fractions}}))


def _explained(
    result: ScenarioResult, still: Mapping[str, Channels], blown: Mapping[str, Channels], channel: str
) -> float:
    """Fraction of a channel's rms difference that knowing the wind takes away."""
    seen = np.concatenate([m.readings[channel] for m in result.manoeuvres])
    before, after = (
        np.sqrt(np.mean((seen - np.concatenate([run[channel] for run in runs.values()])) ** 2))
        for runs in (still, blown)
    )
    return float(1.0 - after / before)
