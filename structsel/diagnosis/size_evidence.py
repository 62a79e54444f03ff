"""Evidence of the size of an effect: flights agree on it, and it exceeds what the form of a simulation leaves."""

from __future__ import annotations

import numpy as np

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import contributions
from structsel.numerics.arrays import Array


def agreed(extended: DiagnosisProblem) -> float:
    """Log Bayes factor of the size of the last effect, with the scatter between flights as its standard error."""
    at = extended.place(len(extended.accepted) - 1)
    posterior = extended.base.posterior
    error = np.maximum(jackknifed(extended.base.solved[1:, at]), np.sqrt(np.diag(posterior.covariance)[at]))
    return 0.5 * float(np.max((posterior.mean[at] / error) ** 2))


def beyond_form(extended: DiagnosisProblem) -> float:
    """Log Bayes factor of the size of the last effect, with the form of an identified simulation as its error.

    What a polynomial leaves of a simulation's own flights is as large in the recordings, and may move like an effect.
    Infinite for other simulations, and for an effect that kinematic responses show: these are not simulated.
    """
    flights, effect = extended.flights, len(extended.accepted) - 1
    errors = flights[0].form_error
    if not errors or not set(extended.accepted[effect].responses) <= set(errors):
        return np.inf
    added = contributions(extended, [effect])
    ratios = [0.0]
    for c in extended.accepted[effect].responses:
        own = sum(float(np.var(f.simulated[c])) for f in flights)
        size = sum(float(np.var(a[c])) for a in added if c in a)
        ratios.append(size / max(errors[c] ** 2 * own, 1e-300))
    return 0.5 * max(ratios)


def jackknifed(without: Array) -> Array:
    """Jackknife standard error of estimates (groups, k), each without one group of flights."""
    groups = len(without)
    return np.sqrt((groups - 1) * without.var(axis=0)) if groups > 1 else np.zeros(without.shape[1])
