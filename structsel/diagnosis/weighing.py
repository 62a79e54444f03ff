"""How likely each effect in question is, from what it brings, what it takes and what others bring."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.diagnosis import judging
from structsel.diagnosis.bench import Bench
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
NOTHING_UNASKED = -6.031
WEIGHTS_UNASKED = np.array([2.576, 0.059, 3.158, 2.192, 1.923, 0.071, -1.945, 0.362, 0.532, 0.5])
"""The weights before: for what the inputs were not asked to bear out, whose evidence is worth less."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """An effect in question.

    Attributes
    ----------
    score : EffectScore
    features : (f,) array
        See `FEATURES`.
    """

    score: EffectScore
    features: Array

    @property
    def effect(self) -> str:
        """Its name."""
        return self.score.effect

    @property
    def constant(self) -> bool:
        """Whether it shows in the level of the flights more than in anything that moves."""
        takes, level = self.features[[FEATURES.index("takes"), FEATURES.index("level")]]
        return bool(level > takes)


def rank_of(score: EffectScore) -> float:
    """Nats that a hypothesis brings on flights not used for it."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def nats(score: EffectScore) -> float:
    """What a hypothesis brings beside tolerances: on other flights or on all, but for an event.

    As far as that is borne out where the inputs alone drive the motion, or can be no chance.
    """
    brings = rank_of(score) if score.event else max(rank_of(score), score.log_evidence)
    return brings if score.driven is None else bounded(brings, nats(score.driven), score.whole)


def bounded(brings: float, driven: float, whole: float = 0.0) -> float:
    """Nats that count, of those that an effect brings and those where the inputs alone drive the motion."""
    return min(brings, (1.0 - whole) * _BORNE_OUT * driven + whole * brings)


def alone(score: EffectScore) -> float:
    """Nats that a hypothesis brings by itself, the simulation being as delivered but for it; as far as borne out."""
    brings = float(score.trial.at_scales[-1])
    return brings if score.driven is None else bounded(brings, alone(score.driven), score.whole)


def not_borne_out(scores: Sequence[EffectScore]) -> float:
    """The most nats that an effect brings on the recorded motion and that the inputs do not bear out."""
    return max((nats(replace(s, driven=None)) - max(0.0, nats(s)) for s in scores), default=0.0)


