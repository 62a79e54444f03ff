"""Linear-Gaussian evidence, manoeuvre by manoeuvre.

Each manoeuvre contributes rows ``y = B beta + H theta + e`` with white e of unit variance, beta ~ N(0, 1) (the
nuisances that tolerances allow) and theta ~ N(0, 1) (the effect under trial); columns are scaled by their prior
standard deviations beforehand. Every result is a sum of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from structsel.numerics.arrays import Array


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

    def with_columns(self, cross: Array, more: NormalEquations) -> NormalEquations:
        """Products with further columns, from their products `cross` (k, j) with the columns and those of their own."""
        return NormalEquations(
            np.block([[self.A, cross], [cross.T, more.A]]), np.concatenate([self.b, more.b]), self.c, self.n
        )

    def select_columns(self, columns: Sequence[int]) -> NormalEquations:
        """Products of some of the columns, in this order."""
        at = list(columns)
        return NormalEquations(self.A[np.ix_(at, at)], self.b[at], self.c, self.n)

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
    total : NormalEquations
        Of all manoeuvres, without the factors.
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
        products = [NormalEquations.of(X, r) for X, r in zip(given, y)]
        self._set(y, [(X,) for X in given], groups, scales, products)

    def _set(
        self,
        y: Sequence[Array],
        blocks: Sequence[tuple[Array, ...]],
        groups: Sequence[tuple[int, ...]] | None,
        scales: Array | None,
        products: Sequence[NormalEquations],
        factors: tuple[Array, Array] | None = None,
    ) -> None:
        """Set up with known products of each manoeuvre; columns are in blocks. `factors` are those of `_factorise`."""
        self.y, self._blocks, self._products = list(y), list(blocks), list(products)
        self.groups = [(m,) for m in range(len(self.y))] if groups is None else list(groups)
        self.total = _sum(self._products)
        self.scales = np.ones((1, len(self.total.b))) if scales is None else scales
        self._inverse, self._rotated = factors or self._factorise()
        logs = np.log(np.diagonal(self._inverse, axis1=-2, axis2=-1)).sum(axis=-1)
        self.evidence = logs - 0.5 * (self._all_and_without([p.c for p in products]) - (self._rotated**2).sum(axis=-1))
        self.chosen = int(np.argmax(self.evidence[:, 0]))
        self.solved = (np.swapaxes(self._inverse[self.chosen], -1, -2) @ self._rotated[self.chosen][..., None])[..., 0]
        scale, inverse, mean = self.scales[self.chosen], self._inverse[self.chosen, 0], self.solved[0]
        chi2 = chi2_of(self.total, scale * mean)
        self.posterior = Posterior(mean, inverse.T @ inverse, float(self.evidence[self.chosen, 0]), chi2)

    @property
    def log_evidence(self) -> float:
        """Of all manoeuvres, summed over the sets of factors."""
        return float(scipy.special.logsumexp(self.evidence[:, 0]))

    def _all_and_without(self, each: Sequence[Any] | Array) -> Array:
        """(1 + m, ...) sums of what each manoeuvre has, of all manoeuvres and without each group."""
        parts = np.asarray(each)
        total = parts.sum(axis=0)
        return np.stack([total, *(total - parts[list(group)].sum(axis=0) for group in self.groups)])

    def _factorise(self) -> tuple[Array, Array]:
        """Inverse Cholesky factors (t, 1 + m, k, k) of the posterior precision, and the products with y by them."""
        scales = self.scales[:, None]
        A = scales[..., None] * self._all_and_without([p.A for p in self._products]) * scales[:, :, None]
        b = scales * self._all_and_without([p.b for p in self._products])
        inverse = np.linalg.inv(np.linalg.cholesky(np.eye(A.shape[-1]) + A))
        return inverse, (inverse @ b[..., None])[..., 0]

    @cached_property
    def given(self) -> list[Array]:
        """(rows, k) nuisances per manoeuvre, scaled by their prior standard deviations."""
        return [blocks[0] if len(blocks) == 1 else np.column_stack(blocks) for blocks in self._blocks]

    @cached_property
    def B(self) -> list[Array]:
        """(rows, k) nuisances per manoeuvre, scaled by the most probable factors too."""
        return [X * self.scales[self.chosen] for X in self.given]

    @property
    def inverse(self) -> Array:
        """(k, k) inverse Cholesky factor of the posterior precision, of all manoeuvres, times the factors."""
        return np.asarray(self._inverse[self.chosen, 0] * self.scales[self.chosen])

    @property
    def factored_y(self) -> Array:
        """(k,) products with y by that factor."""
        return np.asarray(self._rotated[self.chosen, 0])

    def residual(self, m: int, coefficients: Array) -> Array:
        """Rows of manoeuvre m minus their prediction by coefficients (k,) of the columns of `B`."""
        values, first, left = self.scales[self.chosen] * coefficients, 0, self.y[m]
        for X in self._blocks[m]:
            left = left - X @ values[first : first + X.shape[1]]
            first += X.shape[1]
        return left

    def with_columns(self, more: Sequence[Array]) -> Base:
        """Base with further columns (rows, j), whose priors have no factors."""
        cross = [np.vstack([X.T @ H for X in blocks]) for blocks, H in zip(self._blocks, more)]
        own = [NormalEquations.of(H, r) for H, r in zip(more, self.y)]
        products = [p.with_columns(x, o) for p, x, o in zip(self._products, cross, own)]
        # The factor is extended by the rows of the further columns: [[L, 0], [V', M]] with V = L^-1 cross.
        V = self._inverse @ (self.scales[:, None, :, None] * self._all_and_without(cross))
        turned = np.swapaxes(V, -1, -2)
        j = V.shape[-1]
        held = np.linalg.inv(np.linalg.cholesky(np.eye(j) + self._all_and_without([o.A for o in own]) - turned @ V))
        with_y = self._all_and_without([o.b for o in own]) - (turned @ self._rotated[..., None])[..., 0]
        inverse = np.zeros((*V.shape[:2], V.shape[2] + j, V.shape[2] + j))
        inverse[..., :-j, :-j], inverse[..., -j:, -j:] = self._inverse, held
        inverse[..., -j:, :-j] = -(held @ turned) @ self._inverse
        rotated = np.concatenate([self._rotated, (held @ with_y[..., None])[..., 0]], axis=-1)
        scales = np.column_stack([self.scales, np.ones((len(self.scales), j))])
        blocks = [(*old, H) for old, H in zip(self._blocks, more)]
        return Base._of(self.y, blocks, self.groups, scales, products, (inverse, rotated))

    def select_columns(self, columns: Sequence[int], scales: Array | None = None) -> Base:
        """Base with some of the columns, in this order, and with their factors or others."""
        at = list(columns)
        products = [p.select_columns(at) for p in self._products]
        blocks = [(X[:, at],) for X in self.given]
        return Base._of(self.y, blocks, self.groups, self.scales[:, at] if scales is None else scales, products)

    @classmethod
    def _of(cls, *parts: Any) -> Base:
        """Base of known products; see `_set`."""
        made = cls.__new__(cls)
        made._set(*parts)
        return made

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

        def all_and_without(name: str) -> Array:  # (1 + m, sets, ...)
            return self._all_and_without(np.stack([[getattr(one, name) for one in each] for each in sets], axis=1))

        cross, own, with_y = map(all_and_without, ("cross", "own", "with_y"))
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
