"""Output error: parameters whose simulated outputs are nearest the measured ones, over complete manoeuvres.

Gauss-Newton steps, damped after Levenberg and Marquardt, between bounds. Each step is that of least squares weighted
with the noise covariance R of the last residuals; the cost, which must decrease, has the R of the new ones.

``scipy.optimize.least_squares`` (trf, the same batched Jacobian, R updated between its calls) was compared on the
published cases. Parameter sets simulated, ours and trf: HFB-320 from the start values of the book 229 and 690 to 897
(207 with one step per call); AS 355 with 23 parameters 565 and 1,434 to 1,558 (with one or two steps per call it stops
far from the minimum); HFB-320 by filter error from a poor start 1,406, where trf finds sensitivities that are not
finite. It needs 2.2 to 3.9 times the simulations. `refine`, the data compatibility check and the Monte Carlo test of
inputs therefore use the search here.

References
----------
[KM16], output error; [A10], global search first and Levenberg-Marquardt after; [J15].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.output_error_problem import OutputErrorProblem, invert_information, sandwich, solve_damped
from structsel.numerics.score_covariance import score_covariance

ScoreCovariance: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Whitened sensitivities (k, n, c) and residuals (n, c) of a manoeuvre to the middle (k, k) of the sandwich."""

CONVERGED = "the estimates have converged"
_MAX_DAMPING = 1e12
_MIN_STEP = 2.0**-20  # of a Gauss-Newton step
_CONVERGED = 1e-3  # in standard deviations of the estimate


