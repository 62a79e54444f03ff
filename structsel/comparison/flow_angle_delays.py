"""Delays of the flow angles against accelerometers and gyros, whatever a simulation says of the forces.

Accelerometers and gyros give the changes of alpha and beta; a delayed reading follows the same course later. A vane
that stands elsewhere than stated sees nearly the same in a pitching or yawing aircraft, and the two are compared.

References
----------
[J15], chapter 10, for delays in the check of data compatibility.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight
from structsel.comparison.inertial_air_data import SLOW
from structsel.comparison.nuisance import WITHIN_SAMPLE
from structsel.comparison.prediction_filter import Filter
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import delayed

LONGEST = 0.5
"""Longest delay that is sought [s]."""
REGISTERED = 0.02
"""Difference of the channels' clocks that is no finding [s]; of channels sampled more slowly half a sample."""
_COARSE, _MEDIUM, _FINE = 0.04, 0.01, 0.001  # s, between the delays that are tried
_NEAR = 0.02  # s: half of the range about the best delay that is tried at the finest distance
_USUAL = 0.1
"""Mean delay of an instrument that is late or early [s]; delays are distributed exponentially on either side."""
_EVIDENT = 3.0  # log likelihood of the best delay over none, from which it is computed in full
_SPAN, _FEWEST, _LARGEST = 0.3, 8, 30  # s, and samples: past that predicts a residual
_ROUNDS = 3
_SCALE, _SCALE_FREE = 0.05, 0.3  # standard deviations of a relative error of scale: tolerated, and as an explanation
_FREE_PLACE = 0.5  # of the span: standard deviation of a vane's place, as an explanation
_TURN = {"alpha": "q", "beta": "r"}
"""Angular rate at which a vane ahead of the centre of gravity moves sideways."""
_ANSWER = 1.0
"""Rate at which aircraft answer gusts [1/s]. A gust shows in the reading before the motion that it causes: an apparent
delay of this rate times the variance of the gusts over that of the angle's rate. In 19 correct simulations in
turbulence (the proof's generators) it was 0.2 to 1.0 times this product, and 0.02 to 0.06 s."""
_INDEPENDENT = 0.5  # s, after which errors of a vane count as independent of those before
_BY_CHANCE = 8.0
"""Log likelihood below `_MOTION` that place and scale may gain by chance. Of 32 readings made 0.02 s late (16 cases of
the proof's generators) they gain 5 at most in 31 and 9 in one; in turbulence without a delay 8 to 56."""
_PRIOR = -2.0
"""Log odds of a delay beyond its tolerance before the recordings are seen: one in eight."""
_AHEAD, _AHEAD_EARLY, _AHEAD_UNSTATED = 1.03, 1.3, 2.0
"""Log Bayes factor of a delay over that of another place of the vane, from which it is a delay: of a late reading and
of an early one where the place is stated, and where it is not. Where the place is wrong (31 readings of the proof's
generators) it is at most 1.02; delays from 0.02 s on have 1.04 to 16 times as much. A gyro that is late, which makes
the angle appear early, has at most 1.24. At ATTAS, whose boom of 13 m was not stated, a delay has 1.5 times as much."""
_MOTION = 2.0
"""Frequency up to which another place may not leave much less than a delay [Hz]. Above, noise hides both."""


@dataclass(frozen=True)
class FlowAngleDelay:
    """Delay of one flow angle.

    Attributes
    ----------
    channel : {"alpha", "beta"}
    delay, std : float [s]
        Positive if the reading is late.
    log_bayes : float
        Log Bayes factor over no delay.
    of_place : float
        Log Bayes factor of another place of the vane and another scale, without a delay.
    probability : float
        That it exceeds its stated tolerance and is not the place of the vane.
    beyond_sampling : float
        The same, where the clocks of the channels agree to `REGISTERED`, or to half a sample where that is more, only.
    """

    channel: str
    delay: float
    std: float
    log_bayes: float
    of_place: float
    probability: float
    beyond_sampling: float


