"""From what was ranked to findings: parameters, where each acts, what it brings, what it may be taken for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from structsel.comparison.locating.region import find_region
from structsel.comparison.locating.windows import find_intervals
from structsel.diagnosis import judging
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.ranking import TIED, Ranking, Step
from structsel.diagnosis.residuals import contributions
from structsel.diagnosis.result import LISTED, UNNAMED, Bars, EffectFinding, Physics
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.weighing import SLIGHT, jackknifed, told_by
from structsel.effects.base import FittedEffect, ParameterEstimate, Variant
from structsel.numerics.arrays import Array

_SHOWN = 0.15  # of the largest gain, that a response must have to be named
_LEAST = 0.01
_TEMPERATURE, _OF_BEST = 4.0, 0.02
"""By which log evidence of forms is divided, as rows are nearly white only; and of the best's, as no form is right."""
_BEYOND = 1.4
"""By which standard deviations are widened for what forms to first order leave out: of 59 parameters of an earlier look
(seeds from 1089000) 71 % lay within their 90 % intervals; so widened, 85 % would have."""
_RIVALS = 4
_TIES = 3
_DOUBT = 0.08
"""Share of what is beyond the noise in a finding's responses that may stay before none of the names may be right."""
_MOST_LOST = 0.5
"""And of the names' probability that is lost to something unknown, which is as much as stays: what else is missing may
be one effect more, beside one that is named rightly."""


@dataclass(frozen=True, eq=False)
class Member:
    """Effects taken in that are one finding: the same effect in several places."""

    steps: tuple[Step, ...]
    places: tuple[int, ...]

    @property
    def effect(self) -> str:
        """Its name."""
        return self.steps[0].score.effect


def gather(ranking: Ranking) -> list[Member]:
    """Effects taken in, each once, in the order found."""
    groups: dict[str, list[int]] = {}
    for k, step in enumerate(ranking.steps):
        groups.setdefault(step.score.effect, []).append(k)
    return [Member(tuple(ranking.steps[k] for k in each), tuple(each)) for each in groups.values()]


def shares(bench: Bench, members: Sequence[Member]) -> list[float]:
    """Part of the mismatch that each finding carries: its mean gain over all orders of taking them in.

    The gain is in the sum of squares of each response that is judged, as a share of what tolerances leave of it: what
    they explain is no mismatch.

    Parameters
    ----------
    bench : Bench
        With all of them taken in.
    members : sequence of Member
    """
    known: dict[frozenset[int], Array] = {}

    def left(taken: frozenset[int]) -> Array:
        if taken not in known:
            rest = bench.keeping([k for i in sorted(taken) for k in members[i].places]).left_in
            known[taken] = np.array([sum(float(np.sum(e[r.part(c)] ** 2)) for r, e in rest) for c in bench.told])
        return known[taken]

    made = np.zeros(len(members))
    whole = np.maximum(left(frozenset()), np.finfo(float).tiny)
    orders = list(permutations(range(len(members))))
    for order in orders:
        taken: frozenset[int] = frozenset()
        for i in order:
            made[i] += np.sum((left(taken) - left(taken | {i})) / whole)
            taken = taken | {i}
    return [max(0.0, float(x)) for x in made / len(orders)]


def estimates(bench: Bench, k: int, score: EffectScore) -> dict[str, ParameterEstimate]:
    """Parameters of the k-th effect taken in, those of its shape from the weights of its forms."""
    variant = bench.accepted[k].variant
    part = bench.place(k)
    mean = bench.base.posterior.mean[part]
    # Rows are white as far as the noise is known; what they still miss widens what they say.
    rows = sum(len(y) for y in bench.base.y)
    wide = np.sqrt(max(1.0, bench.base.posterior.chi2 / rows))
    std = np.sqrt(np.diag(bench.base.posterior.covariance[part, part])) * wide
    if not score.event:  # nor do flights agree with each other as far as noise alone would have it
        std = np.maximum(std, jackknifed(bench.base.solved[1:, part]))
    alike = [
        (np.log(max(w, 1e-300)), s.variant.shape, t.theta)
        for w, s, t in zip(score.weights, score.signatures, score.trials)
        if set(s.variant.shape) == set(variant.shape)
        and (s.variant.about, s.variant.only_in) == (variant.about, variant.only_in)
        and len(t.theta) == len(variant.parameters)
    ]
    # No form is quite right: those that are nearly as good count too, and their spread is part of what is not known.
    logs = np.array([w for w, _, _ in alike]) / max(_TEMPERATURE, _OF_BEST * score.log_evidence)
    weights = np.exp(logs - logs.max())
    weights = weights / weights.sum()
    forms = np.array([t for _, _, t in alike])
    std = np.hypot(std, np.sqrt(weights @ (forms - weights @ forms) ** 2))
    made = {
        p.name: p.estimate(float(m * p.sd), float(_BEYOND * s * p.sd)) for p, m, s in zip(variant.parameters, mean, std)
    }
    for name, value in variant.shape.items():
        values = np.array([float(shape[name]) for _, shape, _ in alike])
        centre = float(weights @ values)
        grid = np.unique(values)
        near = np.abs(grid - float(value))
        step = float(np.min(near[near > 0.0])) if np.any(near > 0.0) else 0.0
        known = float(np.sqrt(weights @ (values - centre) ** 2 + step**2 / 12.0))
        made[name] = ParameterEstimate(centre, _BEYOND * known, variant.units.get(name, "-"))
    return made


