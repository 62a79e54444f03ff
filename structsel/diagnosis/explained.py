"""Fractions of the mismatch beyond noise and biases that an effect explains."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from structsel.diagnosis import judging
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore

SLIGHT = 0.2  # of the noise power: a smaller residual is within the scatter of the noise
_CONSTANT = 2.0  # of the variance of the biases: the same for constant parts, of which each flight has one


@dataclass(frozen=True)
class Taken:
    """Fractions beyond noise and biases that an effect explains, each in the response where it is largest.

    Attributes
    ----------
    moving, level : float
        Of all but the constant part; of the constant part.
    judged_there : float
        Of the samples at which the effect acts, in the responses by which effects are judged.
    """

    moving: float
    level: float
    judged_there: float

    @classmethod
    def by(cls, one: EffectScore, without: DiagnosisProblem, extended: DiagnosisProblem) -> Taken:
        """Fractions of an effect, from problems without and with it."""
        predicted, where = judged_on(one)
        before, after = (judging.excess(b, predicted, where) for b in (without, extended))
        there = judging.excess_where_moved(without, extended, predicted, where)
        return cls(
            max(explained_fraction(before[c][0], after[c][0], SLIGHT) for c in before),
            max(explained_fraction(before[c][1], after[c][1], _CONSTANT) for c in extended.judged_responses),
            max((explained_fraction(*there[c], SLIGHT) for c in extended.judged_responses if c in there), default=0.0),
        )


def judged_on(one: EffectScore) -> tuple[bool, Collection[str] | None]:
    """Whether an effect is judged by its prediction from other flights, and the flights that count."""
    return (False, one.signature.flights) if one.event else (True, None)


def explained_fraction(before: float, after: float, slight: float) -> float:
    """Fraction of the power beyond the noise that is explained."""
    return float(np.clip((before - after) / (before - 1.0 + slight), 0.0, 1.0)) if before > 1.0 else 0.0
