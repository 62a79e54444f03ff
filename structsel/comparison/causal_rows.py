"""Rows of one-step prediction errors: what the past residuals of a response do not predict of it.

In turbulence, and with noise in the states, the residual moves the aircraft at the next moment, and a pilot or
damper responds to it. Columns computed from the recorded motion are then functions of past residuals. Rows that
are conditioned on the past residuals keep such columns from explaining them.

References
----------
[Lju99], chapters 3 and 7, for prediction errors of a linear model with coloured noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.nuisance import WITHIN_SAMPLE, Nuisance
from structsel.comparison.parameter_columns import accelerometer_moved
from structsel.comparison.past_motion import (
    DELAY,
    TIMED,
    averaged,
    backward_rates,
    evaluated_at_readings,
    referred,
    with_motion_delayed,
)
from structsel.comparison.prediction_filter import Filter
from structsel.comparison.sensitivity import asked_wrongly
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

_ORDER_SPAN = 1.0  # s of its own past, that a difference is predicted from
_FEWEST, _LARGEST = 12, 40  # samples of the same


@dataclass(frozen=True, eq=False)
class Null:
    """The evidence of tolerances and biases alone, and what further columns need of it."""

    log_evidence: float
    filters: Mapping[str, Filter]
    products: Mapping[str, Sequence[Array]]
    mean: Array
    covariance: Array
    A: Array
    b: Array
    power: Mapping[str, float]
    density: Mapping[str, float]


class CausalRows:
    """Differences, tolerances and biases of flights in time, and their evidence on prediction errors.

    Parameters
    ----------
    flights : sequence of Flight
    nuisances : sequence of Nuisance
        Tolerances common to all flights.
    responses : sequence of str, optional
        By default the simulated coefficients.
    """

    def __init__(
        self, flights: Sequence[Flight], nuisances: Sequence[Nuisance], responses: Sequence[str] | None = None
    ):
        self.flights = list(flights)
        self.responses = list(responses or [c for c in flights[0].simulated if c in COEFFICIENTS])
        dt = float(np.median([f.dt for f in flights]))
        self.edge = DELAY
        shortest = min(len(f) for f in flights) - 2 * self.edge
        self.order = min(int(np.clip(round(_ORDER_SPAN / dt), _FEWEST, _LARGEST)), shortest // 3)
        kept = [n for n in nuisances if not n.ahead]
        self.tolerances = kept
        columns_of = _tolerance_columns(flights, kept)
        self.y: dict[tuple[str, int], Array] = {}
        self.X: dict[tuple[str, int], Array] = {}
        self.place: dict[tuple[str, int], NDArray[np.intp]] = {}
        q = len(kept)
        fraction = evaluated_at_readings(flights, self.responses)
        for i, f in enumerate(flights):
            own = [*_own(f), *_timing(f)]
            for c in self.responses:
                shared = [k for k, n in enumerate(kept) if n.name in columns_of and c in columns_of[n.name][i]]
                mine = [k for k, (_, x) in enumerate(own) if c in x]
                columns = [averaged(f, c, kept[k].sd * columns_of[kept[k].name][i][c]) for k in shared]
                columns += [own[k][0] * own[k][1][c] for k in mine]
                X = np.column_stack(columns) if columns else np.zeros((len(f), 0))
                self.X[c, i], self.y[c, i] = self.inside(X), self.inside(referred(f, c, fraction))
                self.place[c, i] = np.array([*shared, *(q + k for k in mine)], dtype=np.intp)
            q += len(own)
        self.q = q
        self.rows = np.array([len(f) - 2 * self.edge - self.order for f in flights], dtype=float)
        self.size = {c: _variation(flights, c) for c in self.responses}

    def null(self, rounds: int = 4) -> Null:
        """Evidence of tolerances and biases alone; noise and coefficients are found in turn."""
        left = {(c, i): y - y.mean() for (c, i), y in self.y.items()}
        columns = {c: self.columns(c) for c in self.responses}
        for turn in range(rounds + 1):
            filters = {c: Filter.of([left[c, i] for i in range(len(self.flights))], self.order) for c in self.responses}
            products = {c: filters[c].products(columns[c]) for c in self.responses}
            A, b, power = np.zeros((self.q, self.q)), np.zeros(self.q), {}
            for c in self.responses:
                power[c] = 0.0
                for i, G in enumerate(products[c]):
                    at = self.place[c, i]
                    A[np.ix_(at, at)] += G[:-1, :-1]
                    b[at] += G[:-1, -1]
                    power[c] += float(G[-1, -1])
            lower = scipy.linalg.cholesky(A + np.eye(self.q), lower=True)
            half = scipy.linalg.solve_triangular(lower, b, lower=True)
            mean = scipy.linalg.solve_triangular(lower, half, lower=True, trans="T")
            if turn < rounds:
                left = {(c, i): y - self.X[c, i] @ mean[self.place[c, i]] for (c, i), y in self.y.items()}
        density = {c: filters[c].log_density(self.rows) for c in self.responses}
        log = -0.5 * (sum(power.values()) - float(half @ half)) - float(np.log(np.diag(lower)).sum())
        covariance = scipy.linalg.cho_solve((lower, True), np.eye(self.q))
        return Null(log + sum(density.values()), filters, products, mean, covariance, A, b, power, density)

    def inside(self, x: Array) -> Array:
        """Samples of one flight's columns (n,) or (n, k) that the rows have: without its ends."""
        return x[self.edge : len(x) - self.edge]

    def columns(self, response: str, more: Sequence[Array] | None = None) -> list[Array]:
        """Tolerances and biases of each flight, the difference, and further columns."""
        made = [np.hstack([self.X[response, i], self.y[response, i][:, None]]) for i in range(len(self.flights))]
        return made if more is None else [np.hstack(pair) for pair in zip(made, more)]

    def remainder(self, null: Null, response: str, F: Sequence[Array], sizes: Array, rounds: int = 3) -> Remainder:
        """Evidence of further columns in one response, of unknown size; the noise is found anew with them.

        Parameters
        ----------
        null : Null
        response : str
        F : sequence of (n, k) array
            Columns per flight, of standard deviation one each at size one.
        sizes : (s,) array
            Sizes of equal prior probability.
        """
        first = null.filters[response]
        A0, b0 = null.A.copy(), null.b.copy()
        for i, G in enumerate(null.products[response]):
            at = self.place[response, i]
            A0[np.ix_(at, at)] -= G[:-1, :-1]
            b0[at] -= G[:-1, -1]
        others = sum(x for c, x in null.power.items() if c != response)
        density = sum(x for c, x in null.density.items() if c != response)
        K, columns = F[0].shape[1], self.columns(response, F)
        noise, best = first, Remainder(-np.inf, 0.0, np.zeros(K))
        for turn in range(rounds + 1):
            A, b, power = A0.copy(), b0.copy(), 0.0
            S, C, z = np.zeros((K, K)), np.zeros((K, self.q)), np.zeros(K)
            for i, G in enumerate(noise.products(columns)):
                at = self.place[response, i]
                m = len(at)
                A[np.ix_(at, at)] += G[:m, :m]
                b[at] += G[:m, m]
                power += float(G[m, m])
                S += G[m + 1 :, m + 1 :]
                C[:, at] += G[m + 1 :, :m]
                z += G[m + 1 :, m]
            lower = scipy.linalg.cholesky(A + np.eye(self.q), lower=True)
            half = scipy.linalg.solve_triangular(lower, b, lower=True)
            turned = scipy.linalg.solve_triangular(lower, C.T, lower=True)
            values, Q = np.linalg.eigh(S - turned.T @ turned)
            values, zq = np.maximum(values, 0.0), Q.T @ (z - turned.T @ half)
            s2 = sizes[:, None] ** 2
            each = 0.5 * np.sum(s2 * zq**2 / (1.0 + s2 * values) - np.log1p(s2 * values), axis=1)
            j = int(np.argmax(each))
            size = float(sizes[j])
            u = Q @ (size**2 * zq / (1.0 + size**2 * values))
            log = -0.5 * (others + power - float(half @ half)) - float(np.log(np.diag(lower)).sum())
            log += float(np.logaddexp.reduce(each) - np.log(len(sizes))) + noise.log_density(self.rows) + density
            if log - null.log_evidence > best.log_bayes:
                best = Remainder(log - null.log_evidence, size, u)
            if turn < rounds:
                mean = scipy.linalg.solve_triangular(lower, half - turned @ u, lower=True, trans="T")
                left = [
                    self.y[response, i] - self.X[response, i] @ mean[self.place[response, i]] - F[i] @ u
                    for i in range(len(self.flights))
                ]
                noise = Filter.of(left, self.order)
        return best

    def _white(self, null: Null, response: str, i: int, columns: Array) -> tuple[Array, Array, Array]:
        """Tolerances and biases, difference, and further columns of flight i, through the filter of the null."""
        m = self.X[response, i].shape[1]
        given = np.hstack([self.X[response, i], self.y[response, i][:, None], columns])
        W = null.filters[response].white(given, i)
        return W[:, :m], W[:, m], W[:, m + 1 :]

    def single(self, null: Null, response: str, columns: Mapping[int, Array], sizes: Array) -> Array:
        """(columns, sizes) log Bayes factors of single columns, (n, columns) by flight; the noise as it is."""
        count = next(iter(columns.values())).shape[1]
        cross, z, full = np.zeros((count, self.q)), np.zeros(count), np.zeros(count)
        for i, S in columns.items():
            X, y, s = self._white(null, response, i, S)
            cross[:, self.place[response, i]] += s.T @ X
            z += s.T @ y
            full += (s**2).sum(axis=0)
        z -= cross @ null.mean
        own = np.maximum(full - ((cross @ null.covariance) * cross).sum(axis=1), 1e-6 * full)
        a2 = sizes[None] ** 2
        return np.asarray(0.5 * z[:, None] ** 2 * a2 / (1.0 + a2 * own[:, None]) - 0.5 * np.log1p(a2 * own[:, None]))

    def jointly(self, null: Null, columns: Sequence[Mapping[str, Array]]) -> float:
        """Log Bayes factor of columns (n, k) by response, per flight; the noise as it is.

        Their coefficients are common to all flights and responses, with standard deviation one.
        """
        count = max(x.shape[1] for one in columns for x in one.values())
        cross, z, own = np.zeros((count, self.q)), np.zeros(count), np.zeros((count, count))
        for i, (f, one) in enumerate(zip(self.flights, columns, strict=True)):
            for c in one.keys() & set(self.responses):
                x = self.inside(np.column_stack([averaged(f, c, column) for column in one[c].T]))
                X, y, s = self._white(null, c, i, x)
                cross[:, self.place[c, i]] += s.T @ X
                z += s.T @ y
                own += s.T @ s
        values, Q = np.linalg.eigh(own - cross @ null.covariance @ cross.T)
        values, zq = np.maximum(values, 0.0), Q.T @ (z - cross @ null.mean)
        return float(0.5 * np.sum(zq**2 / (1.0 + values) - np.log1p(values)))


