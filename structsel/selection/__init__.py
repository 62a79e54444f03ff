"""Which terms belong in the model: `select`, and what it returns."""

from structsel.deprecation import renamed_names
from structsel.selection.diagnostics import Alias
from structsel.selection.engine import select_arrays
from structsel.selection.result import Selection
from structsel.selection.select import select
from structsel.selection.selections import Selections
from structsel.selection.settings import SelectOptions
from structsel.selection.trace import HeldOutPart, TraceStep

__all__ = [
    "Alias",
    "HeldOutPart",
    "SelectOptions",
    "Selection",
    "Selections",
    "TraceStep",
    "select",
    "select_arrays",
]

__getattr__ = renamed_names(__name__, {"Options": "SelectOptions"})
