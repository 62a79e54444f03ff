"""When an effect may be on: the likeliest times by running sums of its products with the differences.

The noise is not known before: that of the differences contains the effect. It is taken as a first-order process with
the power and memory of what tolerances and the likeliest form leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.tolerances import biases_of
from structsel.diagnosis.scoring import EVENT_COST
from structsel.diagnosis.switch_search import NEVER, On, Parts, costs, search
from structsel.effects.base import Variant
from structsel.effects.changes import EDGE, LEAST_DISTANCE
from structsel.numerics.arrays import Array

_BLOCK = 0.2  # s, over which differences are averaged
_LEAST = 1e-6  # of a response's rms, below which a difference is rounding
_LONGEST = 0.98  # correlation of the noise of two blocks
_ALWAYS, _NEVER = 0, 1  # places among the options


@dataclass(frozen=True, eq=False)
class RunningSums:
    """Flights in which times are sought.

    Attributes
    ----------
    flights : list of AveragedFlight
    inverse : (k, k) array
        Inverse Cholesky factor of the posterior precision of the tolerances.
    y : (k,) array
        Products of the tolerances with the differences, by that factor.
    """

    flights: list[AveragedFlight]
    inverse: Array
    y: Array

    @classmethod
    def of(
        cls, flights: Sequence[Flight], tolerances: Sequence[Nuisance], found: Sequence[Variant] = ()
    ) -> RunningSums:
        """With the tolerances of the simulation, and effects that were found, whose sizes are free."""
        scale = {c: float(np.concatenate([f.difference[c] for f in flights]).std()) for c in flights[0].responses}
        size = {c: float(np.concatenate([f.measured[c] for f in flights]).std()) for c in scale}
        scale = {c: x for c, x in scale.items() if x > _LEAST * size[c]}
        made = cls._solved([AveragedFlight.of(f, m, scale, tolerances, found) for m, f in enumerate(flights)])
        return made._over(*made._noise([np.zeros((*f.rows.shape[:2], 0)) for f in made.flights]))

    @classmethod
    def _solved(cls, flights: list[AveragedFlight]) -> RunningSums:
        products = np.sum([f.products for f in flights], axis=0)
        inverse = np.linalg.inv(np.linalg.cholesky(np.eye(len(products)) + products[:, :-1]))
        return cls(flights, inverse, inverse @ products[:, -1])

    def find(
        self, forms: Sequence[Variant], may_end: bool, durations: Sequence[float] = (0.0,)
    ) -> tuple[Variant, list[On], float]:
        """The likeliest form, when it is on in each flight, and the log evidence.

        In each flight it is on always, never, from a time, until one, or in between; without `may_end` until none. A
        change takes one of the durations [s].
        """
        form, on, log_evidence = self._find(forms, may_end, durations)
        if log_evidence <= 0.0:
            return form, on, log_evidence
        columns = []
        for f, one in zip(self.flights, on):
            columns.append(one.along(f.times)[:, None] * _averages_of(f.flight, form, f.scale))
        return self._over(*self._noise(columns))._find([form], may_end, durations)

    def _find(
        self, forms: Sequence[Variant], may_end: bool, durations: Sequence[float]
    ) -> tuple[Variant, list[On], float]:
        """The same for this noise."""
        options = [f.options(may_end) for f in self.flights]
        tried = []
        for form in forms:
            at_once = [f.running_sums(form, x) for f, x in zip(self.flights, self.factored)]
            tried += [(form, duration, [one.within(duration) for one in at_once]) for duration in durations]
        parts = [[one.parts(w) for one, w in zip(sums, options)] for *_, sums in tried]
        first = [search(self.y, each, [_NEVER] * len(each)) for each in parts]
        k = int(np.argmax([one.log_evidence for one in first]))
        form, duration, sums = tried[k]
        other = search(self.y, parts[k], [_ALWAYS] * len(options))
        found = max(first[k], other, key=lambda one: one.log_evidence)
        if may_end:
            # What begins at the likeliest time may end in the same flight, and the reverse.
            options = [f.between(w, i, x) for f, w, i, x in zip(self.flights, options, found.at, found.values)]
            found = search(self.y, [one.parts(w) for one, w in zip(sums, options)], [0] * len(options))
        on = [f.on(w, i, duration) for f, w, i in zip(self.flights, options, found.at)]
        return form, on, found.log_evidence

    def _noise(self, columns: Sequence[Array]) -> tuple[Array, Array]:
        """Noise that tolerances, biases and further columns leave: rms over the present one, and memory.

        Columns are (responses, blocks, j) averages of each flight; the results (responses,).
        """
        further = [f.whitened(x) for f, x in zip(self.flights, columns)]
        white = [
            np.concatenate([f.beyond_rows[..., :-1], f.beyond(x), f.beyond_rows[..., -1:]], axis=-1)
            for f, x in zip(self.flights, further)
        ]
        flat = [x.reshape(-1, x.shape[-1]) for x in white]
        products = np.sum([x[:, :-1].T @ x for x in flat], axis=0)
        shared = len(self.inverse)
        mean = np.linalg.solve(np.eye(len(products)) + products[:, :-1], products[:, -1])
        left = []
        for f, x, w in zip(self.flights, columns, further):
            before, after = (
                a[..., -1] - a[..., :-1] @ mean[:shared] - b @ mean[shared:]
                for a, b in ((f.rows, x), (f.white_rows, w))
            )
            left.append(before - f.biases @ (f.covariance @ np.einsum("rnb,rn->b", f.white_biases, after)))
        rms = np.array([np.mean(x**2, axis=1) for x in left])
        along = np.array([np.mean(x[:, 1:] * x[:, :-1], axis=1) for x in left])
        weight = np.array([f.rows.shape[1] for f in self.flights], dtype=float)
        power, lagged = weight @ rms / weight.sum(), weight @ along / weight.sum()
        memory = np.clip(lagged / np.maximum(power, 1e-300), 0.0, _LONGEST)
        return np.sqrt(power * (1.0 - memory**2)), memory

    def _over(self, power: Array, memory: Array) -> RunningSums:
        """With other noise: (responses,) rms over the present one, and memory."""
        return self._solved([f.over(np.maximum(power, _LEAST), memory) for f in self.flights])

    @cached_property
    def factored(self) -> list[Array]:
        """Of each flight: tolerances, by their factor, and differences beyond the biases; and the biases, by theirs."""
        made = []
        for f in self.flights:
            beyond, biases = f.beyond_rows, f.white_biases @ np.linalg.cholesky(f.covariance)
            made.append(np.concatenate([beyond[..., :-1] @ self.inverse.T, beyond[..., -1:], biases], axis=-1))
        return made


@dataclass(frozen=True, eq=False)
class AveragedFlight:
    """Differences of a flight, and what tolerances and biases add to them, averaged over blocks.

    Attributes
    ----------
    flight : Flight
    scale : mapping of response to float
        Divisor of each response: rms of the noise of a block that the block before does not predict.
    memory : (responses,) array
        Correlation of the noise of two blocks.
    rows : (responses, blocks, k + 1) array
        Of the tolerances, and the differences.
    biases : (responses, blocks, b) array
        Of the flight's own biases.
    """

    flight: Flight
    scale: Mapping[str, float]
    memory: Array
    rows: Array
    biases: Array

    @classmethod
    def of(
        cls,
        flight: Flight,
        m: int,
        scale: Mapping[str, float],
        tolerances: Sequence[Nuisance],
        found: Sequence[Variant],
    ) -> AveragedFlight:
        """Flight number m of those of the tolerances; its noise without memory."""
        shared = [_averages(flight, {c: n.sd * x for c, x in n.columns[m].items()}, scale) for n in tolerances]
        shared += [_averages_of(flight, v, scale) for v in found]
        own = [_averages(flight, {c: sd * x for c, x in one.items()}, scale) for _, sd, one in biases_of(flight)]
        rows = np.concatenate([*shared, _averages(flight, flight.difference, scale)], axis=-1)
        biases = np.concatenate([*own, np.zeros((*rows.shape[:2], 0))], axis=-1)
        return cls(flight, scale, np.zeros(len(scale)), rows, biases)

    def over(self, power: Array, memory: Array) -> AveragedFlight:
        """The same divided by further scales, (responses,), with another memory."""
        scale = {c: x * float(s) for (c, x), s in zip(self.scale.items(), power)}
        rows, biases = (x / power[:, None, None] for x in (self.rows, self.biases))
        return replace(self, scale=scale, memory=memory, rows=rows, biases=biases)

    def whitened(self, x: Array) -> Array:
        """What each block adds to what the noise remembers of the one before."""
        made = x.copy()
        made[:, 1:] -= self.memory[:, None, None] * x[:, :-1]
        made[:, 0] *= np.sqrt(1.0 - self.memory[:, None] ** 2)
        return made

    @cached_property
    def white_rows(self) -> Array:
        """Whitened rows."""
        return self.whitened(self.rows)

    @cached_property
    def beyond_rows(self) -> Array:
        """Whitened rows beyond the biases."""
        return self.beyond(self.white_rows)

    @cached_property
    def white_biases(self) -> Array:
        """Whitened columns of the biases."""
        return self.whitened(self.biases)

    @cached_property
    def covariance(self) -> Array:
        """(b, b) posterior covariance of the biases."""
        Z = self.white_biases.reshape(-1, self.biases.shape[-1])
        return np.asarray(np.linalg.inv(np.eye(Z.shape[1]) + Z.T @ Z))

    def beyond(self, white: Array) -> Array:
        """Whitened columns (responses, blocks, n) beyond the biases."""
        along = np.einsum("rnb,rnk->bk", self.white_biases, white, optimize=True)
        return np.asarray(white - self.white_biases @ (self.covariance @ along))

    @property
    def products(self) -> Array:
        """(k, k + 1) products of the tolerances with themselves and the differences, beyond the biases."""
        X, beyond = (a.reshape(-1, a.shape[-1]) for a in (self.white_rows, self.beyond_rows))
        return np.asarray(X[:, :-1].T @ beyond)

    @cached_property
    def times(self) -> Array:
        """Times [s] at which blocks begin."""
        return self.flight.t[:: _step(self.flight)][: self.rows.shape[1]]

    @cached_property
    def _inner(self) -> NDArray[np.intp]:
        """Blocks that are not at the ends of the flight."""
        t = self.times
        return np.flatnonzero((t > t[0] + EDGE) & (t < t[-1] - EDGE))

    def options(self, may_end: bool) -> Options:
        """Always, never, from each time, and until each if it may end."""
        n, inner = len(self.times), self._inner
        ends = inner if may_end else inner[:0]
        first = np.concatenate([[0, n], inner, np.zeros_like(ends)])
        last = np.concatenate([[n, n], np.full_like(inner, n), ends])
        return Options(first, last, np.where(np.arange(len(first)) > _NEVER, EVENT_COST, 0.0))

    def between(self, tried: Options, at: int, log_evidence: Array) -> Options:
        """One option, always, never, and from the likeliest start until each end, or the reverse."""
        n, inner = len(self.times), self._inner
        start = end = 0
        if len(inner):
            one = 2 + np.arange(len(inner))
            start, end = (inner[int(np.argmax(log_evidence[k]))] for k in (one, one + len(inner)))
        least = LEAST_DISTANCE / (_step(self.flight) * self.flight.dt)
        ends, starts = inner[inner > start + least], inner[inner < end - least]
        first = np.concatenate([[tried.first[at], 0, n], np.full_like(ends, start), starts])
        last = np.concatenate([[tried.last[at], n, n], ends, np.full_like(starts, end)])
        cost = np.concatenate([[tried.cost[at], 0.0, 0.0], np.full(len(ends) + len(starts), 2.0 * EVENT_COST)])
        return Options(first, last, cost)

    def on(self, options: Options, at: int, duration: float) -> On:
        """One of the options in time."""
        first, last, n = options.first[at], options.last[at], len(self.times)
        if first >= last:
            return NEVER
        start, end = self.times[first] if first else -np.inf, self.times[last] if last < n else np.inf
        return On(float(start), float(end), duration if first or last < n else 0.0)

    def options_of(self, one: On) -> Options:
        """A single option."""
        first, last = (np.searchsorted(self.times, [x]) for x in (one.start, one.end))
        return Options(first, last, costs([one]))

    def running_sums(self, form: Variant, factored: Array) -> FormSums:
        """Products of a form that is on from each block on, with factored rows and with itself."""
        x = _averages_of(self.flight, form, self.scale)
        acts = np.asarray(x.any(axis=(1, 2)))
        rows, white = factored[acts].transpose(1, 0, 2), self.whitened(x)[acts].transpose(1, 2, 0)
        x = x[acts].transpose(1, 2, 0)
        # A block in which it begins remembers nothing of it.
        cross = _sums_to_the_end(white @ rows)
        cross[1:-1] = x[1:] @ rows[1:] + cross[2:]
        later = _sums_to_the_end(white @ white.transpose(0, 2, 1))
        own, with_earlier = later.copy(), later.copy()
        own[1:-1] = x[1:] @ x[1:].transpose(0, 2, 1) + later[2:]
        both = x[1:] @ white[1:].transpose(0, 2, 1)
        with_earlier[1:-1] = 0.5 * (both + both.transpose(0, 2, 1)) + later[2:]
        return FormSums(self, cross, own, with_earlier)


class Options(NamedTuple):
    """When a form may be on in one flight: the first block of each option, the one after its last, and its cost."""

    first: NDArray[np.intp]
    last: NDArray[np.intp]
    cost: Array


@dataclass(frozen=True, eq=False)
class FormSums:
    """Products of a form that begins with each block with factored rows, and with itself.

    Attributes
    ----------
    flight : AveragedFlight
    cross : (blocks + 1, j, k + 1 + b) array
    own : (blocks + 1, j, j) array
    with_earlier : (blocks + 1, j, j) array
        With the same form that has begun earlier.
    """

    flight: AveragedFlight
    cross: Array
    own: Array
    with_earlier: Array

    def within(self, duration: float) -> FormSums:
        """Of a form that begins within a duration [s]: the mean of those that begin in it at once."""
        n = round(duration / (_step(self.flight.flight) * self.flight.flight.dt))
        if not n:
            return self
        each, pairs = [1.0 / (n + 1)] * (n + 1), [2.0 * m for m in range(n + 1)]
        of_pairs = _moving_sums(self.own, [1.0] * (n + 1)) + _moving_sums(self.with_earlier, pairs)
        made = _moving_sums(self.cross, each), of_pairs / (n + 1) ** 2, _moving_sums(self.with_earlier, each)
        for x, at_once in zip(made, (self.cross, self.own, self.with_earlier)):
            x[0] = at_once[0]  # always on
        return FormSums(self.flight, *made)

    def parts(self, options: Options) -> Parts:
        """Of the form where it is on."""
        first, last = options.first, options.last
        cross = self.cross[first] - self.cross[last]
        own = self.own[first] - 2.0 * self.with_earlier[last] + self.own[last]
        own[first >= last] = 0.0
        k = self.flight.rows.shape[-1] - 1
        biased = cross[..., k + 1 :]
        own = own - biased @ biased.transpose(0, 2, 1)
        return Parts(np.ascontiguousarray(cross[..., :k]), own, cross[..., k], options.cost)


def _moving_sums(x: Array, weights: Sequence[float]) -> Array:
    """Weighted sums of each block and those after it; zero after the end."""
    made = np.zeros_like(x)
    for later, weight in enumerate(weights[: len(x)]):
        made[: len(x) - later] += weight * x[later:]
    return made


def _sums_to_the_end(x: Array) -> Array:
    """Sums from each block to the end, and zero after it."""
    return np.concatenate([np.cumsum(x[::-1], axis=0)[::-1], np.zeros_like(x[:1])])


def _averages_of(flight: Flight, form: Variant, scale: Mapping[str, float]) -> Array:
    sd = np.array([p.sd for p in form.parameters])
    return _averages(flight, {c: x * sd for c, x in form.columns(flight).items()}, scale, len(sd))


def _averages(flight: Flight, columns: Mapping[str, Array], scale: Mapping[str, float], width: int = 1) -> Array:
    """(responses, blocks, width) averages of columns over blocks, over the scale."""
    step = _step(flight)
    n = len(flight) // step
    made = np.zeros((len(scale), n, width))
    for i, (c, size) in enumerate(scale.items()):
        if c in columns:
            made[i] = columns[c][: n * step].reshape(n, step, width).mean(axis=1) / size
    return made


def _step(flight: Flight) -> int:
    return max(1, round(_BLOCK / flight.dt))
