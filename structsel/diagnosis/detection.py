"""Evidence from prediction errors of any mismatch beyond tolerances and biases, before an effect is named."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.causal_rows import CausalRows, Null
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.past_motion import DELAY, delayed
from structsel.comparison.tolerances import Nuisance
from structsel.diagnosis.exceeded import ExceededTolerance, exceeded, exceeded_as_recorded, explained_by_form
from structsel.diagnosis.isolated import IsolatedResidual, find_isolated
from structsel.diagnosis.predicted_effect import PredictedEffect, find_predicted
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import residuals, white_fraction
from structsel.diagnosis.result import Event
from structsel.diagnosis.weighing import CandidateEffect
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

_CHANNELS = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "mach", "CT", "h_agl", "df", "gear",
)  # fmt: skip
_ATTITUDE = ("phi", "theta", "psi")
_MOTION = frozenset({"alpha", "beta", "p_hat", "q_hat", "r_hat", "mach", "CT", "h_agl", *_ATTITUDE})
_PRODUCTS = (
    ("alpha", "beta"), ("alpha", "de"), ("alpha", "da"), ("alpha", "dr"), ("alpha", "q_hat"), ("alpha", "p_hat"),
    ("alpha", "r_hat"), ("CT", "de"), ("CT", "alpha"), ("CT", "beta"), ("alpha", "mach"), ("de", "mach"),
    ("beta", "mach"), ("da", "mach"), ("p_hat", "r_hat"), ("q_hat", "mach"), ("p_hat", "mach"), ("alpha", "h_agl"),
)  # fmt: skip
_PAST = ("alpha", "beta", "de", "da", "dr", "q_hat", "p_hat", "r_hat", "CT")
_DELAYS = (0.15, 0.4, 1.0)  # s
_ORDERS = 4  # cosines over the range of a channel
_SIZES = np.array([0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.0])
"""Sizes of an unknown function of the channels, relative to the rms variation of the simulated response."""
_FORM, _FORM_IDENTIFIED = 0.015, 0.05
"""Sizes within the tolerance `form`: for a simulation that states coefficients, and for one whose coefficients were
identified from its own flights."""
_EVENT_SIZES = np.geomspace(0.02, 2.0, 5)  # the same
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
    """

    tolerances: tuple[ExceededTolerance, ...]
    remainder: dict[str, float]
    events: list[tuple[float, Event]]
    deviations: tuple[tuple[Nuisance, float, float], ...] = ()
    isolated: IsolatedResidual | None = None
    predicted: PredictedEffect | None = None

    @property
    def parts(self) -> dict[str, float]:
        """Log Bayes factor of each kind other than an exceeded tolerance."""
        return {
            "remainder": _any_of(list(self.remainder.values())),
            "event": _any_of([e[0] for e in self.events]),
        }

    @property
    def axes(self) -> tuple[str, ...]:
        """Responses with evidence of the mismatch, the largest first."""
        if self.alone is not None:
            return (self.alone.response,)
        largest = max(self.remainder.values())
        shown = [c for c, x in self.remainder.items() if x > _SHOWN * largest or x == largest]
        return tuple(sorted(shown, key=lambda c: -self.remainder[c]))

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
            return (
                f"The differences change in '{one.recording}' at {one.t:.1f} +- {one.std:.1f} s ({one.shape}; {size})."
            )
        return (
            f"What recorded states and inputs predict of the differences in {', '.join(self.axes)} exceeds noise and "
            f"tolerances ({size})."
        )

    @property
    def event(self) -> tuple[Event, ...]:
        """The most probable event, if it is more probable than the other kinds of mismatch."""
        if self.alone is not None or self.is_tolerance or self.parts["event"] < self.parts["remainder"]:
            return ()
        return (max(self.events, key=lambda one: one[0])[1],)

    @property
    def log_bayes(self) -> float:
        """Log Bayes factor of a mismatch other than an exceeded tolerance."""
        return float(scipy.special.logsumexp([x + np.log(_PRIOR[k]) for k, x in self.parts.items()]))


