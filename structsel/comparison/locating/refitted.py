"""Residual of the differences after a fit within the tolerances; effects are located on it.

The differences as computed contain what the stated tolerances of the simulation's parameters and of the instruments
explain. That occurs everywhere and at all times, and would conceal what is limited to some places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.noise import Noise, Rows, as_spectra, side_by_side
from structsel.comparison.noise_estimate import estimate_noise
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import Base


@dataclass(frozen=True, eq=False)
class Refitted:
    """Residuals of the differences after a fit of everything that has a tolerance.

    Attributes
    ----------
    residuals : tuple of mapping of response to (n,) array
        In time, per flight, without each flight's level.
    spectra : tuple of mapping of response to (1 + bins,) array
        The same as cosine coefficients.
    noise : Noise
    noise_rms : mapping of response to float
        In the compared band.
    deviations : tuple of (name, sigmas)
        Deviation of each tolerance in its standard deviations, largest first.
    """

    residuals: tuple[dict[str, Array], ...]
    spectra: tuple[dict[str, Array], ...]
    noise: Noise
    noise_rms: dict[str, float]
    deviations: tuple[tuple[str, float], ...]


def refit(flights: Sequence[Flight]) -> Refitted:
    """Refit tolerances and each flight's biases on all flights, held to their priors."""
    responses = flights[0].responses
    nuisances = tolerances_of(flights)
    shared_in_time, own_in_time, shared, own = [], [], [], []
    for i, f in enumerate(flights):
        shared_in_time.append(side_by_side([(n.sd, n.columns[i]) for n in nuisances], f))
        shared.append(as_spectra(shared_in_time[-1], f))
        own_in_time.append(side_by_side([(sd, one) for _, sd, one in biases_of(f)], f))
        own.append(as_spectra(own_in_time[-1], f))
    noise = estimate_noise(flights, shared, responses, {})
    rows = [Rows.of(f, responses, noise, mine) for f, mine in zip(flights, own)]
    base = Base([r.difference() for r in rows], [r.whiten(s, len(nuisances)) for r, s in zip(rows, shared)])
    found = base.posterior.mean
    residuals, spectra = [], []
    for i, f in enumerate(flights):
        weight = rows[i].weight
        residual = {c: x - shared[i][c] @ found for c, x in as_spectra(f.difference, f).items()}
        P = np.vstack([own[i][c] * weight[c][:, None] for c in responses])
        y = np.concatenate([residual[c] * weight[c] for c in responses])
        bias = np.linalg.solve(P.T @ P + np.eye(P.shape[1]), P.T @ y)
        left = {c: f.difference[c] - shared_in_time[i][c] @ found - own_in_time[i][c] @ bias for c in responses}
        residuals.append({c: x - x.mean() for c, x in left.items()})
        spectra.append({c: residual[c] - own[i][c] @ bias for c in responses})
    rms = {
        c: float(np.sqrt(np.mean([np.sum(noise.std(f, c, r.bins)[1:] ** 2) / len(f) for f, r in zip(flights, rows)])))
        for c in responses
    }
    names = [n.name for n in nuisances]
    deviations = sorted(zip(names, (float(x) for x in found)), key=lambda one: -abs(one[1]))
    return Refitted(tuple(residuals), tuple(spectra), noise, rms, tuple(deviations))
