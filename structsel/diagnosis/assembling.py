"""Findings from the ranking: parameters, where each effect acts, its gain, and its alternatives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from structsel.comparison.locating.region import find_region
from structsel.comparison.locating.windows import find_intervals
from structsel.diagnosis import judging
from structsel.diagnosis.explained import SLIGHT, judged_on
from structsel.diagnosis.members import Member, gather, mean_gains, needed
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import TIED, Ranking
from structsel.diagnosis.residuals import contributions
from structsel.diagnosis.result import LISTED, UNNAMED, Bars, EffectFinding, Physics
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.size_evidence import jackknifed
from structsel.effects.base import FittedEffect, ParameterEstimate, Variant
from structsel.formatting import as_sentence, format_percent, join_names
from structsel.numerics.arrays import least_positive

_SHOWN = 0.15  # fraction of the largest gain from which a response is listed
_LEAST = 0.01
UNKNOWN_SAYS = "A cause that is not in the library."
_TEMPERATURE, _OF_BEST = 4.0, 0.02
"""Temperature of the weights of forms, because rows are only nearly white; and its least value over the log evidence of
the best form, because no form is exact."""
_BEYOND = 1.4
"""Factor on standard errors for the error of first-order forms: of 59 parameters of an earlier study (seeds from
1089000) 71 % were within their 90 % intervals, and 85 % with this factor."""
_ALTERNATIVES = 4
_TIES = 3
_LARGE_RESIDUAL = 0.08
"""Fraction of the power beyond the noise in the responses of a finding, from which its cause may be another one."""
_MAX_UNKNOWN = 0.5
"""Largest fraction of the probability that goes to "unknown", which otherwise is the residual fraction: the residual
may be that of a further effect, and the first one right."""


def estimates(problem: DiagnosisProblem, k: int, score: EffectScore) -> dict[str, ParameterEstimate]:
    """Parameters of the k-th effect in the model; those of its shape from the weights of its forms."""
    variant = problem.accepted[k].variant
    part = problem.place(k)
    mean = problem.base.posterior.mean[part]
    # Rows are white as far as the noise is known; a chi-square above one widens the standard errors.
    rows = sum(len(y) for y in problem.base.y)
    wide = np.sqrt(max(1.0, problem.base.posterior.chi2 / rows))
    std = np.sqrt(np.diag(problem.base.posterior.covariance[part, part])) * wide
    if not score.event:  # the scatter between flights is larger than the noise alone
        std = np.maximum(std, jackknifed(problem.base.solved[1:, part]))
    alike = [
        (w, s.variant.shape, t.theta)
        for w, s, t in zip(score.log_weights, score.signatures, score.trials)
        if s.variant.is_like(variant)
    ]
    # No form is exact: the spread of those that are nearly as good is part of the uncertainty.
    temperature = max(_TEMPERATURE, _OF_BEST * score.log_evidence)
    logs = np.array([w for w, _, _ in alike]) / temperature
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
        step = 0.0 if name in variant.spread else least_positive(np.abs(values - float(value)), 0.0)
        spread = variant.spread.get(name, 0.0) * (1.0 if name in variant.times else np.sqrt(temperature))
        known = float(np.sqrt(weights @ (values - centre) ** 2 + step**2 / 12.0 + spread**2))
        made[name] = ParameterEstimate(centre, _BEYOND * known, variant.units.get(name, "-"))
    return made


def found_by(score: EffectScore) -> FittedEffect:
    """Estimates of an alternative in the form by which it is judged."""
    variant, trial = score.signature.variant, score.trial
    std = np.sqrt(np.diag(trial.covariance))
    made = {
        p.name: p.estimate(float(m * p.sd), float(s * p.sd)) for p, m, s in zip(variant.parameters, trial.theta, std)
    }
    made |= {
        n: ParameterEstimate(float(v), variant.spread.get(n, 0.0), variant.units.get(n, "-"))
        for n, v in variant.shape.items()
    }
    return FittedEffect(variant, made, {})


def noise_rms(problem: DiagnosisProblem) -> dict[str, float]:
    """Noise of each response in the compared band, per sample."""
    made = {}
    for c in problem.responses:
        power = sum(float(np.sum(1.0 / r.weight[c][1:] ** 2)) for r in problem.rows)
        made[c] = float(np.sqrt(power / sum(len(r.flight) for r in problem.rows)))
    return made


def implausible(variant: Variant, found: Mapping[str, ParameterEstimate]) -> str:
    """Parameters outside their plausible limits, as text; empty if there are none."""
    said = []
    for p in variant.parameters:
        e = found[p.name]
        if e.value < p.low - 2.0 * e.std or e.value > p.high + 2.0 * e.std:
            said.append(f"{p.name} {e.value:.3g} lies outside {p.low:g} to {p.high:g} {p.unit}".rstrip(" -"))
    return "; ".join(said)


def make_findings(ranking: Ranking, ceiling: Callable[[Collection[str]], Mapping[str, float]]) -> list[EffectFinding]:
    """Findings, the largest expected gain first; fits are cumulative in that order.

    The expected gain is that of `mean_gains` times the probability of the name. A part that tolerances could explain
    counts half.

    Parameters
    ----------
    ranking : Ranking
    ceiling : callable
        Some responses to the fraction of the mismatch of each that a regression model predicts.
    """
    problem = ranking.problem
    members = needed(problem, gather(ranking))
    if not members:
        return []
    plain = problem.as_given
    carried = np.mean([mean_gains(p, members) for p in (problem, plain)], axis=0)
    order = np.argsort([-m.probability * x for m, x in zip(members, carried)])
    total = float(carried.sum())
    responses = problem.judged_responses
    got = judging.measured(problem)
    delivered = judging.as_given(problem)
    first = judging.fit(got, delivered, responses)
    second = judging.fit(got, judging.refitted(delivered, judging.held_out(problem.subset([]))), responses)
    kept: list[int] = []
    bare = without = plain.subset([])
    before = judging.held_out(bare)
    made = []
    for i in order:
        member = members[i]
        kept += member.places
        extended = plain.subset(kept)
        with_it = judging.held_out(extended)
        after = judging.refitted(with_it, judging.held_out(problem.subset(kept)))
        third = judging.fit(got, after, responses)
        bars = {c: Bars(first[c], second[c], third[c]) for c in responses if c in third}
        compared = before, with_it
        if member.steps[0].score.event:  # no other flight predicts it
            compared = judging.fitted(without), judging.fitted(extended)
        axes = _axes(judging.gains(*compared, responses), problem, member)
        parts = contributions(problem, member.places)
        noise = noise_rms(problem)
        intervals = find_intervals(problem.flights, parts, noise)
        region = find_region(problem.flights, parts, noise)
        physics, ties = _physics(problem, member)
        hypothesis = member.steps[0].score.hypothesis
        to_separate = as_sentence(hypothesis.separated_by) if ties else ""
        left = _residual_fraction(bare, plain, member, axes)
        if left > _LARGE_RESIDUAL:
            ties = (*[e for e in ties if e != UNNAMED][: _TIES - 1], UNNAMED)
            physics = _with_unknown(physics, left, axes)
        made.append(
            EffectFinding(
                axes,
                hypothesis.kind,
                physics,
                intervals,
                region,
                ties,
                to_separate,
                bars,
                float("nan"),
                judging.explained(delivered, after, axes),
                float(carried[i]) / total if total > 0.0 else 1.0,
            )
        )
        before, without = with_it, extended
    explainable = ceiling({c for finding in made for c in finding.axes})
    return [replace(finding, explainable=_mean(explainable, finding.axes)) for finding in made]


def _axes(gained: Mapping[str, float], problem: DiagnosisProblem, member: Member) -> tuple[str, ...]:
    """Responses whose error decreases, the largest decrease first."""
    touched = [c for c in problem.responses if any(c in problem.accepted[k].responses for k in member.places)]
    mine = {c: g for c, g in gained.items() if c in touched}
    if not mine:
        return tuple(touched)
    largest = max(mine.values())
    named = [c for c, g in mine.items() if g >= max(_LEAST, _SHOWN * largest)]
    return tuple(sorted(named, key=lambda c: -mine[c])) or (max(mine, key=lambda c: mine[c]),)


def _physics(problem: DiagnosisProblem, member: Member) -> tuple[tuple[Physics, ...], tuple[str, ...]]:
    step = member.steps[0]
    hypothesis = step.score.hypothesis
    # Evidence of the level says nothing about gains: within their tolerances these would explain motion by the wind.
    given = problem.as_given
    fitted = [estimates(given if s.is_level else problem, k, s.score) for k, s in zip(member.places, member.steps)]
    sizes: dict[str, float] = {}
    says = " ".join(
        hypothesis.says(FittedEffect(problem.accepted[k].variant, e, sizes)) for k, e in zip(member.places, fitted)
    )
    probabilities = dict(step.alternatives)
    stated = [problem.accepted[k].variant.stated(e) for k, e in zip(member.places, fitted)]
    merged = dict(stated[0])
    for j, more in enumerate(stated[1:], 2):
        merged |= {f"{name} ({j})" if name in merged else name: e for name, e in more.items()}
    terms = tuple(t for k in member.places for t in problem.accepted[k].variant.terms)
    limits = "; ".join(
        filter(None, (implausible(problem.accepted[k].variant, e) for k, e in zip(member.places, fitted)))
    )
    check = as_sentence(hypothesis.check)
    best = Physics(member.effect, member.probability, says, merged, terms, limits, check)
    alternatives = []
    for score in step.others:
        p = probabilities.get(score.effect, 0.0)
        if score.effect != member.effect and p >= LISTED:
            found = found_by(score)
            says_too = score.hypothesis.says(found)
            variant = score.signature.variant
            alternatives.append(Physics(score.effect, p, says_too, variant.stated(found.estimates), variant.terms))
    if probabilities.get(UNNAMED, 0.0) >= LISTED:
        alternatives.append(Physics(UNNAMED, probabilities[UNNAMED], UNKNOWN_SAYS))
    alternatives = sorted(alternatives, key=lambda p: -p.probability)[: _ALTERNATIVES - 1]
    ties = [e for e, p in step.alternatives if e not in (member.effect, "nothing") and p > TIED * member.probability]
    if step.constant:  # a constant is identified by its fraction in each response only
        tried = {s.effect for s in step.others}
        ties += [e for e in hypothesis.look_alikes if e in tried and e not in ties]
    return (best, *alternatives), tuple(ties[:_TIES])


def _residual_fraction(bare: DiagnosisProblem, plain: DiagnosisProblem, member: Member, axes: Sequence[str]) -> float:
    """Fraction of the power beyond the noise that all effects leave in some responses, with exact tolerances.

    Zero for an effect that is a constant part only.
    """
    step = member.steps[0]
    if step.constant:
        return 0.0
    before, after = (judging.excess(b, *judged_on(step.score)) for b in (bare, plain))
    beyond = sum(max(0.0, before[c][0] - 1.0) for c in axes)
    left = sum(max(0.0, after[c][0] - 1.0 - SLIGHT) for c in axes)
    return min(left / beyond, 1.0) if beyond > 0.0 else 0.0


def _with_unknown(physics: Sequence[Physics], left: float, axes: Sequence[str]) -> tuple[Physics, ...]:
    """Physics with the probability of an unknown cause after a large residual, the most probable first."""
    known, other = share_with_unknown(physics, min(left, _MAX_UNKNOWN))
    says = f"It leaves {format_percent(left)} of the power beyond the noise in {join_names(axes)}."
    known[0] = replace(known[0], says=f"{known[0].says} {says}")
    return known[0], *sorted([other, *known[1:]], key=lambda one: -one.probability)


def share_with_unknown(physics: Sequence[Physics], fraction: float) -> tuple[list[Physics], Physics]:
    """Names less probable by a fraction, and the unknown cause with the rest of the probability."""
    known = [replace(one, probability=(1.0 - fraction) * one.probability) for one in physics if one.effect != UNNAMED]
    total = sum(one.probability for one in physics)
    return known, Physics(UNNAMED, total - sum(one.probability for one in known), UNKNOWN_SAYS)


def _mean(values: Mapping[str, float], axes: Sequence[str]) -> float:
    some = [values[c] for c in axes if c in values]
    return float(np.mean(some)) if some else float("nan")
