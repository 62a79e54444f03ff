"""Regression on what the past predicts: instrumental variables for regressors that follow the residual.

In turbulence, and with noise in the regressors, the regressors of a flight are predetermined, not exogenous: what the
model leaves unexplained at one moment moves the aircraft at the next, and a pilot or a damper answers it. Least squares
is then inconsistent, also after prewhitening, since derivatives and samples average over what lies between.

Let the prewhitened response of one manoeuvre be::

    y = X theta + W b + e

with W earlier residuals of the other responses (a vector autoregression), and e not predictable from the past. The
instruments Z are base signals, and products of them, several samples earlier. Two-stage least squares replaces X by its
prediction from 1, W and Z (all of them prewhitened alike)::

    theta = (Xp'Xp)^-1 Xp'y,    covariance s2 F (Xp'Xp)^-1,    s2 = |y - X theta - W b|^2 / dof

with Sargan's F where it is above one: the multiplicative random effects of many instruments.

The regressors are exogenous where theta is also that of least squares. Durbin, Wu and Hausman test this: V = X - Xp has
no effect in the regression of y on X, V and W.

Everything follows from cross-products of [1, X, Z, W, y], block by block, so that blocks may be left out or weighted.

References
----------
[SS83] instrumental variables for systems with feedback; [W10] ch. 5 and 6, two-stage least squares and the test;
[MG89] the criterion of the change in an estimate; [B17] the variance where instruments are not all valid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.least_squares import LeastSquaresFit, with_mean_constant
from structsel.numerics.normal_equations import Projection, project, solve_normal_equations

CHANCE = 0.05
"""Probability of a larger F of Sargan's with valid instruments, up to which it is no reason to eliminate a term."""
MOVED = 1.0
"""Standard errors by which a parameter moves where a linear term leaves, above which that term stays: without it the
others would be biased by more than their errors."""


@dataclass(frozen=True)
class InstrumentedProducts:
    """Prewhitened cross-products of [1, X, Z, W, y] of one response, and what follows from them.

    Attributes
    ----------
    given : CrossProducts
        The candidates of `given` are X, Z and W.
    n_candidates, n_instruments : int
        Columns of X and Z.
    other : (w,) int array
        Columns of `given` with the residuals of other responses.
    """

    given: CrossProducts
    n_candidates: int
    n_instruments: int
    other: NDArray[np.int64]
    own_constants: bool = False

    @cached_property
    def products(self) -> CrossProducts:
        """Those of `given`, within manoeuvres where each has its own constant; W is always within manoeuvres.

        The level of a residual is misfit, and would take the difference between manoeuvres from the candidates.
        """
        return self.given.within_manoeuvres(None if self.own_constants else self.other.tolist())

    @cached_property
    def without_residuals(self) -> Array:
        """(q, 2 + p + z) combinations of the columns: [1, X, Z, y] with W regressed out; W about its mean."""
        total = self.products.total()
        q, w = total.shape[0], self.other
        keep = np.concatenate([np.arange(1 + self.n_candidates + self.n_instruments), [q - 1]])
        E = np.eye(q)
        if total[0, 0] > 0.0:
            E[0, w] = -total[0, w] / total[0, 0]
        if w.size:
            centred = E.T @ total @ E
            on = project(centred, w.tolist())
            E[:, keep[1:]] -= E[:, w] @ on.coefficients[:, keep[1:]]
        return E[:, keep]

    @cached_property
    def predicted(self) -> Array:
        """(q, p) combinations of the columns: candidates predicted from the constant and the instruments."""
        E, p = self.without_residuals, self.n_candidates
        total = E.T @ self.products.total() @ E
        columns = [0, *range(1 + p, 1 + p + self.n_instruments)]
        return E[:, columns] @ project(total, columns).coefficients[:, 1 : 1 + p]

    def projected(self, kept: Sequence[int], theta: Array) -> CrossProducts:
        """Products of [1, Xp, y - (X - Xp) theta], whose least squares is two-stage least squares.

        Parameters
        ----------
        kept : sequence of int
            Candidates with parameters.
        theta : (k,) array
            Their scaled parameters. With those of the solution itself the residual is that of X, not of Xp.
        """
        E, predicted, columns = self.without_residuals, self.predicted, [1 + j for j in kept]
        response = E[:, -1] - (E[:, columns] - predicted[:, list(kept)]) @ theta
        M = np.column_stack([E[:, 0], predicted, response])
        upper = np.triu_indices(M.shape[1])
        packed = np.array([(M.T @ self.products.unpack(block) @ M)[upper] for block in self.products.packed])
        scale = np.append(self.given.scale[: 1 + self.n_candidates], self.given.scale[-1])
        return replace(self.products, scale=scale, packed=packed, n_candidates=self.n_candidates)

    def fit_terms(self, kept: Sequence[int]) -> PastFit:
        """Two-stage least squares of the constant and these candidates."""
        scaled = solve_normal_equations(self.projected((), np.empty(0)).total(), [0, *(1 + j for j in kept)])
        products = self.projected(kept, scaled[1:])
        return PastFit(self, tuple(kept), scaled, products)

    def eliminate(
        self,
        kept: Sequence[int],
        F_out: float,
        degrees: NDArray[np.integer],
        include: Sequence[int] = (),
        confounders: Sequence[int] = (),
    ) -> list[tuple[int, float, PastFit]]:
        """Candidates that leave one after another, with the partial F of each and the fit without it.

        Parameters
        ----------
        kept : sequence of int
            Candidates at the start.
        F_out : float
            Candidates of a lower partial F leave: those of the highest degree first, then the smallest F.
        degrees : (p,) int array
            Of the candidates.
        include : sequence of int
            Candidates that stay.
        confounders : sequence of int
            Those that stay where another parameter would move by more than `MOVED` without them [MG89].
        """
        left: list[tuple[int, float, PastFit]] = []
        fit, stay = self.fit_terms(kept), set(include)
        while True:
            F = fit.partial_F
            free = [i for i, j in enumerate(fit.terms) if j not in stay and F[i] < F_out]
            if not free:
                return left
            weakest = min(free, key=lambda i: (-degrees[fit.terms[i]], F[i]))
            number = fit.terms[weakest]
            without = self.fit_terms([j for j in fit.terms if j != number])
            if number in confounders and without.moved_from(fit) > MOVED:
                stay.add(number)
                continue
            fit = without
            left.append((number, float(F[weakest]), fit))


