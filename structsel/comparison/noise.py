"""The noise of the differences, and the rows that are white by it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.noise_regressors import helpful_columns, state_functions, usual_functions
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Further
from structsel.numerics.fourier_series import fast_length, spectrum
from structsel.numerics.projection import Projector

HIGHEST = 6.0
"""Frequency [Hz] up to which an aircraft's responses are compared."""
_BANDS = 14
_EDGE = 1.0  # s
_TURNS = 3  # estimates of the noise, each by the weights of the one before
_FREE = 1e-3  # precision of the size of a column without a prior


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviation of each response's cosine coefficients, as a function of frequency and manoeuvre.

    Attributes
    ----------
    edges : (k,) array [Hz]
        Frequencies at which the spectrum is held; between them its logarithm is straight.
    log_std : mapping of response to (k,) array
    level : mapping of (flight's name, response) to float
        Factor of one manoeuvre.
    """

    edges: Array
    log_std: Mapping[str, Array]
    level: Mapping[tuple[str, str], float]

    def but_for(self, responses: Collection[str]) -> Noise:
        """Noise of all other responses."""
        kept = {c: x for c, x in self.log_std.items() if c not in responses}
        return Noise(self.edges, kept, {(f, c): x for (f, c), x in self.level.items() if c in kept})

    def std(self, flight: Flight, response: str, bins: int) -> Array:
        """(1 + bins,) standard deviations of one flight's level and coefficients."""
        f = frequencies(flight, bins)
        held = np.interp(np.log(np.concatenate([f[:1], f])), np.log(self.edges), self.log_std[response])
        return np.exp(held) * self.level[flight.name, response]


def bins_of(flight: Flight) -> int:
    """Cosine coefficients of one flight that are compared."""
    return max(8, int(2.0 * fast_length(len(flight)) * flight.dt * highest_of(flight)))


def highest_of(flight: Flight) -> float:
    """Frequency [Hz] up to which a flight's responses are compared."""
    # Differentiation is within 1 % up to a sixth of the sampling rate.
    limit = HIGHEST if set(flight.responses) & set(COEFFICIENTS) else np.inf
    return float(min(limit, 0.16 / flight.dt)) if np.isfinite(limit) else 0.3 / flight.dt


def side_by_side(columns: Sequence[tuple[float, Mapping[str, Array]]], flight: Flight) -> dict[str, Array]:
    """Columns (1 sigma, what one unit adds by response) scaled by their sigmas, (n, k) by response."""
    made = {c: np.zeros((len(columns), len(flight))) for c in flight.responses}
    for j, (sd, one) in enumerate(columns):
        for c in one.keys() & made.keys():
            made[c][j] = sd * one[c]
    return {c: x.T for c, x in made.items()}


def as_spectra(signals: Mapping[str, Array], flight: Flight) -> dict[str, Array]:
    """Level and compared coefficients of signals (n,) or (n, k) of one flight, by response."""
    bins, edge = bins_of(flight), edge_of(flight)
    made = {}
    for c, x in signals.items():
        there = x.any(axis=0)
        if np.all(there):
            made[c] = spectrum(x, bins, edge)
        else:  # most tolerances act on few responses
            made[c] = np.zeros((*x.shape[1:], bins + 1)).T
            made[c][..., there] = spectrum(x[..., there], bins, edge)
    return made


def difference_spectra(flight: Flight) -> dict[str, Array]:
    """Spectra (bins, 1) of the differences."""
    return as_spectra({c: x[:, None] for c, x in flight.difference.items()}, flight)


def edge_of(flight: Flight) -> int:
    """Samples over which each end of a flight is faded."""
    return int(min(_EDGE / flight.dt, 0.1 * len(flight)))


def frequencies(flight: Flight, bins: int) -> Array:
    """Frequency [Hz] of each coefficient."""
    return np.arange(1, bins + 1) / (2.0 * fast_length(len(flight)) * flight.dt)


def estimate_noise(
    flights: Sequence[Flight],
    explained: Sequence[Mapping[str, Array]],
    responses: Sequence[str],
    pool: Mapping[str, Array],
    known: Noise | None = None,
) -> Noise:
    """Spectrum of the part that tolerances, usual functions of the states and known physics do not explain.

    Parameters
    ----------
    flights : sequence of Flight
    explained : sequence of mapping of response to (bins, k) array
        Spectra that may explain the differences, scaled by their priors, per flight.
    responses : sequence of str
    pool : mapping of response to (n, j) array
        Coefficients of further columns, the flights one after another; the few that help most are used.
    known : Noise, optional
        Of some responses, which are left as they are there.
    """
    bins = [bins_of(f) for f in flights]
    lowest = min(float(frequencies(f, b)[0]) for f, b in zip(flights, bins))
    highest = max(float(frequencies(f, b)[-1]) for f, b in zip(flights, bins))
    edges = np.geomspace(max(lowest, highest / 3000.0), highest, _BANDS)
    log_std = {} if known is None else dict(known.log_std)
    level = {} if known is None else dict(known.level)
    functions = [state_functions(f) for f in flights]
    names = list(functions[0])
    spectra = np.vstack(
        [spectrum(np.column_stack([*x.values()]), b, edge_of(f))[1:] for f, b, x in zip(flights, bins, functions)]
    )

    for response in (c for c in responses if c not in log_std):
        mine = spectra[:, [names.index(name) for name in usual_functions(names, response)]]
        left, free = _residual(flights, bins, explained, mine, response, edges, pool.get(response))
        log_std[response] = _smooth_spectrum(flights, bins, left, free, edges)
        usual = Noise(edges, log_std, {(f.name, response): 1.0 for f in flights})
        for f, b, e, each in zip(flights, bins, left, free):
            n = float(each.sum())
            ratio = float(np.sum((e / usual.std(f, response, b)[1:]) ** 2) / max(n, 1e-9))
            # Shrunk towards one: half a hundred coefficients tell a level to about a tenth.
            level[f.name, response] = float(np.sqrt(np.clip((ratio * n / 20.0 + 1.0) / (n / 20.0 + 1.0), 0.25, 25.0)))

    return Noise(edges, log_std, level)


def _residual(
    flights: Sequence[Flight],
    bins: Sequence[int],
    explained: Sequence[Mapping[str, Array]],
    usual: Array,
    response: str,
    edges: Array,
    further: Array | None,
) -> tuple[list[Array], list[Array]]:
    """Residual of one response's coefficients, and the degrees of freedom of each.

    `explained` is held to its priors, `usual` columns are not. Where few coefficients meet many columns, the residual
    shows little of the noise, at low frequencies above all.
    """
    y = np.concatenate([spectrum(f.difference[response], b, edge_of(f))[1:] for f, b in zip(flights, bins)])
    Z = np.vstack([e[response][1:] for e in explained])
    Z = Z[:, Z.any(axis=0)]  # most tolerances act on other responses
    scale = np.sqrt((usual**2).mean(axis=0))
    usual = usual[:, scale > 0.0] / scale[scale > 0.0]
    squares = None if further is None else further**2
    cuts = np.cumsum(bins)[:-1]

    def level(left: Array, free: Array) -> Array:
        held = _smooth_spectrum(flights, bins, np.split(left, cuts), np.split(free, cuts), edges)
        return np.concatenate(
            [np.exp(np.interp(np.log(frequencies(f, b)), np.log(edges), held)) for f, b in zip(flights, bins)]
        )

    left, free, std = y, np.ones(len(y)), np.full(len(y), max(float(y.std()), 1e-300))
    for _ in range(_TURNS):
        weight = 1.0 / std
        factors = _factored(usual, Z, weight)
        left, free = _left(factors, usual, Z, y, weight)
        std = level(left, free)
        if further is None or squares is None:
            continue
        helpful = helpful_columns(factors, y * weight, further, squares, weight)
        if helpful:
            X = np.column_stack([usual, further[:, helpful]])
            less, fewer = _left(_factored(X, Z, weight), X, Z, y, weight)
            lower = (found := level(less, fewer)) < std
            left, free, std = np.where(lower, less, left), np.where(lower, fewer, free), np.minimum(found, std)
    return np.split(left, cuts), np.split(free, cuts)


def _factored(X: Array, Z: Array, weight: Array) -> tuple[Array, Array]:
    """Lower factor L of the precision of the sizes of columns X without priors and Z with, and ``L^-1 [X Z]'``."""
    rows = np.column_stack([X, Z]) * weight[:, None]
    held_to = np.concatenate([np.full(X.shape[1], np.sqrt(_FREE)), np.ones(Z.shape[1])])
    # The factor of rows.T @ rows + held_to^2, whose small eigenvalues the product would lose to rounding.
    lower = np.asarray(np.linalg.qr(np.vstack([rows, np.diag(held_to)]), mode="r")).T
    return lower, scipy.linalg.solve_triangular(lower, rows.T, lower=True)


def _left(factors: tuple[Array, Array], X: Array, Z: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Residual of y after a fit of the columns, and the degrees of freedom of each of its coefficients."""
    lower, turned = factors
    fit = scipy.linalg.solve_triangular(lower, turned @ (y * weight), lower=True, trans="T")
    return y - X @ fit[: X.shape[1]] - Z @ fit[X.shape[1] :], 1.0 - np.einsum("ij,ij->j", turned, turned)


def _smooth_spectrum(
    flights: Sequence[Flight], bins: Sequence[int], left: Sequence[Array], free: Sequence[Array], edges: Array
) -> Array:
    """Logarithm of the standard deviation at each edge, from the power around it over all flights."""
    f = np.concatenate([frequencies(one, b) for one, b in zip(flights, bins)])
    power, degrees = np.concatenate(left) ** 2, np.concatenate(free)
    width = np.log(edges[1] / edges[0])
    made = np.empty(len(edges))
    for i, edge in enumerate(edges):
        reach = 1.0
        while True:
            near = np.maximum(0.0, 1.0 - np.abs(np.log(f / edge)) / (reach * width))
            if near @ degrees > 8.0 or reach > 20.0:
                break
            reach *= 1.5
        made[i] = 0.5 * np.log(max(float(near @ power / max(near @ degrees, 1e-12)), 1e-300))
    return np.maximum(made, made.max() - 16.0)


@dataclass(frozen=True, eq=False)
class SparseRows:
    """Weighted columns (rows, k) of one flight, most of which are zero in most responses.

    Attributes
    ----------
    at : mapping of response to array of int
        Columns that are not zero.
    values : mapping of response to (bins, n) array
        These columns.
    inside : (j, k) array
        Products of all of them with the columns of the flight's projector.
    """

    at: Mapping[str, NDArray[np.intp]]
    values: Mapping[str, Array]
    inside: Array


@dataclass(frozen=True, eq=False)
class Rows:
    """Turns arrays in time into white rows of one flight.

    Attributes
    ----------
    flight : Flight
    responses : tuple of str
    bins : int
    weight : mapping of response to (1 + bins,) array
    projector : Projector
    """

    flight: Flight
    responses: tuple[str, ...]
    bins: int
    weight: Mapping[str, Array]
    projector: Projector

    @classmethod
    def of(cls, flight: Flight, responses: Sequence[str], noise: Noise, own: Mapping[str, Array]) -> Rows:
        """Rows of a flight whose `own` nuisances' spectra (scaled by 1 sigma) are taken out."""
        bins = bins_of(flight)
        weight = {c: 1.0 / noise.std(flight, c, bins) for c in responses}
        plain = cls(flight, tuple(responses), bins, weight, Projector.of(np.zeros(((bins + 1) * len(responses), 0))))
        return cls(flight, tuple(responses), bins, weight, Projector.of(plain._stack(own, None)))

    @property
    def size(self) -> int:
        """Rows of one response: its level and its coefficients."""
        return self.bins + 1

    def part(self, response: str) -> slice:
        """Rows of one response."""
        i = self.responses.index(response)
        return slice(i * self.size, (i + 1) * self.size)

    def _stack(self, spectra: Mapping[str, Array], width: int | None) -> Array:
        """(rows, k) array of spectra, weighted; a response not there gives zeros."""
        k = next((x.shape[1] for x in spectra.values()), 0) if width is None else width
        made = np.zeros((k, self.size * len(self.responses))).T  # each column contiguous, as in the spectra
        for c in self.responses:
            if c in spectra:
                made[self.part(c)] = spectra[c] * self.weight[c][:, None]
        return made

    def whiten(self, spectra: Mapping[str, Array], width: int | None = None) -> Array:
        """(rows, k) white rows of spectra by response."""
        return self.projector(self._stack(spectra, width))

    def without_zeros(self, parts: Sequence[tuple[Mapping[str, Array], int]]) -> SparseRows:
        """Weighted rows of spectra and their widths, side by side, without columns that are zero in a response."""
        first = np.cumsum([0, *(width for _, width in parts)])
        inside = np.zeros((self.projector.columns.shape[1], first[-1]))
        at: dict[str, NDArray[np.intp]] = {}
        values: dict[str, Array] = {}
        for c in self.responses:
            here = [
                (k, x, np.flatnonzero(x.any(axis=0)))
                for k, (one, _) in zip(first, parts)
                if (x := one.get(c)) is not None
            ]
            at[c] = np.concatenate([k + there for k, _, there in here])
            values[c] = np.concatenate([x.T[there] for _, x, there in here]).T * self.weight[c][:, None]
            inside[:, at[c]] += self.projector.columns[self.part(c)].T @ values[c]
        return SparseRows(at, values, inside)

    def against(self, several: Sequence[Mapping[str, Array]], width: int, given: SparseRows) -> list[Further]:
        """Products of each of several spectra with given columns, of which the last is y, all of them whitened.

        Parameters
        ----------
        several : sequence of mapping of response to (bins, width) array
        width : int
        given : SparseRows
        """
        n, columns = len(several), self.projector.columns
        cross, inside = np.zeros((n, width, given.inside.shape[1])), np.zeros((n, width, columns.shape[1]))
        own = np.zeros((n, width, width))
        flat_cross, flat_inside = cross.reshape(n * width, -1), inside.reshape(n * width, -1)
        for c in self.responses:
            there = np.array([k for k, one in enumerate(several) if c in one], dtype=np.intp)
            if not len(there):
                continue
            rows = np.concatenate([several[k][c].T for k in there])
            rows *= self.weight[c]
            each = rows.reshape(len(there), width, self.size)
            own[there] += each @ each.transpose(0, 2, 1)
            moved = rows.any(axis=1)
            at, rows = (width * there[:, None] + np.arange(width)).ravel()[moved], rows[moved]
            flat_inside[at] += rows @ columns[self.part(c)]
            flat_cross[np.ix_(at, given.at[c])] += rows @ given.values[c]
        lost = inside * self.projector.lost
        own -= lost @ inside.transpose(0, 2, 1)
        cross -= lost @ given.inside
        return [Further(x[:, :-1].T, o, x[:, -1]) for x, o in zip(cross, own)]

    def difference(self) -> Array:
        """(rows,) the differences themselves."""
        return self.whiten(difference_spectra(self.flight))[:, 0]
