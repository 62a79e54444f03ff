"""Finds the physics left out, one effect after another, each held to what it brings on other flights."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from structsel.diagnosis import judging
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.scoring import Score, score_all
from structsel.diagnosis.signatures import Library

MOST = 4
"""Effects that are looked for."""
TEMPERATURE = 4.0
"""By which log evidence is divided: rows are white only as far as the noise is known."""
_NOTHING = 12.0
"""Nats on other flights that misfits of the rows bring by themselves."""
_WIDER = 0.5  # of that, for each further parameter: the more an effect may do, the more misfits it fits
_IMITATED = 5.0
"""Nats on all flights, tolerances free to imitate the effect, that each of its parameters must bring."""
_TAKES, _TAKES_ROUGH = 0.35, 0.5
"""Share of a response's misfit beyond the noise that an effect must take; in rough air."""
_LOWERS, _LOWERS_ROUGH = 0.05, 0.15
"""Share by which the rms of some coefficient must fall on flights not used for it."""
_NEVER, _SURE, _AT_MOST = 0.2, 0.95, 0.97
"""Shares of the misfit at which what evidence says is worth nothing, and all; probability that nothing exceeds.

What is named for half of the misfit is right in one development case of three, for nine tenths of it in nearly all.
"""
_SPARED = 10.0  # nats of what tolerances do, that an effect must spare them to stand for them
_AT_LEAST = -5.0  # nats of evidence, every tolerance free to imitate it, below which it does not
_AGAIN, _MUCH = 2, 100.0  # effects heard a second time, if they bring so many nats
_AMONG = 0.2  # of the misfit of all flights, that an event must take
_SLIGHT = 0.2  # of the noise's power: a misfit that is no larger is not told from the noise's own scatter
_CONSTANT = 2.0  # of the biases' variance: the same of levels, of which there is one for each flight
_LEVEL = 0.6  # of the misfit of levels, there are few of them, that an effect must take for it to count
_EVENT = 0.5  # of its evidence that an effect of one flight may count, which no other flight can foretell
_PART = 1.0 / 3.0  # of the best's nats, that an effect must bring: else something speaks louder, whatever it is
_TRIED = 24
_RIVALS = 4  # behind the best, that are judged as it was
OF_BEST = 0.02
"""Of the best's nats, that the form of any effect may miss by."""
_OF_FIRST = 0.03  # of the first effect's nats: a form that is nearly right leaves about that much of itself

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Step:
    """One effect taken in, and its rivals at that point.

    Attributes
    ----------
    score : Score
    rivals : tuple of (effect, probability)
        All that were tried, likeliest first, the effect itself among them; "nothing" too.
    ranks : mapping of effect to float
        Nats, see `nats`.
    bench : Bench
        With the effect taken in.
    gained : mapping of response to float
        Share by which the rms falls on other flights.
    others : tuple of Score
        All that were tried beside it, best first.
    constant : bool
        Whether it shows in the level of the flights more than in anything that moves.
    """

    score: Score
    rivals: tuple[tuple[str, float], ...]
    ranks: Mapping[str, float]
    bench: Bench
    gained: Mapping[str, float]
    others: tuple[Score, ...] = ()
    constant: bool = False


@dataclass(frozen=True)
class Heard:
    """What was found when an effect was judged.

    Attributes
    ----------
    reason : str
        What speaks against it; empty where nothing does.
    takes : float
        Share of the misfit beyond the noise that it takes, where it takes most.
    gained : mapping of response to float
        Share by which the rms falls on other flights.
    constant : bool
        Whether it takes more of the level than of what moves.
    """

    reason: str
    takes: float
    gained: Mapping[str, float] = field(default_factory=dict)
    constant: bool = False


@dataclass(frozen=True, eq=False)
class Ranking:
    """Everything found.

    Attributes
    ----------
    start : Bench
        Without any effect.
    steps : tuple of Step
    last : tuple of Score
        Of all hypotheses after the last step: what was still tried, and did not do.
    refused : tuple of (effect, reason)
    """

    start: Bench
    steps: tuple[Step, ...]
    last: tuple[Score, ...]
    refused: tuple[tuple[str, str], ...] = field(default=())

    @property
    def bench(self) -> Bench:
        """With everything found taken in."""
        return self.steps[-1].bench if self.steps else self.start


