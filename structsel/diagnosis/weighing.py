"""Probabilities of the candidate effects, from their evidence, the error that they explain and their alternatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from structsel.diagnosis import judging
from structsel.diagnosis.dispersion import Dispersion
from structsel.diagnosis.effect_probability import AGREED, FEATURES, EffectEvidence
from structsel.diagnosis.explained import SLIGHT, Taken, explained_fraction
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.size_evidence import agreed, beyond_form, beyond_plant_form

Evidence = Callable[[EffectScore], float]

_CONFIRMED = 1.5  # log Bayes factor that counts at most, over that on the response to the inputs
_PART, _ALL = 0.75, 0.95
"""Fractions of all that exceeds the noise on other flights. An effect that explains more than the first counts in part
without the response to the inputs, above the second fully. Gusts and noise differ between manoeuvres: an effect that
resembles them leaves much of the next one."""
_EACH = 5  # effects that are compared, by the log Bayes factor over the tolerances and by that over the simulation
_EVENT = 0.5  # fraction of the evidence that counts for an effect of one flight, which no other flight can predict
_FEW = 20.0  # log Bayes factor below which its relative lead means little
_EQUAL, _LESS = 0.975, 0.925
"""Ratios of log Bayes factors from which two effects are equally good, and up to which one is better."""
_CLEAR = 10.0  # scale of the log Bayes factor with the simulation as given
_ALONE = 1.0 / 3.0  # fraction of the lead with the simulation as given that counts if tolerances absorb the effect
_BEHIND, _FURTHEST = 0.02, 3.0  # scale of the distance to the best effect, over its log Bayes factor; largest distance
_LOWERS, _THERE = 0.05, 0.5
"""Fraction by which the rms of some coefficient must decrease on other flights, or fraction explained where it acts."""
_DEGRADES = 0.5  # fraction by which no rms may increase; an effect that degrades more is no alternative either
EVIDENT, _PLENTY = 10.0, 300.0
"""Least log Bayes factor of a candidate with tolerances; or of the first with the simulation as given, if tolerances
absorb it."""


@dataclass(frozen=True, eq=False)
class CandidateEffect(EffectEvidence):
    """One effect that may be missing.

    Attributes
    ----------
    score : EffectScore
    """

    score: EffectScore = field(kw_only=True)

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.score.effect


def predictive_log_bayes(score: EffectScore) -> float:
    """Log Bayes factor of an effect on flights that were held out."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def log_bayes(score: EffectScore) -> float:
    """Log Bayes factor of an effect over the tolerances, on held-out flights or on all flights.

    That of an event on all flights counts in part. It is lower where the residual is larger than the noise, see
    `Dispersion`, and limited by the factor on the response to the inputs, unless the effect explains nearly all of the
    residual.
    """
    return _as_confirmed(score, _dispersed)


def _dispersed(score: EffectScore) -> float:
    """Log Bayes factor over the tolerances on the recorded motion, by the residual where the effect acts."""
    return score.dispersion.reduced(_recorded(score))


def _recorded(score: EffectScore) -> float:
    """Log Bayes factor over the tolerances on the recorded motion, by the estimated noise."""
    return predictive_log_bayes(score) if score.event else max(predictive_log_bayes(score), score.log_evidence)


def confirmed(input_only: float, contradiction: float) -> float:
    """Log Bayes factor on the response to the inputs; lower where it favours no effect over one as large as recorded.

    Turbulence that moves the aircraft gives an effect another size on the recorded motion than it has there.

    Parameters
    ----------
    input_only : float
        Log Bayes factor there.
    contradiction : float
        What it loses if the size is the recorded one; see `EffectScore.contradiction`.
    """
    return input_only - max(0.0, contradiction - max(0.0, input_only))


def bounded(recorded: float, input_only: float, unconfirmed_weight: float = 0.0) -> float:
    """Log Bayes factor that counts, from that on the recorded motion and that on the response to the inputs."""
    return min(recorded, (1.0 - unconfirmed_weight) * _CONFIRMED * input_only + unconfirmed_weight * recorded)


def log_bayes_as_given(score: EffectScore) -> float:
    """Log Bayes factor of an effect with exact tolerances, limited by that on the response to the inputs."""
    return _as_confirmed(score, lambda one: one.as_given)


