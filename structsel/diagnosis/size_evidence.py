"""Evidence of the size of an effect: flights agree on it, and it exceeds what the form of a simulation leaves."""

from __future__ import annotations

import numpy as np

from structsel.diagnosis import judging
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import contributions
from structsel.diagnosis.unknown_function import form_of
from structsel.numerics.arrays import Array


def agreed(extended: DiagnosisProblem) -> float:
    """Log Bayes factor of the size of the last effect, with the scatter between flights as its standard error."""
    at = extended.place(len(extended.accepted) - 1)
    posterior = extended.base.posterior
    error = np.maximum(jackknifed(extended.base.solved[1:, at]), np.sqrt(np.diag(posterior.covariance)[at]))
    return 0.5 * float(np.max((posterior.mean[at] / error) ** 2))


def beyond_form(without: DiagnosisProblem, extended: DiagnosisProblem) -> float:
    """Log Bayes factor of the size of the last effect, with what the form of the simulation leaves as its error.

    What a polynomial leaves of a simulation's own flights is as large in the recordings, and may move like an effect.
    What an effect explains of kinematic residuals counts as well: these are not simulated. Infinite for other
    simulations.
    """
    flights, effect = extended.flights, len(extended.accepted) - 1
    errors = flights[0].form_error
    responses = extended.accepted[effect].responses
    if not errors or not set(responses) & set(flights[0].simulated) <= set(errors):
        return np.inf
    added = contributions(extended, [effect])
    kinematic = set(responses) - set(flights[0].simulated)
    logs = [0.5 * sum(residual_squares(without, c) - residual_squares(extended, c) for c in kinematic)]
    for c in errors.keys() & set(responses):
        own = sum(float(np.var(f.simulated[c])) for f in flights)
        size = sum(float(np.var(a[c])) for a in added if c in a)
        logs.append(0.5 * size / max(errors[c] ** 2 * own, 1e-300))
    return max(logs)


def beyond_plant_form(problem: DiagnosisProblem, before: judging.Residuals, after: judging.Residuals) -> float:
    """Log Bayes factor of what an effect removes from a plant's held-out residual, with its form as the error."""
    got = judging.measured(problem)
    logs = [0.0]
    for c, form in form_of(problem.flights, problem.judged_responses).items():
        removed = judging.rms(before, c) ** 2 - judging.rms(after, c) ** 2
        logs.append(0.5 * removed / (form * judging.rms(got, c)) ** 2)
    return max(logs)


def residual_squares(problem: DiagnosisProblem, response: str) -> float:
    """Sum of squares of the whitened residual of a response, fitted to all flights."""
    return sum(float(np.sum(left[r.part(response)] ** 2)) for r, left in problem.fitted_residuals)


def jackknifed(without: Array) -> Array:
    """Jackknife standard error of estimates (groups, k), each without one group of flights."""
    groups = len(without)
    return np.sqrt((groups - 1) * without.var(axis=0)) if groups > 1 else np.zeros(without.shape[1])
