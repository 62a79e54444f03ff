"""Evidence from prediction errors of any mismatch beyond tolerances and biases, before an effect is named."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from structsel.comparison.causal_rows import CausalRows
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.noisy_simulation import noisy_responses
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.plant import answers, find_plant
from structsel.diagnosis.averages import exceeded_in_averages
from structsel.diagnosis.change_times import find_event, find_steps, gain_columns
from structsel.diagnosis.event import Event
from structsel.diagnosis.exceeded import (
    ExceededTolerance,
    deviations_of,
    exceeded,
    exceeded_as_recorded,
    explained_by_form,
)
from structsel.diagnosis.isolated import IsolatedResidual, find_isolated, lasting_residuals
from structsel.diagnosis.predicted_effect import PredictedEffect, find_predicted, find_predicted_in_plant
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import residuals, white_fraction
from structsel.diagnosis.unknown_function import (
    ATTITUDE,
    FORM,
    features,
    form_of,
    log_bayes_beyond_form,
    of_unit_size,
    plant_features,
    unknown_function,
)
from structsel.diagnosis.weighing import CandidateEffect
from structsel.nomenclature import COEFFICIENTS

_PRIOR = {"remainder": 0.64, "event": 0.36}
"""Prior probabilities of the kinds of mismatch other than an exceeded tolerance, given a mismatch."""
_EVEN = {"remainder": (35.0, 5.0), "event": (60.0, 10.0)}
"""Log Bayes factor at which each is as probable as none, and its scale. In correct simulations in calm air (24, of the
proof's generators, development seeds from 71000) the largest remainder is 22 and the largest event of a flight 17;
events of several flights add up, and turbulence without vanes causes events in all flights."""
SCALE = 5.0  # by which log Bayes factors of different kinds of causes are divided before they are compared
_SHOWN = 0.15  # fraction of the largest log Bayes factor from which another response is listed


@dataclass(frozen=True, eq=False)
class Detection:
    """Log Bayes factors of the kinds of mismatch, each over tolerances and biases alone.

    Attributes
    ----------
    tolerances : tuple of ExceededTolerance
        Stated tolerances that may be exceeded, the most probable first.
    remainder : mapping of response to float
        An unknown smooth function of the channels and their recent past.
    events : sequence of (log Bayes factor, Event)
        A step, pulse or ramp; one for each flight.
    deviations : tuple of (Nuisance, mean, standard deviation)
        Of the stated parameters, with no tolerance exceeded [stated tolerances].
    isolated : IsolatedResidual, optional
        The residual that lasts most.
    predicted : PredictedEffect, optional
        The most probable effect.
    gains : mapping of response to float, optional
        Of a plant: another gain in some recordings, or one that changes with time.
    averaged : tuple of str
        Responses in whose averages over time a tolerance is exceeded, where nothing else was asked; see
        `detect_in_averages`.
    """

    tolerances: tuple[ExceededTolerance, ...]
    remainder: dict[str, float]
    events: list[tuple[float, Event]]
    deviations: tuple[tuple[Nuisance, float, float], ...] = ()
    isolated: IsolatedResidual | None = None
    predicted: PredictedEffect | None = None
    gains: Mapping[str, float] = field(default_factory=dict)
    averaged: tuple[str, ...] = ()

    @property
    def parts(self) -> dict[str, float]:
        """Log Bayes factor of each kind other than an exceeded tolerance."""
        return {
            "remainder": _any_of([*self.remainder.values(), *self.gains.values()]),
            "event": _any_of([e[0] for e in self.events]) if self.events else -np.inf,
        }

    @property
    def axes(self) -> tuple[str, ...]:
        """Responses with evidence of the mismatch, the largest first."""
        if self.averaged:
            return self.averaged
        if self.alone is not None:
            return (self.alone.response,)
        each = {c: max(x, self.gains.get(c, x)) for c, x in self.remainder.items()}
        largest = max(each.values())
        shown = [c for c, x in each.items() if x > _SHOWN * largest or x == largest]
        return tuple(sorted(shown, key=lambda c: -each[c]))

    @property
    def log_odds(self) -> tuple[float, float, float]:
        """Log odds of an exceeded tolerance, of the most probable effect, and of any other mismatch."""
        first = self.tolerances[0].log_odds if self.tolerances else -np.inf
        each = [(x - _EVEN[k][0]) / _EVEN[k][1] + np.log(_PRIOR[k]) for k, x in self.parts.items()]
        effect = self.predicted.log_odds if self.predicted is not None else -np.inf
        return first, effect, float(np.logaddexp(*each))

    @property
    def probability_by_rows(self) -> float:
        """Probability of a mismatch that prediction errors show."""
        return float(scipy.special.expit(scipy.special.logsumexp(self.log_odds)))

    @property
    def probability(self) -> float:
        """Probability that the mismatch is there."""
        in_one = self.isolated.probability if self.isolated is not None else 0.0
        return 1.0 - (1.0 - self.probability_by_rows) * (1.0 - in_one)

    @property
    def alone(self) -> IsolatedResidual | None:
        """The residual of one response, if a mismatch there is more probable than one that prediction errors show."""
        one = self.isolated
        return one if one is not None and one.probability > self.probability_by_rows else None

    @property
    def cause_probabilities(self) -> list[float]:
        """Probability of each tolerance that it is the only cause, given that a tolerance is exceeded."""
        each = scipy.special.softmax([one.log_bayes for one in self.tolerances]) if self.tolerances else ()
        return [float(e * one.alone) for e, one in zip(each, self.tolerances)]

    def by_effect(self, named: Collection[str]) -> dict[str, float]:
        """Probabilities of the effects to which exceeded tolerances belong, if they may be named."""
        made: dict[str, float] = {}
        for probability, one in zip(self.cause_probabilities, self.tolerances):
            if one.effect in named:
                made[one.effect] = made.get(one.effect, 0.0) + probability
        return made

    @property
    def is_tolerance(self) -> bool:
        """Whether an exceeded tolerance has more evidence than the other kinds of mismatch."""
        return bool(self.tolerances) and self.tolerances[0].log_bayes > self.log_bayes

    @property
    def says(self) -> str:
        """One plain sentence."""
        if self.alone is not None:
            return self.alone.says
        if self.is_tolerance:
            return f"Tolerances are exceeded, this one above all: {self.tolerances[0].says}"
        size = f"log Bayes factor {self.log_bayes:.0f}"
        if self.event:
            (one,) = self.event
            return f"The differences change in '{one.recording}' {one.says}; {size}."
        if self.gains and max(self.gains.values()) > max(self.remainder.values()):
            return f"The gain of {', '.join(self.axes)} changes between recordings or along them ({size})."
        return (
            f"What recorded states and inputs predict of the differences in {', '.join(self.axes)} exceeds noise and "
            f"tolerances ({size})."
        )

    @property
    def event(self) -> tuple[Event, ...]:
        """The most probable event, if it is more probable than the other kinds of mismatch."""
        parts = self.parts
        if not self.events or self.alone is not None or self.is_tolerance or parts["event"] < parts["remainder"]:
            return ()
        return (max(self.events, key=lambda one: one[0])[1],)

    @property
    def log_bayes(self) -> float:
        """Log Bayes factor of a mismatch other than an exceeded tolerance."""
        return float(scipy.special.logsumexp([x + np.log(_PRIOR[k]) for k, x in self.parts.items()]))


def detect(
    flights: Sequence[Flight], problem: DiagnosisProblem, candidates: Sequence[CandidateEffect] = ()
) -> Detection | None:
    """Evidence of any mismatch; None where nothing can be asked.

    Parameters
    ----------
    flights : sequence of Flight
    problem : DiagnosisProblem
        Of these flights, without effects.
    candidates : sequence of CandidateEffect
        Effects that may be there.
    """
    if not set(flights[0].simulated) & set(COEFFICIENTS):
        return _detect_in_plant(flights, problem, candidates)
    if not set(AIRFRAME) <= set(flights[0].channels):
        return None
    rows = CausalRows(flights, problem.nuisances)
    form = form_of(flights, rows.responses)
    null = rows.null()
    inside = [rows.inside(x) for x in features(flights)]
    single = of_unit_size([rows.inside(x) for x in features(flights, ATTITUDE)])
    remainder = {c: unknown_function(rows, null, c, inside, single, form[c]) for c in rows.responses}
    events = [find_event(rows, null, i) for i in range(len(flights))]
    white = white_fraction(problem) or 0.0
    alike = explained_by_form(problem, rows.size, form)
    causes = exceeded(rows.tolerances, null.mean, null.covariance, form=alike) + exceeded_as_recorded(
        problem, alike, white
    )
    predicted = find_predicted(rows, null, candidates, white)
    return Detection(
        _best_of_each(causes),
        remainder,
        events,
        deviations_of(rows.tolerances, null.mean, null.covariance),
        isolated_residual(problem),
        predicted,
    )


def detect_in_averages(problem: DiagnosisProblem) -> Detection | None:
    """Evidence of exceeded tolerances in averages over time; None for plants, and where none may be exceeded.

    Turbulence, and noise that lasts, move the aircraft: functions of the recorded motion then explain differences that
    they do not cause. Averages over longer times have little of that.
    """
    if problem.is_plant:
        return None
    seen = exceeded_in_averages(problem)
    if not seen.tolerances:
        return None
    nothing = dict.fromkeys(problem.judged_responses, -np.inf)
    return Detection(seen.tolerances, nothing, [], seen.deviations, averaged=seen.responses)


def _detect_in_plant(
    flights: Sequence[Flight], problem: DiagnosisProblem, candidates: Sequence[CandidateEffect]
) -> Detection | None:
    """Evidence of any mismatch of a plant, in what is not simulated from its recorded motion.

    A simulation at recorded motion contains its noise, which the differences then have with the opposite sign. Every
    function of that motion would explain them, and the past of what was measured may predict it better than the
    simulation does.
    """
    responses = sorted(set(flights[0].simulated) - simulated_at_readings(flights, problem.nuisances))
    if not responses:
        return None
    rows = CausalRows(flights, problem.nuisances, responses)
    form = form_of(flights, responses)
    null = rows.null()
    inside = [rows.inside(x) for x in plant_features(flights, responses)]
    single = of_unit_size(inside)
    remainder = {c: unknown_function(rows, null, c, inside, single, form[c]) for c in responses}
    gains = {
        c: log_bayes_beyond_form(rows, null, c, [rows.inside(x) for x in gain_columns(flights, c)], FORM)
        for c in responses
    }
    events = find_steps(rows, null)
    causes = exceeded(rows.tolerances, null.mean, null.covariance, form=explained_by_form(problem, rows.size, form))
    predicted = find_predicted_in_plant(rows, null, candidates, form)
    return Detection(
        _best_of_each(causes),
        remainder,
        events,
        deviations_of(rows.tolerances, null.mean, null.covariance),
        None,
        predicted,
        gains,
    )


def _best_of_each(causes: Sequence[ExceededTolerance]) -> tuple[ExceededTolerance, ...]:
    """The most probable explanation by each tolerance."""
    best: dict[str, ExceededTolerance] = {}
    for one in sorted(causes, key=lambda one: -one.log_bayes):
        best.setdefault(one.tolerance.name, one)
    return tuple(best.values())


def isolated_residual(problem: DiagnosisProblem, start: DiagnosisProblem | None = None) -> IsolatedResidual | None:
    """The coefficient whose residual of tolerances and effects lasts most; None with too few coefficients.

    Parameters
    ----------
    problem : DiagnosisProblem
    start : DiagnosisProblem, optional
        Without the effects.
    """
    form = form_of(problem.flights, [c for c in problem.responses if c in COEFFICIENTS])
    found = find_isolated(problem.flights, residuals(problem), {c: x for c, x in form.items() if x > FORM})
    if found is None or start is None:
        return found
    # With exact tolerances: at their full width they may explain what the effect does.
    before, after = (
        lasting_residuals(one.flights, residuals(one.as_given))[found.response] for one in (start, problem)
    )
    return replace(found, fraction=min(1.0, after / before) if before > 0.0 else 1.0)


def _any_of(logs: Sequence[float]) -> float:
    """Log Bayes factor of one hypothesis of several, or of any number of them, equally probable."""
    one = scipy.special.logsumexp(logs) - np.log(len(logs))
    several = np.sum(np.logaddexp(0.0, logs) - np.log(2.0))
    return float(np.logaddexp(one, several) - np.log(2.0))


def simulated_at_readings(flights: Sequence[Flight], nuisances: Sequence[Nuisance]) -> set[str]:
    """Responses of a plant that are simulated from its recorded motion, with its noise, not from inputs alone."""
    return noisy_responses(nuisances) | {c for c in answers(flights) if find_plant(flights, c).along is not None}
