"""Linear-Gaussian evidence, manoeuvre by manoeuvre.

Each manoeuvre contributes rows ``y = B beta + H theta + e`` with white e of unit variance, beta ~ N(0, 1) (the
nuisances that tolerances allow) and theta ~ N(0, 1) (the effect under trial); columns are scaled by their prior
standard deviations beforehand. Every result is a sum of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from structsel.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Projector:
    """Whitening of the rows of one manoeuvre, whose noise includes nuisance parameters P of its own.

    ``I + P P'`` is the covariance of noise and nuisances. Its inverse square root shrinks the directions of P only:
    `basis` holds these directions, `shrink` the fraction that each loses.
    """

    basis: Array
    shrink: Array

    @classmethod
    def of(cls, P: Array) -> Projector:
        """Projector of columns scaled by their prior standard deviations, (rows, k)."""
        if not P.shape[1]:
            return cls(np.zeros((P.shape[0], 0)), np.zeros(0))
        U, s, _ = np.linalg.svd(P, full_matrices=False)
        return cls(U, 1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def __call__(self, X: Array) -> Array:
        """Whitened rows."""
        inside = self.basis.T @ X
        return X - self.basis @ (inside * (self.shrink[:, None] if X.ndim == 2 else self.shrink))

    @property
    def lost(self) -> Array:
        """Fraction of the power that each direction of `basis` loses."""
        return 2.0 * self.shrink - self.shrink**2


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums of products over one or several sets of rows; they can be added and subtracted.

    Attributes
    ----------
    A : (k, k) array
        Columns with columns.
    b : (k,) array
        Columns with y.
    c : float
        y with y.
    n : int
        Rows.
    """

    A: Array
    b: Array
    c: float
    n: int

    @classmethod
    def of(cls, X: Array, y: Array) -> NormalEquations:
        """Products of the rows of columns (n, k) and y (n,)."""
        return cls(X.T @ X, X.T @ y, float(y @ y), len(y))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.A + other.A, self.b + other.b, self.c + other.c, self.n + other.n)

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.A - other.A, self.b - other.b, self.c - other.c, self.n - other.n)


@dataclass(frozen=True, eq=False)
class Further:
    """Products of further columns with those of a base.

    Attributes
    ----------
    cross : (k, j) array
        With the base's columns.
    own : (j, j) array
        With each other.
    with_y : (j,) array
    """

    cross: Array
    own: Array
    with_y: Array


@dataclass(frozen=True, eq=False)
class Posterior:
    """Coefficients under a standard normal prior.

    Attributes
    ----------
    mean : (k,) array [prior standard deviations]
    covariance : (k, k) array
    log_evidence : float
        Without the constant of 2 pi.
    chi2 : float
        Residual sum of squares at the mean.
    """

    mean: Array
    covariance: Array
    log_evidence: float
    chi2: float


def solve(products: NormalEquations) -> Posterior:
    """Posterior of the coefficients of `products`."""
    k = len(products.b)
    factor = scipy.linalg.cho_factor(np.eye(k) + products.A)
    mean = scipy.linalg.cho_solve(factor, products.b)
    log_determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    evidence = -0.5 * (products.c - float(products.b @ mean) + log_determinant)
    return Posterior(mean, scipy.linalg.cho_solve(factor, np.eye(k)), evidence, chi2_of(products, mean))


def wider_priors(mean: Array, variance: Array, factors: Array) -> Array:
    """Increase of the log evidence where the prior of a single coefficient is wider by a factor.

    Parameters
    ----------
    mean, variance : (k,) arrays [prior standard deviations]
        Of the posterior under the prior as it is.
    factors : (k,) or (k, f) array
    """
    wider = np.asarray(factors, dtype=float) ** 2
    less = 1.0 / wider - 1.0  # of the prior's precision
    # Rounding may put the posterior variance of what is not determined above that of the prior, which is 1.
    mean, variance = (x.reshape(-1, *(1,) * (wider.ndim - 1)) for x in (mean, np.minimum(variance, 1.0)))
    held = 1.0 + less * variance
    return np.asarray(-0.5 * (np.log(wider) + np.log(held) + less * mean**2 / held))


def chi2_of(products: NormalEquations, coefficients: Array) -> float:
    """Residual sum of squares of given coefficients on these rows."""
    return products.c - 2.0 * float(products.b @ coefficients) + float(coefficients @ products.A @ coefficients)


