"""Whether a case can be decided: the log evidence that a perfect account of its effects would reach."""

from __future__ import annotations

from pathlib import Path

from proof.case_files import Case
from proof.keys import COEFFICIENTS
from proof.worker import open_case
from structsel.diagnosis import comparison

_READ = ("sensor", "atmospheric")
"""Kinds of effects that change readings."""


def log_evidence_of(case: Case, folder: Path) -> float | None:
    """Log Bayes factor of a perfect account of a case's effects against none; None where it is not known.

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
    compared = comparison(*open_case(folder), effects=())
    coefficients = [c for c in COEFFICIENTS if c in compared.responses]
    read = any(kind in _READ for e in case.key.effects for kind in e.kinds)
    return compared.log_bayes_factor(
        {
            recording.name: {c: (recording.t, x) for c, x in zip(COEFFICIENTS, added.T) if c in coefficients}
            for recording, added in zip(case.recordings, case.contribution)
        },
        coefficients if read else None,
    )
