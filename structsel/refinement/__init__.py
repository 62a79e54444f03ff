"""Refinement: parameters whose simulated flights come nearest the recorded ones, by output error.

`refine` takes a linear structure or an AeroModel and one or many recordings; `compare_estimates` sets several ways
of estimating the same parameters side by side.
"""

from structsel.refinement.comparison import Comparison, compare_estimates
from structsel.refinement.linear_structure import LinearStructure, Matrices
from structsel.refinement.parameters import Parameter
from structsel.refinement.result import Estimate, OutputFit, Refinement
from structsel.refinement.station import refine

__all__ = [
    "Comparison",
    "Estimate",
    "LinearStructure",
    "Matrices",
    "OutputFit",
    "Parameter",
    "Refinement",
    "compare_estimates",
    "refine",
]
