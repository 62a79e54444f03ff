"""Refinement: parameters whose simulated outputs come nearest the recorded ones, by output error or filter error.

`refine` takes a linear structure or an AeroModel and one or many recordings, in time or over a band of frequencies;
`equation_error` estimates the same by regression; `compare_estimates` compares the estimates of several methods, and
`derivatives_by_condition` does so over many manoeuvres, against the angle of attack in trim or airspeed.
"""

from structsel.deprecation import renamed_names
from structsel.refinement.conditions import Derivatives, derivatives_by_condition
from structsel.refinement.equation_error import EquationError, equation_error
from structsel.refinement.estimate_comparison import EstimateComparison, compare_estimates
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.parameters import Parameter
from structsel.refinement.refine import refine
from structsel.refinement.result import Estimate, OutputFit, Refinement
from structsel.refinement.settings import RefineOptions

__getattr__ = renamed_names(__name__, {
    "Comparison": "EstimateComparison", "Matrices": "structsel.numerics.linear_models:LinearSystem",
})  # fmt: skip

__all__ = [
    "Derivatives",
    "EquationError",
    "Estimate",
    "EstimateComparison",
    "LinearStructure",
    "OutputFit",
    "Parameter",
    "RefineOptions",
    "Refinement",
    "compare_estimates",
    "derivatives_by_condition",
    "equation_error",
    "refine",
]
