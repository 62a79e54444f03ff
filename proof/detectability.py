"""Whether a case can be decided: the log evidence that a perfect account of its effects would reach."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proof.case_files import Case
from proof.keys import COEFFICIENTS
from proof.worker import open_case
from structsel.diagnosis import EffectComparison, comparison
from structsel.diagnosis.comparison import Contribution

_READ = ("sensor", "atmospheric")
"""Kinds of effects that change readings."""


def log_evidence_of(case: Case, folder: Path) -> float | None:
    """Log Bayes factor of a perfect model of a case's effects against none; None where it is not known.

    What the effects add is taken to first order along the recordings, so that a free simulation counts as forced. Wrong
    readings and moving air also change the kinematic residuals, by contributions that are not computed: for them only
    the coefficients are compared.

    Parameters
    ----------
    case : Case
    folder : Path
        Where it was written.
    """
    if not case.contribution:
        return None
    compared, responses = _compared(case, folder)
    return compared.log_bayes_factor(_by_recording(case, case.contribution, responses), responses)


def log_evidence_of_each(case: Case, folder: Path) -> list[float]:
    """Log Bayes factor of a perfect model of both effects of a pair against one of the other alone, for each.

    Empty where it is not known. Computed as `log_evidence_of`.
    """
    if len(case.of_each) != 2:
        return []
    compared, responses = _compared(case, folder)
    first, second = (_by_recording(case, added, responses) for added in case.of_each)
    return [compared.log_bayes_factor(own, responses, known=other) for own, other in ((first, second), (second, first))]


def _compared(case: Case, folder: Path) -> tuple[EffectComparison, list[str]]:
    """Comparison of a case, and the responses that count."""
    compared = comparison(*open_case(folder), effects=())
    read = any(kind in _READ for e in case.key.effects for kind in e.kinds)
    return compared, [c for c in compared.responses if c in COEFFICIENTS or not read]


def _by_recording(case: Case, contribution: Sequence[np.ndarray], responses: Sequence[str]) -> Contribution:
    """A contribution to the coefficients among the responses."""
    return {
        recording.name: {c: (recording.t, x) for c, x in zip(COEFFICIENTS, added.T) if c in responses}
        for recording, added in zip(case.recordings, contribution)
    }