def log_bayes_alone(score: EffectScore) -> float:
    """As `log_bayes_as_given`, less what the tolerances would still add; see `EffectScore.as_given_alone`."""
    return _as_confirmed(score, lambda one: one.as_given_alone)


def _as_confirmed(score: EffectScore, evidence: Evidence) -> float:
    """A log Bayes factor, limited by that on the response to the inputs."""
    recorded = evidence(score)
    if score.input_only is None:
        return recorded
    there = confirmed(_as_confirmed(score.input_only, evidence), score.contradiction)
    return bounded(recorded, there, score.unconfirmed_weight)


def unconfirmed_log_bayes(scores: Sequence[EffectScore]) -> float:
    """Largest part of a log Bayes factor that the response to the inputs does not confirm."""
    return max((_recorded(s) - max(0.0, _as_confirmed(s, _recorded)) for s in scores), default=0.0)


def shows(score: EffectScore) -> bool:
    """Whether an effect has enough evidence to be examined, with free tolerances or with exact ones."""
    return max(log_bayes(score), log_bayes_as_given(score)) >= EVIDENT


def with_dispersion(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores with the dispersion of the evident effects; not of plants, whose noise is all that nothing explains."""
    if problem.is_plant:
        return list(scores)

    return [replace(s, dispersion=Dispersion.of(problem, s.signature)) if shows(s) else s for s in scores]


def with_unconfirmed_weight(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores with the fraction of their evidence that counts without the response to the inputs."""
    plain = problem.as_given
    before = _beyond_noise(plain)

    def known(score: EffectScore) -> EffectScore:
        takes = explained_fraction(before, _beyond_noise(plain.with_effect(score.signature)), SLIGHT)
        return replace(score, unconfirmed_weight=float(np.clip((takes - _PART) / (_ALL - _PART), 0.0, 1.0)))

    return [known(s) if _is_unconfirmed(s) else s for s in scores]


def _is_unconfirmed(score: EffectScore) -> bool:
    """Whether the response to the inputs confirms less than the complete evidence of an effect."""
    plain = replace(score, input_only=None)
    return not score.event and (
        log_bayes(score) < log_bayes(plain) or log_bayes_as_given(score) < log_bayes_as_given(plain)
    )


def _beyond_noise(problem: DiagnosisProblem) -> float:
    """Residual power beyond the noise on held-out flights, of all responses together, plus one [noise power]."""
    return 1.0 + sum(motion - 1.0 for motion, _ in judging.excess(problem).values())


def leading_effects(scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Effects with the largest log Bayes factors over the tolerances or the simulation as given, in the given order."""
    best = [s for by in (log_bayes, log_bayes_as_given) for s in sorted(scores, key=by, reverse=True)[:_EACH]]
    return [s for s in scores if s in best]


def evident(problem: DiagnosisProblem, score: EffectScore) -> bool:
    """Whether an effect has enough evidence for a candidate. An event that was found is none.

    After a finding only the log Bayes factor over the tolerances counts. Their deviations then favour the effects that
    resemble them more than in a correct simulation.
    """
    if log_bayes(score) >= EVIDENT:
        return not (score.event and score.effect in problem.found)
    return not problem.accepted and log_bayes_as_given(score) >= _PLENTY


def candidate_effects(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[CandidateEffect]:
    """Candidate effects that do not degrade held-out flights, with their features.

    Parameters
    ----------
    problem : DiagnosisProblem
    scores : sequence of EffectScore
        Of all effects.
    """
    kept, alternatives = _admissible(problem, scores)
    made = []
    for one, taken, gain, of_plant in kept:
        extended = problem.with_effect(one.signature)
        of_form = beyond_form(problem, extended)
        air = one.hypothesis.kind == "atmospheric"
        values = {
            "ahead": lead(one, alternatives),
            "takes": taken.moving,
            "level": taken.level,
            "behind": behind(one, [other for other, *_ in kept]),
            "event": one.event,
            "further": bool(problem.found - {one.effect}),
        }
        made.append(
            CandidateEffect(
                features=np.array([values[name] for name in FEATURES], dtype=float),
                lead_alone=lead(one, (), log_bayes_alone),
                log_bayes=log_bayes(one),
                max_log_odds=min(np.inf if one.event else agreed(extended), of_form) - AGREED,
                lowers=gain >= _LOWERS or taken.judged_there >= _THERE,
                gain=gain,
                identified=problem.flights[0].is_identified,
                of_form=min(of_form, of_plant),
                is_plant=problem.is_plant,
                is_tested=one.input_only is not None or (air and not problem.is_plant),
                is_air=air,
                log_prior=one.hypothesis.log_prior,
                score=one,
            )
        )
    return made


def _admissible(
    problem: DiagnosisProblem, scores: Sequence[EffectScore]
) -> tuple[list[tuple[EffectScore, Taken, float, float]], list[EffectScore]]:
    """Candidate effects, with what each explains and how far it decreases the error; and all alternatives.

    An effect that degrades held-out flights is neither. With exact tolerances it may do so because it takes their
    deviations; one that has evidence over the tolerances must degrade with free ones too.
    """
    plain = problem.as_given
    before = judging.held_out(plain, True)
    kept: list[tuple[EffectScore, Taken, float, float]] = []
    alternatives, judged = list(scores), set()
    # The next effect takes the place of one that degrades held-out flights.
    while asked := [s for s in leading_effects(alternatives) if evident(problem, s) and s.effect not in judged]:
        for one in asked:
            judged.add(one.effect)
            extended = plain.with_effect(one.signature)
            taken = Taken.by(one, plain, extended)
            after = judging.held_out(extended, True)
            gain = max(judging.gains(before, after, extended.judged_responses).values(), default=0.0)
            degrades = _degrades(one, plain, extended)
            if degrades and log_bayes(one) >= EVIDENT:
                degrades = _degrades(one, problem, problem.with_effect(one.signature))
            if degrades:
                alternatives.remove(one)
            else:
                of_plant = beyond_plant_form(plain, before, after) if problem.is_plant else np.inf
                kept.append((one, taken, max(gain, 0.0), of_plant))
    return kept, alternatives


def _degrades(one: EffectScore, problem: DiagnosisProblem, extended: DiagnosisProblem) -> bool:
    """Whether an effect increases the error of a response on held-out flights too far."""
    # Other flights cannot predict the one on which an event of one flight acts.
    but_for = one.signature.flights if one.alone else ()
    before, after = (judging.held_out(b, True, but_for) for b in (problem, extended))
    return min(judging.gains(before, after, extended.judged_responses).values(), default=0.0) < -_DEGRADES


def lead(one: EffectScore, alternatives: Sequence[EffectScore], as_given: Evidence = log_bayes_as_given) -> float:
    """Lead over the best alternative, relative to its own log Bayes factor over the tolerances.

    Or a third of that with the simulation as given, times log(1 + its factor / 10), if that is larger.

    Parameters
    ----------
    one : EffectScore
    alternatives : sequence of EffectScore
    as_given : callable
        Log Bayes factor of an effect with the simulation as given.
    """
    scaled = max(0.0, ahead_of(one, alternatives, as_given, log_bayes)) * np.log1p(max(0.0, as_given(one)) / _CLEAR)
    return max(ahead_of(one, alternatives, log_bayes), _ALONE * float(scaled))


def ahead_of(one: EffectScore, scores: Sequence[EffectScore], evidence: Evidence, *also: Evidence) -> float:
    """Lead of a log Bayes factor over the best alternative, relative to its own value; within -1 and 1.

    Alternatives within a few per cent, by `also` too, are not counted: these recordings cannot distinguish them.
    """
    mine, by = evidence(one), (evidence, *also)
    counted = (evidence(s) * max(_distinguished(e(s), e(one)) for e in by) for s in scores if s is not one)
    return float(np.clip((mine - max([0.0, *counted])) / max(mine, _FEW), -1.0, 1.0))


def _distinguished(one: float, other: float) -> float:
    """How far two log Bayes factors differ, between 0 and 1."""
    largest = max(one, other)
    return float(np.clip((_EQUAL - min(one, other) / largest) / (_EQUAL - _LESS), 0.0, 1.0)) if largest > 0.0 else 1.0


def behind(one: EffectScore, kept: Sequence[EffectScore]) -> float:
    """Distance of a log Bayes factor to that of the best candidate; see `FEATURES`."""
    evidence = log_bayes if log_bayes(one) >= EVIDENT else log_bayes_as_given
    best = max(0.0, *map(evidence, kept))
    return max((evidence(one) - best) / max(_CLEAR, _BEHIND * best), -_FURTHEST)
