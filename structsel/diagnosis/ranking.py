"""Finds the missing effects one by one, each compared with the others and with no effect."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from structsel.diagnosis.detection import SCALE, Detection
from structsel.diagnosis.effect_probability import distribution, first_probabilities, further_probabilities
from structsel.diagnosis.input_response import InputDrivenMotion
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.reshaping import reshape
from structsel.diagnosis.residuals import white_fraction
from structsel.diagnosis.result import UNNAMED
from structsel.diagnosis.scoring import EffectScore, score_all
from structsel.diagnosis.signatures import Library
from structsel.diagnosis.switching import refine, with_proposals
from structsel.diagnosis.weighing import EVIDENT, CandidateEffect, candidate_effects, log_bayes, with_dispersion
from structsel.numerics.arrays import Array

MAX_EFFECTS = 4
"""Number of effects that are searched."""
_MAX_PLACES = 8
"""Number of forms in the model: one effect may act in several places."""
NAMED = 0.5
"""Probability of a mismatch from which the most probable effect is named."""
TIED = 1.0 / 3.0
"""Fraction of the largest probability from which another effect is reported as ambiguous with the first."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Step:
    """One effect that enters the model, and the alternatives to it.

    Attributes
    ----------
    score : EffectScore
    alternatives : tuple of (effect, probability)
        All candidate effects, the most probable first, the effect itself and "nothing" among them.
    problem : DiagnosisProblem
        With the effect in the model.
    others : tuple of EffectScore
        All candidate effects, the most probable first.
    constant : bool
        Whether it explains more of the constant part of the flights than of the rest.
    is_level : bool
        Whether it is moving air that explains the level of a plant's velocities.
    """

    score: EffectScore
    alternatives: tuple[tuple[str, float], ...]
    problem: DiagnosisProblem
    others: tuple[EffectScore, ...] = ()
    constant: bool = False
    is_level: bool = False


@dataclass(frozen=True, eq=False)
class Ranking:
    """Effects that were found, and the evidence of all others.

    Attributes
    ----------
    start : DiagnosisProblem
        Without effects.
    steps : tuple of Step
    scores : tuple of EffectScore
        Of all effects, in the last search.
    motion : InputDrivenMotion, optional
        Response of the flights to the recorded inputs alone.
    considered : tuple of (effect, probability)
        Candidate effects when no further effect entered, the most probable first; "nothing" among them.
    others : tuple of EffectScore
        Of those effects.
    detection : Detection, optional
        Of any mismatch, if it was computed.
    """

    start: DiagnosisProblem
    steps: tuple[Step, ...]
    scores: tuple[EffectScore, ...] = ()
    motion: InputDrivenMotion | None = None
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    others: tuple[EffectScore, ...] = ()
    detection: Detection | None = None

    @property
    def problem(self) -> DiagnosisProblem:
        """Problem with all effects that were found."""
        return self.steps[-1].problem if self.steps else self.start

    def only(self, effects: Collection[str]) -> Ranking:
        """The ranking with the steps of some of the effects that were found."""
        kept = [k for k, s in enumerate(self.steps) if s.score.effect in effects]
        if len(kept) == len(self.steps):
            return self
        steps = [self.steps[k] for k in kept]
        steps[-1] = replace(steps[-1], problem=self.problem.subset(kept))
        return replace(self, steps=tuple(steps))

    @property
    def input_only(self) -> DiagnosisProblem | None:
        """As `problem`, for the response to the recorded inputs alone; None if it was not needed."""
        return None if self.motion is None else self.motion.with_effects(self.problem.accepted)


def rank(
    problem: DiagnosisProblem,
    library: Library,
    progress: Progress | None = None,
    ask: Callable[[Sequence[EffectScore], Sequence[CandidateEffect]], Detection | None] | None = None,
) -> Ranking:
    """Enter effects one by one as long as another one is probable.

    Parameters
    ----------
    problem : DiagnosisProblem
    library : Library
    progress : callable, optional
    ask : callable, optional
        Returns the detection of any mismatch, or None, from the scores of all effects and the candidates; called if
        none is probable.
    """
    tell = progress or (lambda what, done, of: None)
    start, motion = problem, InputDrivenMotion.of(problem.flights)
    steps: list[Step] = []
    scores: list[EffectScore] = []
    considered: tuple[tuple[str, float], ...] = (("nothing", 1.0),)
    asked: list[CandidateEffect] = []
    seen: Detection | None = None
    while (k := len({s.score.effect for s in steps})) < MAX_EFFECTS and len(steps) < _MAX_PLACES:
        tell("ranking", k, MAX_EFFECTS)
        scores, candidates = search_effects(problem, library, motion)
        if steps:
            candidates = [one for one in candidates if one.lowers]
            p = _by_name(candidates, further_probabilities(candidates))
        else:
            p = _by_name(candidates, first_probabilities(candidates, white_fraction(problem)))
            if 1.0 - p["nothing"] < NAMED and ask is not None and (seen := ask(scores, candidates)) is not None:
                p = with_detection(p, seen, candidates, {s.effect for s in scores})
        candidates.sort(key=lambda one: -p[one.effect])
        alternatives = tuple(sorted(p.items(), key=lambda item: -item[1]))
        first = next((name for name, _ in alternatives if name != "nothing"), "")
        if 1.0 - p["nothing"] < NAMED or not candidates or first != candidates[0].effect:
            considered, asked = alternatives, candidates
            break
        best = candidates[0]
        problem, library = enter(best, problem, library, start)
        others = tuple(w.score for w in candidates)
        steps.append(Step(best.score, alternatives, problem, others, best.constant, best.is_level))
    tell("ranking", MAX_EFFECTS, MAX_EFFECTS)
    others = tuple(w.score for w in asked)
    return Ranking(start, tuple(steps), tuple(scores), motion, considered, others, seen)