def find_flow_angle_delays(flights: Sequence[Flight]) -> tuple[FlowAngleDelay, ...]:
    """Delays of alpha and beta that are common to all flights; one without evidence of any is left out.

    Both angles usually have one boom. If their delays agree, each is as probable as a common delay of both.

    Parameters
    ----------
    flights : sequence of Flight
        Of one aircraft.
    """
    read = [one for one in (_Reading.of(channel, flights) for channel in _TURN) if one is not None]
    found = [_judged([one]) for one in read]
    if len(found) < 2:
        return tuple(found)
    one, other = found
    scale = np.hypot(np.hypot(one.std, other.std), WITHIN_SAMPLE * flights[0].dt)
    alike = float(np.exp(-0.5 * ((one.delay - other.delay) / scale) ** 2))
    common = _judged(read)
    return tuple(
        replace(
            a,
            probability=max(a.probability, alike * common.probability, alike * b.probability),
            beyond_sampling=max(a.beyond_sampling, alike * common.beyond_sampling, alike * b.beyond_sampling),
        )
        for a, b in ((one, other), (other, one))
    )


@dataclass(frozen=True, eq=False)
class _Reading:
    """One flow angle with evidence of a delay.

    Attributes
    ----------
    channel : {"alpha", "beta"}
    fit : _Fit
    filter : Filter
        Of the residual of the most probable delay.
    aircraft : Aircraft
    most : float [s]
        The most probable delay of those tried.
    nothing, place : float
        Log evidence of no delay, and of no delay but another place and another scale.
    """

    channel: str
    fit: _Fit
    filter: Filter
    aircraft: Aircraft
    most: float
    nothing: float
    place: float

    @classmethod
    def of(cls, channel: str, flights: Sequence[Flight]) -> _Reading | None:
        """None without evidence of a delay."""
        courses = [_Course.of(f, channel) for f in flights if channel in f.integrated and channel in f.raw]
        if not courses:
            return None
        fit = _Fit(courses, int(np.clip(round(_SPAN / max(c.dt for c in courses)), _FEWEST, _LARGEST)))
        aircraft = flights[0].aircraft
        none = fit.evidence(np.zeros(1), _tolerated(aircraft))
        coarse = np.arange(-LONGEST, LONGEST + 0.5 * _COARSE, _COARSE)
        if fit.with_filter(none.filter, coarse, _tolerated(aircraft)).logs.max() - none.logs[0] < _EVIDENT:
            return None
        taus = np.arange(-LONGEST, LONGEST + 0.5 * _MEDIUM, _MEDIUM)
        late = fit.evidence(taus, _tolerated(aircraft), none.filter)
        nothing = max(none.logs[0], late.logs[np.argmin(np.abs(taus))])
        place = fit.evidence(np.zeros(1), _elsewhere(aircraft), none.filter).logs[0]
        return cls(channel, fit, late.filter, aircraft, float(taus[np.argmax(late.logs)]), float(nothing), float(place))

    def logs(self, taus: Array) -> Array:
        """Log evidence of delays, over that of none."""
        return self.fit.with_filter(self.filter, taus, _tolerated(self.aircraft)).logs - self.nothing

    def left(self, tau: float) -> float:
        """Variance of what a delay leaves, with scale and place within their tolerances."""
        return self.fit.left(tau, _tolerated(self.aircraft))

    def known(self, tau: float, left: float) -> float:
        """Standard deviation of a delay within the stated tolerance, and of the apparent delay of gusts [s]."""
        return float(np.hypot(self.aircraft.tolerances.delay, _ANSWER * left / self.fit.rates(tau)))

    def lower(self, left: float) -> float:
        """Log likelihood of a delay over that of another place and scale, of the motion alone."""
        ratio = self.fit.left(0.0, _elsewhere(self.aircraft)) / left
        return float(0.5 * sum(c.t[-1] for c in self.fit.courses) / _INDEPENDENT * np.log(ratio))


