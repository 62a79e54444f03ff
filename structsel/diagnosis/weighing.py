"""Probabilities of the candidate effects, from their evidence, the error that they explain and their alternatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.diagnosis import judging
from structsel.diagnosis.explained import SLIGHT, Taken, explained_fraction, fractions_there, largest
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.size_evidence import agreed, beyond_form, beyond_plant_form
from structsel.numerics.arrays import Array

_CONFIRMED = 1.5  # log Bayes factor that counts at most, over that on the response to the inputs
_PART, _ALL = 0.75, 0.95
"""Fractions of all that exceeds the noise on other flights. An effect that explains more than the first counts in part
without the response to the inputs, above the second fully. Gusts and noise differ between manoeuvres: an effect that
resembles them leaves much of the next one."""
_EACH = 5  # effects that are compared, by the log Bayes factor over the tolerances and by that over the simulation
_EVENT = 0.5  # fraction of the evidence that counts for an effect of one flight, which no other flight can predict
_FEW = 20.0  # log Bayes factor below which its relative lead means little
_NEAR = 0.95  # ratio of log Bayes factors from which two effects are equally good
_CLEAR = 10.0  # scale of the log Bayes factor with the simulation as given
_ALONE = 1.0 / 3.0  # fraction of the lead with the simulation as given that counts if tolerances absorb the effect
_OWN = 20.0  # log evidence of a form at which its feature saturates
_BEHIND, _FURTHEST = 0.02, 3.0  # scale of the distance to the best effect, over its log Bayes factor; largest distance
_LOWERS, _THERE = 0.05, 0.5
"""Fraction by which the rms of some coefficient must decrease on other flights, or fraction explained where it acts."""
_DEGRADES = 0.5  # fraction by which no rms may increase; an effect that degrades more is no alternative either
EVIDENT, _PLENTY = 10.0, 300.0
"""Least log Bayes factor of a candidate with tolerances; or of the first with the simulation as given, if tolerances
absorb it."""

FEATURES = (
    "ahead", "ahead alone", "takes", "takes there", "level", "own", "event", "prior", "takes besides",
    "behind",
)  # fmt: skip
"""Features of an effect. B is its log Bayes factor over the tolerances, B0 that over the simulation as given.

ahead : lead of B over the best alternative, relative to B; or a third of `ahead alone`, if that is larger.
ahead alone : the same for B0, if positive, times log(1 + B0 / 10).
takes, level : fraction explained beyond the noise, and of the constant parts beyond the biases, with exact tolerances.
takes there : fraction explained of the samples at which it acts, weighted by the squared effect.
own : log evidence of its form with every tolerance free, over 20.
event : it has event times that were searched in the differences, or acts in one flight only.
prior : log frequency with which simulations lack it, relative to other effects.
takes besides : as `takes there`, with tolerances free, times log(1 + B / 10).
behind : B minus that of the best candidate, over 10 or a fiftieth of the latter, at least -3; B0 in place of B if the
    effect is a candidate by B0 only.