class Base:
    """Rows and nuisances of each manoeuvre, factored once for all trials: with all manoeuvres and without each.

    The prior standard deviations of the nuisances are uncertain: they are the given ones times one of several sets
    of factors with equal prior probabilities.

    Parameters
    ----------
    y : sequence of (rows,) arrays
        Per manoeuvre, white with unit variance.
    given : sequence of (rows, k) arrays
        Nuisances, scaled by their prior standard deviations.
    groups : sequence of tuple of int, optional
        Manoeuvres left out together; by default each in turn.
    scales : (t, k) array, optional
        Factors on the prior standard deviations; by default ones.

    Attributes
    ----------
    evidence : (t, 1 + m) array
        Log evidence at each set of factors, of all manoeuvres and without each.
    chosen : int
        The most probable set of factors.
    solved : (1 + m, k) array
        Coefficients with these factors, from all manoeuvres and without each.
    posterior : Posterior
    """

    def __init__(
        self,
        y: Sequence[Array],
        given: Sequence[Array],
        groups: Sequence[tuple[int, ...]] | None = None,
        scales: Array | None = None,
    ):
        self.y, self.given = list(y), list(given)
        self.groups = [(m,) for m in range(len(self.y))] if groups is None else list(groups)
        each = [NormalEquations.of(X, r) for X, r in zip(self.given, self.y)]
        total = _sum(each)
        sets = [total, *(total - _sum([each[m] for m in group]) for group in self.groups)]
        self.scales = np.ones((1, len(total.b))) if scales is None else scales
        b = self.scales[:, None, :] * np.stack([s.b for s in sets])
        A = self.scales[:, None, :, None] * np.stack([s.A for s in sets]) * self.scales[:, None, None, :]
        k = A.shape[-1]
        factor = np.linalg.cholesky(np.eye(k) + A)
        self._inverse = np.linalg.inv(factor)
        self._rotated = (self._inverse @ b[..., None])[..., 0]
        power = np.stack([s.c for s in sets]) - (self._rotated**2).sum(axis=-1)
        self.evidence = -0.5 * power - np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
        self.chosen = int(np.argmax(self.evidence[:, 0]))
        self.solved = (np.swapaxes(self._inverse[self.chosen], -1, -2) @ self._rotated[self.chosen][..., None])[..., 0]
        self.posterior = solve(NormalEquations(A[self.chosen, 0], b[self.chosen, 0], total.c, total.n))

    @cached_property
    def B(self) -> list[Array]:
        """(rows, k) nuisances per manoeuvre, scaled by the most probable factors too."""
        return [X * self.scales[self.chosen] for X in self.given]

    def with_columns(self, more: Sequence[Array]) -> Base:
        """Base with further columns (rows, j), whose priors have no factors."""
        given = [np.column_stack(pair) for pair in zip(self.given, more)]
        ones = np.ones((len(self.scales), given[0].shape[1] - self.scales.shape[1]))
        return Base(self.y, given, self.groups, np.column_stack([self.scales, ones]))

    def select_columns(self, columns: Sequence[int]) -> Base:
        """Base with some of the columns, in this order."""
        at = list(columns)
        return Base(self.y, [X[:, at] for X in self.given], self.groups, self.scales[:, at])

    @cached_property
    def freed(self) -> Array:
        """(k,) increase of the log evidence if one column has the first set of factors and all others the last."""
        first, last = self.scales[0], self.scales[-1]
        inverse = self._inverse[-1, 0]
        mean = inverse.T @ self._rotated[-1, 0]
        return wider_priors(mean, (inverse**2).sum(axis=0), first / last)

    def try_each(self, sets: Sequence[Sequence[Further]]) -> list[Trial]:
        """Evidence for each set of further columns (scaled by their priors), with all manoeuvres and without each.

        Parameters
        ----------
        sets : sequence of sequence of Further
            For each set, added to the base alone, the products by manoeuvre.
        """
        made: list[Trial | None] = [None] * len(sets)
        for same in group_by_width([one[0].cross.shape[1] for one in sets]):
            for i, trial in zip(same, self._evaluate_group([sets[i] for i in same])):
                made[i] = trial
        return [trial for trial in made if trial is not None]

    def _evaluate_group(self, sets: Sequence[Sequence[Further]]) -> list[Trial]:
        """Trials of sets with equal numbers of columns, computed together."""

        def all_and_without(parts: Array) -> Array:  # (sets, m, ...) to (1 + m, sets, ...)
            total = parts.sum(axis=1)
            return np.stack([total, *(total - parts[:, list(group)].sum(axis=1) for group in self.groups)])

        cross = all_and_without(np.stack([[one.cross for one in each] for each in sets]))
        own = all_and_without(np.stack([[one.own for one in each] for each in sets]))
        with_y = all_and_without(np.stack([[one.with_y for one in each] for each in sets]))
        left, n, k, width = cross.shape
        side_by_side = cross.transpose(0, 2, 1, 3).reshape(left, k, n * width)
        brought, first, inner = [], [], []
        for scale, inverse, rotated in zip(self.scales, self._inverse, self._rotated):
            V = (inverse @ (scale[:, None] * side_by_side)).reshape(left, k, n, width).transpose(0, 2, 1, 3)
            turned = np.swapaxes(V, -1, -2)
            held = np.eye(width) + own - turned @ V
            s = with_y - (turned @ rotated[:, None, :, None])[..., 0]
            theta = np.linalg.solve(held, s[..., None])[..., 0]
            brought.append(0.5 * (s * theta).sum(axis=-1) - 0.5 * np.linalg.slogdet(held)[1])
            first.append(theta[0])
            inner.append(held[0])
        gained = np.stack(brought)  # (scales, 1 + m, sets)
        combined = self.evidence[..., None] + gained
        evidence = scipy.special.logsumexp(combined, axis=0) - scipy.special.logsumexp(self.evidence, axis=0)[:, None]
        best = np.argmax(combined[:, 0], axis=0)
        return [
            Trial(
                float(evidence[0, i]),
                evidence[0, i] - evidence[1:, i],
                first[best[i]][i],
                np.linalg.inv(inner[best[i]][i]),
                gained[:, 0, i],
            )
            for i in range(n)
        ]


def group_by_width(widths: Sequence[int]) -> list[list[int]]:
    """Indices of the sets with equal numbers of columns, for each number; such sets are computed together."""
    return [[i for i, w in enumerate(widths) if w == width] for width in set(widths)]


def _sum(parts: Sequence[NormalEquations]) -> NormalEquations:
    total = parts[0]
    for one in parts[1:]:
        total = total + one
    return total


@dataclass(frozen=True, eq=False)
class Trial:
    """Columns under trial, compared with the base alone.

    Attributes
    ----------
    log_bayes : float
        Log evidence with them less that without.
    predictive : (m,) array
        Of each manoeuvre given the others: gain in log predictive density.
    theta : (j,) array [prior standard deviations]
    covariance : (j, j) array
    at_scales : (t,) array
        Log evidence with them less that without, at each set of factors of the base.
    """

    log_bayes: float
    predictive: Array
    theta: Array
    covariance: Array
    at_scales: Array