def with_whole(bench: Bench, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores that know how much of their evidence counts although the inputs do not bear it out."""
    plain = bench.as_delivered
    before = _beyond_noise(plain)

    def known(score: EffectScore) -> EffectScore:
        takes = _share(before, _beyond_noise(plain.beside(score.signature)), SLIGHT)
        return replace(score, whole=float(np.clip((takes - _MOST) / (_ALL - _MOST), 0.0, 1.0)))

    return [known(s) if _doubted(s) else s for s in scores]


def _doubted(score: EffectScore) -> bool:
    """Whether the inputs do not bear out all that an effect brings."""
    plain = replace(score, driven=None)
    return not score.event and (nats(score) < nats(plain) or alone(score) < alone(plain))


def _beyond_noise(bench: Bench) -> float:
    """What other flights leave of all responses together beyond the noise, in units of one response's, and one."""
    return 1.0 + sum(motion - 1.0 for motion, _ in judging.excess(bench).values())


def in_question(scores: Sequence[EffectScore]) -> list[EffectScore]:
    """The best beside tolerances, and the best by themselves, in the order given."""
    best = [s for by in (nats, alone) for s in sorted(scores, key=by, reverse=True)[:_EACH]]
    return [s for s in scores if s in best]


def evident(bench: Bench, score: EffectScore) -> bool:
    """Whether an effect brings enough to be weighed; of what happens at some moments, only what was not found before.

    Tolerances that are off in what was found leave more to their own look-alikes than those of a right simulation do.
    """
    found = {s.hypothesis.name for s in bench.accepted}
    if nats(score) >= EVIDENT:
        return not (score.event and score.effect in found)
    return not found and alone(score) >= _PLENTY


def weigh(bench: Bench, scores: Sequence[EffectScore]) -> list[Weighed]:
    """Features of the effects in question that matter: that lower the error on flights not used for them.

    With thousands of samples evidence is always overwhelming. What instruments' own equations show, or a few moments,
    counts as evidence; but where the coefficients are no better for it, it does not say what the simulation lacks.

    Parameters
    ----------
    bench : Bench
    scores : sequence of EffectScore
        Of all hypotheses.
    """
    kept, rivals = _judged(bench, scores)
    made = []
    for one, taken in kept:
        by_itself = max(0.0, ahead_of(one, rivals, alone)) * np.log1p(max(0.0, alone(one)) / _CLEAR)
        ahead = max(ahead_of(one, rivals, nats), _ALONE * by_itself)
        besides = most(shares_there(one, bench, bench.beside(one.signature)), bench)
        told = (
            ahead,
            by_itself,
            taken.moving,
            taken.there,
            taken.level,
            float(np.clip(one.own / _OWN, -1.0, 1.0)),
            one.event,
            one.hypothesis.log_prior,
            besides * np.log1p(max(0.0, nats(one)) / _CLEAR),
            behind(one, [other for other, _ in kept]),
        )
        made.append(Weighed(one, np.array(told, dtype=float)))
    return made


def _judged(bench: Bench, scores: Sequence[EffectScore]) -> tuple[list[tuple[EffectScore, Taken]], list[EffectScore]]:
    """Effects in question that matter, with what each takes as delivered; and all that do not spoil other flights."""
    plain = bench.as_delivered
    before = judging.held_out(plain, True)
    kept: list[tuple[EffectScore, Taken]] = []
    rivals, judged = list(scores), set()
    # What spoils other flights makes room for the next.
    while asked := [s for s in in_question(rivals) if evident(bench, s) and s.effect not in judged]:
        for one in asked:
            judged.add(one.effect)
            beside = plain.beside(one.signature)
            taken = Taken.by(one, plain, beside)
            gained = judging.gains(before, judging.held_out(beside, True), beside.told)
            lowers, spoils = max(gained.values(), default=0.0), -min(gained.values(), default=0.0)
            if spoils > _SPOILS:
                rivals.remove(one)
            elif lowers >= _LOWERS or taken.told_there >= _THERE:
                kept.append((one, taken))
    return kept, rivals


def chances(weighed: Sequence[Weighed]) -> Array:
    """(1 + n,) probabilities: that none of the effects is there, and of each."""
    return np.asarray(scipy.special.softmax([0.0, *map(_log_odds, weighed)]))


def _log_odds(one: Weighed) -> float:
    """Of an effect, against nothing."""
    if one.score.driven is None and one.score.hypothesis.kind != "atmospheric":
        return float(NOTHING_UNASKED + one.features @ WEIGHTS_UNASKED)
    return float(NOTHING + one.features @ WEIGHTS)


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
    brings = nats if nats(one) >= EVIDENT else alone
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
    told_there: float

    @classmethod
    def by(cls, one: EffectScore, without: Bench, beside: Bench) -> Taken:
        """Of an effect, from benches without and with it."""
        foretold, where = told_by(one)
        before, after = (judging.excess(b, foretold, where) for b in (without, beside))
        there = shares_there(one, without, beside)
        return cls(
            max(_share(before[c][0], after[c][0], SLIGHT) for c in before),
            max(there.values(), default=0.0),
            max(_share(before[c][1], after[c][1], _CONSTANT) for c in beside.told),
            most(there, beside),
        )


def told_by(one: EffectScore) -> tuple[bool, Collection[str] | None]:
    """Whether other flights are to foretell an effect, and the flights that count."""
    return (False, one.signature.flights) if one.event else (True, None)


def shares_there(one: EffectScore, without: Bench, beside: Bench) -> dict[str, float]:
    """Of each response that an effect moves, the share it takes of the moments at which it acts."""
    acting = judging.excess_where_moved(without, beside, *told_by(one))
    return {c: _share(b, a, SLIGHT) for c, (b, a) in acting.items()}


def most(shares: Mapping[str, float], bench: Bench) -> float:
    """The largest of the responses that are judged."""
    return max((shares[c] for c in bench.told if c in shares), default=0.0)


def _share(before: float, after: float, slight: float) -> float:
    """Share of what lies beyond the noise that is gone."""
    return float(np.clip((before - after) / (before - 1.0 + slight), 0.0, 1.0)) if before > 1.0 else 0.0
