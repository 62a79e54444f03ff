"""The noise of the differences, from what nothing that may be in them explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.noise import Noise, bins_of, edge_of, frequencies
from structsel.comparison.noise_regressors import helpful_columns, state_functions, usual_functions
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

_BANDS = 14
_TURNS = 3  # estimates of the noise, each by the weights of the one before
_FREE = 1e-3  # precision of the size of a column without a prior
_ENOUGH = 8.0  # degrees of freedom of a band
_OF_LEVEL = 20.0  # coefficients that tell the level of a flight as well as the others do: fifty tell it to a tenth


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
    bands = _Bands.over(np.concatenate([frequencies(f, b) for f, b in zip(flights, bins)]))
    log_std = {} if known is None else dict(known.log_std)
    level = {} if known is None else dict(known.level)
    functions = [state_functions(f) for f in flights]
    names = list(functions[0])
    spectra = np.vstack(
        [spectrum(np.column_stack([*x.values()]), b, edge_of(f))[1:] for f, b, x in zip(flights, bins, functions)]
    )
    cuts = np.cumsum(bins)[:-1]

    for response in (c for c in responses if c not in log_std):
        y = np.concatenate([spectrum(f.difference[response], b, edge_of(f))[1:] for f, b in zip(flights, bins)])
        Z = np.vstack([e[response][1:] for e in explained])
        mine = spectra[:, [names.index(name) for name in usual_functions(names, response)]]
        left, free = _residual(y, Z, mine, bands, pool.get(response))
        log_std[response] = bands.log_std(left, free)
        usual = Noise(bands.edges, log_std, {(f.name, response): 1.0 for f in flights})
        for f, b, e, degrees in zip(flights, bins, np.split(left, cuts), np.split(free, cuts)):
            n = float(degrees.sum())
            ratio = float(np.sum((e / usual.std(f, response, b)[1:]) ** 2) / max(n, 1e-9))
            known_to = n / _OF_LEVEL
            level[f.name, response] = float(np.sqrt(np.clip((ratio * known_to + 1.0) / (known_to + 1.0), 0.25, 25.0)))

    return Noise(bands.edges, log_std, level)


@dataclass(frozen=True, eq=False)
class _Bands:
    """Frequencies (n,) of the coefficients of all flights [Hz], and those at which their power is averaged."""

    frequencies: Array
    edges: Array

    @classmethod
    def over(cls, frequencies: Array) -> _Bands:
        highest = float(frequencies.max())
        return cls(frequencies, np.geomspace(max(float(frequencies.min()), highest / 3000.0), highest, _BANDS))

    def log_std(self, left: Array, free: Array) -> Array:
        """Logarithm of the standard deviation at each edge, from residuals around it and their degrees of freedom."""
        power, width = left**2, np.log(self.edges[1] / self.edges[0])
        made = np.empty(len(self.edges))
        for i, edge in enumerate(self.edges):
            reach = 1.0
            while True:
                near = np.maximum(0.0, 1.0 - np.abs(np.log(self.frequencies / edge)) / (reach * width))
                if near @ free > _ENOUGH or reach > 20.0:
                    break
                reach *= 1.5
            made[i] = 0.5 * np.log(max(float(near @ power / max(near @ free, 1e-12)), 1e-300))
        return np.maximum(made, made.max() - 16.0)

    def std(self, left: Array, free: Array) -> Array:
        """Standard deviation of each coefficient."""
        held = self.log_std(left, free)
        return np.asarray(np.exp(np.interp(np.log(self.frequencies), np.log(self.edges), held)))


def _residual(y: Array, Z: Array, usual: Array, bands: _Bands, further: Array | None) -> tuple[Array, Array]:
    """Residual of one response's coefficients, and the degrees of freedom of each.

    Columns `Z` are held to their priors, `usual` ones are not. Where few coefficients meet many columns, the residual
    shows little of the noise, at low frequencies above all. In each turn the further columns that help are chosen
    anew. At each frequency the least counts that is left without them, with them, or with those of all turns.
    """
    Z = Z[:, Z.any(axis=0)]  # most tolerances act on other responses
    scale = np.sqrt((usual**2).mean(axis=0))
    usual = usual[:, scale > 0.0] / scale[scale > 0.0]
    squares = None if further is None else further**2
    taken: set[int] = set()
    left, free, std = y, np.ones(len(y)), np.full(len(y), max(float(y.std()), 1e-300))
    for _ in range(_TURNS):
        weight = 1.0 / std
        factors = _factored(usual, Z, weight)
        left, free = _left(factors, usual, Z, y, weight)
        std = bands.std(left, free)
        if further is None or squares is None:
            continue
        helpful = helpful_columns(factors, y * weight, further, squares, weight)
        taken.update(helpful)
        for columns in filter(None, dict.fromkeys((tuple(sorted(helpful)), tuple(sorted(taken))))):
            X = np.column_stack([usual, further[:, columns]])
            less, fewer = _left(_factored(X, Z, weight), X, Z, y, weight)
            lower = (found := bands.std(less, fewer)) < std
            left, free, std = np.where(lower, less, left), np.where(lower, fewer, free), np.minimum(found, std)
    return left, free


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
