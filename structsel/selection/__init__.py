"""Which terms belong in the model: `select`, and what it returns."""

from structsel.selection.engine import select_arrays
from structsel.selection.identifiability import Alias
from structsel.selection.options import Options
from structsel.selection.result import HeldOutPart, Selection, Selections, TraceStep
from structsel.selection.select import select

__all__ = [
    "Alias",
    "HeldOutPart",
    "Options",
    "Selection",
    "Selections",
    "TraceStep",
    "select",
    "select_arrays",
]
