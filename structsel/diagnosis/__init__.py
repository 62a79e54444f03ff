"""Finds the effects that a simulation lacks, adds them, and shows the improvement."""

from structsel.deprecation import renamed_names
from structsel.diagnosis.comparison import EffectComparison, EffectSignature, comparison
from structsel.diagnosis.diagnose import diagnose
from structsel.diagnosis.result import Bars, Diagnosis, EffectFinding, Physics, ToleranceDeviation, Trace

__getattr__ = renamed_names(__name__, {"Finding": "EffectFinding", "Pull": "ToleranceDeviation"})

__all__ = [
    "Bars",
    "Diagnosis",
    "EffectComparison",
    "EffectFinding",
    "EffectSignature",
    "Physics",
    "ToleranceDeviation",
    "Trace",
    "comparison",
    "diagnose",
]
