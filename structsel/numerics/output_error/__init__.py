"""Output error: parameters whose simulated outputs come nearest what was measured, whole manoeuvres at once.

The model is a function of the parameters alone, ``predict(thetas (m, k)) -> outputs (m, n, c)``, many parameter sets
in one call. With v = z - y(theta) over all manoeuvres and R the noise covariance at its best for these residuals::

    J = 1/2 sum v' R^-1 v + N/2 ln det R         R = 1/N sum v v'          cost "ml"
    J = 1/2 sum v' R^-1 v                        R as given                cost "weighted"

`search_globally` looks everywhere between bounds by differential evolution; `fit_output_error` goes down from a start
by Levenberg-Marquardt with the noise covariance relaxed between steps.

References
----------
[KM16], output error; [A10], both costs, evolution first and Levenberg-Marquardt after; [J15].
"""

from structsel.numerics.output_error.descent import fit_output_error
from structsel.numerics.output_error.evolution import GlobalSearch, search_globally
from structsel.numerics.output_error.records import Constraint, Predict
from structsel.numerics.output_error.result import OutputErrorFit

__all__ = ["Constraint", "GlobalSearch", "OutputErrorFit", "Predict", "fit_output_error", "search_globally"]
