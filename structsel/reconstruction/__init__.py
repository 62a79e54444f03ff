"""Flight-path reconstruction: a path that is consistent with all instruments, and the errors of the instruments.

`reconstruct` is for one manoeuvre, `reconstruct_all` for many.
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
