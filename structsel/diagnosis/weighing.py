"""How likely each effect in question is, from what it brings, what it takes and what others bring."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.diagnosis import judging
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore
from structsel.numerics.arrays import Array

_BORNE_OUT = 1.5  # times what it brings where inputs alone drive the motion: no more of what an effect brings counts
_MOST, _ALL = 0.75, 0.95
"""But for what takes so much of all that is beyond the noise on other flights: from the one on part of it counts, from
the other on all. Gusts and noise are others in each manoeuvre, and what imitates them leaves much of the next."""
_EACH = 5  # effects weighed for what they bring beside tolerances, and for what they bring as delivered
_EVENT = 0.5  # of its evidence that an effect of one flight may count, which no other flight can foretell
SLIGHT = 0.2  # of the noise's power: a misfit that is no larger is not told from the noise's own scatter
_CONSTANT = 2.0  # of the biases' variance: the same of levels, of which there is one for each flight
_FEW = 20.0  # nats, below which being ahead by all of them means little
_NEAR = 0.95  # of an effect's nats, from which on another brings as much
_CLEAR = 10.0  # nats, to which those as delivered are compared
_ALONE = 1.0 / 3.0  # of how far an effect is ahead as delivered, that counts beside tolerances where those imitate it
_OWN = 20.0  # nats, beyond which more say no more
_BEHIND, _FURTHEST = 0.02, 3.0  # of the best's nats, by which an effect is behind it; and how far behind counts
_LOWERS, _THERE = 0.05, 0.5
"""Shares: by which some coefficient's rms must fall on other flights, or what it differs by where the effect acts."""
_SPOILS = 0.5  # share by which the rms of none may rise; what spoils more is no rival either
EVIDENT, _PLENTY = 10.0, 300.0
"""Nats that an effect must bring beside tolerances; or, as the first, as delivered where tolerances imitate it."""

FEATURES = (
    "ahead", "ahead alone", "takes", "takes there", "level", "own", "event", "prior", "takes besides",
    "behind",
)  # fmt: skip
"""What is known of an effect when it is weighed.

ahead : its nats beside all tolerances less the best other's, over its own; or a third of the next, where that is more.
ahead alone : the same as delivered, where that is positive, times log(1 + nats / 10).
takes, level : share that it takes of what lies beyond the noise, and of the levels beyond the biases, as delivered.
takes there : the same of the moments at which it acts, each weighed by the square of what it does.
own : log evidence of its form with every tolerance free to imitate it, over 20 nats.
event : it is of moments sought in the differences, or of one flight.
prior : log of how often simulations lack it, as against other effects.
takes besides : share that it takes of the moments at which it acts, beside tolerances, times log(1 + nats / 10).
behind : its nats less those of the best in question, over ten or a fiftieth of those, no less than -3; as delivered
    where it is weighed for what it brings so.
"""
NOTHING = -5.052
WEIGHTS = np.array([2.556, 0.038, 3.187, 1.785, 1.923, 0.201, -2.141, 0.653, 0.520, 0.611])
"""From development cases, by the logit of `proof/calibrate.py` (docs/decisions/0012-naming-an-effect.md)."""
UNRIVALLED = 1.0
"""Log odds that an effect loses where it is compared with nothing only: what it is ahead of rivals is then in full."""
_EVEN, _SCALE = 32.0, 3.0
"""Nats, times the share of white noise in what is left of the forces, at which an effect is as probably there as not,
whatever little of the differences it takes; and their scale. Correct simulations in calm air have at most 26
(34 of the proof's generators, development seeds from 71000)."""
_AGREED = 2.0  # nats that the size of an effect must bring on all flights alike, to be as probable as nothing
NOTHING_UNASKED = -6.031
WEIGHTS_UNASKED = np.array([2.576, 0.059, 3.158, 2.192, 1.923, 0.071, -1.945, 0.362, 0.532, 0.5])
"""The weights before: for what the inputs were not asked to bear out, whose evidence is worth less."""


