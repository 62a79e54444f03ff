"""Output-error problem: measured outputs, their model, the noise covariance, the cost and its derivatives.

The model is a function of the parameters, ``predict(thetas (m, k)) -> outputs (m, n, c)``, for many parameter sets in
one call. With v = z - y(theta) over all manoeuvres and R the noise covariance::

    J = 1/2 sum v' R^-1 v + N/2 ln det R         R = 1/N sum v v'          cost "ml"
    J = 1/2 sum v' R^-1 v                        R as given                cost "weighted"

to which a prior adds 1/2 sum_j ((theta_j - mean_j) / std_j)^2.

References
----------
[KM16], output error; [A10], both costs; [J15].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import numpy as np
import scipy

from structsel.errors import DataError, DomainError

Predict: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Parameter sets (m, k) to outputs (m, n, c) of one manoeuvre; not finite where the simulation diverges."""
Constraint: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Parameter sets (m, k) to margins (m,) or (m, g), none below zero where the set is allowed."""

_DIFFERENCE = 1e-4  # step of the central differences, relative to the parameter or its scale
_LEAST_STD = 1e-7  # of that of the channel: a channel with a perfect fit would outweigh all others
_BATCH = 1 << 22  # numbers in one batch of outputs


class OutputErrorProblem:
    """Measured outputs y, their model, and the noise covariance.

    Parameters
    ----------
    predict : Predict or sequence of Predict
        One for each manoeuvre.
    y : (n, c) array or sequence of them
        NaN where not sampled.
    R : (c,) or (c, c) array or None
        Covariance that weighs the residuals; only with the cost "weighted", where the variances of the measured
        channels are the default.
    cost : {"ml", "weighted"}
    full : bool
        Estimate R with its correlations between channels.
    affects : sequence of (k,) bool array, optional
        Parameters that each manoeuvre depends on; the others are not varied in its sensitivities.
    bounds : (k, 2) array, optional
        Infinite where there is none.
    constraint : Constraint, optional
    floor : (c,) array, optional
        Least variance of each channel; a tiny fraction of the channel's own by default.
    prior : (mean (k,), std (k,)), optional
    steps : (k,) array, optional
        Of the central differences; relative to the parameter or its scale by default.

    Raises
    ------
    DataError
        Shapes that do not agree, a channel without samples, or missing samples with a full R.
    DomainError
        An R that is not a covariance, or an R with the cost "ml".
    """

    def __init__(
        self,
        predict: Predict | Sequence[Predict],
        y: np.ndarray | Sequence[np.ndarray],
        *,
        R: np.ndarray | None = None,
        cost: Literal["ml", "weighted"] = "ml",
        full: bool = False,
        affects: Sequence[np.ndarray] | None = None,
        bounds: np.ndarray | None = None,
        constraint: Constraint | None = None,
        floor: np.ndarray | None = None,
        prior: tuple[np.ndarray, np.ndarray] | None = None,
        steps: np.ndarray | None = None,
    ):
        self.predict = [predict] if callable(predict) else list(predict)
        self.y = [np.asarray(y, dtype=float)] if isinstance(y, np.ndarray) else [np.asarray(a, dtype=float) for a in y]
        self.affects, self.constraint, self.prior, self.steps = affects, constraint, prior, steps
        self.bounds = None if bounds is None else np.asarray(bounds, dtype=float)
        if not self.y or len(self.y) != len(self.predict) or any(a.ndim != 2 for a in self.y):
            raise DataError(
                f"output error needs one (n, c) array of outputs for each manoeuvre's model; it has {len(self.y)} "
                f"for {len(self.predict)}, of shapes {', '.join(str(a.shape) for a in self.y)}."
            )
        self.c = self.y[0].shape[1]
        self.sampled = [np.isfinite(a) for a in self.y]
        self.complete = [bool(s.all()) for s in self.sampled]
        self.counts = np.sum([s.sum(axis=0) for s in self.sampled], axis=0)
        if any(a.shape[1] != self.c for a in self.y) or not self.counts.all():
            raise DataError(
                "output error needs the same output channels in all manoeuvres, each sampled somewhere; "
                f"samples by channel: {self.counts.tolist()}."
            )
        if full and any((s.any(axis=1) != s.all(axis=1)).any() for s in self.sampled):
            raise DataError(
                "a full noise covariance needs samples in which either all outputs were read or none; "
                "leave channels of other rates out, or estimate a diagonal one."
            )
        self.cost, self.full = cost, full
        pooled = np.concatenate(self.y)
        spread = np.nanstd(pooled, axis=0)
        size = np.where(spread > 0.0, spread, np.nanmax(np.abs(pooled), axis=0))
        self.floor = (_LEAST_STD * np.where(size > 0.0, size, 1.0)) ** 2 if floor is None else floor
        self.weights = None if cost == "ml" else self._given(R, spread**2 + self.floor)
        if cost == "ml" and R is not None:
            raise DomainError("cost 'ml' estimates the noise covariance; with a given R ask for cost 'weighted'.")

    @property
    def N(self) -> int:
        """Number of measured values."""
        return int(self.counts.sum())

    def _given(self, R: np.ndarray | None, variances: np.ndarray) -> np.ndarray:
        weights = np.diag(variances) if R is None else np.asarray(R, dtype=float)
        weights = np.diag(weights) if weights.ndim == 1 else weights
        fits = weights.shape == (self.c, self.c) and np.isfinite(weights).all() and np.allclose(weights, weights.T)
        if not fits or np.linalg.eigvalsh(weights)[0] <= 0.0:
            raise DomainError(f"R must be {self.c} variances or a positive definite covariance of {self.c} outputs.")
        return weights

    # --- the model --------------------------------------------------------------------------------

    def simulate(self, j: int, thetas: np.ndarray) -> np.ndarray:
        """(m, n, c) outputs of manoeuvre j; not finite where the simulation diverges."""
        with np.errstate(all="ignore"):
            return np.asarray(self.predict[j](np.ascontiguousarray(thetas)), dtype=float)

    def residuals(self, outputs: Sequence[np.ndarray]) -> list[np.ndarray]:
        """(n, c) of each manoeuvre, measured less predicted; NaN where not sampled."""
        return [y - z for y, z in zip(self.y, outputs)]

    def covariance(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """(c, c) covariance that weighs these residuals: estimated, not below its floor, or as given."""
        if self.weights is not None:
            return self.weights
        return self._raised(self.sample_covariance(residuals))

    def sample_covariance(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """(c, c) sample covariance of residuals; diagonal unless R is full."""
        filled = [np.where(s, v, 0.0) for s, v in zip(self.sampled, residuals)]
        products = np.sum([v.T @ v for v in filled], axis=0)
        return products / self.counts if self.full else np.diag(np.diag(products) / self.counts)

    def _raised(self, covariance: np.ndarray) -> np.ndarray:
        if self.full:
            return covariance + np.diag(self.floor)
        return np.diag(np.maximum(np.diag(covariance), self.floor))

    def whitener(self, R: np.ndarray) -> np.ndarray:
        """(c, c) matrix F such that v F has unit covariance."""
        return scipy.linalg.inv(scipy.linalg.cholesky(R, lower=True)).T

    # --- the cost ---------------------------------------------------------------------------------

    def costs(self, thetas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J of each parameter set, infinite if the simulation diverges, and the fraction of samples after that."""
        m = len(thetas)
        at_once = max(1, _BATCH // max(y.size for y in self.y))
        parts = [self._some_costs(thetas[a : a + at_once]) for a in range(0, m, at_once)]
        return np.concatenate([p[0] for p in parts]) + self._prior_cost(thetas), np.concatenate([p[1] for p in parts])

    def _some_costs(self, thetas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        products = np.zeros((len(thetas), self.c, self.c))
        lost = np.zeros(len(thetas))
        for j, (y, sampled) in enumerate(zip(self.y, self.sampled)):
            with np.errstate(all="ignore"):
                v = y - self.simulate(j, thetas)
                if not self.complete[j]:
                    v = np.where(sampled, v, 0.0)
                lost += np.count_nonzero(~np.isfinite(v), axis=(1, 2))
                if self.full or self.weights is not None:
                    products += np.swapaxes(v, 1, 2) @ v
                else:
                    products[:, range(self.c), range(self.c)] += np.einsum("mnc,mnc->mc", v, v)
        return np.array([self._likelihood(p) for p in products]), lost / self.N

    def _likelihood(self, products: np.ndarray) -> float:
        """J from the sums of products of the residuals, (c, c)."""
        if not np.isfinite(products).all():
            return np.inf
        if self.weights is not None:
            return 0.5 * float(np.sum(scipy.linalg.inv(self.weights) * products))
        if self.full:
            covariance = products / self.counts
            R = self._raised(covariance)
            sign, logarithm = np.linalg.slogdet(R)
            if sign <= 0.0:
                return np.inf
            return 0.5 * float(self.counts[0] * (logarithm + np.sum(scipy.linalg.inv(R) * covariance) - self.c))
        variance = np.diag(products) / self.counts
        held = np.maximum(variance, self.floor)
        # If the floor raises R, the two terms of the likelihood do not cancel.
        return 0.5 * float(self.counts @ (np.log(held) + variance / held - 1.0))

    def cost_of(self, theta: np.ndarray, residuals: Sequence[np.ndarray]) -> float:
        """J of residuals, the prior included."""
        with np.errstate(all="ignore"):
            filled = [np.where(s, v, 0.0) for s, v in zip(self.sampled, residuals)]
            return self._likelihood(np.sum([v.T @ v for v in filled], axis=0)) + float(self._prior_cost(theta))

    def _prior_cost(self, thetas: np.ndarray) -> np.ndarray:
        """(...) of parameter sets (..., k)."""
        if self.prior is None:
            return np.zeros(thetas.shape[:-1])
        mean, std = self.prior
        return 0.5 * np.sum(((thetas - mean) / std) ** 2, axis=-1)

    # --- derivatives ------------------------------------------------------------------------------

    def sensitivities(self, theta: np.ndarray, scale: np.ndarray, bounds: np.ndarray) -> list[np.ndarray]:
        """(k, n, c) of each manoeuvre by central differences in one batch; 0 where not sampled.

        At a bound, or where one side diverges, the difference is one-sided; where both diverge it is 0.
        """
        k = theta.size
        step = _DIFFERENCE * np.maximum(np.abs(theta), scale) if self.steps is None else self.steps
        above, below = np.minimum(theta + step, bounds[:, 1]), np.maximum(theta - step, bounds[:, 0])
        found = []
        for j, (y, sampled) in enumerate(zip(self.y, self.sampled)):
            which = np.arange(k) if self.affects is None else np.flatnonzero(self.affects[j])
            S = np.zeros((k, *y.shape))
            at_once = max(1, _BATCH // (2 * y.size))
            for a in range(0, which.size, at_once):
                some = which[a : a + at_once]
                moved = np.tile(theta, (2 * some.size, 1))
                moved[np.arange(some.size), some] = above[some]
                moved[some.size + np.arange(some.size), some] = below[some]
                ends = self.simulate(j, moved)
                up, down = ends[: some.size], ends[some.size :]
                with np.errstate(all="ignore"):
                    S[some] = (up - down) / (above - below)[some, None, None]
                for i in np.flatnonzero(~np.isfinite(np.where(sampled, S[some], 0.0)).all(axis=(1, 2))):
                    steps = (above - theta)[some[i]], (below - theta)[some[i]]
                    S[some[i]] = self._one_sided(j, theta, steps, (up[i], down[i]))
            found.append(S if self.complete[j] else np.where(sampled, S, 0.0))
        return found

    def _one_sided(
        self, j: int, theta: np.ndarray, steps: tuple[float, float], ends: tuple[np.ndarray, np.ndarray]
    ) -> np.ndarray:
        middle = self.simulate(j, theta[None])[0]
        for step, end in zip(steps, ends):
            with np.errstate(all="ignore"):
                slope = (end - middle) / step
            if np.isfinite(np.where(self.sampled[j], slope, 0.0)).all():
                return slope
        return np.zeros_like(middle)


_RANK = 1e-11  # of the eigenvalues of the information scaled to unit diagonal: singular values 3e-6
_INSENSITIVE = (
    1e-6  # least change of the outputs by a parameter of the size of its scale, in standard deviations of noise
)


def sandwich(D: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """D middle D, infinite on the diagonal where D is."""
    undetermined = np.isinf(np.diag(D))
    finite = np.where(np.isinf(D), 0.0, D)
    product = finite @ middle @ finite
    product[undetermined, undetermined] = np.inf
    return product


def _decompose(H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale to unit diagonal, eigenvalues and vectors of the scaled matrix."""
    d = np.sqrt(np.diag(H))
    inverse = np.where(d > 0.0, 1.0 / np.where(d > 0.0, d, 1.0), 0.0)
    values, vectors = scipy.linalg.eigh(H * np.outer(inverse, inverse))
    return inverse, values, vectors


def solve_damped(H: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
    """(H + damping diag(H))^-1 g, without the null directions of H."""
    inverse, values, vectors = _decompose(H)
    kept = values > _RANK * values[-1]
    V = vectors[:, kept]
    return inverse * (V @ ((V.T @ (inverse * g)) / (values[kept] + damping)))


def invert_information(H: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of H, infinite on the diagonal for undetermined parameters, and a mask of these parameters."""
    with np.errstate(all="ignore"):
        insensitive = np.sqrt(np.diag(H)) * scale < _INSENSITIVE
    kept = ~insensitive
    D = np.zeros_like(H)
    undetermined = insensitive.copy()
    if kept.any():
        inverse, values, vectors = _decompose(H[np.ix_(kept, kept)])
        null = values <= _RANK * values[-1]
        V = vectors[:, ~null]
        D[np.ix_(kept, kept)] = np.outer(inverse, inverse) * ((V / values[~null]) @ V.T)
        undetermined[kept] = (vectors[:, null] ** 2).sum(axis=1) > 1e-3
    D[undetermined] = D[:, undetermined] = 0.0
    D[undetermined, undetermined] = np.inf
    return D, undetermined
