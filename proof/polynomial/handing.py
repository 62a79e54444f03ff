"""What is handed over: recordings, a simulation forced or free, and the key; cases with one effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from proof.case_files import Case
from proof.keys import EffectKey, Family, Form, Intervals, Key, Severity, Verdict
from proof.polynomial import instruments as ins
from proof.polynomial.aircraft import craft
from proof.polynomial.effects import Concept, Context, Effect, Entry, name
from proof.polynomial.flight import fly_simulation, fly_truth
from proof.polynomial.instruments import Channels, Faults
from proof.polynomial.making import SHARES, Outcome, Scene, contribution_of, draw_scene, find_size, play
from proof.polynomial.terms import AXES
from proof.scenario.sizing import NotAttainable
from structsel.recording import Recording


def find_active(outcome: Outcome, axis: str, region: str) -> tuple[Intervals, dict[str, tuple[float, float]] | None]:
    """When the effect carries more than a quarter of its most, and the range of a channel in which it does."""
    i = AXES.index(axis)
    most = max(float(np.quantile(np.abs(d[:, i]), 0.995)) for d in outcome.delta)
    made: Intervals = {}
    seen = []
    for k, d in enumerate(outcome.delta):
        t = outcome.flown[k].t
        on = np.abs(d[:, i]) > 0.25 * most
        edges = np.flatnonzero(np.diff(np.concatenate(([0], on.astype(int), [0]))))
        spans = [[float(t[a]), float(t[b - 1])] for a, b in zip(edges[::2], edges[1::2])]
        joined: list[list[float]] = []
        for a, b in spans:
            if joined and a - joined[-1][1] < 0.6:
                joined[-1][1] = b
            else:
                joined.append([a, b])
        made[name(k)] = [(round(a, 2), round(b, 2)) for a, b in joined if b - a > 0.15]
        if region:
            seen.append(outcome.clean[k][region][on])
    if not region or not any(len(s) for s in seen):
        return made, None
    whole = np.concatenate(seen)
    return made, {region: (float(whole.min()), float(whole.max()))}


def describe(effect: Effect, concept: Concept, entry: Entry, outcome: Outcome) -> EffectKey:
    """The key's entry of one effect, axes ordered by what is attainable in them."""
    share = outcome.attainable
    axes = sorted((a for a in concept.axes if share[a] > 0.01), key=lambda a: -share[a]) or [concept.axes[0]]
    intervals, region = None if isinstance(concept.intervals, str) else concept.intervals, None
    if concept.intervals == "active":
        intervals, region = find_active(outcome, axes[0], concept.region)
    parameters: dict[str, float | str] = {"what": effect.label} if effect.label else {}
    return EffectKey(
        effect=effect.name,
        accept=(effect.name, *concept.accept),
        tie=concept.tie,
        kinds=effect.kinds,
        axes=tuple(axes),
        region=region,
        parameters={**parameters, **entry.parameters},
        intervals=intervals,
    )


def recordings_of(scene: Scene, outcome: Outcome) -> list[Recording]:
    """What is handed over."""
    made = []
    for k, f in enumerate(outcome.flown):
        held = dict(outcome.readings[k])
        held["mach"] = held["V"] / (f.reads["V"] / f.reads["mach"])
        made.append(Recording(name(k), f.t, held))
    return made


def forced(outcome: Outcome) -> dict[str, Channels]:
    """Simulated coefficients at what the simulation was told."""
    return {name(k): {"t": f.t, **dict(zip(AXES, outcome.simulated[k].T))} for k, f in enumerate(outcome.flown)}


def free(scene: Scene, outcome: Outcome, wind: Mapping[str, float] | None = None) -> dict[str, Channels]:
    """The simulation flown open loop with what was recorded, from where the recording began.

    Raises
    ------
    NotAttainable
    """
    made = {}
    for k, f in enumerate(outcome.flown):
        faulty = outcome.faulty[k]
        controls = {n: faulty[n] for n in ("de", "da", "dr")}
        if "df" in scene.channels:
            controls["df"] = faulty["df"]
        stated = replace(scene.craft, aircraft=scene.aircraft, terms=scene.sim_terms)
        run = fly_simulation(
            stated,
            scene.sim_terms,
            f,
            f.states[0],
            controls,
            faulty["thrust"],
            {**scene.settings, **(wind or {})},
            scene.rate,
        )
        extra = tuple(c for c in scene.channels if c not in ("df", "rpm"))
        held = ins.channels_of(run, scene.aircraft, scene.ground, extra, Faults(), k)
        held["thrust"], held["throttle"] = faulty["thrust"], faulty["throttle"]
        held["qbar"] = 0.5 * held["rho"] * held["V"] ** 2
        held["mach"] = run.reads["mach"]
        # An open-loop run that has gone elsewhere says nothing.
        if (
            np.abs(held["phi"]).max() > 1.5
            or abs(held["V"] / f.reads["V"] - 1.0).max() > 0.4
            or held["alpha"].max() > 0.5
        ):
            raise NotAttainable("free")
        made[name(k)] = {"t": f.t, **{n: x for n, x in held.items() if n not in ("rho", "h_agl")}}
    return made