@dataclass(frozen=True, eq=False)
class CandidateEffect:
    """An effect in question.

    Attributes
    ----------
    score : EffectScore
    features : (f,) array
        See `FEATURES`.
    max_log_odds : float
        Log odds against nothing that its size permits, as far as flights agree on it with tolerances free.
    lowers : bool
        Whether it lowers the error on other flights visibly.
    """

    score: EffectScore
    features: Array
    max_log_odds: float = np.inf
    lowers: bool = True

    @property
    def log_odds(self) -> float:
        """Against nothing, among its rivals."""
        return min(self.max_log_odds, self._of(self.features))

    @property
    def log_odds_alone(self) -> float:
        """Log odds against nothing, as though no other effect were like it, where the inputs were asked to bear it out.

        What they were not asked to bear out may be any part of what a simulation lacks that moves as its rivals do.
        """
        if not self._is_asked:
            return self.log_odds
        x = self.features.copy()
        as_given = np.log1p(max(0.0, log_bayes_as_given(self.score)) / _CLEAR)
        x[FEATURES.index("ahead alone")] = as_given
        x[FEATURES.index("ahead")] = max(ahead_of(self.score, (), log_bayes), _ALONE * as_given)
        x[FEATURES.index("behind")] = 0.0
        return min(self.max_log_odds, self._of(x) - UNRIVALLED)

    @property
    def _is_asked(self) -> bool:
        return self.score.input_only is not None or self.score.hypothesis.kind == "atmospheric"

    def _of(self, features: Array) -> float:
        if self._is_asked:
            return float(NOTHING + features @ WEIGHTS)
        return float(NOTHING_UNASKED + features @ WEIGHTS_UNASKED)

    @property
    def effect(self) -> str:
        """Its name."""
        return self.score.effect

    @property
    def constant(self) -> bool:
        """Whether it shows in the level of the flights more than in anything that moves."""
        takes, level = self.features[[FEATURES.index("takes"), FEATURES.index("level")]]
        return bool(level > takes)


def predictive_log_bayes(score: EffectScore) -> float:
    """Nats that a hypothesis brings on flights not used for it."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def log_bayes(score: EffectScore) -> float:
    """What a hypothesis brings beside tolerances: on other flights or on all, but for an event.

    As far as that is borne out where the inputs alone drive the motion, or can be no chance.
    """
    brings = predictive_log_bayes(score) if score.event else max(predictive_log_bayes(score), score.log_evidence)
    return (
        brings if score.input_only is None else bounded(brings, log_bayes(score.input_only), score.unconfirmed_weight)
    )


def bounded(brings: float, input_only: float, unconfirmed_weight: float = 0.0) -> float:
    """Nats that count, of those that an effect brings and those where the inputs alone drive the motion."""
    return min(brings, (1.0 - unconfirmed_weight) * _BORNE_OUT * input_only + unconfirmed_weight * brings)


def log_bayes_as_given(score: EffectScore) -> float:
    """Nats that a hypothesis brings by itself, the simulation being as delivered but for it; as far as borne out."""
    brings = float(score.trial.at_scales[-1])
    return (
        brings
        if score.input_only is None
        else bounded(brings, log_bayes_as_given(score.input_only), score.unconfirmed_weight)
    )


def unconfirmed_log_bayes(scores: Sequence[EffectScore]) -> float:
    """The most nats that an effect brings on the recorded motion and that the inputs do not bear out."""
    return max((log_bayes(replace(s, input_only=None)) - max(0.0, log_bayes(s)) for s in scores), default=0.0)


def with_unconfirmed_weight(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores that know how much of their evidence counts although the inputs do not bear it out."""
    plain = problem.as_given
    before = _beyond_noise(plain)

    def known(score: EffectScore) -> EffectScore:
        takes = _fraction(before, _beyond_noise(plain.with_effect(score.signature)), SLIGHT)
        return replace(score, unconfirmed_weight=float(np.clip((takes - _MOST) / (_ALL - _MOST), 0.0, 1.0)))

    return [known(s) if _is_unconfirmed(s) else s for s in scores]


