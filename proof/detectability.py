"""Whether a case can be decided: the log evidence that a perfect account of its effects would reach."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proof.case_files import Case
from proof.keys import COEFFICIENTS
from proof.worker import open_case
from structsel.diagnosis import comparison
from structsel.diagnosis.comparison import Contribution

_READ = ("sensor", "atmospheric")
"""Kinds of effects that change readings."""


def log_evidence_of(case: Case, folder: Path) -> tuple[float | None, list[float]]:
    """Log Bayes factor of a perfect model of a case's effects against none; and for each of a pair, against the other.

    The latter is that of a perfect model of both against one of the other alone. None, and an empty list, where they
    are not known. What the effects add is taken to first order along the recordings, so that a free simulation counts
    as forced. Wrong readings and moving air also change the kinematic residuals, by contributions that are not
    computed: for them only the coefficients are compared.

    Parameters
    ----------
    case : Case
    folder : Path
        Where it was written.
    """
    if not case.contribution:
        return None, []
    compared = comparison(*open_case(folder), effects=())
    read = any(kind in _READ for e in case.key.effects for kind in e.kinds)
    responses = [c for c in compared.responses if c in COEFFICIENTS or not read]
    added, *of_each = (_by_recording(case, x, responses) for x in (case.contribution, *case.of_each))
    return (
        compared.log_bayes_factor(added, responses),
        [compared.log_bayes_factor(x, responses, known=other) for x, other in zip(of_each, reversed(of_each))],
    )


def _by_recording(case: Case, contribution: Sequence[np.ndarray], responses: Sequence[str]) -> Contribution:
    """A contribution to the coefficients among the responses."""
    return {
        recording.name: {c: (recording.t, x) for c, x in zip(COEFFICIENTS, added.T) if c in responses}
        for recording, added in zip(case.recordings, contribution)
    }