@dataclass(frozen=True)
class OutputErrorFit:
    """Parameters, their covariance, and the course of the search; k parameters, c outputs.

    Attributes
    ----------
    theta : (k,) array
        Estimates with the least cost.
    crlb : (k, k) array
        Covariance for white residuals: the Cramer-Rao bound; for the cost "weighted", that of its estimator.
        Infinite on the diagonal where the data do not determine a parameter.
    covariance : (k, k) array
        Covariance with the autocorrelation of the residuals.
    R : (c, c) array
        Covariance of the noise, from the residuals.
    outputs, residuals : tuple of (n, c) array
        Of each manoeuvre; residuals are measured less predicted, NaN where not sampled.
    costs : (i,) array
        Cost J at the start and after each accepted step.
    thetas : (i, k) array
        Parameters at the start and after each accepted step.
    converged : bool
    message : str
        How the search ended.
    at_bound : (k,) int array
        -1 at the lower bound, 1 at the upper, else 0.
    undetermined : (k,) bool array
        Parameters that the outputs do not depend on, alone or in a linear combination.
    evaluations : int
        Parameter sets simulated.
    """

    theta: np.ndarray
    crlb: np.ndarray
    covariance: np.ndarray
    R: np.ndarray
    outputs: tuple[np.ndarray, ...]
    residuals: tuple[np.ndarray, ...]
    costs: np.ndarray
    thetas: np.ndarray
    converged: bool
    message: str
    at_bound: np.ndarray
    undetermined: np.ndarray
    evaluations: int

    def __post_init__(self) -> None:
        arrays = [self.theta, self.crlb, self.covariance, self.R, self.costs, self.thetas]
        for array in (*arrays, self.at_bound, self.undetermined, *self.outputs, *self.residuals):
            array.setflags(write=False)

    @property
    def std(self) -> np.ndarray:
        """(k,) standard deviations, residuals coloured."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def std_white(self) -> np.ndarray:
        """(k,) Cramer-Rao standard deviations."""
        return np.sqrt(np.diag(self.crlb))

    @property
    def correlation(self) -> np.ndarray:
        """(k, k) correlation of the estimates; 0 with what is not determined."""
        std = self.std_white
        usable = np.isfinite(std) & (std > 0.0)
        inverse = np.where(usable, 1.0 / np.where(usable, std, 1.0), 0.0)
        found = np.where(np.isfinite(self.crlb), self.crlb, 0.0) * np.outer(inverse, inverse)
        np.fill_diagonal(found, 1.0)
        return found


def fit_output_error(
    problem: OutputErrorProblem,
    theta0: np.ndarray,
    *,
    scale: np.ndarray | None = None,
    method: Literal["levenberg-marquardt", "gauss-newton"] = "levenberg-marquardt",
    iterations: int = 60,
    tolerance: float = 1e-5,
    damping: float = 1e-3,
    factor: float = 10.0,
    score: ScoreCovariance = score_covariance,
    progress: Callable[[int, float], None] | None = None,
) -> OutputErrorFit:
    """Parameters with the least output error, by a local search.

    A parameter stays at a bound until the gradient changes sign.

    Parameters
    ----------
    problem : OutputErrorProblem
    theta0 : (k,) array
    scale : (k,) array, optional
        Typical size of each parameter, for differences and to detect undetermined parameters; ``|theta0|`` by
        default, or 1 where that is zero.
    method : {"levenberg-marquardt", "gauss-newton"}
        Gauss-Newton halves its step if the cost increases.
    iterations : int
        Maximum number of steps.
    tolerance : float
        Converged if the undamped step of every parameter is below this fraction of the parameter, or below a
        thousandth of its standard deviation.
    damping, factor : float
        First damping, a fraction of the information's diagonal, and the factor by which it changes.
    score : callable
        `score_covariance`, or `spectral_score_covariance` for transforms.
    progress : callable, optional
        Called with the number of the step and the cost.

    Returns
    -------
    OutputErrorFit
        If the search did not converge, `converged` is False and `message` has the reason.

    Raises
    ------
    DomainError
        Start values outside the bounds, or a lower bound above the upper one.

    References
    ----------
    [KM16], [A10]: damping from 1e-3, changed by factors of 10, until five digits agree.
    """
    theta = np.array(theta0, dtype=float)
    bounds = np.tile([-np.inf, np.inf], (theta.size, 1)) if problem.bounds is None else problem.bounds
    if bounds.shape != (theta.size, 2) or not (bounds[:, 0] <= bounds[:, 1]).all():
        raise DomainError(f"bounds must be {theta.size} pairs, the lower first.")
    outside = np.flatnonzero((theta < bounds[:, 0]) | (theta > bounds[:, 1]) | ~np.isfinite(theta))
    if outside.size:
        j = int(outside[0])
        raise DomainError(f"parameter {j} starts at {theta[j]:g}, outside its bounds {bounds[j].tolist()}.")
    typical = np.where(theta != 0.0, np.abs(theta), 1.0) if scale is None else np.asarray(scale, dtype=float)
    search = _LocalSearch(problem, bounds, typical, method, tolerance, damping, factor, score)
    return search.run(theta, iterations, progress)


@dataclass
class _LocalSearch:
    problem: OutputErrorProblem
    bounds: np.ndarray
    scale: np.ndarray
    method: str
    tolerance: float
    damping: float
    factor: float
    score: ScoreCovariance
    evaluations: int = 0
    last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray, list, list]] | None = None

    def run(self, theta: np.ndarray, iterations: int, progress: Callable[[int, float], None] | None) -> OutputErrorFit:
        """Step until converged."""
        cost, outputs = self.evaluate(theta)
        costs, thetas = [cost], [theta]
        if not self.allowed(theta):
            message = "the start does not satisfy the constraint; choose one that does, or search globally first"
        elif not np.isfinite(cost):
            message = (
                "the simulation diverges with the start values: its outputs are not finite. Start nearer, bound the "
                "parameters, or search globally first"
            )
        else:
            message = f"not converged after {iterations} steps"
        for count in range(iterations if self.allowed(theta) and np.isfinite(cost) else 0):
            H, g = self.information(theta, outputs)[:2]
            noise = 1.0 if self.problem.cost == "ml" else np.sqrt(2.0 * cost / self.problem.N)
            if self.converged(theta, H, g, noise, 1.0):
                message = CONVERGED
                break
            trial = self.improve(theta, cost, H, g)
            if trial is None:
                # Differences have limited accuracy: an estimate within a few hundredths of a std has converged.
                near = self.converged(theta, H, g, noise, 50.0)
                message = CONVERGED if near else self.why_no_step(theta, H, g)
                break
            theta, cost, outputs = trial
            costs.append(cost)
            thetas.append(theta)
            if progress is not None:
                progress(count + 1, cost)
        return self.report(theta, outputs, np.array(costs), np.array(thetas), message)

    def evaluate(self, theta: np.ndarray) -> tuple[float, list[np.ndarray]]:
        """Cost and outputs."""
        self.evaluations += 1
        outputs = [self.problem.simulate(j, theta[None])[0] for j in range(len(self.problem.y))]
        with np.errstate(all="ignore"):
            return self.problem.cost_of(theta, self.problem.residuals(outputs)), outputs

    def allowed(self, theta: np.ndarray) -> bool:
        """Whether the constraint holds."""
        constraint = self.problem.constraint
        return constraint is None or bool(np.min(constraint(theta[None])) >= 0.0)

    def information(self, theta: np.ndarray, outputs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, list, list]:
        """Information matrix H, negative gradient g of the cost, whitened sensitivities and residuals."""
        if self.last is not None and np.array_equal(self.last[0], theta):
            return self.last[1]  # the report is about the last point of the search
        problem, k = self.problem, theta.size
        residuals = problem.residuals(outputs)
        self.last = None  # sensitivities take much memory
        F = problem.whitener(problem.covariance(residuals))
        S = [s @ F for s in problem.sensitivities(theta, self.scale, self.bounds)]
        self.evaluations += 2 * k
        v = [np.where(sampled, r, 0.0) @ F for sampled, r in zip(problem.sampled, residuals)]
        flat = [s.reshape(k, -1) for s in S]
        H = np.sum([s @ s.T for s in flat], axis=0)
        g = np.sum([s @ r.ravel() for s, r in zip(flat, v)], axis=0)
        if problem.prior is not None:
            mean, std = problem.prior
            H, g = H + np.diag(std**-2.0), g - (theta - mean) / std**2
        self.last = theta.copy(), (H, g, S, v)
        return H, g, S, v

    def step(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
        """Damped step within the bounds: parameters that would leave them stay there, and the others are recomputed."""
        low, high = self.bounds[:, 0] - theta, self.bounds[:, 1] - theta
        move = np.zeros(theta.size)
        free = ~(((low >= 0.0) & (g < 0.0)) | ((high <= 0.0) & (g > 0.0)))
        while free.any():
            held = ~free
            rest = g[free] - H[np.ix_(free, held)] @ move[held]
            move[free] = solve_damped(H[np.ix_(free, free)], rest, damping)
            out = free & ((move < low) | (move > high))
            if not out.any():
                break
            move[out] = np.clip(move[out], low[out], high[out])
            free &= ~out
        return move

    def converged(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray, noise: float, slack: float) -> bool:
        """Whether the undamped step is negligible in every parameter."""
        move = np.abs(self.step(theta, H, g, 0.0))
        std = noise * np.sqrt(np.diag(invert_information(H, self.scale)[0]))
        return bool(np.all((move <= self.tolerance * np.abs(theta)) | (move <= slack * _CONVERGED * std)))

    def improve(
        self, theta: np.ndarray, cost: float, H: np.ndarray, g: np.ndarray
    ) -> tuple[np.ndarray, float, list[np.ndarray]] | None:
        """Parameters, cost and outputs after a step that lowers the cost, or None."""
        undamped = self.step(theta, H, g, 0.0) if self.method == "gauss-newton" else None
        fraction = 1.0
        while fraction >= _MIN_STEP and self.damping <= _MAX_DAMPING:
            move = fraction * undamped if undamped is not None else self.step(theta, H, g, self.damping)
            trial = np.clip(theta + move, *self.bounds.T)
            if self.allowed(trial):
                found, outputs = self.evaluate(trial)
                if found < cost:
                    self.damping = max(self.damping / self.factor, 1e-12)
                    return trial, found, outputs
            if undamped is not None:
                fraction *= 0.5
            else:
                self.damping *= self.factor
        return None

    def why_no_step(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray) -> str:
        """Reason why no step lowers the cost."""
        if not self.allowed(np.clip(theta + self.step(theta, H, g, 1.0), *self.bounds.T)):
            return "the constraint prevents a lower cost"
        return "no step lowers the cost, yet the estimates have not converged"

    def report(
        self, theta: np.ndarray, outputs: list[np.ndarray], costs: np.ndarray, thetas: np.ndarray, message: str
    ) -> OutputErrorFit:
        """Result with its covariances."""
        problem, k = self.problem, theta.size
        residuals = problem.residuals(outputs)
        at_bound = np.where(theta <= self.bounds[:, 0], -1, np.where(theta >= self.bounds[:, 1], 1, 0))
        if np.isfinite(costs[-1]):
            H, _, S, v = self.information(theta, outputs)
            D, undetermined = invert_information(H, self.scale)
            blanked = [np.where(sampled, r, np.nan) for sampled, r in zip(problem.sampled, v)]
            middle = np.sum([self.score(s, r) for s, r in zip(S, blanked)], axis=0)
            if problem.prior is not None:
                middle = middle + np.diag(problem.prior[1] ** -2.0)
            covariance = sandwich(D, middle)
            crlb = D if problem.cost == "ml" else sandwich(D, _white_information(S, v, problem))
            noise = problem.sample_covariance(residuals)
        else:
            crlb = covariance = np.full((k, k), np.nan)
            noise, undetermined = np.full((problem.c, problem.c), np.nan), np.zeros(k, dtype=bool)
        return OutputErrorFit(
            *(theta, crlb, covariance, noise, tuple(outputs), tuple(residuals), costs, thetas),
            *(message == CONVERGED, message, at_bound, undetermined, self.evaluations),
        )


def _white_information(S: list[np.ndarray], v: list[np.ndarray], problem: OutputErrorProblem) -> np.ndarray:
    """(k, k) sum of S' C S with C the covariance of whitened residuals from channel to channel."""
    covariance = np.sum([r.T @ r for r in v], axis=0) / np.sqrt(np.outer(problem.counts, problem.counts))
    return np.sum([np.einsum("anc,cd,bnd->ab", s, covariance, s, optimize=True) for s in S], axis=0)