def _is_unconfirmed(score: EffectScore) -> bool:
    """Whether the inputs do not bear out all that an effect brings."""
    plain = replace(score, input_only=None)
    return not score.event and (
        log_bayes(score) < log_bayes(plain) or log_bayes_as_given(score) < log_bayes_as_given(plain)
    )


def _beyond_noise(problem: DiagnosisProblem) -> float:
    """What other flights leave of all responses together beyond the noise, in units of one response's, and one."""
    return 1.0 + sum(motion - 1.0 for motion, _ in judging.excess(problem).values())


def leading_effects(scores: Sequence[EffectScore]) -> list[EffectScore]:
    """The best beside tolerances, and the best by themselves, in the order given."""
    best = [s for by in (log_bayes, log_bayes_as_given) for s in sorted(scores, key=by, reverse=True)[:_EACH]]
    return [s for s in scores if s in best]


def evident(problem: DiagnosisProblem, score: EffectScore) -> bool:
    """Whether an effect brings enough to be weighed; of what happens at some moments, only what was not found before.

    Tolerances that are off in what was found leave more to their own look-alikes than those of a right simulation do.
    """
    found = {s.hypothesis.name for s in problem.accepted}
    if log_bayes(score) >= EVIDENT:
        return not (score.event and score.effect in found)
    return not found and log_bayes_as_given(score) >= _PLENTY