def make_single(
    effect: Effect, craft_name: str, severity: str, seed: int, form: Form, states: str, attempt: int = 0
) -> Case:
    """A case with one effect.

    Raises
    ------
    NotAttainable
        Where it cannot be flown, or would not show at all; draw anew.
    """
    scene = draw_scene([effect], craft(craft_name), seed, states, attempt)
    base = fly_truth(scene.craft, scene.plans, scene.background.physics, scene.settings, scene.rate)
    rng = np.random.default_rng([seed, attempt, 2])
    concept = effect.make(Context(scene.craft, scene.plans, base, scene.settings, scene.aircraft.tolerances, rng))
    _, entry, outcome = find_size(scene, concept, float(rng.uniform(*SHARES[severity])))
    key = describe(effect, concept, entry, outcome)
    share = outcome.share(concept.axes)
    if share < 0.05:
        raise NotAttainable(f"{effect.name} does not show")
    severity = severity_of(max(outcome.attainable[a] for a in concept.axes))
    return assemble(scene, outcome, form, [key], severity, "single")


def severity_of(share: float) -> Severity:
    """By what is attainable in the main axis."""
    return "easy" if share >= 0.30 else "medium" if share >= 0.15 else "hard"


def assemble(
    scene: Scene,
    outcome: Outcome,
    form: Form,
    effects: Sequence[EffectKey],
    severity: Severity,
    family: Family,
    verdicts: tuple[Verdict, ...] = ("mismatch",),
) -> Case:
    """The case and its key."""
    if form == "free":
        try:
            simulated = free(scene, outcome)
        except NotAttainable:
            form = "forced"
    if form == "forced":
        simulated = forced(outcome)
    key = Key(
        verdicts=verdicts,
        form=form,
        severity=severity,
        attainable=outcome.attainable,
        effects=tuple(effects),
        source=f"own/{scene.craft.name}",
        family=family,
        seed=scene.seed,
    )  # type: ignore[arg-type]
    return Case(
        f"case-{scene.seed:05d}",
        scene.aircraft,
        recordings_of(scene, outcome),
        simulated,
        key,
        # What shows in velocities alone brings nothing to the coefficients.
        contribution=contribution_of(scene, outcome) if any(a in AXES for e in effects for a in e.axes) else (),
    )


def make_windy(effect: Effect, craft_name: str, severity: str, seed: int, attempt: int = 0) -> Case:
    """A wind that the simulation, flown free, does not know: it shows in the velocities over the ground.

    Raises
    ------
    NotAttainable
        Where it cannot be flown or does not show.
    """
    scene = draw_scene([effect], craft(craft_name), seed, ins.RECONSTRUCTED, attempt)
    base = fly_truth(scene.craft, scene.plans, scene.background.physics, scene.settings, scene.rate)
    rng = np.random.default_rng([seed, attempt, 2])
    concept = effect.make(Context(scene.craft, scene.plans, base, scene.settings, scene.aircraft.tolerances, rng))
    wanted, low, high = float(rng.uniform(*SHARES[severity])), np.log(concept.low), np.log(concept.high)
    for _ in range(6):
        entry = concept.at(float(np.exp(0.5 * (low + high))))
        outcome = play(scene, entry)
        still, blown = free(scene, outcome), free(scene, outcome, entry.physics.settings)
        shares = {}
        for channel in ("vn", "ve", "vd", "V", "h"):
            seen = np.concatenate([r[channel] for r in outcome.readings])
            b, a = (
                np.sqrt(np.mean((seen - np.concatenate([run[channel] for run in runs.values()])) ** 2))
                for runs in (still, blown)
            )
            shares[channel] = float(1.0 - a / b)
        share = max(shares["vn"], shares["ve"])
        low, high = (0.5 * (low + high), high) if share < wanted else (low, 0.5 * (low + high))
    if share < 0.05:
        raise NotAttainable(f"{effect.name} does not show")
    axes = tuple(sorted((c for c in shares if shares[c] > 0.03), key=lambda c: -shares[c]))
    key = EffectKey(
        effect=effect.name,
        accept=(effect.name,),
        tie=concept.tie,
        kinds=effect.kinds,
        axes=axes,
        parameters=entry.parameters,
    )
    case = assemble(scene, outcome, "free", [key], severity_of(max(shares.values())), "single")
    return replace(case, key=case.key.model_copy(update={"attainable": {**dict.fromkeys(AXES, 0.0), **shares}}))
