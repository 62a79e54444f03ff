"""How well each hypothesis accounts for the differences, over all of its forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Library, Signature
from structsel.effects.base import Effect
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Trial

_COUNTS, _IN_FULL = 0.6, 0.8
"""Shares of the tolerances' work from which on what an effect spares counts, and counts in full."""
_STILL_OFF = 0.01  # nats for each row, that tolerances may still bring beside it
_MOMENT = 4.0  # nats: log of the places, half a second apart, that half a minute has for a moment sought in it
_BEYOND_ONE = 2.0  # nats that it must bring beyond what one tolerance in full would, all others being exact


@dataclass(frozen=True, eq=False)
class EffectScore:
    """One hypothesis tried.

    Attributes
    ----------
    hypothesis : Effect
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
        Log of how much likelier the best form's parameters are within their plausible limits than beforehand, less what
        the moments cost that were sought where the differences change, and the manoeuvres it is confined to.
    best : int
        The form to judge: the likeliest, or the one that spares the tolerances most.
    own : float
        Log evidence of that form alone, less what its being one of several costs.
    driven : EffectScore, optional
        Of that form where the inputs alone drive the motion.
    whole : float
        Share of its evidence that counts although that does not bear it out.
    """

    hypothesis: Effect
    signatures: tuple[Signature, ...]
    trials: tuple[Trial, ...]
    weights: Array
    log_evidence: float
    predictive: Array
    within: float
    best: int
    own: float
    input_only: EffectScore | None = None
    unconfirmed_weight: float = 0.0

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.hypothesis.name

    @property
    def signature(self) -> Signature:
        """Of the form to judge."""
        return self.signatures[self.best]

    @property
    def event(self) -> bool:
        """Whether no other flight can foretell it: it happens at moments of its own, or in one flight only."""
        at_moments = self.hypothesis.event and _moments(self.signature) > 0
        return at_moments or len(self.signature.flights) == 1 < len(self.predictive)

    @property
    def trial(self) -> Trial:
        """Of the form to judge."""
        return self.trials[self.best]


def score_all(problem: DiagnosisProblem, library: Library) -> list[EffectScore]:
    """Scores of every hypothesis that can be tried, best evidence first."""
    by_effect = [(h, library.of(h.name)) for h in library.effects]
    trials = iter(problem.try_signatures([s for _, forms in by_effect for s in forms]))
    made = [score(problem, h, forms, [next(trials) for _ in forms]) for h, forms in by_effect]
    return sorted(made, key=lambda s: -s.log_evidence)


def score(
    problem: DiagnosisProblem, hypothesis: Effect, forms: Sequence[Signature], trials: Sequence[Trial]
) -> EffectScore:
    """Score of one hypothesis from the trials of its forms."""
    within = np.array([_limited(s, t) for s, t in zip(forms, trials)])
    evidence = np.array([t.log_bayes for t in trials]) + within
    log_forms = np.log(len(forms))
    weights = np.exp(evidence - scipy.special.logsumexp(evidence))
    # Weights of the forms as the other flights alone would give them.
    ahead = np.array([t.predictive for t in trials])
    without = evidence[:, None] - ahead
    without = without - scipy.special.logsumexp(without, axis=0)
    predictive = scipy.special.logsumexp(without + ahead, axis=0)
    total = float(scipy.special.logsumexp(evidence) - log_forms)
    reduction = _reductions(problem, trials)
    best = int(np.argmax(evidence + reduction))
    return EffectScore(
        hypothesis, tuple(forms), tuple(trials), weights, total, predictive, float(within[best]), best,
        float(evidence[best] - log_forms),
    )  # fmt: skip


def judged_by(score: EffectScore, form: int) -> EffectScore:
    """The score with another of its forms to judge."""
    signature, trial = score.signatures[form], score.trials[form]
    within = _limited(signature, trial)
    own = trial.log_bayes + within - np.log(len(score.signatures))
    return replace(score, best=form, within=within, own=float(own))


def _reductions(problem: DiagnosisProblem, trials: Sequence[Trial]) -> Array:
    """What each form spares the tolerances, in nats; nothing where that is not most of what they do without it.

    Where one cause, of few parameters, does nearly all that a hundred tolerances would have to do, a simulation that is
    right but for that cause is likelier than one that is off everywhere in just the way that looks like it. Evidence
    does not say so by itself: with every tolerance in full, each is wide enough to help imitating a bit.
    """
    evidence = problem.base.evidence[:, 0]
    brought = np.stack([t.at_scales for t in trials])
    work = float(evidence[0] - evidence[-1])
    if work <= 0.0:
        return np.zeros(len(trials))
    reduction = brought[:, -1] - brought[:, 0]
    fractions = np.minimum(1.0, reduction / work)
    # Where much is left for them to do all the same, things are off indeed.
    off = work - reduction > _STILL_OFF * sum(len(y) for y in problem.base.y)
    # Nor may it be a single tolerance, pulled no further than tolerances are.
    alike = brought[:, -1] - float(problem.base.freed.max()) < _BEYOND_ONE
    return work * fractions * np.where(off | alike | (fractions < _COUNTS), 0.0, np.minimum(1.0, fractions / _IN_FULL))


def _limited(signature: Signature, trial: Trial) -> float:
    """What limits bring to a form, less what was sought for it."""
    return _within(signature, trial) - _sought(signature, len(trial.predictive))


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


def _sought(signature: Signature, manoeuvres: int) -> float:
    """What the choice of a form's moments costs, and that of the manoeuvres it is confined to [nats]."""
    return _MOMENT * _moments(signature) + (manoeuvres * np.log(2.0) if signature.variant.only_in else 0.0)


def _moments(signature: Signature) -> int:
    """Number of moments that were sought in the differences."""
    return sum(name == "time" or name.startswith("time in ") for name in signature.variant.shape)


def _log_between(a: float, b: float) -> float:
    """Log probability that a standard normal number lies between."""
    if a > 0.0:
        a, b = -b, -a
    upper, lower = scipy.special.log_ndtr(b), scipy.special.log_ndtr(a)
    return float(upper + np.log1p(-np.exp(min(lower - upper, -1e-12))))
