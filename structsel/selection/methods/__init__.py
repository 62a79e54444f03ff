"""Selection methods, one file each; `METHODS` is the table that options, command line and reports read.

A method from outside joins with ``METHODS["mine"] = SelectionMethod("mine", "My method", search)``.
"""

from structsel.selection.methods.best_subset import BEST_SUBSET
from structsel.selection.methods.method import (
    SearchConstraints,
    SearchProblem,
    SelectionMethod,
    VisitedModels,
    thresholds,
)
from structsel.selection.methods.orthogonal import ORTHOGONAL
from structsel.selection.methods.stepwise import STEPWISE

METHODS: dict[str, SelectionMethod] = {method.name: method for method in (STEPWISE, ORTHOGONAL, BEST_SUBSET)}

__all__ = [
    "METHODS",
    "SearchConstraints",
    "SearchProblem",
    "SelectionMethod",
    "VisitedModels",
    "thresholds",
]
