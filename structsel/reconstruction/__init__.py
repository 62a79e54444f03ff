"""Reconstruction: one flight path that agrees with all instruments, and the errors of each of them.

The first of the two steps. `reconstruct` does one manoeuvre, `reconstruct_all` many.
"""

from structsel.reconstruction.batch import Reconstructions, reconstruct_all
from structsel.reconstruction.reconstruct import reconstruct
from structsel.reconstruction.result import CONSTANTS, Constant, NoiseLevel, Reconstruction
from structsel.reconstruction.settings import METHODS, ReconstructOptions

__all__ = [
    "CONSTANTS",
    "METHODS",
    "Constant",
    "NoiseLevel",
    "ReconstructOptions",
    "Reconstruction",
    "Reconstructions",
    "reconstruct",
    "reconstruct_all",
]
