"""Ranks the physics a simulation may have left out, adds it, and shows the gain."""

from structsel.deprecation import renamed_names
from structsel.diagnosis.comparison import EffectComparison, EffectSignature, comparison
from structsel.diagnosis.diagnose import diagnose
from structsel.diagnosis.result import Bars, Diagnosis, EffectFinding, Physics, Pull, Trace

__getattr__ = renamed_names(__name__, {"Finding": "EffectFinding"})

__all__ = [
    "Bars",
    "Diagnosis",
    "EffectComparison",
    "EffectFinding",
    "EffectSignature",
    "Physics",
    "Pull",
    "Trace",
    "comparison",
    "diagnose",
]
