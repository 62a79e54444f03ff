"""Where, when and how a simulation and recordings part."""

from structsel.comparison.compare import compare
from structsel.comparison.result import Mismatch

__all__ = ["Mismatch", "compare"]