def detect(
    flights: Sequence[Flight], problem: DiagnosisProblem, candidates: Sequence[CandidateEffect] = ()
) -> Detection | None:
    """Evidence of any mismatch; None if the flights are not those of an aircraft with coefficients.

    Parameters
    ----------
    flights : sequence of Flight
    problem : DiagnosisProblem
        Of these flights, without effects.
    candidates : sequence of CandidateEffect
        Effects that may be there.
    """
    if not set(flights[0].simulated) & set(COEFFICIENTS) or not set(AIRFRAME) <= set(flights[0].channels):
        return None
    rows = CausalRows(flights, problem.nuisances)
    form = _form_of(flights, rows.responses)
    null = rows.null()
    F = features(flights)
    inside = [x[rows.edge : len(x) - rows.edge] for x in F]
    single = _of_unit_size([x[rows.edge : len(x) - rows.edge] for x in features(flights, _ATTITUDE)])
    remainder = {c: _unknown_function(rows, null, c, inside, single, form[c]) for c in rows.responses}
    events = [_event(rows, null, i) for i in range(len(flights))]
    white = white_fraction(problem) or 0.0
    alike = explained_by_form(problem, rows.size, form)
    causes = exceeded(rows.tolerances, null.mean, null.covariance, form=alike) + exceeded_as_recorded(
        problem, alike, white
    )
    best: dict[str, ExceededTolerance] = {}
    for one in sorted(causes, key=lambda one: -one.log_bayes):
        best.setdefault(one.tolerance.name, one)
    std = np.sqrt(np.diag(null.covariance))
    deviations = tuple((n, float(m), float(s)) for n, m, s in zip(rows.tolerances, null.mean, std))
    predicted = find_predicted(rows, null, candidates, white)
    return Detection(tuple(best.values()), remainder, events, deviations, isolated_residual(problem), predicted)


def isolated_residual(problem: DiagnosisProblem) -> IsolatedResidual | None:
    """The coefficient whose residual of tolerances and effects lasts most; None with too few coefficients."""
    form = _form_of(problem.flights, [c for c in problem.responses if c in COEFFICIENTS])
    return find_isolated(problem.flights, residuals(problem), {c: x for c, x in form.items() if x > _FORM})


def _form_of(flights: Sequence[Flight], responses: Sequence[str]) -> dict[str, float]:
    """Error of the form of the simulation of each response, relative to the rms by which it varies."""
    least = _FORM_IDENTIFIED if flights[0].is_identified else _FORM
    stated = [dict.fromkeys(responses, least), flights[0].form_error, flights[0].fit_error]
    return {c: max(one.get(c, 0.0) for one in stated) for c in responses}


def _unknown_function(
    rows: CausalRows, null: Null, response: str, F: Sequence[Array], single: Sequence[Array], form: float
) -> float:
    """Log Bayes factor of an unknown function of the channels: of all features together, or of one of them alone.

    A prior that spreads over a hundred features has no evidence of a function that is one of them: of a moment that
    follows the square of the bank angle, 0.6 of the variance of Cm, -1 together and 163 alone. Alone, 13 correct
    simulations (development seeds) have -2 at most. None is larger than a form that leaves more than the response.
    """
    if not np.any(form < _SIZES):
        return -np.inf
    together = _remainder(rows, null, response, [x * rows.size[response] for x in F], form)
    each = [x * rows.size[response] for x in single]
    by_itself = rows.single(null, response, dict(enumerate(each)), _SIZES[form < _SIZES])
    k = int(np.argmax(scipy.special.logsumexp(by_itself, axis=1)))  # the likeliest, with the noise of the null
    alone = _remainder(rows, null, response, [x[:, [k]] for x in each], form) - np.log(each[0].shape[1])
    return float(np.logaddexp(together, alone) - np.log(2.0))


def _of_unit_size(F: Sequence[Array]) -> list[Array]:
    """Columns that vary, each with the standard deviation one over all flights."""
    size = np.concatenate(F).std(axis=0)
    return [x[:, size > 1e-9] / size[size > 1e-9] for x in F]


def _remainder(rows: CausalRows, null: Null, response: str, F: Sequence[Array], form: float) -> float:
    """Log Bayes factor of an unknown function of the channels beyond the tolerance of the form."""
    within = form >= _SIZES
    beyond = rows.remainder(null, response, F, _SIZES[~within]).log_bayes
    return beyond if beyond < 0.0 else beyond - max(0.0, rows.remainder(null, response, F, _SIZES[within]).log_bayes)


def _any_of(logs: Sequence[float]) -> float:
    """Log Bayes factor of one hypothesis of several, or of any number of them, equally probable."""
    one = scipy.special.logsumexp(logs) - np.log(len(logs))
    several = np.sum(np.logaddexp(0.0, logs) - np.log(2.0))
    return float(np.logaddexp(one, several) - np.log(2.0))


