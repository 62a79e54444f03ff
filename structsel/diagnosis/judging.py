"""What is left of the differences on flights not used for fitting: as delivered, refitted, and with the physics."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.noise import Rows, edge_of
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

_WHITE = 1.3  # chi-square per row, below which what is left counts as noise
_STILL = 1e-9  # of the noise's power: what moves a response by less does not move it
Residuals = list[dict[str, Array]]
"""Per flight: cosine coefficients in each response's unit; the level, which constant biases move, is left out."""


def measured(problem: DiagnosisProblem) -> Residuals:
    """What was measured, on the flights that are held out."""
    return [_spectra(problem, m, problem.flights[m].measured) for group in problem.base.groups for m in group]


def as_given(problem: DiagnosisProblem) -> Residuals:
    """Differences from the simulation as it came."""
    return [_spectra(problem, m, problem.flights[m].difference) for group in problem.base.groups for m in group]


def held_out(problem: DiagnosisProblem, level: bool = False) -> Residuals:
    """What tolerances and the effects taken in leave, their parameters found on the other flights.

    Parameters
    ----------
    bench : Bench
    level : bool
        With the level, as far as constant biases do not account for it.
    """
    first = 0 if level else 1
    return [
        {c: (left[r.part(c)] / r.weight[c])[first:] for c in problem.responses}
        for r, left in problem.held_out_residuals
    ]


def _spectra(problem: DiagnosisProblem, m: int, signals: Mapping[str, Array]) -> dict[str, Array]:
    r = problem.rows[m]
    return {c: spectrum(signals[c], r.bins, edge_of(r.flight))[1:] for c in problem.responses}


def rms(parts: Residuals, response: str) -> float:
    """Root mean square of one response over all flights."""
    return float(np.sqrt(sum(float(p[response] @ p[response]) for p in parts) / sum(len(p[response]) for p in parts)))


def excess(
    problem: DiagnosisProblem, predicted: bool = True, flights: Collection[str] | None = None
) -> dict[str, tuple[float, float]]:
    """Mean square of what is left of each response, in units of the noise; 1 is noise alone.

    Parameters
    ----------
    bench : Bench
    foretold : bool
        On the flights held out, as the others foretell it; else on all flights, with the parameters of all.
    flights : collection of str, optional
        Names of those that count.

    Returns
    -------
    mapping of response to (motion, level)
        Of all that moves, and of the level, in units of noise and constant biases.
    """
    left_of = _left_of(problem, predicted, flights)
    rows = sum(r.size - 1 for r, _ in left_of)
    made = {}
    for c in problem.responses:
        parts = [left[r.part(c)] for r, left in left_of]
        motion = sum(float(x[1:] @ x[1:]) for x in parts) / rows
        made[c] = (motion, float(np.mean([x[0] ** 2 for x in parts])))
    return made


def excess_where_moved(
    without: DiagnosisProblem,
    extended: DiagnosisProblem,
    predicted: bool = True,
    flights: Collection[str] | None = None,
) -> dict[str, tuple[float, float]]:
    """Mean square of what is left without an effect and beside it, each moment weighed by the square of what it does.

    In units of the noise, of each response that it moves; the cosine coefficients of white rows are turned back into
    moments, which are white as well. Other parameters as for `excess`.
    """
    pairs = list(zip(_left_of(without, predicted, flights), _left_of(extended, predicted, flights)))
    made = {}
    for c in without.responses:
        one, other = (
            np.concatenate([scipy.fft.idct(left[r.part(c)][1:], norm="ortho") for r, left in side])
            for side in zip(*pairs)
        )
        weight = (one - other) ** 2
        total = float(weight.sum())
        if total > _STILL:
            made[c] = float(weight @ one**2) / total, float(weight @ other**2) / total
    return made


def _left_of(problem: DiagnosisProblem, predicted: bool, flights: Collection[str] | None) -> list[tuple[Rows, Array]]:
    """White rows that are left of each flight that counts."""
    left_of = problem.held_out_residuals if predicted else problem.fitted_residuals
    return left_of if flights is None else [(r, left) for r, left in left_of if r.flight.name in flights]


def is_noise(problem: DiagnosisProblem, response: str) -> bool:
    """Whether what all flights together leave of a response is no more than its noise."""
    rows = np.concatenate([left[r.part(response)] for r, left in problem.fitted_residuals])
    return bool(np.mean(rows**2) < _WHITE)


def explained(delivered: Residuals, after: Residuals, axes: Sequence[str]) -> float:
    """Share of the variance of the differences explained on flights not used for fitting, mean over the axes."""
    sizes = {c: rms(delivered, c) for c in axes}
    fractions = [1.0 - (rms(after, c) / size) ** 2 for c, size in sizes.items() if size > 0.0]
    return float(np.clip(np.mean(fractions), 0.0, 1.0)) if fractions else 0.0


@dataclass(frozen=True)
class ResponseFit:
    """How well one response is foretold.

    Attributes
    ----------
    r2, rrmse, tic : float
        R^2; rms error over rms measured (about its mean); Theil's coefficient.
    """

    r2: float
    rrmse: float
    tic: float

    def to_dict(self) -> dict[str, float]:
        """For diagnosis.json."""
        return {"r2": self.r2, "rrmse": self.rrmse, "tic": self.tic}


def fit(got: Residuals, left: Residuals, responses: Sequence[str]) -> dict[str, ResponseFit]:
    """Fit of each response, in the band that is compared."""
    made = {}
    for c in responses:
        y = np.concatenate([g[c] for g in got])
        e = np.concatenate([g[c] for g in left])
        size = float(np.sqrt(y @ y))
        error = float(np.sqrt(e @ e))
        predicted = float(np.linalg.norm(y - e))
        if size > 0.0:
            made[c] = ResponseFit(1.0 - (error / size) ** 2, error / size, error / (size + predicted))
    return made


def gains(before: Residuals, after: Residuals, responses: Sequence[str]) -> dict[str, float]:
    """Share by which the rms of each response falls."""
    return {c: 1.0 - rms(after, c) / rms(before, c) for c in responses if rms(before, c) > 0.0}


def refitted(plain: Residuals, fitted: Residuals) -> Residuals:
    """What is left with tolerances refitted, in those responses that the other flights foretell better by it.

    Parameters
    ----------
    plain, fitted : list of mapping of response to (n,) array
        Tolerances held at zero, and free.
    """
    better = {c for c in fitted[0] if rms(fitted, c) < rms(plain, c)}
    return [{c: (b if c in better else a)[c] for c in b} for a, b in zip(plain, fitted)]
