"""Where, when and how a simulation and recordings part."""

from structsel.mismatch.result import Mismatch
from structsel.mismatch.station import compare

__all__ = ["Mismatch", "compare"]
