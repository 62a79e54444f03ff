"""Ranks the physics a simulation may have left out, adds it, and shows the gain."""

from structsel.diagnosis.comparison import EffectComparison, EffectSignature, comparison
from structsel.diagnosis.diagnose import diagnose
from structsel.diagnosis.result import Bars, Diagnosis, Finding, Physics, Pull, Trace

__all__ = [
    "Bars",
    "Diagnosis",
    "EffectComparison",
    "EffectSignature",
    "Finding",
    "Physics",
    "Pull",
    "Trace",
    "comparison",
    "diagnose",
]