def search_effects(
    problem: DiagnosisProblem, library: Library, motion: InputDrivenMotion
) -> tuple[list[EffectScore], list[CandidateEffect]]:
    """Scores of all effects beside those in the model, and the candidates among them.

    Parameters
    ----------
    problem : DiagnosisProblem
    library : Library
    motion : InputDrivenMotion
        Of the flights.
    """
    scores = _scored(problem, library)
    # What no form of the library explains counts as noise. Those of evident effects have other times and shapes by now.
    known = {id(s) for s in library.signatures}
    moved = [s.signature for s in scores if s.log_evidence >= EVIDENT and id(s.signature) not in known]
    if moved:
        problem = problem.with_noise_without(moved, library.signatures)
        scores = _scored(problem, library)
    scores = with_dispersion(problem, motion.confirm(problem, scores))
    return scores, candidate_effects(problem, scores)


def _scored(problem: DiagnosisProblem, library: Library) -> list[EffectScore]:
    """Scores of all effects, the leading ones with their most probable times and shapes."""
    return reshape(problem, refine(problem, score_all(problem, library)))


def enter(
    best: CandidateEffect, problem: DiagnosisProblem, library: Library, start: DiagnosisProblem
) -> tuple[DiagnosisProblem, Library]:
    """The problem with a candidate in the model, and the library with the forms that are then proposed.

    Parameters
    ----------
    best : CandidateEffect
    problem : DiagnosisProblem
    library : Library
    start : DiagnosisProblem
        Without effects, with all tolerances.
    """
    accepted = [*problem.accepted, best.score.signature]
    library = with_proposals(library, problem.flights, start.nuisances, accepted)
    return problem.with_effects(accepted, library.signatures), library


def _by_name(candidates: Sequence[CandidateEffect], p: Array) -> dict[str, float]:
    return {"nothing": float(p[0])} | {one.effect: float(x) for one, x in zip(candidates, p[1:])}


def with_detection(
    p: Mapping[str, float], seen: Detection, candidates: Sequence[CandidateEffect], named: Collection[str]
) -> dict[str, float]:
    """Probabilities after the detection of any mismatch, "unknown" among them.

    The probability of a mismatch that prediction errors show is distributed over the effects, the exceeded tolerances
    and "unknown" (an unknown function or an event) by the largest log Bayes factor of each. That of a residual in one
    response alone belongs to "unknown": no effect explains it.

    Parameters
    ----------
    p : mapping of effect to float
        Probabilities from the evidence of effects only, with that of "nothing".
    seen : Detection
    candidates : sequence of CandidateEffect
        These effects.
    named : collection of str
        Effects that may be named.
    """
    beyond = p["nothing"] * seen.probability_by_rows
    made = dict(p) | {"nothing": p["nothing"] * (1.0 - seen.probability)}
    of_motion = () if seen.averaged else candidates  # which differences may have caused
    largest = max((log_bayes(one.score) for one in of_motion), default=-np.inf)
    if seen.predicted is not None:
        largest = max(largest, seen.predicted.log_bayes)
    exceeded = seen.tolerances[0].log_bayes if seen.tolerances else -np.inf
    of_effects, of_tolerances, _ = beyond * softmax(np.array([largest, exceeded, seen.log_bayes]) / SCALE)
    for one, fraction in zip(candidates, distribution(candidates) if candidates else ()):
        made[one.effect] += float(of_effects * fraction)
    for effect, fraction in seen.by_effect(named).items():
        made[effect] = made.get(effect, 0.0) + float(of_tolerances * fraction)
    return made | {UNNAMED: max(0.0, 1.0 - sum(made.values()))}
