"""Residuals of a model, and the effect of one more term, in numbers and in a notebook."""

from structsel.exploring.added_terms import Additions, try_additions
from structsel.exploring.explore import explore_residuals

__all__ = ["Additions", "explore_residuals", "try_additions"]
