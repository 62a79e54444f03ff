"""Residuals on flights that were held out: of the simulation as given, refitted, and with the effects found."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.noise import Rows, edge_of
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

_WHITE = 1.3  # chi-square per row, below which a residual counts as noise
_STILL = 1e-9  # of the noise power: an effect below it does not act on a response
Residuals = list[dict[str, Array]]
"""Per flight: cosine coefficients in the unit of each response, without the constant part, which biases change."""


def measured(problem: DiagnosisProblem) -> Residuals:
    """Measured responses of the flights that are held out."""
    return [_spectra(problem, m, problem.flights[m].measured) for group in problem.base.groups for m in group]


def as_given(problem: DiagnosisProblem) -> Residuals:
    """Differences from the simulation as given."""
    return [_spectra(problem, m, problem.flights[m].difference) for group in problem.base.groups for m in group]


def held_out(problem: DiagnosisProblem, level: bool = False, but_for: Collection[str] = ()) -> Residuals:
    """Residual of tolerances and effects whose parameters are estimated from the other flights.

    Parameters
    ----------
    problem : DiagnosisProblem
    level : bool
        With the constant part that biases do not explain.
    but_for : collection of str
        Names of flights that do not count.
    """
    each = [(r, left) for r, left in problem.held_out_residuals if r.flight.name not in but_for]
    return _coefficients(problem, each, 0 if level else 1)


def fitted(problem: DiagnosisProblem) -> Residuals:
    """Residual of tolerances and effects whose parameters are estimated from all flights."""
    return _coefficients(problem, problem.fitted_residuals, 1)


def _coefficients(problem: DiagnosisProblem, left_of: Sequence[tuple[Rows, Array]], first: int) -> Residuals:
    return [{c: (left[r.part(c)] / r.weight[c])[first:] for c in problem.responses} for r, left in left_of]


def _spectra(problem: DiagnosisProblem, m: int, signals: Mapping[str, Array]) -> dict[str, Array]:
    r = problem.rows[m]
    return {c: spectrum(signals[c], r.bins, edge_of(r.flight))[1:] for c in problem.responses}


def rms(parts: Residuals, response: str) -> float:
    """Root mean square of one response over all flights."""
    return float(np.sqrt(sum(float(p[response] @ p[response]) for p in parts) / sum(len(p[response]) for p in parts)))


def excess(
    problem: DiagnosisProblem, predicted: bool = True, flights: Collection[str] | None = None
) -> dict[str, tuple[float, float]]:
    """Mean square of the residual of each response, in units of the noise; 1 for noise alone.

    Parameters
    ----------
    problem : DiagnosisProblem
    predicted : bool
        True for flights that are held out and predicted from the others; False for the fit to all flights.
    flights : collection of str, optional
        Names of those that count.

    Returns
    -------
    mapping of response to (motion, level)
        Of the coefficients except the constant part, and of the constant part; in units of noise and biases.
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
    """Mean square of the residual without and with an effect, each sample weighted by the squared effect.

    In units of the noise, for each response on which the effect acts. The cosine coefficients of whitened rows are
    transformed back to samples, which are white as well. Other parameters as for `excess`.
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
    """Residual rows of each flight that counts."""
    left_of = problem.held_out_residuals if predicted else problem.fitted_residuals
    return left_of if flights is None else [(r, left) for r, left in left_of if r.flight.name in flights]


def is_noise(problem: DiagnosisProblem, response: str) -> bool:
    """Whether the residual of the fit to all flights is noise alone."""
    rows = np.concatenate([left[r.part(response)] for r, left in problem.fitted_residuals])
    return bool(np.mean(rows**2) < _WHITE)


def explained(delivered: Residuals, after: Residuals, axes: Sequence[str]) -> float:
    """Fraction of the variance of the differences that is explained on held-out flights, mean over the axes."""
    sizes = {c: rms(delivered, c) for c in axes}
    fractions = [1.0 - (rms(after, c) / size) ** 2 for c, size in sizes.items() if size > 0.0]
    return float(np.clip(np.mean(fractions), 0.0, 1.0)) if fractions else 0.0


@dataclass(frozen=True)
class ResponseFit:
    """Accuracy of the prediction of one response.

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
    """Fit of each response in the compared band."""
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
    """Fraction by which the rms of each response decreases."""
    return {c: 1.0 - rms(after, c) / rms(before, c) for c in responses if rms(before, c) > 0.0}


def refitted(plain: Residuals, fitted: Residuals) -> Residuals:
    """Residual with refitted tolerances, for the responses that the other flights then predict better.

    Parameters
    ----------
    plain, fitted : list of mapping of response to (n,) array
        Tolerances held at zero, and free.
    """
    better = {c for c in fitted[0] if rms(fitted, c) < rms(plain, c)}
    return [{c: (b if c in better else a)[c] for c in b} for a, b in zip(plain, fitted)]
