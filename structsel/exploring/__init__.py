"""Looking at what a model leaves: what adding a term would do, in numbers and in a notebook."""

from structsel.exploring.additions import Additions, try_additions
from structsel.exploring.station import explore_residuals

__all__ = ["Additions", "explore_residuals", "try_additions"]
