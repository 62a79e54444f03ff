"""From a start downhill: Gauss-Newton, damped after Levenberg and Marquardt, between bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import linalg

from structsel.errors import DomainError
from structsel.numerics.coloured_output import coloured_information
from structsel.numerics.output_error.records import Constraint, Predict, Records
from structsel.numerics.output_error.result import OutputErrorFit

Colour: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]

_MOST_DAMPED = 1e12
_SHORTEST = 2.0**-20  # of a Gauss-Newton step
_SETTLED = 1e-3  # in standard deviations of the estimate
_RANK = 1e-11  # of the eigenvalues of the information scaled to unit diagonal: singular values 3e-6
_UNMOVED = 1e-6  # standard deviations of all the noise that a parameter as large as its scale moves the outputs


def fit_output_error(
    predict: Predict | Sequence[Predict],
    y: np.ndarray | Sequence[np.ndarray],
    theta0: np.ndarray,
    *,
    bounds: np.ndarray | None = None,
    R: np.ndarray | None = None,
    cost: Literal["ml", "weighted"] = "ml",
    full: bool = False,
    method: Literal["levenberg-marquardt", "gauss-newton"] = "levenberg-marquardt",
    constraint: Constraint | None = None,
    affects: Sequence[np.ndarray] | None = None,
    scale: np.ndarray | None = None,
    iterations: int = 60,
    tolerance: float = 1e-5,
    damping: float = 1e-3,
    factor: float = 10.0,
    colour: Colour = coloured_information,
    progress: Callable[[int, float], None] | None = None,
) -> OutputErrorFit:
    """Parameters with the least output error near a start.

    Each step is that of least squares weighted with the R of the last residuals, its information matrix damped by
    a share of its diagonal; the cost it must lower has R at its best for the new ones. A parameter at a bound that
    would be left stays there until the slope turns.

    Parameters
    ----------
    predict, y, R, cost, full, affects
        As `Records` takes them.
    theta0 : (k,) array
    bounds : (k, 2) array, optional
        Infinite where there is none.
    method : {"levenberg-marquardt", "gauss-newton"}
        Gauss-Newton halves its step where the cost rises.
    constraint : Constraint, optional
        A step that leaves it is not taken.
    scale : (k,) array, optional
        Typical size of each parameter, for differences and for telling what is not determined; ``|theta0|``, or 1
        where that is zero.
    iterations : int
        Most steps.
    tolerance : float
        Settled where every parameter's undamped step is below this share of it, or below a thousandth of its
        standard deviation.
    damping, factor : float
        Its first value, and what it is multiplied and divided by.
    colour : callable
        Whitened sensitivities (k, n, c) and residuals (n, c) of a manoeuvre to the middle (k, k) of the covariance's
        sandwich.
    progress : callable, optional
        Called with the step's number and the cost.

    Returns
    -------
    OutputErrorFit
        The best found; where the search did not settle, `converged` is False and `message` says why.

    Raises
    ------
    DomainError
        A start outside its bounds, or bounds that cross.

    References
    ----------
    [KM16], [A10]: damping from 1e-3 by tens until five digits agree.
    """
    theta = np.array(theta0, dtype=float)
    limits = np.tile([-np.inf, np.inf], (theta.size, 1)) if bounds is None else np.asarray(bounds, dtype=float)
    if limits.shape != (theta.size, 2) or not (limits[:, 0] <= limits[:, 1]).all():
        raise DomainError(f"bounds must be {theta.size} pairs, the lower first.")
    outside = np.flatnonzero((theta < limits[:, 0]) | (theta > limits[:, 1]) | ~np.isfinite(theta))
    if outside.size:
        j = int(outside[0])
        raise DomainError(f"parameter {j} starts at {theta[j]:g}, outside its bounds {limits[j].tolist()}.")
    typical = np.where(theta != 0.0, np.abs(theta), 1.0) if scale is None else np.asarray(scale, dtype=float)
    records = Records(predict, y, R=R, cost=cost, full=full, affects=affects)
    search = _Descent(records, limits, typical, constraint, method, tolerance, damping, factor, colour)
    return search.run(theta, iterations, progress)


@dataclass
class _Descent:
    records: Records
    limits: np.ndarray
    scale: np.ndarray
    constraint: Constraint | None
    method: str
    tolerance: float
    damping: float
    factor: float
    colour: Colour
    evaluations: int = 0

    def run(self, theta: np.ndarray, iterations: int, progress: Callable[[int, float], None] | None) -> OutputErrorFit:
        """Go down until settled."""
        cost, outputs = self.judge(theta)
        costs, thetas = [cost], [theta]
        if not self.allowed(theta):
            message = "the start does not satisfy the constraint; choose one that does, or search globally first"
        elif not np.isfinite(cost):
            message = (
                "the start cannot be flown: its outputs are not finite. Start nearer, bound the parameters, or "
                "search globally first"
            )
        else:
            message = f"not settled after {iterations} steps"
        for count in range(iterations if self.allowed(theta) and np.isfinite(cost) else 0):
            H, g = self.slope(theta, outputs)[:2]
            noise = 1.0 if self.records.cost == "ml" else np.sqrt(2.0 * cost / self.records.N)
            if self.settled(theta, H, g, noise, 1.0):
                message = SETTLED
                break
            trial = self.improve(theta, cost, H, g)
            if trial is None:
                # Differences have an end to their digits: what is within a few hundredths of a std is there.
                near = self.settled(theta, H, g, noise, 50.0)
                message = SETTLED if near else self.stuck(theta, H, g)
                break
            theta, cost, outputs = trial
            costs.append(cost)
            thetas.append(theta)
            if progress is not None:
                progress(count + 1, cost)
        return self.report(theta, outputs, np.array(costs), np.array(thetas), message)

    def judge(self, theta: np.ndarray) -> tuple[float, list[np.ndarray]]:
        """Cost and outputs."""
        self.evaluations += 1
        outputs = [self.records.fly(j, theta[None])[0] for j in range(len(self.records.y))]
        with np.errstate(all="ignore"):
            return self.records.cost_of(self.records.residuals(outputs)), outputs

    def allowed(self, theta: np.ndarray) -> bool:
        """Whether the constraint holds."""
        return self.constraint is None or bool(np.min(self.constraint(theta[None])) >= 0.0)

    def slope(self, theta: np.ndarray, outputs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, list, list]:
        """Information matrix, downhill slope, whitened sensitivities and residuals."""
        residuals = self.records.residuals(outputs)
        F = self.records.whitener(self.records.covariance(residuals))
        S = [s @ F for s in self.records.sensitivities(theta, self.scale, self.limits)]
        self.evaluations += 2 * theta.size
        v = [np.where(seen, r, 0.0) @ F for seen, r in zip(self.records.seen, residuals)]
        flat = [s.reshape(theta.size, -1) for s in S]
        H = np.sum([s @ s.T for s in flat], axis=0)
        return H, np.sum([s @ r.ravel() for s, r in zip(flat, v)], axis=0), S, v

    def step(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
        """Damped step between the bounds: what would leave them is held there and the rest solved again."""
        low, high = self.limits[:, 0] - theta, self.limits[:, 1] - theta
        move = np.zeros(theta.size)
        free = ~(((low >= 0.0) & (g < 0.0)) | ((high <= 0.0) & (g > 0.0)))
        while free.any():
            held = ~free
            rest = g[free] - H[np.ix_(free, held)] @ move[held]
            move[free] = _solve(H[np.ix_(free, free)], rest, damping)
            out = free & ((move < low) | (move > high))
            if not out.any():
                break
            move[out] = np.clip(move[out], low[out], high[out])
            free &= ~out
        return move

    def settled(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray, noise: float, slack: float) -> bool:
        """Whether the undamped step is negligible in every parameter."""
        move = np.abs(self.step(theta, H, g, 0.0))
        std = noise * np.sqrt(np.diag(_invert(H, self.scale)[0]))
        return bool(np.all((move <= self.tolerance * np.abs(theta)) | (move <= slack * _SETTLED * std)))

    def improve(
        self, theta: np.ndarray, cost: float, H: np.ndarray, g: np.ndarray
    ) -> tuple[np.ndarray, float, list[np.ndarray]] | None:
        """A step that lowers the cost, or None."""
        whole = self.step(theta, H, g, 0.0) if self.method == "gauss-newton" else None
        share = 1.0
        while share >= _SHORTEST and self.damping <= _MOST_DAMPED:
            move = share * whole if whole is not None else self.step(theta, H, g, self.damping)
            trial = np.clip(theta + move, *self.limits.T)
            if self.allowed(trial):
                found, outputs = self.judge(trial)
                if found < cost:
                    self.damping = max(self.damping / self.factor, 1e-12)
                    return trial, found, outputs
            if whole is not None:
                share *= 0.5
            else:
                self.damping *= self.factor
        return None

    def stuck(self, theta: np.ndarray, H: np.ndarray, g: np.ndarray) -> str:
        """Why no step lowers the cost."""
        if not self.allowed(np.clip(theta + self.step(theta, H, g, 1.0), *self.limits.T)):
            return "the constraint stands in the way of a lower cost"
        return "no step lowers the cost, yet the estimates have not settled"

    def report(
        self, theta: np.ndarray, outputs: list[np.ndarray], costs: np.ndarray, thetas: np.ndarray, message: str
    ) -> OutputErrorFit:
        """Covariances and the rest."""
        records, k = self.records, theta.size
        residuals = records.residuals(outputs)
        at_bound = np.where(theta <= self.limits[:, 0], -1, np.where(theta >= self.limits[:, 1], 1, 0))
        if np.isfinite(costs[-1]):
            H, _, S, v = self.slope(theta, outputs)
            D, undetermined = _invert(H, self.scale)
            blanked = [np.where(seen, r, np.nan) for seen, r in zip(records.seen, v)]
            coloured = np.sum([self.colour(s, r) for s, r in zip(S, blanked)], axis=0)
            covariance = _sandwich(D, coloured)
            crlb = D if records.cost == "ml" else _sandwich(D, _white_information(S, v, records))
            noise = records.scatter(residuals)
        else:
            crlb = covariance = np.full((k, k), np.nan)
            noise, undetermined = np.full((records.c, records.c), np.nan), np.zeros(k, dtype=bool)
        return OutputErrorFit(
            *(theta, crlb, covariance, noise, tuple(outputs), tuple(residuals), costs, thetas),
            *(message == SETTLED, message, at_bound, undetermined, self.evaluations),
        )


SETTLED = "the estimates have settled"


def _white_information(S: list[np.ndarray], v: list[np.ndarray], records: Records) -> np.ndarray:
    """(k, k) sum of S' C S with C the covariance of whitened residuals from channel to channel."""
    scatter = np.sum([r.T @ r for r in v], axis=0) / np.sqrt(np.outer(records.counts, records.counts))
    return np.sum([np.einsum("anc,cd,bnd->ab", s, scatter, s, optimize=True) for s in S], axis=0)


