"""Effects in the model, each once: which of them are needed, and the fraction of the mismatch that each explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking, Step
from structsel.diagnosis.size_evidence import residual_squares
from structsel.diagnosis.weighing import EVIDENT
from structsel.numerics.arrays import Array

_NEGLIGIBLE = 0.02
"""Fraction of what the others leave of a response, below which one of several effects is no finding if it explains no
more of any response, unless it has evidence: tolerances would take its place."""


@dataclass(frozen=True, eq=False)
class Member:
    """Forms in the model that are one finding: the same effect in several places."""

    steps: tuple[Step, ...]
    places: tuple[int, ...]

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.steps[0].score.effect

    @property
    def probability(self) -> float:
        """Probability of its name, when it entered."""
        return dict(self.steps[0].alternatives).get(self.effect, 1.0)


def gather(ranking: Ranking) -> list[Member]:
    """Effects in the model, each once, in the order in which they entered."""
    groups: dict[str, list[int]] = {}
    for k, step in enumerate(ranking.steps):
        groups.setdefault(step.score.effect, []).append(k)
    return [Member(tuple(ranking.steps[k] for k in each), tuple(each)) for each in groups.values()]


def with_members(problem: DiagnosisProblem, members: Sequence[Member]) -> DiagnosisProblem:
    """The problem with some of the effects in the model, fitted again."""
    return problem.subset([k for m in members for k in m.places])


def squares_left(problem: DiagnosisProblem, responses: Sequence[str]) -> Array:
    """Sum of squares of the residual of each response."""
    return np.array([residual_squares(problem, c) for c in responses])


def needed(problem: DiagnosisProblem, members: Sequence[Member]) -> list[Member]:
    """Effects without those that explain a negligible fraction of what the others leave, the least needed first.

    Where tolerances can take the place of an effect it explains little, but they deviate by more without it: it stays
    if its log Bayes factor beside the others is that of a candidate.
    """
    kept, responses = list(members), problem.judged_responses
    while len(kept) > 1:
        complete, adds = with_members(problem, kept), []
        all_left = squares_left(complete, responses)
        for i in range(len(kept)):
            without = with_members(problem, [*kept[:i], *kept[i + 1 :]])
            left = np.maximum(squares_left(without, responses), np.finfo(float).tiny)
            is_evident = complete.base.log_evidence - without.base.log_evidence >= EVIDENT
            adds.append(np.inf if is_evident else float(np.max(1.0 - all_left / left)))
        if min(adds) >= _NEGLIGIBLE:
            break
        del kept[int(np.argmin(adds))]
    return kept


def mean_gains(problem: DiagnosisProblem, members: Sequence[Member]) -> list[float]:
    """Gain of each finding, its mean over all orders of entering (Shapley value).

    The gain is the decrease of the logarithm of the sum of squares of each judged response. That of the sum itself
    would be the same for two effects of which either explains nearly all, however much more one of them explains.

    Parameters
    ----------
    problem : DiagnosisProblem
        With all of them in the model. Where its tolerances are exact, what they could explain counts too.
    members : sequence of Member
    """
    known: dict[frozenset[int], float] = {}

    def left(taken: frozenset[int]) -> float:
        if taken not in known:
            fitted = with_members(problem, [members[i] for i in sorted(taken)])
            squares = squares_left(fitted, problem.judged_responses)
            known[taken] = float(np.log(np.maximum(squares, np.finfo(float).tiny)).sum())
        return known[taken]

    made = np.zeros(len(members))
    orders = list(permutations(range(len(members))))
    for order in orders:
        taken: frozenset[int] = frozenset()
        for i in order:
            made[i] += left(taken) - left(taken | {i})
            taken = taken | {i}
    return [max(0.0, float(x)) for x in made / len(orders)]