def found_by(score: EffectScore) -> FittedEffect:
    """A rival as it stood when it was tried."""
    variant, trial = score.signature.variant, score.trial
    std = np.sqrt(np.diag(trial.covariance))
    made = {
        p.name: p.estimate(float(m * p.sd), float(s * p.sd)) for p, m, s in zip(variant.parameters, trial.theta, std)
    }
    made |= {n: ParameterEstimate(float(v), 0.0, variant.units.get(n, "-")) for n, v in variant.shape.items()}
    return FittedEffect(variant, made, {})


def noise_rms(bench: Bench) -> dict[str, float]:
    """Noise of each response in the compared band, per sample."""
    made = {}
    for c in bench.responses:
        power = sum(float(np.sum(1.0 / r.weight[c][1:] ** 2)) for r in bench.rows)
        made[c] = float(np.sqrt(power / sum(len(r.flight) for r in bench.rows)))
    return made


def implausible(variant: Variant, told: Mapping[str, ParameterEstimate]) -> str:
    """What is implausible about parameters; empty where nothing is."""
    said = []
    for p in variant.parameters:
        e = told[p.name]
        if e.value < p.low - 2.0 * e.std or e.value > p.high + 2.0 * e.std:
            said.append(f"{p.name} {e.value:.3g} lies outside {p.low:g} to {p.high:g} {p.unit}".rstrip(" -"))
    return "; ".join(said)


def make_findings(ranking: Ranking, explainable: Mapping[str, float]) -> list[EffectFinding]:
    """Findings, the largest share of the mismatch first; fits are cumulative in that order."""
    bench = ranking.bench
    members = gather(ranking)
    if not members:
        return []
    plain = bench.as_delivered
    carried = shares(bench, members)
    order = np.argsort(carried)[::-1]
    total = sum(carried)
    told = bench.told
    got = judging.measured(bench)
    delivered = judging.as_delivered(bench)
    first = judging.fit(got, delivered, told)
    second = judging.fit(got, judging.refitted(delivered, judging.held_out(bench.keeping([]))), told)
    kept: list[int] = []
    bare = plain.keeping([])
    before = judging.held_out(bare)
    made = []
    for i in order:
        member = members[i]
        kept += member.places
        with_it = judging.held_out(plain.keeping(kept))
        after = judging.refitted(with_it, judging.held_out(bench.keeping(kept)))
        third = judging.fit(got, after, told)
        bars = {c: Bars(first[c], second[c], third[c]) for c in told if c in third}
        axes = _axes(judging.gains(before, with_it, told), bench, member)
        parts = contributions(bench, member.places)
        noise = noise_rms(bench)
        intervals = find_intervals(bench.flights, parts, noise)
        region = find_region(bench.flights, parts, noise)
        physics, ties = _physics(bench, member)
        hypothesis = member.steps[0].score.hypothesis
        told_apart = hypothesis.separated_by if ties else ""
        stays = _stays(bare, plain, member, axes)
        if stays > _DOUBT:
            ties = (*[e for e in ties if e != UNNAMED][: _TIES - 1], UNNAMED)
            physics = _doubted(physics, stays, axes)
        made.append(
            EffectFinding(
                axes,
                hypothesis.kind,
                physics,
                intervals,
                region,
                ties,
                told_apart,
                bars,
                _mean(explainable, axes),
                judging.explained(delivered, after, axes),
                carried[i] / total if total > 0.0 else 1.0,
            )
        )
        before = with_it
    return made