def _tolerated(aircraft: Aircraft) -> Array:
    """Standard deviations of an error of scale and of the vane's place [m] within their tolerances."""
    return np.array([_SCALE, aircraft.tolerances.lever_arm])


def _elsewhere(aircraft: Aircraft) -> Array:
    """Standard deviations of an error of scale and of the vane's place [m] as an explanation."""
    return np.array([_SCALE_FREE, _FREE_PLACE * aircraft.b])


def _judged(read: Sequence[_Reading]) -> FlowAngleDelay:
    """One delay that some readings have in common, and its probability, by the name of the first."""
    aircraft, dt = read[0].aircraft, max(c.dt for c in read[0].fit.courses)
    near = np.mean([one.most for one in read]) + np.arange(-_NEAR, _NEAR + 0.5 * _FINE, _FINE)
    logs = np.sum([one.logs(near) for one in read], axis=0)
    weight = scipy.special.softmax(logs)
    delay = float(weight @ near)
    std = float(np.sqrt(weight @ (near - delay) ** 2 + _FINE**2 / 12.0))
    any_size = scipy.special.logsumexp(logs - np.abs(near) / _USUAL) + np.log(_FINE / (2.0 * _USUAL))
    of_place = sum(max(0.0, one.place - one.nothing) for one in read)
    stated = _AHEAD if delay > 0.0 else _AHEAD_EARLY
    ahead = any_size - (stated if "vane" in aircraft.sensors else _AHEAD_UNSTATED) * of_place
    # Evidence of white rows is that of the highest frequencies, where no model of a vane is exact.
    each = [(one, one.left(delay)) for one in read]
    lower = sum(one.lower(left) for one, left in each) + _BY_CHANCE
    known = float(np.mean([one.known(delay, left) for one, left in each]))

    def exceeds(registered: float) -> float:
        within = scipy.special.logsumexp(logs + _log_within(near, registered, known)) + np.log(_FINE)
        return float(scipy.special.expit(min(any_size - within, ahead, lower) + _PRIOR))

    beyond_sampling = exceeds(max(REGISTERED, 0.5 * dt))
    channel = read[0].channel
    return FlowAngleDelay(channel, delay, std, float(any_size), float(of_place), exceeds(_FINE), beyond_sampling)


def _log_within(taus: Array, half: float, sd: float) -> Array:
    """Log density [1/s] of a delay that is anywhere within plus or minus `half`, and has a normal error besides."""
    up, down = scipy.special.log_ndtr((half - np.abs(taus)) / sd), scipy.special.log_ndtr((-half - np.abs(taus)) / sd)
    return np.asarray(up + np.log1p(-np.exp(down - up)) - np.log(2.0 * half))