def candidate_effects(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[CandidateEffect]:
    """Features of the effects in question that do not spoil other flights.

    Parameters
    ----------
    bench : Bench
    scores : sequence of EffectScore
        Of all hypotheses.
    """
    kept, alternatives = _admissible(problem, scores)
    made = []
    for one, taken, lowers in kept:
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
        most_probable = np.inf if one.event else agreed(extended) - _AGREED
        made.append(CandidateEffect(one, np.array(values, dtype=float), most_probable, lowers))
    return made


def agreed(extended: DiagnosisProblem) -> float:
    """Nats that the size of the effect taken in last brings, with the scatter between flights as its error."""
    at = extended.place(len(extended.accepted) - 1)
    posterior = extended.base.posterior
    error = np.maximum(jackknifed(extended.base.solved[1:, at]), np.sqrt(np.diag(posterior.covariance)[at]))
    return 0.5 * float(np.max((posterior.mean[at] / error) ** 2))


def jackknifed(without: Array) -> Array:
    """Standard error of estimates (groups, k) found with each group of flights left out, by how far these disagree."""
    groups = len(without)
    return np.sqrt((groups - 1) * without.var(axis=0)) if groups > 1 else np.zeros(without.shape[1])


def _admissible(
    problem: DiagnosisProblem, scores: Sequence[EffectScore]
) -> tuple[list[tuple[EffectScore, Taken, bool]], list[EffectScore]]:
    """Effects in question, with what each takes as delivered and whether it lowers the error; and all rivals.

    What spoils other flights is neither.
    """
    plain = problem.as_given
    before = judging.held_out(plain, True)
    kept: list[tuple[EffectScore, Taken, bool]] = []
    alternatives, judged = list(scores), set()
    # What spoils other flights makes room for the next.
    while asked := [s for s in leading_effects(alternatives) if evident(problem, s) and s.effect not in judged]:
        for one in asked:
            judged.add(one.effect)
            extended = plain.with_effect(one.signature)
            taken = Taken.by(one, plain, extended)
            gained = judging.gains(before, judging.held_out(extended, True), extended.judged_responses)
            lowers, spoils = max(gained.values(), default=0.0), -min(gained.values(), default=0.0)
            if spoils > _SPOILS:
                alternatives.remove(one)
            else:
                kept.append((one, taken, lowers >= _LOWERS or taken.judged_there >= _THERE))
    return kept, alternatives


def probabilities(candidates: Sequence[CandidateEffect]) -> Array:
    """(1 + n,) probabilities: that none of the effects is there besides what was found, and of each."""
    return np.asarray(scipy.special.softmax([0.0, *(one.log_odds for one in candidates)]))


def first_probabilities(candidates: Sequence[CandidateEffect], white: float) -> Array:
    """(1 + n,) probabilities where nothing was found before: that there is no mismatch, and of each effect.

    Whether there is a mismatch is asked of each effect as though it had no rivals; they only share the probability.
    With thousands of samples evidence is always overwhelming: an effect that does not lower the error visibly counts
    only as far as the motion cannot be a consequence of what is left.

    Parameters
    ----------
    weighed : sequence of Weighed
    white : float
        Share of white noise in what is left of the forces: of anything else the motion may be a consequence.
    """
    if not candidates:
        return np.ones(1)
    evidence = (white * max(log_bayes(one.score) for one in candidates) - _EVEN) / _SCALE
    as_given = [one.log_odds_alone for one in candidates if one.lowers]
    some = float(scipy.special.expit(max([evidence, *as_given])))
    return np.array([1.0 - some, *(some * scipy.special.softmax([one.log_odds for one in candidates]))])


def ahead_of(one: EffectScore, scores: Sequence[EffectScore], brings: Callable[[EffectScore], float]) -> float:
    """Nats of an effect less those of the best other, over its own; within -1 and 1.

    What brings as much to within 5 % is the same effect to these recordings, and takes nothing from either.
    """
    mine = brings(one)
    others = (brings(s) for s in scores if s is not one)
    best = max([0.0, *(x for x in others if not _NEAR * mine <= x <= mine / _NEAR)])
    return float(np.clip((mine - best) / max(mine, _FEW), -1.0, 1.0))


def behind(one: EffectScore, kept: Sequence[EffectScore]) -> float:
    """How far what an effect brings falls behind the best; see `FEATURES`."""
    brings = log_bayes if log_bayes(one) >= EVIDENT else log_bayes_as_given
    best = max(0.0, *map(brings, kept))
    return max((brings(one) - best) / max(_CLEAR, _BEHIND * best), -_FURTHEST)


@dataclass(frozen=True)
class Taken:
    """Shares that an effect takes of what is beyond noise and biases, in the response in which it takes most.

    Attributes
    ----------
    moving, there, level : float
        Of what moves; of the moments at which it acts; of levels.
    told_there : float
        As `there`, of responses that are judged only: readings' own rates do not count.
    """

    moving: float
    there: float
    level: float
    judged_there: float

    @classmethod
    def by(cls, one: EffectScore, without: DiagnosisProblem, extended: DiagnosisProblem) -> Taken:
        """Of an effect, from benches without and with it."""
        foretold, where = judged_on(one)
        before, after = (judging.excess(b, foretold, where) for b in (without, extended))
        there = fractions_there(one, without, extended)
        return cls(
            max(_fraction(before[c][0], after[c][0], SLIGHT) for c in before),
            max(there.values(), default=0.0),
            max(_fraction(before[c][1], after[c][1], _CONSTANT) for c in extended.judged_responses),
            largest(there, extended),
        )


def judged_on(one: EffectScore) -> tuple[bool, Collection[str] | None]:
    """Whether other flights are to foretell an effect, and the flights that count."""
    return (False, one.signature.flights) if one.event else (True, None)


def fractions_there(one: EffectScore, without: DiagnosisProblem, extended: DiagnosisProblem) -> dict[str, float]:
    """Of each response that an effect moves, the share it takes of the moments at which it acts."""
    acting = judging.excess_where_moved(without, extended, *judged_on(one))
    return {c: _fraction(b, a, SLIGHT) for c, (b, a) in acting.items()}


def largest(fractions: Mapping[str, float], problem: DiagnosisProblem) -> float:
    """The largest of the responses that are judged."""
    return max((fractions[c] for c in problem.judged_responses if c in fractions), default=0.0)


def _fraction(before: float, after: float, slight: float) -> float:
    """Share of what lies beyond the noise that is gone."""
    return float(np.clip((before - after) / (before - 1.0 + slight), 0.0, 1.0)) if before > 1.0 else 0.0