@dataclass(frozen=True, eq=False)
class Remainder:
    """Evidence of further columns: log Bayes factor, the most probable size, coefficients."""

    log_bayes: float
    size: float
    coefficients: Array


def _tolerance_columns(
    flights: Sequence[Flight], tolerances: Sequence[Nuisance]
) -> dict[str, Sequence[Mapping[str, Array]]]:
    """Columns of each tolerance, with the motion of some samples before; a plant's are its simulated response's."""
    if not set(COEFFICIENTS) & set(flights[0].simulated):
        return {n.name: n.columns for n in tolerances}
    made = {n.name: n.columns for n in tolerances_of([with_motion_delayed(f) for f in flights])}
    # An accelerometer off its place feels the angular acceleration of its own sample, not of four before.
    turning = [backward_rates(f) for f in flights]
    return made | {
        f"accelerometer {x}": [accelerometer_moved(f, k, w) for f, w in zip(flights, turning)]
        for k, x in enumerate("xyz")
    }


def _own(f: Flight) -> list[tuple[float, Mapping[str, Array]]]:
    return [(sd, x) for _, sd, x in biases_of(f)]


def _timing(f: Flight) -> list[tuple[float, Mapping[str, Array]]]:
    """Own time of each control in one flight: what it acts on times its rate."""
    made: list[tuple[float, Mapping[str, Array]]] = []
    for c in TIMED:
        if c in f.raw and np.ptp(f.raw[c]) > 0.0:
            turned = {r: a * f.rate(f.raw[c]) for r, a in asked_wrongly(f, c).items()}
            if turned:
                made.append((WITHIN_SAMPLE * f.dt, turned))
    return made


def _variation(flights: Sequence[Flight], response: str) -> float:
    simulated = np.concatenate([f.simulated[response] for f in flights])
    return max(float(simulated.std()), 1e-9)
