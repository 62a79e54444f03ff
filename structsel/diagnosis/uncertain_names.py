"""Names that are uncertain where one response alone has a residual that lasts: it may have the cause of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from structsel.diagnosis.assembling import share_with_unknown
from structsel.diagnosis.detection import detect
from structsel.diagnosis.isolated import IsolatedResidual
from structsel.diagnosis.ranking import TIED, Ranking
from structsel.diagnosis.result import LISTED, UNNAMED, EffectFinding


def without_names(ranking: Ranking, alone: IsolatedResidual) -> Ranking:
    """The ranking without effects: the probabilities of the first search, and "unknown" with that of such a residual.

    Parameters
    ----------
    ranking : Ranking
        With one effect or more.
    alone : IsolatedResidual
        That all of its effects leave.
    """
    first, named = ranking.steps[0], 1.0 - alone.probability
    considered = {effect: named * p for effect, p in first.alternatives}
    considered[UNNAMED] = considered.get(UNNAMED, 0.0) + alone.probability
    seen = detect(ranking.start.flights, ranking.start)
    return replace(
        ranking,
        steps=(),
        considered=tuple(sorted(considered.items(), key=lambda item: -item[1])),
        others=first.others,
        detection=None if seen is None else replace(seen, tolerances=(), isolated=alone),
    )


def less_probable(findings: Sequence[EffectFinding], alone: IsolatedResidual | None) -> list[EffectFinding]:
    """Findings whose names keep the probability that such a residual is not there; "unknown" has the rest."""
    if alone is None or alone.probability < LISTED:
        return list(findings)
    return [_less_probable(finding, alone) for finding in findings]


def _less_probable(finding: EffectFinding, alone: IsolatedResidual) -> EffectFinding:
    names, cause = share_with_unknown(finding.physics, alone.probability)
    cause = replace(cause, says=f"{cause.says} {alone.says}")
    physics = tuple(sorted([*names, cause], key=lambda p: -p.probability))
    likely = [p.effect for p in physics if p.probability > TIED * physics[0].probability]
    others = dict.fromkeys([*finding.ambiguous_with, *likely])
    return replace(finding, physics=physics, ambiguous_with=tuple(e for e in others if e != physics[0].effect))