@dataclass(frozen=True, eq=False)
class _Course:
    """A reading of one flight, what accelerometers and gyros predict of it, and what a vane's place would add."""

    t: Array
    dt: float
    read: Array
    predicted: Array
    place: Array

    @classmethod
    def of(cls, flight: Flight, channel: str) -> _Course:
        arm = flight[channel] - flight.at_cg[channel]
        return cls(
            flight.t - flight.t[0], flight.dt, flight.raw[channel], flight.integrated[channel] + arm,
            flight[_TURN[channel]] / flight["V"],
        )  # fmt: skip

    @property
    def inside(self) -> slice:
        """Samples at which the longest delay is known."""
        edge = int(LONGEST / self.dt) + 1
        return slice(edge, len(self.t) - edge)

    def columns(self, tau: float) -> Array:
        """Errors of scale and place of the delayed prediction (n, k), and the reading less that prediction (n,)."""
        late, place = (delayed(x, self.t, tau) for x in (self.predicted, self.place))
        return np.column_stack([late - late.mean(), place, self.read - late])[self.inside]

    @cached_property
    def drifts(self) -> Array:
        """A line, and waves below `SLOW`."""
        n = len(self.t)
        waves = np.arange(1, max(1, int(2.0 * n * self.dt * SLOW)) + 1)
        at = np.arange(n) + 0.5
        return np.column_stack([np.ones(n), at / n - 0.5, np.cos(np.pi * np.outer(at, waves) / n)])[self.inside]

    @cached_property
    def drift_basis(self) -> Array:
        """Orthonormal columns of the same space."""
        return np.linalg.qr(self.drifts)[0]


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Log evidence by delay, with one filter."""

    logs: Array
    filter: Filter


class _Fit:
    """Evidence of delays, with errors of scale and place that all flights share, and a drift of each."""

    def __init__(self, courses: Sequence[_Course], order: int):
        self.courses, self.order = courses, order

    def evidence(self, taus: Array, widths: Array, first: Filter | None = None) -> _Evidence:
        """Largest evidence over rounds in which the filter is that of the residual of the best delay."""
        found = [] if first is None else [self.with_filter(first, taus, widths)]
        best = float(taus[np.argmax(found[0].logs)]) if found else 0.0
        for _ in range(_ROUNDS - len(found)):
            found.append(self.with_filter(self._filter(best, widths), taus, widths))
            best = float(taus[np.argmax(found[-1].logs)])
        return max(found, key=lambda one: float(scipy.special.logsumexp(one.logs)))

    def _filter(self, tau: float, widths: Array) -> Filter:
        """Autoregression of what drifts, scale and place leave."""
        return Filter.of([self._left(course, tau, widths) for course in self.courses], self.order)

    @staticmethod
    def _left(course: _Course, tau: float, widths: Array) -> Array:
        """Reading less the delayed prediction, drifts, scale and place."""
        W = course.columns(tau)
        W -= course.drift_basis @ (course.drift_basis.T @ W)
        X, y = W[:, :-1], W[:, -1]
        return np.asarray(y - X @ np.linalg.solve(X.T @ X + np.diag(y.var() / widths**2), X.T @ y))

    def left(self, tau: float, widths: Array) -> float:
        """Variance below `_MOTION` of what a delay, drifts, scale and place leave."""
        power, count = 0.0, 0
        for c in self.courses:
            waves = scipy.fft.dct(self._left(c, tau, widths), norm="ortho")
            power += float(np.sum(waves[: int(2.0 * len(waves) * c.dt * _MOTION) + 1] ** 2))
            count += len(waves)
        return power / count

    def rates(self, tau: float) -> float:
        """Variance of the rate of the angle [1/s^2]."""
        return float(np.var(np.concatenate([np.diff(c.columns(tau)[:, 0]) / c.dt for c in self.courses])))

    def with_filter(self, one: Filter, taus: Array, widths: Array) -> _Evidence:
        """Evidence of each delay with given noise."""
        bases = [np.linalg.qr(one(c.drifts))[0] for c in self.courses]
        rows = np.array([float(len(Q)) for Q in bases])
        logs = np.array([self._log_evidence(one, float(tau), widths, bases) for tau in taus])
        return _Evidence(logs + one.log_density(rows), one)

    def _log_evidence(self, one: Filter, tau: float, widths: Array, bases: Sequence[Array]) -> float:
        """Log evidence of one delay, but for the constants of the noise."""
        G = np.zeros((3, 3))
        for i, (course, Q) in enumerate(zip(self.courses, bases)):
            W = one(course.columns(tau))
            drift = Q.T @ W
            G += (W.T @ W - drift.T @ drift) / one.variance[i]
        lower = scipy.linalg.cholesky(G[:-1, :-1] + np.diag(widths**-2.0), lower=True)
        half = scipy.linalg.solve_triangular(lower, G[:-1, -1], lower=True)
        size = np.log(np.diag(lower)).sum() + np.log(widths).sum()
        return float(-0.5 * (G[-1, -1] - half @ half) - size)
