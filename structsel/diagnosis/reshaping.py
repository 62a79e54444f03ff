"""Values of the shapes of the leading effects, between and around those of the library.

A library has few values of a frequency, a time constant or a limit. Where the differences determine it more closely,
none of them explains most of an effect, and what is left resembles other effects.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore, improved, judged_by, limited, with_better
from structsel.diagnosis.signatures import Signature, acting, each_spectra
from structsel.diagnosis.weighing import EVIDENT
from structsel.effects.base import of_shape
from structsel.numerics.arrays import Array, least_positive
from structsel.numerics.evidence import Trial

_STEP = 0.08  # first change of the logarithm of a value: less than two in the library are apart
_STEPS = 3  # parabolas, each narrower
_NARROWER = 0.2  # least ratio of a step to the one before


@dataclass(frozen=True, eq=False)
class _Form:
    """A form that was tried, with the logarithms of the values of its shape."""

    at: Array
    signature: Signature
    trial: Trial

    @property
    def log_evidence(self) -> float:
        return self.trial.log_bayes + limited(self.signature, self.trial)


def reshape(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores with the most probable values of the shapes of the leading effects; the largest evidence first.

    Parameters
    ----------
    problem : DiagnosisProblem
    scores : sequence of EffectScore
        Of all effects.
    """
    return improved(scores, EVIDENT, partial(_reshaped, problem))


def _reshaped(problem: DiagnosisProblem, one: EffectScore) -> EffectScore:
    variant = one.signature.variant
    if variant.again is None:
        return one
    first = _Form(_logarithms(variant.shape.values()), one.signature, one.trial)
    values = np.array([_logarithms(s.variant.shape.values()) for s in one.signatures if s.variant.is_like(variant)])
    limits = values.min(axis=0) - 2.0 * _STEP, values.max(axis=0) + 2.0 * _STEP
    best, deviations = _most_probable(problem, first, limits)
    # The evidence of a form of the library stands for all values nearer to it than to the next one.
    apart = np.array([least_positive(np.abs(x), _STEP) for x in (values - first.at).T])
    searched = float(np.maximum(0.0, np.log(apart / (np.sqrt(2.0 * np.pi) * deviations))).sum())
    if best.log_evidence - searched <= first.log_evidence:
        return one
    spread = dict(zip(variant.shape, np.exp(best.at) * deviations))
    found = replace(best.signature, variant=replace(best.signature.variant, spread=spread, searched=searched))
    return judged_by(with_better(problem, one, found, best.trial), one.best)


def _logarithms(values: Iterable[float]) -> Array:
    return np.log(np.abs(np.array(list(values))))


def _most_probable(problem: DiagnosisProblem, first: _Form, limits: tuple[Array, Array]) -> tuple[_Form, Array]:
    """The most probable form within limits, and the standard deviations of the logarithms of its values."""
    best, steps = first, np.full(len(first.at), _STEP)
    deviations = steps
    for _ in range(_STEPS):
        around = _tried(
            problem, best, [np.clip(best.at + side * x, *limits) for x in np.diag(steps) for side in (-1.0, 1.0)]
        )
        low, high = (np.array([one.log_evidence for one in around[side::2]]) for side in (0, 1))
        bend = np.maximum(2.0 * best.log_evidence - low - high, 1e-9)
        deviations = np.minimum(steps / np.sqrt(bend), _STEP)
        vertex = np.clip(best.at + steps * np.clip(0.5 * (high - low) / bend, -2.0, 2.0), *limits)
        best = max((best, *around, *_tried(problem, best, [vertex])), key=lambda one: one.log_evidence)
        steps = np.clip(2.0 * deviations, _NARROWER * steps, steps)
    return best, deviations


def _tried(problem: DiagnosisProblem, like: _Form, several: Sequence[Array]) -> list[_Form]:
    """The form with other logarithms of the values of its shape."""
    again, signs = like.signature.variant.again, np.sign(list(like.signature.variant.shape.values()))
    assert again is not None
    forms = [of_shape(again, *(signs * np.exp(x)).tolist()) for x in several]
    flights = problem.flights
    made = [
        Signature(like.signature.hypothesis, form, spectra, acting(spectra, flights))
        for form, spectra in zip(forms, each_spectra(forms, flights, problem.responses))
    ]
    return [_Form(*one) for one in zip(several, made, problem.try_signatures(made))]
