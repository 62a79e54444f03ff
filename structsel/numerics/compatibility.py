"""Are the instruments compatible? One deterministic flight path through all of them, by maximum likelihood.

The kinematics are driven by the readings themselves, less constant biases; start, biases, winds and the vanes'
errors are chosen so that the outputs z, integrated all the way, come nearest what was read. No process noise, so
an input that is wrong in more than a constant shows as a residual that grows. With v = z - z(theta), R diagonal
and P0 the spread of the start values, whose only office is to keep a direction that nothing determines at home::

    J = 1/2 sum_c n_c ln R_c + 1/2 |theta - theta_0|^2 / P0       R_c = 1/n_c sum_i v_ic^2

is the likelihood with R already at its best. Its Gauss-Newton step is that of least squares weighted with the R of
the last residuals, damped after Levenberg and Marquardt. With S_i = dz_i/dtheta by central differences,

    D = [sum_i S_i' R^-1 S_i + P0^-1]^-1                                   residuals white
    D [sum_ij S_i' R^-1 C(i - j) R^-1 S_j + P0^-1] D                       residuals coloured, C their covariance

References
----------
[K79] for the check; [KM16], output error, data compatibility and covariance with coloured residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from structsel.numerics.coloured_output import coloured_information
from structsel.numerics.flight_path import CIRCULAR, fly, readings
from structsel.numerics.unscented import STEEPEST, FlightPathProblem

_DIFFERENCE = 1e-3  # of the central differences, in standard deviations of the start
_SMALLEST_STD = 1e-3  # of the std stated: a channel fitted to the last digit would outweigh all others
_SETTLED = 1e-3  # in standard deviations of the estimate
_SHORTEST = 200  # samples in the first fit
_MOST_DAMPED = 1e10


@dataclass(frozen=True)
class CompatibilityFit:
    """The deterministic flight path nearest all readings; n samples, L active states.

    Attributes
    ----------
    path : (n, 26) array
        Full vectors, as `flight_path.STATES`; inputs' biases still in the inputs.
    values : (L,) array
        Active states at the first sample; the constants among them hold throughout.
    crlb : (L, L) array
        Their covariance were the residuals white: the Cramer-Rao bound. NaN where the flight cannot be flown.
    covariance : (L, L) array
        Their covariance with the residuals as coloured as they are.
    residuals : (n, 12) array
        Measured less fitted; NaN where not sampled.
    measurement_std : (12,) array
        Of the residuals; as the problem states it where a channel has none.
    costs : (k,) array
        J after each step over the whole flight.
    converged : bool
    message : str
        How the search ended.
    iterations : int
        Steps tried, those over the first part of the flight included.
    """

    path: np.ndarray
    values: np.ndarray
    crlb: np.ndarray
    covariance: np.ndarray
    residuals: np.ndarray
    measurement_std: np.ndarray
    costs: np.ndarray
    converged: bool
    message: str
    iterations: int

    @property
    def std(self) -> np.ndarray:
        """(L,) standard deviations of the values, residuals coloured."""
        return np.sqrt(np.diag(self.covariance))


def output_error_path(problem: FlightPathProblem, *, iterations: int = 50) -> CompatibilityFit:
    """Fit one deterministic flight path to all readings by output error.

    The first stretch is fitted first, then one twice as long, up to the whole flight: over a short time the path
    is nearly linear in the biases, where a poor guess integrated over minutes would end upside down.

    Parameters
    ----------
    problem : FlightPathProblem
        Its `input_std` and `drift` play no part: readings drive the path as they are and constants are constant.
    iterations : int
        Most steps over one stretch.

    Returns
    -------
    CompatibilityFit
        The best found; where the search did not settle, `converged` is False and `message` says why.

    References
    ----------
    [K79], [KM16].
    """
    n = len(problem.t)
    stretches = [n]
    while stretches[0] > 2 * _SHORTEST:
        stretches.insert(0, -(-stretches[0] // 2))
    values, steps = problem.start[problem.active], 0
    for length in stretches:
        search = _Search(problem, length)
        values, costs, message = search.settle(values, iterations)
        steps += len(costs) - 1
        if not np.isfinite(costs[-1]):
            break
    # Where even a part could not be flown, what is reported is still over the whole flight.
    whole = search if length == n else _Search(problem, n)
    path, residuals = whole.fit(values)
    std = whole.noise(residuals)
    if np.isfinite(costs[-1]):
        crlb, covariance = _covariances(whole.sensitivities(values), residuals, std, problem.start_std)
    else:
        crlb = covariance = np.full((values.size, values.size), np.nan)
    return CompatibilityFit(
        *(path, values, crlb, covariance, residuals, std, np.array(costs)),
        *(message == _AT_REST, message, steps),
    )


_AT_REST = "the estimates have settled"


class _Search:
    """Levenberg-Marquardt over the first `length` samples."""

    def __init__(self, problem: FlightPathProblem, length: int):
        self.problem, self.length = problem, length
        self.measured = problem.measurements[:length]
        self.seen = np.isfinite(self.measured)
        self.counts = self.seen.sum(axis=0)

    def fly(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Path and outputs; an output that is not a number where the flight cannot be flown."""
        p = self.problem
        start = p.start.copy()
        start[p.active] = values
        path = fly(p.t[: self.length], p.inputs[: self.length], start, p.place, p.g, p.located)
        outputs = readings(path, p.inputs[: self.length], p.place, p.flank)
        outputs[~np.isfinite(outputs)] = np.nan  # infinities would take part in sums with others
        return path, outputs

    def fit(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Path and residuals."""
        path, outputs = self.fly(values)
        residuals = self.measured - outputs
        residuals[:, CIRCULAR] -= 2.0 * np.pi * np.round(residuals[:, CIRCULAR] / (2.0 * np.pi))
        return path, residuals

    def noise(self, residuals: np.ndarray) -> np.ndarray:
        """(12,) standard deviations of residuals."""
        stated = self.problem.measurement_std
        with np.errstate(over="ignore"):  # infinite then, and not to be flown
            square = np.sum(np.where(self.seen, residuals, 0.0) ** 2, axis=0) / np.maximum(self.counts, 1)
        return np.where(self.counts > 0, np.maximum(np.sqrt(square), _SMALLEST_STD * stated), stated)

    def cost(self, values: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """J, residuals and their std; J is infinite where the flight meets the vertical."""
        path, residuals = self.fit(values)
        std = self.noise(residuals)
        if not np.isfinite(std).all() or not np.abs(path[:, 4]).max() < STEEPEST:
            return np.inf, residuals, std
        # Where R is held up by its floor the two terms of the likelihood no longer cancel.
        misfit = np.nansum((residuals / std) ** 2) - self.counts.sum()
        away = (values - self.problem.start[self.problem.active]) / self.problem.start_std
        return float(self.counts @ np.log(std) + 0.5 * misfit + 0.5 * away @ away), residuals, std

    def sensitivities(self, values: np.ndarray) -> np.ndarray:
        """(L, length, 12) derivatives of the outputs; 0 where not sampled."""
        out = np.empty((values.size, self.length, 12))
        for j, step in enumerate(_DIFFERENCE * self.problem.start_std):
            ends = []
            for way in (step, -step):
                moved = values.copy()
                moved[j] += way
                ends.append(self.fly(moved)[1])
            out[j] = np.where(self.seen, (ends[0] - ends[1]) / (2.0 * step), 0.0)
        return out

    def settle(self, values: np.ndarray, iterations: int) -> tuple[np.ndarray, list[float], str]:
        """Best values, costs, and how the search ended."""
        p = self.problem
        cost, residuals, std = self.cost(values)
        costs = [cost]
        if not np.isfinite(cost):
            return values, costs, f"the path from the start values cannot be flown for {self.length} samples"
        damping = 1e-3
        for _ in range(iterations):
            S = (self.sensitivities(values) / std).reshape(values.size, -1)
            v = np.where(self.seen, residuals / std, 0.0).ravel()
            # In units of the start's spread, so that damping and conditioning know no metres or radians.
            scaled = S * p.start_std[:, None]
            H = scaled @ scaled.T + np.eye(values.size)
            slope = scaled @ v - (values - p.start[p.active]) / p.start_std
            inverse = linalg.inv(H)
            # Judged by the whole Gauss-Newton step: a damped one is small whether or not there is far to go.
            if np.all(np.abs(inverse @ slope) < _SETTLED * np.sqrt(np.diag(inverse))):
                return values, costs, _AT_REST
            while True:
                move = linalg.solve(H + damping * np.diag(np.diag(H)), slope, assume_a="pos")
                trial, *rest = self.cost(values + p.start_std * move)
                if trial <= cost:
                    break
                damping *= 10.0
                if damping > _MOST_DAMPED:
                    return values, costs, "no step lowers the cost, yet the estimates have not settled"
            values, cost, (residuals, std) = values + p.start_std * move, trial, rest
            damping /= 10.0
            costs.append(cost)
        return values, costs, f"not settled after {iterations} steps over {self.length} samples"


def _covariances(
    S: np.ndarray, residuals: np.ndarray, std: np.ndarray, start_std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance for white and for coloured residuals."""
    weighted = (S / std).reshape(len(S), -1)
    prior = np.diag(start_std**-2.0)
    crlb = linalg.inv(weighted @ weighted.T + prior)
    meat = coloured_information(S / std, residuals / std)
    return crlb, crlb @ (meat + prior) @ crlb