def features(flights: Sequence[Flight], further: Sequence[str] = ()) -> list[Array]:
    """Functions of the channels and of their recent past, per flight; each of the same rms, together of rms one.

    The motion is delayed by some samples, the inputs are not. Products of `further` channels are those with the angle
    of attack.
    """
    each: dict[str, list[Array]] = {}
    for c in (*_CHANNELS, *further):
        if all(c in f or c in f.channels for f in flights):
            x = [np.asarray(f[c], dtype=float) for f in flights]
            together = np.concatenate(x)
            if np.ptp(together) > 1e-9 * max(1.0, float(np.abs(together).max())):
                each[c] = [np.log(np.maximum(one, 0.0) + 2.0) for one in x] if c == "h_agl" else x
    columns: list[list[Array]] = []
    weights: list[float] = []

    def add(x: list[Array], weight: float, moved: bool, least: float = 0.0) -> None:
        lagged = [delayed(one, DELAY) for one in x] if moved else x
        together = np.concatenate(lagged)
        size = max(float(together.std()), least)
        if size > 1e-9:
            columns.append([(one - together.mean()) / size for one in lagged])
            weights.append(weight)

    unit: dict[str, list[Array]] = {}
    for c, x in each.items():
        together = np.concatenate(x)
        low, high = np.quantile(together, [0.002, 0.998])
        along = [np.clip((one - low) / max(high - low, 1e-300), -0.05, 1.05) for one in x]
        unit[c] = [(one - together.mean()) / together.std() for one in x]
        add(unit[c], 1.0, c in _MOTION)
        for k in range(2, _ORDERS + 1):
            add([np.cos(np.pi * k * one) for one in along], 1.0 / (1.0 + (k / 4.0) ** 2), c in _MOTION)
    for a, b in (*_PRODUCTS, *(("alpha", c) for c in further)):
        if a in unit and b in unit:
            add([x * y for x, y in zip(unit[a], unit[b])], 0.7, a in _MOTION or b in _MOTION)
    for c in (c for c in _PAST if c in unit):
        for delay in _DELAYS:
            past = [delayed(x, max(1, round(delay / f.dt))) - x for x, f in zip(unit[c], flights)]
            # A difference keeps its size: a channel that hardly changes has little memory.
            add(past, 0.7, c in _MOTION, 0.3)
    add([np.ones(len(f)) for f in flights], 0.0, False)
    w = np.array(weights) / np.linalg.norm(weights)
    return [np.column_stack([column[i] for column in columns]) * w for i in range(len(flights))]


_SHAPES = ("step", "pulse", "pulse", "ramp")
_EVERY = 1.0  # s, between the times at which events are sought


def shapes(t: Array, every: float = _EVERY) -> tuple[Array, list[str], Array]:
    """Steps, pulses and ramps on a grid of times: columns (n, k), their shapes and times."""
    at = np.arange(1.5, t[-1] - 1.5, every)
    off = t[:, None] - at
    columns = [(off >= 0.0).astype(float)]
    columns += [np.where(np.abs(off) < w / 2.0, 0.5 * (1.0 + np.cos(2.0 * np.pi * off / w)), 0.0) for w in (1.0, 4.0)]
    columns.append(np.clip(off / 5.0, 0.0, 1.0))
    return np.hstack(columns), [s for s in _SHAPES for _ in at], np.tile(at, len(_SHAPES))


def _event(rows: CausalRows, null: Null, i: int) -> tuple[float, Event]:
    """Log Bayes factor of an event in one flight, and the most probable one."""
    f = rows.flights[i]
    S, shape, at = shapes(f.t - f.t[0])
    if not len(at):  # too short for an event
        return 0.0, Event(f.name, float(f.t[0]), 0.0, _SHAPES[0])
    total = np.zeros(len(at))
    for c in rows.responses:
        each = rows.single(null, c, {i: S[rows.edge : len(S) - rows.edge]}, _EVENT_SIZES * rows.size[c])
        one = scipy.special.logsumexp(each, axis=1) - np.log(len(_EVENT_SIZES))
        total += np.logaddexp(0.0, one) - np.log(2.0)
    best = shape[int(np.argmax(total))]
    same = np.array([s == best for s in shape])
    weight = scipy.special.softmax(total[same])
    t = float(weight @ at[same])
    std = float(np.sqrt(weight @ (at[same] - t) ** 2 + _EVERY**2 / 12.0))  # the grid adds its own
    log_bayes = float(scipy.special.logsumexp(total) - np.log(len(total)))
    return log_bayes, Event(f.name, float(f.t[0]) + t, std, best)
