"""How well each hypothesis accounts for the differences, over all of its forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp

from structsel.diagnosis.bench import Bench
from structsel.diagnosis.signatures import Library, Signature
from structsel.hypotheses.base import Hypothesis
from structsel.numerics.evidence import Trial
from structsel.numerics.smoothing.result import Array


@dataclass(frozen=True, eq=False)
class Score:
    """One hypothesis tried.

    Attributes
    ----------
    hypothesis : Hypothesis
    signatures : tuple of Signature
        Its forms.
    trials : tuple of Trial
    weights : (v,) array
        Posterior weights of the forms.
    log_evidence : float
        Over the base, averaged over forms, within plausible limits.
    predictive : (m,) array
        Log predictive density of each flight given the others, over the base's.
    within : float
        Log of how much likelier the best form's parameters are within their plausible limits than beforehand.
    """

    hypothesis: Hypothesis
    signatures: tuple[Signature, ...]
    trials: tuple[Trial, ...]
    weights: Array
    log_evidence: float
    predictive: Array
    within: float

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.hypothesis.effect

    @property
    def best(self) -> int:
        """The likeliest form."""
        return int(np.argmax(self.weights))

    @property
    def signature(self) -> Signature:
        """Of the likeliest form."""
        return self.signatures[self.best]

    @property
    def trial(self) -> Trial:
        """Of the likeliest form."""
        return self.trials[self.best]


def score_all(bench: Bench, library: Library) -> list[Score]:
    """Scores of every hypothesis that can be tried, best evidence first."""
    made = [score(bench, hypothesis, library.of(hypothesis.effect)) for hypothesis in library.hypotheses]
    return sorted(made, key=lambda s: -s.log_evidence)


def score(bench: Bench, hypothesis: Hypothesis, forms: Sequence[Signature]) -> Score:
    """Score of one hypothesis."""
    trials = [bench.try_signature(s) for s in forms]
    within = np.array([_within(s, t) for s, t in zip(forms, trials)])
    evidence = np.array([t.log_bayes for t in trials]) + within
    log_forms = np.log(len(forms))
    weights = np.exp(evidence - logsumexp(evidence))
    # Weights of the forms as the other flights alone would give them.
    ahead = np.array([t.predictive for t in trials])
    without = evidence[:, None] - ahead
    without = without - logsumexp(without, axis=0)
    predictive = logsumexp(without + ahead, axis=0)
    total = float(logsumexp(evidence) - log_forms)
    return Score(
        hypothesis, tuple(forms), tuple(trials), weights, total, predictive, float(within[np.argmax(evidence)])
    )


def _within(signature: Signature, trial: Trial) -> float:
    """Log of how much likelier the parameters lie within their limits now than beforehand."""
    total = 0.0
    for k, p in enumerate(signature.variant.parameters):
        if np.isinf(p.low) and np.isinf(p.high):
            continue
        low, high = p.low / p.sd, p.high / p.sd
        mean, sd = float(trial.theta[k]), float(np.sqrt(trial.covariance[k, k]))
        now = _log_between((low - mean) / sd, (high - mean) / sd)
        total += now - _log_between(low, high)
    return total


def _log_between(a: float, b: float) -> float:
    """Log probability that a standard normal number lies between."""
    if a > 0.0:
        a, b = -b, -a
    upper, lower = log_ndtr(b), log_ndtr(a)
    return float(max(upper + np.log1p(-np.exp(min(lower - upper, -1e-12))), -1e4))