"""
NOTHING = -5.052
WEIGHTS = np.array([2.556, 0.038, 3.187, 1.785, 1.923, 0.201, -2.141, 0.653, 0.520, 0.611])
"""From development cases, by the logit of `proof/calibrate.py` (docs/decisions/0012-naming-an-effect.md)."""
NO_ALTERNATIVE = 1.0
"""Log odds that an effect loses if it is compared with no effect only, where its lead is largest."""
IDENTIFIED = 1.0
"""Log odds that an effect loses if the simulation was identified from its own flights: the form is not exact.
Of ten correct free simulations of development seeds (polynomial, from 81000) three had odds of 0.54 to 0.60 without."""
_EVEN, _SCALE = 32.0, 3.0
"""Log Bayes factor times the fraction of white noise in the residual forces, at which an effect has probability one
half however little it explains; and its scale. Correct simulations in calm air have at most 26
(34 of the proof's generators, development seeds from 71000)."""
_EVEN_LEVEL, _SCALE_LEVEL = 12.0, 1.5
"""Log Bayes factor of moving air that explains the level of a plant's velocities, at which it has probability one half,
and its scale. Simulations in still air have 11 at most (eight generated, two of a real UAV with its wind taken out)."""
_COLOURED, _DECAY, _SURE = 3.0, 8, 400.0
"""Log odds that a mismatch loses where the residual forces contain no white noise and the effect decreases the error of
no response on other flights; times the fraction of coloured noise to this power. Half of it where the flights agree on
the size by this log Bayes factor. Small physics that is not modelled, and gusts, are then larger than the noise and
resemble every effect a little. Log odds without alternatives, where less than a tenth is white and the error decreases
by less than a sixth: up to 1.9 in correct simulations, real ones and those of the proof; 3.9 and 4.6 with a real effect
that acts for a short time."""
AGREED = 2.0  # log Bayes factor of the size that flights agree on, at which an effect has probability one half
NOTHING_UNTESTED = -6.031
WEIGHTS_UNTESTED = np.array([2.576, 0.059, 3.158, 2.192, 1.923, 0.071, -1.945, 0.362, 0.532, 0.5])
"""Earlier weights, for effects that are not tested on the response to the inputs: their evidence is worth less."""


@dataclass(frozen=True, eq=False)
class CandidateEffect:
    """One effect that may be missing.

    Attributes
    ----------
    score : EffectScore
    features : (f,) array
        See `FEATURES`.
    max_log_odds : float
        Largest log odds that the agreement of the flights on its size permits, with tolerances free.
    lowers : bool
        Whether it decreases the error on other flights visibly.
    gain : float
        Largest fraction by which it decreases the rms of a response there.
    identified : bool
        Whether the simulation was identified from its own flights.
    of_form : float
        Log Bayes factor of its size, with the form of a plant or of an identified simulation as its error.
    is_plant : bool
        Whether no coefficient is simulated.
    """

    score: EffectScore
    features: Array
    max_log_odds: float = np.inf
    lowers: bool = True
    gain: float = 1.0
    identified: bool = False
    of_form: float = np.inf
    is_plant: bool = False

    @property
    def log_odds(self) -> float:
        """Log odds against no effect, with its alternatives."""
        by_level = (log_bayes(self.score) - _EVEN_LEVEL) / _SCALE_LEVEL if self.is_level else -np.inf
        return min(self.max_log_odds, max(by_level, self._of(self.features)))

    @property
    def is_level(self) -> bool:
        """Whether it is steadily moving air that explains the level of a plant's velocities on other flights."""
        return (
            self.is_plant
            and self.score.hypothesis.kind == "atmospheric"
            and not self.score.event
            and self.constant
            and self.lowers
        )

    @property
    def log_odds_alone(self) -> float:
        """Log odds against no effect as if it had no alternatives, if it is tested on the response to the inputs.

        An effect that is not tested may be any part of the mismatch with the same motion as its alternatives.
        """
        if not self._is_tested:
            return self.log_odds
        x = self.features.copy()
        as_given = np.log1p(max(0.0, log_bayes_as_given(self.score)) / _CLEAR)
        x[FEATURES.index("ahead alone")] = as_given
        x[FEATURES.index("ahead")] = max(ahead_of(self.score, (), log_bayes), _ALONE * as_given)
        x[FEATURES.index("behind")] = 0.0
        return min(self.max_log_odds, self._of(x) - NO_ALTERNATIVE)

    @property
    def _is_tested(self) -> bool:
        return self.score.input_only is not None or self.score.hypothesis.kind == "atmospheric"

    def _of(self, features: Array) -> float:
        less = IDENTIFIED * self.identified
        if self._is_tested:
            return float(NOTHING - less + features @ WEIGHTS)
        return float(NOTHING_UNTESTED - less + features @ WEIGHTS_UNTESTED)

    @property
    def loss(self) -> float:
        """Log odds that it loses against no effect if the residual contains no white noise."""
        sure = max(self.max_log_odds, 0.0) if np.isfinite(self.max_log_odds) else 0.0
        return _COLOURED * (1.0 - self.gain) / (1.0 + sure / _SURE) if self._is_tested else 0.0

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.score.effect

    @property
    def constant(self) -> bool:
        """Whether it explains more of the constant part of the flights than of the rest."""
        takes, level = self.features[[FEATURES.index("takes"), FEATURES.index("level")]]
        return bool(level > takes)


def predictive_log_bayes(score: EffectScore) -> float:
    """Log Bayes factor of an effect on flights that were held out."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def log_bayes(score: EffectScore) -> float:
    """Log Bayes factor of an effect over the tolerances, on held-out flights or on all flights.

    That of an event on all flights counts in part. The factor is limited by that on the response to the inputs,
    unless the effect explains nearly all of the residual.
    """
    recorded = predictive_log_bayes(score) if score.event else max(predictive_log_bayes(score), score.log_evidence)
    if score.input_only is None:
        return recorded
    return bounded(recorded, log_bayes(score.input_only), score.unconfirmed_weight)


def bounded(recorded: float, input_only: float, unconfirmed_weight: float = 0.0) -> float:
    """Log Bayes factor that counts, from that on the recorded motion and that on the response to the inputs."""
    return min(recorded, (1.0 - unconfirmed_weight) * _CONFIRMED * input_only + unconfirmed_weight * recorded)


def log_bayes_as_given(score: EffectScore) -> float:
    """Log Bayes factor of an effect with exact tolerances, limited by that on the response to the inputs."""
    recorded = float(score.trial.at_scales[-1])
    if score.input_only is None:
        return recorded
    return bounded(recorded, log_bayes_as_given(score.input_only), score.unconfirmed_weight)


def unconfirmed_log_bayes(scores: Sequence[EffectScore]) -> float:
    """Largest part of a log Bayes factor that the response to the inputs does not confirm."""
    return max((log_bayes(replace(s, input_only=None)) - max(0.0, log_bayes(s)) for s in scores), default=0.0)


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
    found = {s.hypothesis.name for s in problem.accepted}
    if log_bayes(score) >= EVIDENT:
        return not (score.event and score.effect in found)
    return not found and log_bayes_as_given(score) >= _PLENTY


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
        as_given = max(0.0, ahead_of(one, alternatives, log_bayes_as_given)) * np.log1p(
            max(0.0, log_bayes_as_given(one)) / _CLEAR
        )
        ahead = max(ahead_of(one, alternatives, log_bayes), _ALONE * as_given)
        extended = problem.with_effect(one.signature)
        besides = largest(fractions_there(one, problem, extended), problem)
        values = (
            ahead,
            as_given,
            taken.moving,
            taken.there,
            taken.level,
            float(np.clip(one.own / _OWN, -1.0, 1.0)),
            one.event,
            one.hypothesis.log_prior,
            besides * np.log1p(max(0.0, log_bayes(one)) / _CLEAR),
            behind(one, [other for other, *_ in kept]),
        )
        of_form = beyond_form(problem, extended)
        max_log_odds = min(np.inf if one.event else agreed(extended), of_form) - AGREED
        identified = problem.flights[0].is_identified
        lowers = gain >= _LOWERS or taken.judged_there >= _THERE
        x = np.array(values, dtype=float)
        of_form = min(of_form, of_plant)
        made.append(CandidateEffect(one, x, max_log_odds, lowers, gain, identified, of_form, problem.is_plant))
    return made


def _admissible(
    problem: DiagnosisProblem, scores: Sequence[EffectScore]
) -> tuple[list[tuple[EffectScore, Taken, float, float]], list[EffectScore]]:
    """Candidate effects, with what each explains and how far it decreases the error; and all alternatives.

    An effect that degrades held-out flights is neither.
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
            gained = judging.gains(before, after, extended.judged_responses)
            gain, degrades = max(gained.values(), default=0.0), -min(gained.values(), default=0.0)
            if one.alone:  # other flights cannot predict the one on which it acts
                without, with_it = (judging.held_out(b, True, one.signature.flights) for b in (plain, extended))
                degrades = -min(judging.gains(without, with_it, extended.judged_responses).values(), default=0.0)
            if degrades > _DEGRADES:
                alternatives.remove(one)
            else:
                of_plant = beyond_plant_form(plain, before, after) if problem.is_plant else np.inf
                kept.append((one, taken, max(gain, 0.0), of_plant))
    return kept, alternatives


def probabilities(candidates: Sequence[CandidateEffect]) -> Array:
    """(1 + n,) probabilities of no further effect, and of each effect."""
    return np.asarray(scipy.special.softmax([0.0, *(one.log_odds for one in candidates)]))


def first_probabilities(candidates: Sequence[CandidateEffect], white: float | None) -> Array:
    """(1 + n,) probabilities in the first search: of no mismatch, and of each effect.

    The probability of a mismatch is computed from each effect as if it had no alternatives, and then distributed. With
    thousands of samples the evidence is always large. An effect that does not decrease the error visibly therefore
    counts in proportion to the white noise: a coloured residual may have caused the motion. One that does counts less
    where little is white. In a plant it counts in proportion to the decrease of the error on other flights.

    Parameters
    ----------
    candidates : sequence of CandidateEffect
    white : float or None
        Fraction of white noise in the residual forces; None without forces.
    """
    if not candidates:
        return np.ones(1)
    coloured = 0.0 if white is None else (1.0 - white) ** _DECAY
    counts = 0.0 if white is None else white * (1.0 - coloured**2)
    evidence = [
        min(((c.gain if c.is_plant else counts) * log_bayes(c.score) - _EVEN) / _SCALE, c.of_form - AGREED)
        for c in candidates
    ]
    as_given = [one.log_odds_alone - coloured * one.loss for one in candidates if one.lowers]
    by_level = [one.log_odds for one in candidates if one.is_level]
    some = float(scipy.special.expit(max([*evidence, *as_given, *by_level])))
    return np.array([1.0 - some, *(some * scipy.special.softmax([one.log_odds for one in candidates]))])


def ahead_of(one: EffectScore, scores: Sequence[EffectScore], evidence: Callable[[EffectScore], float]) -> float:
    """Lead of a log Bayes factor over the best alternative, relative to its own value; within -1 and 1.

    Alternatives within 5 % are not counted: these recordings cannot distinguish them.
    """
    mine = evidence(one)
    others = (evidence(s) for s in scores if s is not one)
    best = max([0.0, *(x for x in others if not _NEAR * mine <= x <= mine / _NEAR)])
    return float(np.clip((mine - best) / max(mine, _FEW), -1.0, 1.0))


def behind(one: EffectScore, kept: Sequence[EffectScore]) -> float:
    """Distance of a log Bayes factor to that of the best candidate; see `FEATURES`."""
    evidence = log_bayes if log_bayes(one) >= EVIDENT else log_bayes_as_given
    best = max(0.0, *map(evidence, kept))
    return max((evidence(one) - best) / max(_CLEAR, _BEHIND * best), -_FURTHEST)
