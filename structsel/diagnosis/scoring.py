"""Evidence of each effect, over all of its forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.diagnosis.dispersion import NOISE_ALONE, Dispersion
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Library, Signature
from structsel.effects.base import Effect
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Trial

_COUNTS, _IN_FULL = 0.6, 0.8
"""Fractions of the gain by tolerances that an effect replaces, from which this counts, and counts fully."""
_STILL_OFF = 0.01  # log Bayes factor per row that tolerances may add to the effect
EVENT_COST = 4.0  # log of the number of possible times in half a minute, half a second apart
_CLOSE = 0.5  # log evidence over the largest, from which event times and shapes are refined
_BEYOND_ONE = 2.0  # log Bayes factor of an effect over the best single tolerance, all others being exact


@dataclass(frozen=True, eq=False)
class EffectScore:
    """Evidence of one effect.

    Attributes
    ----------
    hypothesis : Effect
    signatures : tuple of Signature
        Its forms.
    trials : tuple of Trial
    log_weights : (v,) array
        Logarithms of the posterior weights of the forms.
    log_evidence : float
        Over the base, averaged over forms, within plausible limits.
    predictive : (m,) array
        Log predictive density of each flight given the others, over the base's.
    still_added : (v,) array
        Log Bayes factor of the tolerances beside each form, at their most probable size; over exact ones.
    within : float
        Log of the posterior over the prior probability that the parameters of the best form are within their limits,
        minus the log of the number of event times and of manoeuvres that were searched.
    best : int
        The form that is judged: the most probable, or the one that replaces tolerances best.
    input_only : EffectScore, optional
        Evidence of that form on the response to the recorded inputs.
    contradiction : float
        Log Bayes factor that the latter loses if the size of the effect is the recorded one.
    unconfirmed_weight : float
        Fraction of the evidence that counts although the response to the inputs does not confirm it.
    dispersion : Dispersion
        Residual where the form that is judged acts.
    """

    hypothesis: Effect
    signatures: tuple[Signature, ...]
    trials: tuple[Trial, ...]
    log_weights: Array
    log_evidence: float
    predictive: Array
    still_added: Array
    within: float
    best: int
    input_only: EffectScore | None = None
    contradiction: float = 0.0
    unconfirmed_weight: float = 0.0
    dispersion: Dispersion = NOISE_ALONE

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.hypothesis.name

    @property
    def signature(self) -> Signature:
        """Signature of the form that is judged."""
        return self.signatures[self.best]

    @property
    def as_given(self) -> float:
        """Log Bayes factor with exact tolerances."""
        return float(self.trial.at_scales[-1])

    @property
    def as_given_alone(self) -> float:
        """That factor; what exceeds the one with free tolerances counts less what these would still add.

        Where many parameters deviate within their tolerances, an effect that resembles some of them explains much of
        the differences with exact tolerances, and nothing with free ones.
        """
        return min(self.as_given, max(self.trial.log_bayes, self.as_given - float(self.still_added[self.best])))

    @property
    def event(self) -> bool:
        """Whether no other flight can predict it: it begins at times of its own, or acts in one flight only."""
        return self.alone or (self.hypothesis.event and bool(self.signature.variant.times))

    @property
    def alone(self) -> bool:
        """Whether it acts in one flight only."""
        return len(self.signature.flights) == 1 < len(self.predictive)

    @property
    def trial(self) -> Trial:
        """Trial of the form that is judged."""
        return self.trials[self.best]


def score_all(problem: DiagnosisProblem, library: Library) -> list[EffectScore]:
    """Scores of every effect that can be tested, the largest evidence first."""
    by_effect = [(h, library.of(h.name)) for h in library.effects]
    trials = iter(problem.try_signatures([s for _, forms in by_effect for s in forms]))
    made = [score(problem, h, forms, [next(trials) for _ in forms]) for h, forms in by_effect]
    return sorted(made, key=lambda s: -s.log_evidence)


def score(
    problem: DiagnosisProblem, hypothesis: Effect, forms: Sequence[Signature], trials: Sequence[Trial]
) -> EffectScore:
    """Score of one hypothesis from the trials of its forms."""
    within = np.array([limited(s, t) for s, t in zip(forms, trials)])
    evidence = np.array([t.log_bayes for t in trials]) + within
    log_weights = evidence - scipy.special.logsumexp(evidence)
    # Weights of the forms, computed from the other flights only.
    ahead = np.array([t.predictive for t in trials])
    without = evidence[:, None] - ahead
    without = without - scipy.special.logsumexp(without, axis=0)
    predictive = scipy.special.logsumexp(without + ahead, axis=0)
    total = float(scipy.special.logsumexp(evidence) - np.log(len(forms)))
    with_form = np.stack([t.at_scales for t in trials])
    best = int(np.argmax(evidence + _reductions(problem, with_form)))
    reached = problem.base.evidence[:, 0] + with_form
    return EffectScore(
        hypothesis, tuple(forms), tuple(trials), log_weights, total, predictive,
        still_added=reached.max(axis=1) - reached[:, -1], within=float(within[best]), best=best,
    )  # fmt: skip


def improved(
    scores: Sequence[EffectScore], least: float, better: Callable[[EffectScore], EffectScore]
) -> list[EffectScore]:
    """Scores with better ones of the effects that lead; the largest evidence first.

    An effect leads if its log evidence is at least `least` and half the largest.
    """
    from_here = max(least, _CLOSE * max((one.log_evidence for one in scores), default=0.0))
    made = [better(one) if one.log_evidence >= from_here else one for one in scores]
    return sorted(made, key=lambda one: -one.log_evidence)


def with_better(problem: DiagnosisProblem, one: EffectScore, form: Signature, trial: Trial) -> EffectScore:
    """The score with a better form in place of the one that is judged."""
    forms, trials = [*one.signatures], [*one.trials]
    forms[one.best], trials[one.best] = form, trial
    return score(problem, one.hypothesis, forms, trials)


def judged_by(score: EffectScore, form: int) -> EffectScore:
    """The score, judged by another of its forms."""
    return replace(score, best=form, within=limited(score.signatures[form], score.trials[form]))


def _reductions(problem: DiagnosisProblem, with_form: Array) -> Array:
    """Gain by tolerances that each form replaces [log Bayes factor]; zero where that is less than most of it.

    One cause with few parameters may replace nearly all of the gain by a hundred tolerances. A simulation that is
    exact except for that cause is then more probable than one whose parameters all deviate in the same pattern. The
    evidence alone does not show this: at their full width, all tolerances together approximate the cause.
    """
    evidence = problem.base.evidence[:, 0]
    gain = float(evidence[0] - evidence[-1])
    if gain <= 0.0:
        return np.zeros(len(with_form))
    reduction = with_form[:, -1] - with_form[:, 0]
    fractions = np.minimum(1.0, reduction / gain)
    # If tolerances still add much to the effect, parameters do deviate.
    still_off = gain - reduction > _STILL_OFF * sum(len(y) for y in problem.base.y)
    # Nor does an effect count that a single tolerance explains as well.
    like_one = with_form[:, -1] - float(problem.base.freed.max()) < _BEYOND_ONE
    return (
        gain
        * fractions
        * np.where(still_off | like_one | (fractions < _COUNTS), 0.0, np.minimum(1.0, fractions / _IN_FULL))
    )


def contradiction(one: Trial, other: Trial) -> float:
    """Half the squared distance of two estimates, in standard deviations of their difference, beyond that by chance."""
    off = one.theta - other.theta
    distance = float(off @ np.linalg.solve(one.covariance + other.covariance, off))
    return 0.5 * max(0.0, distance - len(off))


def limited(signature: Signature, trial: Trial) -> float:
    """Log probability of the limits of a form, minus the cost of its search."""
    return _within(signature, trial) - _sought(signature, len(trial.predictive))


def _within(signature: Signature, trial: Trial) -> float:
    """Log of the posterior over the prior probability that the parameters lie within their limits."""
    total = 0.0
    for k, p in enumerate(signature.variant.parameters):
        if np.isinf(p.low) and np.isinf(p.high):
            continue
        low, high = p.low / p.sd, p.high / p.sd
        mean, sd = float(trial.theta[k]), float(np.sqrt(trial.covariance[k, k]))
        now = _log_between((low - mean) / sd, (high - mean) / sd)
        total += now - _log_between(low, high)
    return total


def _sought(signature: Signature, manoeuvres: int) -> float:
    """Log of the number of event times, sets of manoeuvres and values of its shape among which a form was chosen."""
    form = signature.variant
    return EVENT_COST * len(form.times) + (manoeuvres * np.log(2.0) if form.only_in else 0.0) + form.searched


def _log_between(a: float, b: float) -> float:
    """Log probability that a standard normal number lies between."""
    if a > 0.0:
        a, b = -b, -a
    upper, lower = scipy.special.log_ndtr(b), scipy.special.log_ndtr(a)
    return float(upper + np.log1p(-np.exp(min(lower - upper, -1e-12))))
