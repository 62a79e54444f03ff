"""Notes on errors of instruments and motion of the air that only the kinematic residuals show."""

from __future__ import annotations

from collections.abc import Mapping

from structsel.comparison.responses import KINEMATIC
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import found_by
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.weighing import log_bayes

_PLAIN = 100.0  # log Bayes factor
_TAKES = 0.5  # fraction explained beyond the noise, or beyond the biases, of some kinematic residual


def notes(ranking: Ranking) -> list[str]:
    """Note on the clearest effect that is no finding but explains a kinematic residual; empty if there is none.

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
    return [
        f"only the kinematic residuals show this (log Bayes factor {log_bayes(one):.0f}), not the coefficients: {says}"
    ]


def _closes(before: Mapping[str, tuple[float, float]], after: Mapping[str, tuple[float, float]]) -> bool:
    """Whether most of some kinematic residual beyond the noise, or beyond the biases, is explained."""
    return any(
        b > 2.0 and (b - a) > _TAKES * (b - 1.0) for c in KINEMATIC if c in before for b, a in zip(before[c], after[c])
    )
