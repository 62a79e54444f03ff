"""Finds the physics left out, one effect after another, each weighed against the others and against nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from structsel.diagnosis.bench import Bench
from structsel.diagnosis.detection import SCALE, Detection
from structsel.diagnosis.driven import InputDrivenMotion
from structsel.diagnosis.residuals import white_share
from structsel.diagnosis.result import UNNAMED
from structsel.diagnosis.scoring import EffectScore, score_all
from structsel.diagnosis.signatures import Library
from structsel.diagnosis.weighing import Weighed, chances, first_chances, nats, weigh
from structsel.numerics.arrays import Array

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
    detection : Detection, optional
        Of any mismatch, where it was asked for.
    """

    start: Bench
    steps: tuple[Step, ...]
    scores: tuple[EffectScore, ...] = ()
    motion: InputDrivenMotion | None = None
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    others: tuple[EffectScore, ...] = ()
    detection: Detection | None = None

    @property
    def bench(self) -> Bench:
        """With everything found taken in."""
        return self.steps[-1].bench if self.steps else self.start

    @property
    def driven(self) -> Bench | None:
        """As `bench`, of flights that move as the inputs alone would have them; None where none was needed."""
        return None if self.motion is None else self.motion.beside(self.bench.accepted)


def rank(
    bench: Bench,
    library: Library,
    progress: Progress | None = None,
    ask: Callable[[Sequence[EffectScore]], Detection | None] | None = None,
) -> Ranking:
    """Take effects in one after another while it is likely that one is there.

    Parameters
    ----------
    bench : Bench
    library : Library
    progress : callable, optional
    ask : callable, optional
        Given the scores of all effects where none is probable, gives the detection of any mismatch, or None.
    """
    tell = progress or (lambda what, done, of: None)
    start, driven = bench, InputDrivenMotion.of(bench.flights)
    steps: list[Step] = []
    scores: list[EffectScore] = []
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    asked: list[Weighed] = []
    seen: Detection | None = None
    while (k := len({s.score.effect for s in steps})) < MOST and len(steps) < _PLACES:
        tell("ranking", k, MOST)
        scores = driven.bear_out(bench, score_all(bench, library))
        weighed = weigh(bench, scores)
        if steps:
            weighed = [one for one in weighed if one.lowers]
            p = _by_name(weighed, chances(weighed))
        else:
            p = _by_name(weighed, first_chances(weighed, white_share(bench)))
            if 1.0 - p["nothing"] < NAMED and ask is not None and (seen := ask(scores)) is not None:
                p = with_detection(p, seen, weighed, {s.effect for s in scores})
        weighed.sort(key=lambda one: -p[one.effect])
        rivals = tuple(sorted(p.items(), key=lambda item: -item[1]))
        first = next((name for name, _ in rivals if name != "nothing"), "")
        if 1.0 - p["nothing"] < NAMED or not weighed or first != weighed[0].effect:
            considered, asked = rivals, weighed
            break
        best = weighed[0]
        bench = bench.taking([*bench.accepted, best.score.signature], library.signatures)
        steps.append(Step(best.score, rivals, bench, tuple(w.score for w in weighed), best.constant))
    tell("ranking", MOST, MOST)
    others = tuple(w.score for w in asked)
    return Ranking(start, tuple(steps), tuple(scores), driven, considered, others, seen)


def _by_name(weighed: Sequence[Weighed], p: Array) -> dict[str, float]:
    return {"nothing": float(p[0])} | {one.effect: float(x) for one, x in zip(weighed, p[1:])}


def with_detection(
    p: Mapping[str, float], seen: Detection, weighed: Sequence[Weighed], named: Collection[str]
) -> dict[str, float]:
    """Probabilities where a mismatch of any kind was looked for, "unknown" among them.

    What is detected is shared by the effects, the exceeded tolerances and "unknown" (an unknown function or an event),
    according to the largest log Bayes factor of each.

    Parameters
    ----------
    p : mapping of effect to float
        Probabilities from the evidence of effects alone, of "nothing" too.
    seen : Detection
    weighed : sequence of Weighed
        These effects.
    named : collection of str
        Effects that may be named.
    """
    beyond = p["nothing"] * seen.probability
    made = dict(p) | {"nothing": p["nothing"] - beyond}
    most = max((nats(one.score) for one in weighed), default=-np.inf)
    exceeded = seen.tolerances[0].log_bayes if seen.tolerances else -np.inf
    of_effects, of_tolerances, _ = beyond * softmax(np.array([most, exceeded, seen.log_bayes]) / SCALE)
    for one, share in zip(weighed, softmax([one.log_odds for one in weighed]) if weighed else ()):
        made[one.effect] += float(of_effects * share)
    for effect, share in seen.by_effect(named).items():
        made[effect] = made.get(effect, 0.0) + float(of_tolerances * share)
    return made | {UNNAMED: max(0.0, 1.0 - sum(made.values()))}
