"""Evidence from prediction errors of the most probable effect, if its evidence on the recorded motion is weak.

A lag of a surface or ice shows in few samples; a coloured residual of the rest hides it where all samples are compared.
What the past does not predict is white.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.causal_rows import CausalRows, Null
from structsel.comparison.past_motion import with_motion_delayed
from structsel.diagnosis.unknown_function import log_bayes_beyond_form, of_unit_size
from structsel.diagnosis.weighing import AGREED, CandidateEffect
from structsel.numerics.arrays import Array

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
    first = _first_candidate(candidates)
    if first is None:
        return None
    columns = _columns(rows, first)
    if not any(columns):
        return None
    return PredictedEffect(first.effect, rows.jointly(null, columns), white, first.of_form)


def find_predicted_in_plant(
    rows: CausalRows, null: Null, candidates: Sequence[CandidateEffect], form: Mapping[str, float]
) -> PredictedEffect | None:
    """The same of a plant, in the response in which it is clearest, beyond the error of the simulation's form.

    Parameters
    ----------
    rows : CausalRows
    null : Null
    candidates : sequence of CandidateEffect
    form : mapping of response to float
        Error of the form, relative to the rms by which the response varies.
    """
    first = _first_candidate(candidates)
    if first is None:
        return None
    columns = _columns(rows, first)
    logs = []
    for c in rows.responses:
        if any(c in one for one in columns):
            count = next(one[c].shape[1] for one in columns if c in one)
            each = [one.get(c, np.zeros((len(f), count))) for one, f in zip(columns, rows.flights)]
            F = [x * rows.size[c] / np.sqrt(count) for x in of_unit_size([rows.inside(x) for x in each])]
            logs.append(log_bayes_beyond_form(rows, null, c, F, form[c]))
    return PredictedEffect(first.effect, max(logs), 1.0, first.of_form) if logs else None


def _first_candidate(candidates: Sequence[CandidateEffect]) -> CandidateEffect | None:
    first = max(candidates, key=lambda one: one.log_odds, default=None)
    return None if first is None or first.score.event or first.score.hypothesis.kind == "sensor" else first


def _columns(rows: CausalRows, candidate: CandidateEffect) -> list[dict[str, Array]]:
    """Columns of its form, of prior standard deviation one, with the motion of some samples before."""
    variant = candidate.score.signature.variant
    sd = np.array([parameter.sd for parameter in variant.parameters])
    moved = [with_motion_delayed(f) for f in rows.flights]
    return [{c: x * sd for c, x in variant.columns(f).items() if c in rows.responses and x.any()} for f in moved]