def rank_of(score: Score) -> float:
    """Nats that a hypothesis brings on flights not used for it."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.hypothesis.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def rank(bench: Bench, library: Library, rough: bool = False, progress: Progress | None = None) -> Ranking:
    """Take effects in one after another while they bring enough on other flights.

    Parameters
    ----------
    bench : Bench
    library : Library
    rough : bool
        Whether the air was turbulent: more is asked for then.
    progress : callable, optional
    """
    tell = progress or (lambda what, done, of: None)
    start = bench
    steps: list[Step] = []
    refused: list[tuple[str, str]] = []
    scores: list[Score] = []
    for k in range(MOST):
        tell("ranking", k, MOST)
        scores = sorted(score_all(bench, library), key=rank_of, reverse=True)
        floor = _OF_FIRST * max(steps[0].ranks.values()) if steps else 0.0
        tried = [s for s in scores if rank_of(s) >= floor or not steps]
        step = _take_best(bench, library, tried, refused, rough)
        if step is None:
            break
        steps.append(step)
        bench = step.bench
    tell("ranking", MOST, MOST)
    return Ranking(start, tuple(steps), tuple(scores), tuple(refused))


def _take_best(
    bench: Bench, library: Library, scores: Sequence[Score], refused: list[tuple[str, str]], rough: bool
) -> Step | None:
    """The best hypothesis that holds on other flights and matters; None where there is none.

    An effect that a tolerance can imitate brings little beyond a refit, however large it is. It counts in full where it
    stands for what all tolerances would have to do.
    """
    able = sorted((s for s in scores if worth(s) > 0.0), key=nats, reverse=True)
    if bench.accepted:  # beside another effect, what only spares the tolerances is not trusted
        able = [s for s in able if rank_of(s) > _NOTHING]
    if rough and able:
        refused += ((s.effect, "gusts look the same") for s in able if s.hypothesis.diluted)
        able = [s for s in able if not s.hypothesis.diluted]
    able = [s for s in able if nats(s) > _PART * nats(able[0])]
    judge = _Judge(bench, rough)
    failed: set[str] = set()
    again = _AGAIN
    for i, one in enumerate(able[:_TRIED]):
        heard = judge.hear(one)
        if heard.reason and again and nats(one) > _MUCH:
            again -= 1
            heard = judge.hear_again(one, library)
        if heard.reason:
            refused.append((one.effect, f"{nats(one):.0f} nats, but {heard.reason}"))
            failed.add(one.effect)
            continue
        failed |= {s.effect for s in able[i + 1 : i + 1 + _RIVALS] if judge.hear(s).reason}
        new = bench.taking([*bench.accepted, one.signature], library.signatures)
        ranks = {s.effect: nats(s) for s in scores}
        chances = {s.effect: ranks[s.effect] for s in able if s.effect not in failed}
        sure = float(np.clip((heard.takes - _NEVER) / (_SURE - _NEVER), 0.0, _AT_MOST))
        rivals = tuple((effect, sure * p) for effect, p in probabilities(chances))
        return Step(one, rivals, ranks, new, heard.gained, tuple(scores[:12]), heard.constant)
    return None


def nats(score: Score) -> float:
    """What a hypothesis brings: on other flights, or on all of them where tolerances imitate it, which it spares."""
    if score.hypothesis.event:
        return rank_of(score)
    if stands_for(score):
        return score.own + score.spared + score.hypothesis.log_prior
    return max(rank_of(score), score.log_evidence)


def stands_for(score: Score) -> bool:
    """Whether a hypothesis stands for what the tolerances would have to do, nearly all of it."""
    return not score.hypothesis.event and score.spared >= _SPARED and score.own > _AT_LEAST


def worth(score: Score) -> float:
    """Whether a hypothesis brings more than misfits do by themselves: above zero where it does."""
    width = score.signature.width
    ahead = rank_of(score) / (_NOTHING * (1.0 + _WIDER * (width - 1)))
    brought = ahead if score.hypothesis.event else max(ahead, score.log_evidence / (_IMITATED * width))
    return max(brought, score.spared / _SPARED if stands_for(score) else 0.0) - 1.0


class _Judge:
    """Whether what an effect takes of the misfits is what something left out would take.

    Forms that are not quite right, air that is not quite still and stand-ins that are not the simulation leave misfits
    in which any flexible effect finds something to explain. What was left out explains most of it somewhere, of the
    simulation as delivered: tolerances that may all help would hide what they imitate, and are flexible themselves.
    """

    def __init__(self, bench: Bench, rough: bool):
        self._bench, self._delivered, self._rough = bench, bench.as_delivered(), rough
        self._left = judging.held_out(self._delivered, True)
        self._takes, self._lowers = (_TAKES_ROUGH, _LOWERS_ROUGH) if rough else (_TAKES, _LOWERS)

    def hear(self, score: Score) -> Heard:
        """What speaks against an effect, and what it brings."""
        return self._weigh(score, self._settings(score))

    def hear_again(self, score: Score, library: Library) -> Heard:
        """As `hear`, the noise being what it would be if the effect were there: it may have been taken for noise."""
        beside = self._bench.taking([*self._bench.accepted, score.signature], library.signatures)
        without = beside.keeping(range(len(self._bench.accepted)))
        return self._weigh(score, [(without.as_delivered(), beside.as_delivered())])

    def _settings(self, score: Score) -> Iterator[tuple[Bench, Bench]]:
        """Benches without and with an effect: as delivered, in rough air beside the tolerances too."""
        yield self._delivered, self._delivered.beside(score.signature)
        if self._rough:
            beside = self._bench.beside(score.signature)
            yield self._bench.as_good(beside), beside

    def _weigh(self, score: Score, settings: Iterable[tuple[Bench, Bench]]) -> Heard:
        foretold = not score.hypothesis.event  # no other flight can foretell an event of one
        where = None if foretold else score.signature.flights
        made = Heard("", 0.0)
        for without, beside in settings:
            before, after = (judging.excess(b, foretold, where) for b in (without, beside))
            moving = max(_taken(before[c][0], after[c][0], _SLIGHT) for c in before)
            if not foretold:  # nor may it be lost in what all flights show
                all_before, all_after = (judging.excess(b, False) for b in (without, beside))
                among = max(_taken(all_before[c][0], all_after[c][0], _SLIGHT) for c in all_before)
                moving = min(moving, among * self._takes / _AMONG)
            # A constant that biases may be is judged by how unlikely it is as those; in rough air it is not judged.
            constant = foretold and not self._rough
            level = max(_taken(before[c][1], after[c][1], _CONSTANT) for c in beside.told) if constant else 0.0
            level = level if level >= _LEVEL else 0.0
            takes = max(moving, level, 0.0)
            if takes < self._takes:
                return Heard(f"it takes {takes:.0%} of the misfit only", takes)
            left = judging.refitted(self._left, judging.held_out(without, True))
            gained = judging.gains(left, judging.held_out(beside, True), beside.told)
            made = Heard("", takes, gained, level > moving)
            lowers = max(gained.values(), default=0.0)
            if foretold and lowers < self._lowers and not level:
                return Heard(f"it lowers the error by {max(lowers, 0.0):.1%} only", takes, gained)
        return made


def _taken(before: float, after: float, slight: float) -> float:
    """Share of what lies beyond the noise that is gone."""
    return (before - after) / (before - 1.0 + slight) if before > 1.0 else 0.0


def probabilities(ranks: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Probability of each effect in question, and of nothing, likeliest first."""
    each = {**ranks, "nothing": _IMITATED}
    # No form is quite right; with many nats, how nearly right it is decides more than noise does.
    values = np.array(list(each.values())) / max(TEMPERATURE, OF_BEST * max(each.values()))
    p = np.exp(values - logsumexp(values))
    return tuple(sorted(zip(each, map(float, p)), key=lambda item: -item[1]))
