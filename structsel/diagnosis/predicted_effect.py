"""Evidence from prediction errors of the most probable effect, if its evidence on the recorded motion is weak.

A lag of a surface or ice shows in few samples; a coloured residual of the rest hides it where all samples are compared.
What the past does not predict is white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.causal_rows import CausalRows, Null
from structsel.comparison.past_motion import with_motion_delayed
from structsel.diagnosis.weighing import AGREED, CandidateEffect

_EVEN, _SCALE = 12.0, 1.5
"""Log Bayes factor times the fraction of white noise in the residual forces, at which an effect has probability one
half, and its scale. Correct simulations have 4.6 at most (224 of both generators, evaluations since seed 85000), one in
gusts that no vane feels 9.8, seven effects that had no other evidence 9 to 200."""


@dataclass(frozen=True)
class PredictedEffect:
    """The most probable effect, and what the prediction errors say of it.

    Attributes
    ----------
    effect : str
    log_bayes : float
        Over tolerances and biases, with the motion of some samples before.
    white : float
        Fraction of white noise in the residual of the forces.
    of_form : float
        Log Bayes factor of its size, with the form of an identified simulation as its error.
    """

    effect: str
    log_bayes: float
    white: float
    of_form: float

    @property
    def log_odds(self) -> float:
        """Log odds that it is there. Moving air that no vane feels is coloured."""
        return float(min((self.white * self.log_bayes - _EVEN) / _SCALE, self.of_form - AGREED))


def find_predicted(
    rows: CausalRows, null: Null, candidates: Sequence[CandidateEffect], white: float
) -> PredictedEffect | None:
    """The most probable candidate in the prediction errors.

    None if it is an event, whose time was searched, or an error of an instrument, whose biases are free in each flight.

    Parameters
    ----------
    rows : CausalRows
    null : Null
        Of these rows.
    candidates : sequence of CandidateEffect
    white : float
        Fraction of white noise in the residual of the forces.
    """
    first = max(candidates, key=lambda one: one.log_odds, default=None)
    if first is None or first.score.event or first.score.hypothesis.kind == "sensor":
        return None
    variant = first.score.signature.variant
    sd = np.array([parameter.sd for parameter in variant.parameters])
    late = [with_motion_delayed(f) for f in rows.flights]
    columns = [{c: x * sd for c, x in variant.columns(f).items() if c in rows.responses and x.any()} for f in late]
    if not any(columns):
        return None
    return PredictedEffect(first.effect, rows.jointly(null, columns), white, first.of_form)
