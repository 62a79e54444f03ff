"""The noise of the differences, and the rows that are white by it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Further
from structsel.numerics.fourier_series import fast_length, spectrum
from structsel.numerics.projection import Projector

HIGHEST = 6.0
"""Frequency [Hz] up to which an aircraft's responses are compared."""
_EDGE = 1.0  # s


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
