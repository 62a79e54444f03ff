"""Findings without one effect as their cause: a detected mismatch, unknown physics, and turbulence."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from structsel.comparison.locating.ceiling import explainable
from structsel.comparison.locating.turbulence import TurbulenceEstimate
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import found_by
from structsel.diagnosis.ranking import NAMED, TIED, Ranking
from structsel.diagnosis.result import LISTED, UNNAMED, Bars, EffectFinding, Physics
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

_MATERIAL = 0.10  # fraction by which the error would decrease


def find_unknown(
    ranking: Ranking,
    left: Sequence[Mapping[str, Array]],
    responses: Sequence[str],
    ceiling: Callable[[Collection[str]], Mapping[str, float]],
) -> list[EffectFinding]:
    """Repeatable mismatch that no effect in the library explains, if there is one.

    Parameters
    ----------
    ranking : Ranking
    left : sequence of mapping of response to (n,) array
        Residual of tolerances and the effects found, per flight.
    responses : sequence of str
        Responses by which effects are judged.
    ceiling : callable
        Some responses to the fraction of the mismatch of each that a regression model predicts.
    """
    problem = ranking.problem
    got, delivered = judging.measured(problem), judging.as_given(problem)
    after = judging.refitted(delivered, judging.held_out(problem))
    # Half of a residual that is little more than noise cannot be predicted: no regression is needed. The noise of a
    # plant is all that its simulation and the library do not explain.
    remaining = {
        c: judging.rms(after, c) / judging.rms(delivered, c)
        for c in responses
        if judging.rms(delivered, c) > 0.0 and (c not in COEFFICIENTS or not judging.is_noise(problem, c))
    }
    tested = [c for c, w in remaining.items() if w > _MATERIAL]
    fraction = explainable(problem.flights, left, tested) if tested else {}
    worth = {c: remaining[c] * (1.0 - np.sqrt(1.0 - s)) for c, s in fraction.items() if s > NAMED}
    axes = tuple(sorted((c for c, w in worth.items() if w > _MATERIAL), key=lambda c: -worth[c]))
    if not axes:
        return []
    fits = judging.fit(got, delivered, axes), judging.fit(got, after, axes)
    bars = {c: Bars(fits[0][c], fits[1][c], fits[1][c]) for c in axes}
    listed = ", ".join(f"{fraction[c]:.0%} of the residual in {c}" for c in axes)
    says = (
        "A repeatable mismatch remains that no effect in the library explains: a regression model predicts "
        f"{listed} on recordings that were held out."
    )
    mean = float(np.mean(list(ceiling(axes).values())))
    physics = Physics(UNNAMED, float(np.clip(np.mean([fraction[c] for c in axes]), 0.0, 1.0)), says)
    return [EffectFinding(axes, "static", (physics,), {}, {}, (), "", bars, mean, 0.0, 0.0, is_fitted=False)]


def detected(ranking: Ranking, responses: Sequence[str]) -> list[EffectFinding]:
    """Mismatch that the prediction errors show, if no effect is the most probable cause.

    Parameters
    ----------
    ranking : Ranking
        With the probabilities after the detection.
    responses : sequence of str
        Responses by which effects are judged.
    """
    probabilities, detection = dict(ranking.considered), ranking.detection
    if detection is None or 1.0 - probabilities["nothing"] < NAMED:
        return []
    by_effect = detection.by_effect({s.effect for s in ranking.scores})
    physics = [
        Physics(UNNAMED, probabilities[UNNAMED], f"Something that no single effect explains well. {detection.says}")
    ]
    for score in ranking.others:
        if score.effect not in by_effect and probabilities[score.effect] >= LISTED:
            found = found_by(score)
            physics.append(
                Physics(score.effect, probabilities[score.effect], score.hypothesis.says(found), found.estimates)
            )
    for effect in (e for e in by_effect if probabilities[e] >= LISTED):
        one = next(x for x in detection.tolerances if x.effect == effect)
        physics.append(Physics(effect, probabilities[effect], one.says, {one.tolerance.name: one.estimate}))
    physics.sort(key=lambda one: -one.probability)
    ties = tuple(p.effect for p in physics[1:4] if p.probability > TIED * physics[0].probability)
    problem = ranking.problem
    axes = tuple(c for c in detection.axes if c in responses) or tuple(responses[:1])
    fits = [judging.fit(judging.measured(problem), judging.as_given(problem), axes)]
    after = judging.refitted(judging.as_given(problem), judging.held_out(problem))
    fits.append(judging.fit(judging.measured(problem), after, axes))
    bars = {c: Bars(fits[0][c], fits[1][c], fits[1][c]) for c in axes if c in fits[1]}
    kinds = {s.effect: s.hypothesis.kind for s in ranking.scores}
    kind = kinds.get(physics[0].effect, "unknown")
    nan = float("nan")
    made = EffectFinding(
        axes, kind, tuple(physics), {}, {}, ties, "", bars, nan, 0.0, 0.0, events=detection.event, is_fitted=False
    )
    return [made]


def turbulent(found: TurbulenceEstimate, ranking: Ranking, responses: Sequence[str]) -> EffectFinding:
    """Turbulence as a finding: the simulation may be complete, but the air was turbulent."""
    problem = ranking.problem
    axes = tuple(c for c in ("CZ", "CY", "Cm", "Cl", "Cn", "CX") if c in responses)
    got, after = judging.measured(problem), judging.held_out(problem)
    fits = judging.fit(got, after, axes)
    bars = {c: Bars(fits[c], fits[c], fits[c]) for c in axes if c in fits}
    physics = Physics("turbulence", found.probability, found.says)
    return EffectFinding(axes[:2], "random", (physics,), {}, {}, (), "", bars, found.explained, found.explained, 0.0)
