"""A wrong mass, thrust or airspeed in averages over time, which turbulence and lasting noise change least.

Gusts that no vane feels turn the aircraft into them within seconds. Forces and recorded flow angles then differ by what
an error of a vane or of a derivative would cause, in averages too. Gusts do not imitate an error of all forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.sensitivity import misread
from structsel.comparison.tolerances import biases_of
from structsel.diagnosis.exceeded import WIDER, ExceededTolerance, deviations_of, exceeded, explained_by_form
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.unknown_function import form_of
from structsel.numerics.arrays import Array
from structsel.numerics.noise_models import autocorrelation

_WINDOWS = 8  # of a flight at most
_TIMES = 2.0  # the time over which the differences are alike, of which a window has at least so many
_SCATTER, _LEVELS = 0.7, 1.5
"""Standard deviations of the logarithms of what varies between windows, and of what a flight has throughout."""
_OF_SCATTER = 0.5  # part of the scatter between windows that a flight is expected to have throughout
_GUSTS = ("alpha", "beta")
"""Channels that unknown gusts change in each window, in all responses at once, beside the airspeed."""
_OF_RATES = frozenset({"inertia-error", "sensor-delay", "sensor-position"})
"""Effects in proportion to rates, whose averages are differences between the ends of a window."""
_TOLD = frozenset({"mass", "thrust", "V scale"})
"""Tolerances that no gust imitates."""
_ASKED = 4  # tolerances whose evidence is found with the scatter that they leave


@dataclass(frozen=True, eq=False)
class AveragedEvidence:
    """What the averages say.

    Attributes
    ----------
    tolerances : tuple of ExceededTolerance
        The most probable first; none if gusts may imitate that.
    deviations : tuple of (Nuisance, mean, standard deviation)
        Of the stated parameters, with no tolerance exceeded [stated tolerances].
    responses : tuple of str
        In which the first of the tolerances shows, the clearest first.
    """

    tolerances: tuple[ExceededTolerance, ...]
    deviations: tuple[tuple[Nuisance, float, float], ...]
    responses: tuple[str, ...]


def exceeded_in_averages(problem: DiagnosisProblem) -> AveragedEvidence:
    """Evidence of exceeded tolerances in averages of the differences over windows of each flight.

    What is left varies from window to window and from flight to flight, in each response by itself and in all of them
    by gusts. The standard deviations are found by the evidence, about what the autocorrelation of the differences lets
    expect.

    Parameters
    ----------
    problem : DiagnosisProblem
        Without effects.
    """
    flights, responses = problem.flights, problem.judged_responses
    size = {c: float(np.sqrt(np.mean([np.var(f.simulated[c]) for f in flights]))) for c in responses}
    alike = explained_by_form(problem, size, form_of(flights, responses))
    of = _Averages.of(flights, problem.nuisances, responses)
    null = of.likeliest()
    mean, covariance = of.posterior(of.covariance(null.scatter))
    found = [e for e in exceeded(of.tolerances, mean, covariance, form=alike) if e.effect not in _OF_RATES]
    asked = [of.ask(one.tolerance, alike, null.scatter) for one in found[:_ASKED]]
    each = sorted((e for e in asked if e.log_bayes > 0.0), key=lambda e: -e.log_bayes)
    if not each or each[0].tolerance.name not in _TOLD:
        each = []
    deviations = deviations_of(of.tolerances, mean, covariance)
    return AveragedEvidence(tuple(each), deviations, of.shows(each[0]) if each else ())


@dataclass(frozen=True, eq=False)
class _Likeliest:
    """Logarithms of the likeliest standard deviations of the scatter, and the log evidence with them."""

    scatter: Array
    log_evidence: float


@dataclass(frozen=True, eq=False)
class _Averages:
    """Averages of the differences, and of what one prior standard deviation of each tolerance does.

    Attributes
    ----------
    responses : sequence of str
    tolerances : list of Nuisance
    y : (n,) array
    B : (n, k) array
    own : (n, n) array
        Covariance by the constant errors of each flight's instruments.
    response : (n,) int array
    expected : (r,) array
        Standard deviation of the averages of each response that its differences let expect.
    sd, spread : (m,) arrays
        Standard deviation that is expected of each part of the scatter, and that of its logarithm.
    parts : (m, n, n) array
        Covariance by each part, if its standard deviation is one.
    """

    responses: Sequence[str]
    tolerances: list[Nuisance]
    y: Array
    B: Array
    own: Array
    response: NDArray[np.intp]
    expected: Array
    sd: Array
    spread: Array
    parts: Array

    @classmethod
    def of(cls, flights: Sequence[Flight], nuisances: Sequence[Nuisance], responses: Sequence[str]) -> _Averages:
        alike = {c: _time_alike(flights, c) for c in responses}
        length = max(_TIMES * max(alike.values()), max(map(len, flights)) / _WINDOWS)
        parts, blocks, first = [], [], 0
        for i, f in enumerate(flights):
            edges = np.linspace(0, len(f), max(1, int(len(f) / length)) + 1).astype(int)
            windows = np.arange(len(edges) - 1)
            stated = [(n.sd, n.columns[i]) for n in nuisances]
            biases = [(sd, columns) for _, sd, columns in biases_of(f)]
            # Recorded dynamic pressure, too, lacks a gust along the path.
            gusts = [(1.0, {c: f.slope(c, a) for c in responses}) for a in _GUSTS] + [(1.0, misread(f, V=1.0))]
            P = []
            for k, c in enumerate(responses):
                means = [_means([(1.0, f.difference)], c, edges), _means(stated, c, edges), _means(gusts, c, edges)]
                parts.append((*means, np.full(len(windows), k), np.full(len(windows), i), first + windows))
                P.append(_means(biases, c, edges))
            own = np.vstack(P)
            blocks.append(own @ own.T)
            first += len(windows)
        y, B, slopes, response, flight, window = (np.concatenate(x) for x in zip(*parts))
        spread = np.array([np.sqrt(np.mean([np.var(f.difference[c]) for f in flights])) for c in responses])
        expected = np.maximum(spread * np.sqrt([min(1.0, alike[c] / length) for c in responses]), 1e-30)
        return cls(
            responses, list(nuisances), y[:, 0], B, scipy.linalg.block_diag(*blocks), response, expected,
            *_scatter(expected, slopes, response, flight, window),
        )  # fmt: skip

    @cached_property
    def stated(self) -> Array:
        """Covariance of the averages by the stated tolerances and the biases."""
        return np.asarray(self.B @ self.B.T + self.own)

    def with_prior(self, j: int, sd: float) -> Array:
        """The same with another prior standard deviation of one parameter [stated tolerances]."""
        return self.stated + (sd**2 - 1.0) * np.outer(self.B[:, j], self.B[:, j])

    def covariance(self, scatter: Array, stated: Array | None = None) -> Array:
        """Covariance with the logarithms of the standard deviations of the scatter."""
        base = self.stated if stated is None else stated
        return np.asarray(base + np.tensordot(np.exp(2.0 * scatter), self.parts, 1))

    def likeliest(self, stated: Array | None = None, start: Array | None = None) -> _Likeliest:
        """The likeliest scatter beside stated tolerances and biases."""
        usual = np.log(self.sd)

        def loss(x: Array) -> tuple[float, Array]:
            factor = scipy.linalg.cho_factor(self.covariance(x, stated), lower=True)
            inverse = scipy.linalg.cho_solve(factor, np.eye(len(self.y)))
            weighted = inverse @ self.y
            half_log = float(np.log(np.diag(factor[0])).sum())
            away = (x - usual) / self.spread
            value = 0.5 * float(self.y @ weighted) + half_log + 0.5 * float(away @ away)
            slope = np.tensordot(self.parts, inverse - np.outer(weighted, weighted), 2)
            return value, np.exp(2.0 * x) * slope + away / self.spread

        found = scipy.optimize.minimize(loss, usual if start is None else start, jac=True, method="L-BFGS-B")
        return _Likeliest(found.x, -float(found.fun))

    def ask(self, tolerance: Nuisance, form: Mapping[str, float], start: Array) -> ExceededTolerance:
        """Evidence that one tolerance is exceeded, with what is left beside it."""
        j, within = self.tolerances.index(tolerance), float(np.hypot(1.0, form[tolerance.name]))
        more = [self.likeliest(self.with_prior(j, max(w, within)), start) for w in WIDER]
        logs = [one.log_evidence for one in more]
        plain = self.likeliest(self.with_prior(j, within), start).log_evidence
        log_bayes = float(scipy.special.logsumexp(logs) - np.log(len(WIDER)) - plain)
        best = int(np.argmax(logs))
        return self.exceeding(j, float(WIDER[best]), more[best].scatter, log_bayes, form)

    def posterior(self, K: Array) -> tuple[Array, Array]:
        """Mean and covariance of all parameters [stated tolerances]."""
        factor = scipy.linalg.cho_factor(K, lower=True)
        mean = self.B.T @ scipy.linalg.cho_solve(factor, self.y)
        return mean, np.eye(self.B.shape[1]) - self.B.T @ scipy.linalg.cho_solve(factor, self.B)

    def exceeding(
        self, j: int, factor: float, scatter: Array, log_bayes: float, form: Mapping[str, float]
    ) -> ExceededTolerance:
        """An exceeded tolerance, its prior standard deviation [stated tolerances] and the scatter beside it."""
        mean, covariance = self.posterior(self.covariance(scatter, self.with_prior(j, factor)))
        off, std = factor**2 * mean[j], factor * np.sqrt(1.0 - factor**2 * (1.0 - covariance[j, j]))
        kept = np.delete(np.arange(len(mean)), j)
        others = exceeded([self.tolerances[i] for i in kept], mean[kept], covariance[np.ix_(kept, kept)], form=form)
        left = [e for e in others if e.effect not in _OF_RATES]
        alone = float(scipy.special.expit(-left[0].log_odds)) if left else 1.0
        return ExceededTolerance(self.tolerances[j], float(off), float(std), log_bayes, alone)

    def shows(self, one: ExceededTolerance) -> tuple[str, ...]:
        """Responses in which a deviation exceeds the scatter, the clearest first."""
        part = one.deviations * self.B[:, self.tolerances.index(one.tolerance)]
        clear = np.array([np.sqrt(np.mean(part[self.response == k] ** 2)) for k in range(len(self.responses))])
        clear /= self.expected
        kept = [k for k in np.argsort(-clear) if clear[k] > _OF_SCATTER * clear.max()]
        return tuple(self.responses[k] for k in kept)


def _scatter(
    expected: Array, slopes: Array, response: NDArray[np.intp], flight: NDArray[np.intp], window: NDArray[np.intp]
) -> tuple[Array, Array, Array]:
    """Parts of the scatter: of each response alone, and of gusts in all of them; in each window, and in each flight."""
    sizes, spreads, parts = [], [], []
    for spread, usual, place in ((_SCATTER, 1.0, window), (_LEVELS, _OF_SCATTER, flight)):
        same = place[:, None] == place
        for k, sd in enumerate(expected):
            here = response == k
            sizes.append(usual * sd)
            spreads.append(spread)
            parts.append(same * np.outer(here, here))
        for slope in slopes.T:
            size = [np.sqrt(np.mean(slope[response == k] ** 2)) for k in range(len(expected))]
            if any(size):  # at most what one response lets expect
                sizes.append(usual * min(sd / x for sd, x in zip(expected, size) if x))
                spreads.append(_LEVELS)
                parts.append(same * np.outer(slope, slope))
    return np.array(sizes), np.array(spreads), np.array(parts, dtype=float)


def _means(columns: Sequence[tuple[float, Mapping[str, Array]]], response: str, edges: NDArray[np.intp]) -> Array:
    """(windows, k) averages of columns (1 sigma, what one unit adds by response) over windows."""
    counts = np.diff(edges)
    made = np.zeros((len(counts), len(columns)))
    for j, (sd, one) in enumerate(columns):
        if response in one:
            made[:, j] = sd * np.add.reduceat(one[response], edges[:-1]) / counts
    return made


def _time_alike(flights: Sequence[Flight], response: str) -> float:
    """Samples over which the differences are alike: the integral of their autocorrelation, to its first zero."""
    lags = min(map(len, flights)) // 2
    power = np.array([np.var(f.difference[response]) * len(f) for f in flights])
    each = [autocorrelation(f.difference[response], lags) for f in flights]
    mean = power @ np.array(each) / max(float(power.sum()), 1e-300)
    crossing = np.flatnonzero(mean <= 0.0)
    last = crossing[0] if len(crossing) else len(mean)
    return float(max(1.0, 2.0 * mean[:last].sum() - 1.0))
