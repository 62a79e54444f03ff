"""Parameters beyond their tolerance that explain most of the error on other recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from structsel.comparison.nuisance import Nuisance
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import UNKNOWN_SAYS
from structsel.diagnosis.exceeded import EVEN, ExceededTolerance, exceeded_as_recorded
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.result import LISTED, UNNAMED, Bars, EffectFinding, Physics

_WIDER = 15.0
"""Prior standard deviation of a parameter that may be exceeded, over its stated tolerance."""
_MOST = 0.5  # fraction of the mean square of a response on other recordings, that it must explain
_LARGEST = 0.6  # relative deviation that is plausible of a moment of inertia
_ALIKE = 0.9  # of the largest fraction, from which another parameter explains as much
_CERTAIN = 0.99


@dataclass(frozen=True, eq=False)
class _Freed:
    """One parameter that is free, and what is then explained of each response on other recordings [mean square]."""

    tolerance: ExceededTolerance
    problem: DiagnosisProblem
    fractions: Mapping[str, float]

    @property
    def response(self) -> str:
        """Response of which it explains most."""
        return max(self.fractions, key=lambda c: self.fractions[c])

    @property
    def largest(self) -> float:
        """The fraction that it explains of this response."""
        return self.fractions[self.response]


def find_material(ranking: Ranking, findings: Sequence[EffectFinding]) -> list[EffectFinding]:
    """The findings, and a parameter beyond its tolerance, if it explains most of a response beside them.

    The noise of a real recording is not white, so a deviation of many tolerances may mean little: a parameter counts if
    with it alone, all others as stated, the mean square of a response on other recordings falls by half. It comes
    before the effects if its name is more probable than the first one's and it explains more.

    Parameters
    ----------
    ranking : Ranking
        With all effects that were found.
    findings : sequence of EffectFinding
        These effects.
    """
    problem = ranking.problem
    beyond = {one.tolerance.name for one in exceeded_as_recorded(problem, white=1.0) if one.log_odds > 0.0}
    freed = _freed(problem, [n for n in problem.nuisances if n.name in beyond])
    if not freed or (best := max(freed, key=lambda one: one.largest)).largest < _MOST:
        return list(findings)
    freed += _freed(problem, [n for n in problem.nuisances if n.effect and n.name not in beyond])
    alike = [one for one in freed if one.fractions[best.response] >= _ALIKE * best.largest]
    made = _finding(ranking, best, sorted(alike, key=lambda one: -one.fractions[best.response]))
    bare = judging.held_out(problem.as_given.subset([]))
    by_effects, by_parameter = sum(_explained(bare, problem.as_given).values()), sum(best.fractions.values())
    likelier = made.physics[0].probability > findings[0].physics[0].probability
    ahead = sum(not likelier or by_effects * finding.fraction >= by_parameter for finding in findings)
    return [*findings[:ahead], made, *findings[ahead:]]


def _freed(problem: DiagnosisProblem, tolerances: Sequence[Nuisance]) -> list[_Freed]:
    """Those of some parameters that deviate by more than their tolerance if they are free and all others as stated."""
    made, given = [], judging.held_out(problem.as_given)
    for tolerance in tolerances:
        freed = problem.with_exceeded(tolerance, _WIDER)
        deviation, std = (float(x[-1]) for x in freed.deviations)
        plausible = tolerance.effect != "inertia-error" or abs(deviation) * tolerance.sd < _LARGEST
        if plausible and abs(deviation) - std > EVEN:
            exceeded = ExceededTolerance(tolerance, deviation, std)
            made.append(_Freed(exceeded, freed, _explained(given, freed)))
    return made


def _explained(before: judging.Residuals, extended: DiagnosisProblem) -> dict[str, float]:
    """Fraction of the mean square of each judged response that is explained on other recordings."""
    gained = judging.gains(before, judging.held_out(extended), extended.judged_responses)
    return {c: 1.0 - (1.0 - g) ** 2 for c, g in gained.items()}


def _finding(ranking: Ranking, best: _Freed, alike: Sequence[_Freed]) -> EffectFinding:
    problem = ranking.problem
    named = {one.tolerance.effect: one for one in reversed(alike)}  # of each effect the parameter that explains most
    share = best.largest * _CERTAIN / sum(one.fractions[best.response] for one in named.values())
    physics = [
        Physics(
            effect,
            share * one.fractions[best.response],
            one.tolerance.says,
            {one.tolerance.tolerance.name: one.tolerance.estimate},
        )
        for effect, one in reversed(named.items())
    ]
    if (rest := _CERTAIN - sum(p.probability for p in physics)) >= LISTED:
        physics.append(Physics(UNNAMED, rest, UNKNOWN_SAYS))
    physics.sort(key=lambda p: -p.probability)
    axes = tuple(
        sorted((c for c, f in best.fractions.items() if f >= 0.5 * best.largest), key=lambda c: -best.fractions[c])
    )
    got, delivered, after = judging.measured(problem), judging.as_given(problem), judging.held_out(best.problem)
    fits = [judging.fit(got, x, axes) for x in (delivered, judging.held_out(problem.as_given), after)]
    bars = {c: Bars(fits[0][c], fits[1][c], fits[2][c]) for c in axes if c in fits[2]}
    ties = tuple(p.effect for p in physics[1:] if p.effect != UNNAMED)
    nan = float("nan")
    explained = judging.explained(delivered, after, axes)
    kinds = {s.effect: s.hypothesis.kind for s in ranking.scores}
    kind = kinds.get(physics[0].effect, "parameter")
    return EffectFinding(axes, kind, tuple(physics), {}, {}, ties, "", bars, nan, explained, 0.0)