def _axes(gained: Mapping[str, float], bench: Bench, member: Member) -> tuple[str, ...]:
    """Responses whose error falls, the clearest first."""
    touched = {c for k in member.places for c in bench.accepted[k].responses}
    mine = {c: g for c, g in gained.items() if c in touched}
    if not mine:
        return tuple(touched)
    most = max(mine.values())
    named = [c for c, g in mine.items() if g >= max(_LEAST, _SHOWN * most)]
    return tuple(sorted(named, key=lambda c: -mine[c])) or (max(mine, key=lambda c: mine[c]),)


def _physics(bench: Bench, member: Member) -> tuple[tuple[Physics, ...], tuple[str, ...]]:
    step = member.steps[0]
    hypothesis = step.score.hypothesis
    told = [estimates(bench, k, s.score) for k, s in zip(member.places, member.steps)]
    sizes: dict[str, float] = {}
    says = " ".join(
        hypothesis.says(FittedEffect(bench.accepted[k].variant, e, sizes)) for k, e in zip(member.places, told)
    )
    chances = dict(step.rivals)
    merged: dict[str, ParameterEstimate] = dict(told[0])
    for j, more in enumerate(told[1:], 2):
        merged |= {f"{name} ({j})" if name in merged else name: e for name, e in more.items()}
    terms = tuple(t for k in member.places for t in bench.accepted[k].variant.terms)
    doubts = "; ".join(filter(None, (implausible(bench.accepted[k].variant, e) for k, e in zip(member.places, told))))
    best = Physics(
        step.score.effect, chances.get(step.score.effect, 1.0), says, merged, terms, doubts, hypothesis.check
    )
    rivals = []
    for score in step.others:
        p = chances.get(score.effect, 0.0)
        if score.effect != step.score.effect and p >= LISTED:
            found = found_by(score)
            says_too = score.hypothesis.says(found)
            rivals.append(Physics(score.effect, p, says_too, found.estimates, score.signature.variant.terms))
    if chances.get(UNNAMED, 0.0) >= LISTED:
        rivals.append(Physics(UNNAMED, chances[UNNAMED], "Something that none of them explains."))
    rivals = sorted(rivals, key=lambda p: -p.probability)[: _RIVALS - 1]
    ties = [
        e
        for e, p in step.rivals
        if e not in (step.score.effect, "nothing") and p > TIED * chances.get(step.score.effect, 1.0)
    ]
    if step.constant:  # of a constant, only its share in each response tells what it is
        tried = {s.effect for s in step.others}
        ties += [e for e in hypothesis.look_alikes if e in tried and e not in ties]
    return (best, *rivals), tuple(ties[:_TIES])


def _stays(bare: Bench, plain: Bench, member: Member, axes: Sequence[str]) -> float:
    """Share of what moves beyond the noise that everything found leaves in some responses, as delivered.

    What is a mere level has no motion to tell it by.
    """
    step = member.steps[0]
    if step.constant:
        return 0.0
    before, after = (judging.excess(b, *told_by(step.score)) for b in (bare, plain))
    beyond = sum(max(0.0, before[c][0] - 1.0) for c in axes)
    left = sum(max(0.0, after[c][0] - 1.0 - SLIGHT) for c in axes)
    return min(left / beyond, 1.0) if beyond > 0.0 else 0.0


def _doubted(physics: Sequence[Physics], stays: float, axes: Sequence[str]) -> tuple[Physics, ...]:
    """Explanations of what they leave much of, and that it may be something else; likeliest first."""
    lost = min(stays, _MOST_LOST)
    says = f"It leaves {stays:.0%} of what lies beyond the noise in {', '.join(axes)}."
    known = [replace(one, probability=(1.0 - lost) * one.probability) for one in physics if one.effect != UNNAMED]
    known[0] = replace(known[0], says=f"{known[0].says} {says}")
    whole = sum(one.probability for one in physics)
    other = Physics(UNNAMED, whole - sum(one.probability for one in known), "Something that none of them explains.")
    return known[0], *sorted([other, *known[1:]], key=lambda one: -one.probability)


def _mean(values: Mapping[str, float], axes: Sequence[str]) -> float:
    some = [values[c] for c in axes if c in values]
    return float(np.mean(some)) if some else float("nan")
