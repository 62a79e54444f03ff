"""What instruments or the air do that kinematics shows and no coefficient minds: no finding, but worth a word."""

from __future__ import annotations

from collections.abc import Mapping

from structsel.comparison.responses import KINEMATIC
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import found_by
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.weighing import log_bayes

_PLAIN = 100.0  # nats
_TAKES = 0.5  # of what lies beyond the noise, or beyond the biases, in some kinematic response


def notes(ranking: Ranking) -> list[str]:
    """The plainest of what was not found but closes the kinematics, in a sentence.

    Parameters
    ----------
    ranking : Ranking
    """
    found = {s.score.effect for s in ranking.steps}
    asked = [
        s
        for s in ranking.scores
        if s.hypothesis.kind in ("sensor", "atmospheric")
        and not s.event
        and s.effect not in found
        and log_bayes(s) > _PLAIN
    ]
    if not asked:
        return []
    before = judging.excess(ranking.problem)
    closing = [s for s in asked if _closes(before, judging.excess(ranking.problem.with_effect(s.signature)))]
    if not closing:
        return []
    one = max(closing, key=log_bayes)
    says = one.hypothesis.says(found_by(one))
    return [f"kinematics alone shows it ({log_bayes(one):.0f} nats), and no coefficient is the better for it: {says}"]


def _closes(before: Mapping[str, tuple[float, float]], after: Mapping[str, tuple[float, float]]) -> bool:
    """Whether most is gone of what some kinematic response misses beyond noise, or beyond biases."""
    return any(
        b > 2.0 and (b - a) > _TAKES * (b - 1.0) for c in KINEMATIC if c in before for b, a in zip(before[c], after[c])
    )