def _sandwich(D: np.ndarray, meat: np.ndarray) -> np.ndarray:
    """D meat D, infinite where D is."""
    lost = np.isinf(np.diag(D))
    held = np.where(np.isinf(D), 0.0, D)
    found = held @ meat @ held
    found[lost, lost] = np.inf
    return found


def _decompose(H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale to unit diagonal, eigenvalues and vectors of the scaled matrix."""
    d = np.sqrt(np.diag(H))
    inverse = np.where(d > 0.0, 1.0 / np.where(d > 0.0, d, 1.0), 0.0)
    values, vectors = linalg.eigh(H * np.outer(inverse, inverse))
    return inverse, values, vectors


def _solve(H: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
    """(H + damping diag(H))^-1 g, without the directions that H says nothing about."""
    inverse, values, vectors = _decompose(H)
    kept = values > _RANK * values[-1]
    V = vectors[:, kept]
    return inverse * (V @ ((V.T @ (inverse * g)) / (values[kept] + damping)))


def _invert(H: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of H, infinite on the diagonal where it has none, and which parameters these are."""
    with np.errstate(all="ignore"):
        unmoved = np.sqrt(np.diag(H)) * scale < _UNMOVED
    kept = ~unmoved
    D = np.zeros_like(H)
    undetermined = unmoved.copy()
    if kept.any():
        inverse, values, vectors = _decompose(H[np.ix_(kept, kept)])
        null = values <= _RANK * values[-1]
        V = vectors[:, ~null]
        D[np.ix_(kept, kept)] = np.outer(inverse, inverse) * ((V / values[~null]) @ V.T)
        undetermined[kept] = (vectors[:, null] ** 2).sum(axis=1) > 1e-3
    D[undetermined] = D[:, undetermined] = 0.0
    D[undetermined, undetermined] = np.inf
    return D, undetermined
