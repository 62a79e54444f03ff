"""Finds the physics left out, one effect after another, each weighed against the others and against nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.diagnosis.bench import Bench
from structsel.diagnosis.driven import InputDrivenMotion
from structsel.diagnosis.scoring import EffectScore, score_all
from structsel.diagnosis.signatures import Library
from structsel.diagnosis.weighing import Weighed, chances, weigh

MOST = 4
"""Effects that are looked for."""
_PLACES = 8
"""And how often, of which several may be the same effect in several places."""
NAMED = 0.5
"""Probability that something is there, from which on the likeliest is named."""
TIED = 1.0 / 3.0
"""Of the likeliest's probability, from which on recordings cannot tell another effect from it."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Step:
    """One effect taken in, and its rivals at that point.

    Attributes
    ----------
    score : EffectScore
    rivals : tuple of (effect, probability)
        All that were in question, likeliest first, the effect itself among them; "nothing" too.
    bench : Bench
        With the effect taken in.
    others : tuple of EffectScore
        All that were in question, likeliest first.
    constant : bool
        Whether it shows in the level of the flights more than in anything that moves.
    """

    score: EffectScore
    rivals: tuple[tuple[str, float], ...]
    bench: Bench
    others: tuple[EffectScore, ...] = ()
    constant: bool = False


@dataclass(frozen=True, eq=False)
class Ranking:
    """Everything found.

    Attributes
    ----------
    start : Bench
        Without any effect.
    steps : tuple of Step
    scores : tuple of EffectScore
        Of all hypotheses, when they were last tried.
    motion : InputDrivenMotion, optional
        The flights as the inputs alone would have them, of which effects were asked.
    considered : tuple of (effect, probability)
        What was in question when nothing more was taken in, most probable first; "nothing" too.
    others : tuple of EffectScore
        Of those effects.
    """

    start: Bench
    steps: tuple[Step, ...]
    scores: tuple[EffectScore, ...] = ()
    motion: InputDrivenMotion | None = None
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    others: tuple[EffectScore, ...] = ()

    @property
    def bench(self) -> Bench:
        """With everything found taken in."""
        return self.steps[-1].bench if self.steps else self.start

    @property
    def driven(self) -> Bench | None:
        """As `bench`, of flights that move as the inputs alone would have them; None where none was needed."""
        return None if self.motion is None else self.motion.beside(self.bench.accepted)


def rank(bench: Bench, library: Library, progress: Progress | None = None) -> Ranking:
    """Take effects in one after another while it is likely that one is there.

    Parameters
    ----------
    bench : Bench
    library : Library
    progress : callable, optional
    """
    tell = progress or (lambda what, done, of: None)
    start, driven = bench, InputDrivenMotion.of(bench.flights)
    steps: list[Step] = []
    scores: list[EffectScore] = []
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    asked: list[Weighed] = []
    while (k := len({s.score.effect for s in steps})) < MOST and len(steps) < _PLACES:
        tell("ranking", k, MOST)
        scores = driven.bear_out(bench, score_all(bench, library))
        weighed, rivals = _weighed(weigh(bench, scores))
        if not weighed or 1.0 - dict(rivals)["nothing"] < NAMED:
            considered, asked = rivals, weighed
            break
        best = weighed[0]
        bench = bench.taking([*bench.accepted, best.score.signature], library.signatures)
        others = tuple(w.score for w in weighed)
        steps.append(Step(best.score, rivals, bench, others, best.constant))
    tell("ranking", MOST, MOST)
    return Ranking(start, tuple(steps), tuple(scores), driven, considered, tuple(w.score for w in asked))


def _weighed(effects: Sequence[Weighed]) -> tuple[list[Weighed], tuple[tuple[str, float], ...]]:
    """Effects, likeliest first; and the probability of each and of nothing."""
    p = chances(effects)
    order = np.argsort(-p[1:], kind="stable")
    each = [("nothing", float(p[0])), *((w.effect, float(x)) for w, x in zip(effects, p[1:]))]
    return [effects[i] for i in order], tuple(sorted(each, key=lambda item: -item[1]))
