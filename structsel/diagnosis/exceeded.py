"""Evidence for stated tolerances that are exceeded, and the effects to which they belong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.nuisance import Nuisance
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import white_fraction
from structsel.effects.base import ParameterEstimate
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import wider_priors

WIDER = np.array([5.0, 15.0, 50.0])
"""Prior standard deviations of an exceeded parameter, over its stated tolerance (1 sigma); equally probable."""
_MISSING = 3.0  # deviation over the stated value; one of a half or twice its value is there
EVEN = 4.0
"""Deviation in stated tolerances at which a well determined parameter has probability one half to be exceeded."""


@dataclass(frozen=True, eq=False)
class ExceededTolerance:
    """One tolerance as an explanation of the differences, with all others as stated.

    Attributes
    ----------
    tolerance : Nuisance
    deviations : float
        From the stated value, in stated tolerances.
    std : float
        Standard error of the deviation.
    log_bayes : float
        Log Bayes factor of the exceeded tolerance over all as stated; NaN where it was not computed, as `alone`.
    alone : float
        Probability that no other tolerance is exceeded, and that no parameter without a tolerance is the cause.
    """

    tolerance: Nuisance
    deviations: float
    std: float
    log_bayes: float = float("nan")
    alone: float = float("nan")

    @property
    def log_odds(self) -> float:
        """Log odds that the tolerance is exceeded."""
        return self.log_bayes - _log_bayes_at(EVEN)

    @property
    def effect(self) -> str:
        """Name of the effect; a parameter with less than a quarter of its value is missing in the simulation."""
        n = self.tolerance
        return n.absent if n.absent and abs(self.estimate.value) > _MISSING else n.effect

    @property
    def estimate(self) -> ParameterEstimate:
        """The deviation with its standard error, in its unit."""
        n = self.tolerance
        return ParameterEstimate(self.deviations * n.sd, self.std * n.sd, n.unit)

    @property
    def says(self) -> str:
        """One plain sentence."""
        found = self.estimate
        size = f"{100.0 * found.value:+.1f} +- {100.0 * found.std:.1f} %"
        if found.unit != "relative":
            size = f"{found.value:+.3g} +- {found.std:.1g} {found.unit}"
        return (
            f"'{self.tolerance.name}' deviates from its stated value by {size}, "
            f"{abs(self.deviations):.1f} times its tolerance."
        )


def exceeded(
    tolerances: Sequence[Nuisance],
    mean: Array,
    covariance: Array,
    scale: Array | float = 1.0,
    worth: float = 1.0,
    form: Mapping[str, float] | None = None,
) -> tuple[ExceededTolerance, ...]:
    """Stated tolerances that may be exceeded, the most probable first.

    The prior of each in turn is widened by one of several factors, with all others as stated.

    Parameters
    ----------
    tolerances : sequence of Nuisance
    mean, covariance : (k,) and (k, k) array [prior standard deviations]
        Posterior of these parameters and of all others.
    scale : (k,) array or float
        Prior standard deviations, in stated tolerances.
    worth : float
        Factor on the log Bayes factors.
    form : mapping of tolerance to float, optional
        Deviations that the form of the simulation may explain; see `explained_by_form`.
    """
    stated_scale = np.broadcast_to(scale, mean.shape)
    scale = np.array(stated_scale)
    for j, n in enumerate(tolerances):
        scale[j] /= np.hypot(1.0, (form or {}).get(n.name, 0.0))
    stated = [j for j, n in enumerate(tolerances) if n.effect]
    logs = worth * _log_bayes(mean, np.diag(covariance), scale)
    others = max((logs[j] for j in range(len(tolerances)) if j not in stated), default=-np.inf)
    made = []
    for j in sorted((j for j in stated if logs[j] > 0.0), key=lambda j: -logs[j]):
        freed, spread = _freed(mean, covariance, j, WIDER[-1] / scale[j])
        left = worth * _log_bayes(freed, np.diag(spread), scale)[[i for i in stated if i != j]]
        alone = scipy.special.expit(_log_bayes_at(EVEN) - left.max(initial=-np.inf))
        alone = float(alone * scipy.special.expit(logs[j] - others))
        off, std = stated_scale[j] * freed[j], stated_scale[j] * np.sqrt(spread[j, j])
        made.append(ExceededTolerance(tolerances[j], float(off), float(std), float(logs[j]), alone))
    return tuple(made)


def deviations_of(
    tolerances: Sequence[Nuisance], mean: Array, covariance: Array
) -> tuple[tuple[Nuisance, float, float], ...]:
    """Each parameter with the mean and the standard deviation of its posterior [stated tolerances]."""
    std = np.sqrt(np.diag(covariance))
    return tuple((n, float(m), float(s)) for n, m, s in zip(tolerances, mean, std))


def explained_by_form(
    problem: DiagnosisProblem, size: Mapping[str, float], form: Mapping[str, float]
) -> dict[str, float]:
    """Apparent deviation of each parameter [stated tolerances] that the error of the simulation's form may explain.

    Parameters
    ----------
    problem : DiagnosisProblem
    size : mapping of response to float
        Rms variation of the simulated response.
    form : mapping of response to float
        Error of the form, relative to this variation.
    """
    made = {}
    for n in problem.nuisances:
        power = {c: np.mean(np.concatenate([x[c] for x in n.columns if c in x]) ** 2) for x in n.columns for c in x}
        shows = max((n.sd * np.sqrt(p) / (size[c] * form[c]) for c, p in power.items() if c in size), default=0.0)
        made[n.name] = 1.0 / max(shows, 1e-3)
    return made


def exceeded_as_recorded(
    problem: DiagnosisProblem, form: Mapping[str, float] | None = None, white: float | None = None
) -> tuple[ExceededTolerance, ...]:
    """Exceeded tolerances from the rows of the diagnosis, which use later samples too.

    The white noise of the instruments causes no motion, but any other residual of the forces may have caused it. The
    evidence therefore counts in proportion to the white noise in the residual, or to `white` if that is given.
    """
    k = len(problem.nuisances)
    base = problem.base
    scale = np.ones(len(base.posterior.mean))
    scale[:k] = base.scales[base.chosen][:k]
    return exceeded(
        problem.nuisances,
        base.posterior.mean,
        base.posterior.covariance,
        scale,
        (white_fraction(problem) or 0.0) if white is None else white,
        form,
    )


def _log_bayes(mean: Array, variance: Array, scale: Array) -> Array:
    """(k,) log Bayes factors of each prior wider than stated by one of some factors, over the prior as stated."""
    wide = wider_priors(mean, variance, WIDER / scale[:, None])
    more = scipy.special.logsumexp(wide, axis=1) - np.log(len(WIDER))
    return np.asarray(more - wider_priors(mean, variance, 1.0 / scale))


def _log_bayes_at(deviations: float) -> float:
    """Log Bayes factor of a deviation that is known exactly."""
    wide = scipy.stats.norm.logpdf(deviations, scale=WIDER)
    return float(scipy.special.logsumexp(wide) - np.log(len(WIDER)) - scipy.stats.norm.logpdf(deviations))


def _freed(mean: Array, covariance: Array, j: int, factor: float) -> tuple[Array, Array]:
    """Posterior mean and covariance where the prior of one coefficient is wider by a factor (Sherman and Morrison)."""
    less = 1.0 / factor**2 - 1.0
    along = covariance[:, j] / (1.0 + less * min(covariance[j, j], 1.0))
    return mean - less * along * mean[j], covariance - less * np.outer(along, covariance[j])