@dataclass(frozen=True)
class PastFit:
    """Parameters of the terms of one response, estimated by what the past predicts of them.

    Attributes
    ----------
    source : InstrumentedProducts
    terms : tuple of int
        Candidates of ``products``.
    scaled : (1 + k,) array
        Parameters as the products are scaled, the constant first; zero where each manoeuvre has its own.
    products : CrossProducts
        Of what the past predicts; the residual is that of the candidates themselves.
    """

    source: InstrumentedProducts
    terms: tuple[int, ...]
    scaled: Array
    products: CrossProducts

    @property
    def slopes(self) -> Array:
        """(k,) scaled parameters of the terms."""
        return self.scaled[1:]

    @property
    def theta(self) -> Array:
        """(1 + k,) parameters in physical units."""
        return self.scaled * self.products.scale[-1] / self.products.scale[self._columns]

    @property
    def _columns(self) -> list[int]:
        return [0, *(1 + j for j in self.terms)]

    @cached_property
    def _projection(self) -> Projection:
        return project(self.products.total(), self._columns)

    @property
    def rss(self) -> float:
        """Residual sum of squares, scaled."""
        return self._projection.rss

    def standard_errors(self, dispersion: float) -> Array:
        """(k,) scaled, with the variance times a factor."""
        s2 = dispersion * self.rss / max(self.products.dof() - len(self.terms) - self.source.other.size, 1.0)
        return np.sqrt(s2 * np.diag(self._projection.inverse)[1:])

    @property
    def partial_F(self) -> Array:
        """(k,) partial F of the terms; the variance has the part of Sargan's F that is beyond chance (5 %)."""
        F, _, k, dof = self._instruments
        beyond = F / scipy.stats.f.isf(CHANCE, k, dof) if k > 0 else 0.0
        with np.errstate(divide="ignore"):
            return (self.slopes / self.standard_errors(max(1.0, beyond))) ** 2

    def moved_from(self, larger: PastFit) -> float:
        """Largest difference of a parameter from its value in a model with more terms, in standard errors of this."""
        others = dict(zip(larger.terms, larger.slopes, strict=True))
        moved = self.slopes - np.array([others[j] for j in self.terms])
        return float(np.max(np.abs(moved) / self.standard_errors(self.dispersion), initial=0.0))

    def test_exogeneity(self) -> tuple[float, float]:
        """F and its probability where the terms do not follow the residual (Durbin, Wu and Hausman)."""
        E, terms = self.source.without_residuals, list(self.terms)
        M = np.column_stack([E[:, self._columns], self.source.predicted[:, terms], E[:, -1]])
        total = M.T @ self.source.products.total() @ M
        k = len(terms)
        exogenous, free = project(total, range(1 + k)), project(total, range(1 + 2 * k))
        return _test_reduction(exogenous.rss, free.rss, k, self.products.dof() - 2 * k - self.source.other.size)

    def test_instruments(self) -> tuple[float, float]:
        """F and its probability where the instruments do not follow the residual (Sargan)."""
        return self._instruments[:2]

    @cached_property
    def _instruments(self) -> tuple[float, float, int, float]:
        """Sargan's F, its probability, and its degrees of freedom."""
        E, p, z = self.source.without_residuals, self.source.n_candidates, self.source.n_instruments
        total = E.T @ self.source.products.total() @ E
        v = np.zeros(total.shape[0])
        v[self._columns], v[-1] = -self.scaled, 1.0
        M = np.column_stack([np.eye(total.shape[0])[:, [0, *range(1 + p, 1 + p + z)]], v])
        total = M.T @ total @ M
        rank = np.linalg.matrix_rank(
            total[1:-1, 1:-1] / np.outer(*(2 * [np.sqrt(np.diag(total)[1:-1])])), hermitian=True
        )
        alone, free = project(total, [0]), project(total, range(1 + z))
        dof = self.products.dof() - rank - self.source.other.size
        k = int(rank) - len(self.terms)
        return *_test_reduction(alone.rss, free.rss, k, dof), k, dof

    @cached_property
    def dispersion(self) -> float:
        """Factor of the variance [-], Sargan's F where it is above one.

        Effects of the instruments themselves are taken as random in all directions [B17].
        """
        return max(1.0, self.test_instruments()[0])

    def fit(self, constants: Array, weights: Array) -> LeastSquaresFit:
        """The same as a fit in physical units.

        Parameters
        ----------
        constants : (K,) array
            Of each manoeuvre, where each has its own, in units of the response; else empty.
        weights : (K,) array
            Samples of each manoeuvre over all.
        """
        first = 1 if constants.size else 0
        rows = self._columns[first:]
        total, unit = self.products.total()[np.ix_(rows, rows)], self.products.scale[rows]
        inverse = self._projection.inverse[first:, first:] / np.outer(unit, unit) * self.dispersion
        root = np.sqrt(np.diag(total))
        condition = float(np.sqrt(np.linalg.cond(total / np.outer(root, root)))) if rows else 1.0
        values = self.theta
        if constants.size:
            raw = self.source.given
            heads = np.array([raw.sums[raw.manoeuvre == k].sum(axis=0) for k in np.unique(raw.manoeuvre)])
            means = weights @ (heads[:, rows] / heads[:, :1]) * unit
            inverse = with_mean_constant(inverse, means, float(np.sum(weights**2 / heads[:, 0])))
            values = np.append(weights @ constants, values[1:])
        n = int(self.products.samples()) - self.source.other.size
        return LeastSquaresFit(values, inverse, self.rss * self.products.scale[-1] ** 2, n, condition, constants)


def _test_reduction(rss: float, free: float, k: int, dof: float) -> tuple[float, float]:
    """F and its probability where k further columns, which leave ``free`` of ``rss``, have no effect."""
    if k <= 0 or dof <= 0 or not free > 0.0:
        return 0.0, 1.0
    F = max(rss - free, 0.0) / k / (free / dof)
    return float(F), float(scipy.stats.f.sf(F, k, dof))
