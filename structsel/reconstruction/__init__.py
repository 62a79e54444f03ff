"""Reconstruction: one flight path that all instruments can have seen, and what is wrong with each of them.

The first of the two steps. `reconstruct` does one manoeuvre, `reconstruct_all` many.
"""

from structsel.reconstruction.batch import Reconstructions, reconstruct_all
from structsel.reconstruction.reconstruct import METHODS, reconstruct
from structsel.reconstruction.result import CONSTANTS, Constant, NoiseLevel, Reconstruction

__all__ = [
    "CONSTANTS",
    "METHODS",
    "Constant",
    "NoiseLevel",
    "Reconstruction",
    "Reconstructions",
    "reconstruct",
    "reconstruct_all",
]
