"""Stepwise search with cluster-robust F-tests: the clusters are blocks of samples.

Prewhitening is the efficient way to deal with coloured residuals that are noise. Where they are misfit instead (a
delayed channel, noise in the signals themselves, missing dynamics) it changes the weights of a misfit.
Here the fit stays ordinary least squares, and only the tests change: the variance of a term's score is taken from its
scatter over blocks, for any correlation inside them. With A the kept columns (and the constant), x_j|A the residual of
candidate j on them, e that of the response, and theta_j the coefficient of candidate j if it entered::

    d_j  = sum_t x_j|A^2,     theta_j = sum_t x_j|A e / d_j
    u_bj = sum_{t in b} x_j|A (e - theta_j x_j|A)
    F_j  = theta_j^2 d_j^2 / sum_b u_bj^2  (B - k - 1) / B

to be compared with F of 1 and B - 1 degrees of freedom.

References
----------
The variance is the cluster-robust one of generalised estimating equations; [C89] and [TP1916] for the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.search_path import SearchPath, SearchStep

PERFECT = 1e-12  # of the response's sum of squares


class _Clusters:
    """Weighted cross-products of every block; a column is unpacked when it is first used."""

    def __init__(self, products: CrossProducts, weights: Array | None):
        q = products.scale.size
        self.used = np.flatnonzero(weights > 0) if weights is not None else np.arange(products.n_blocks)
        self.weights = np.ones(self.used.size) if weights is None else weights[self.used]
        self.packed = products.packed
        i = np.arange(q)
        self.start = i * q - i * (i - 1) // 2 - i  # packed place of (i, j) is start[i] + j, j >= i
        self.columns: dict[int, Array] = {}
        self.squares = self.packed[np.ix_(self.used, self.start + i)] * self.weights[:, None]

    @property
    def count(self) -> int:
        """Blocks of weight above zero."""
        return int(self.used.size)

    def column(self, j: int) -> Array:
        """(B, q): products of column j with all columns, block by block."""
        if j not in self.columns:
            i = np.arange(self.start.size)
            at = np.where(i <= j, self.start[i] + j, self.start[j] + i)
            self.columns[j] = self.packed[np.ix_(self.used, at)] * self.weights[:, None]
        return self.columns[j]


@dataclass(frozen=True, eq=False)
class _ClusterFit:
    """Least squares on the kept columns, and every candidate's test given them.

    Attributes
    ----------
    rss : float
    theta : (1 + k,) array
        Of the constant and the kept candidates.
    F_kept : (k,) array
        Cluster-robust partial F of the kept ones.
    F, gain, sign : (p,) array
        Of every candidate if it entered: cluster-robust partial F, reduction of rss, sign of its coefficient.
    tolerance : (p,) array
        Fraction of each candidate's sum of squares that the kept ones do not explain.
    """

    rss: float
    theta: Array
    F_kept: Array
    F: Array
    gain: Array
    sign: Array
    tolerance: Array


def _fit(G: Array, clusters: _Clusters, kept: Sequence[int]) -> _ClusterFit:
    """Fit and test, by the formulas of this file; G (q, q) are the products of Z = [1, x, y] over all blocks."""
    A = [0, *(j + 1 for j in kept)]
    y = G.shape[0] - 1
    x = slice(1, y)
    n_clusters = clusters.count
    shrink = max(n_clusters - len(kept) - 1, 0) / n_clusters

    # Every column regressed on the kept ones: beta = (G_AA)^-1 G_A, (k+1, q).
    size = np.sqrt(np.diag(G)[A])
    factor = scipy.linalg.cho_factor(G[np.ix_(A, A)] / np.outer(size, size))
    beta = scipy.linalg.cho_solve(factor, G[A] / size[:, None]) / size[:, None]
    theta = beta[:, y]
    rss = max(float(G[y, y] - G[A, y] @ theta), 0.0)
    d = np.diag(G)[x] - np.einsum("ij,ij->j", G[A, x], beta[:, x])

    # Scores by block: sum_{t in b} e z, and of it the part that is orthogonal to A, (B, p).
    e_z = clusters.column(y) - sum(t * clusters.column(a) for t, a in zip(theta, A, strict=True))
    scores = (e_z - e_z[:, A] @ beta)[:, x]
    total = scores.sum(axis=0)
    value = np.where(d > 0, total / np.where(d > 0, d, 1.0), 0.0)

    # sum_{t in b} x_j|A^2 = G_b,jj + beta_j' (G_b,AA beta_j - 2 G_b,Aj), (B, p).
    G_b = np.stack([clusters.column(a) for a in A], axis=1)  # (B, k+1, q)
    inner = np.einsum("bij,jc->bic", G_b[:, :, A], beta) - 2.0 * G_b
    squares = (clusters.squares + np.einsum("ic,bic->bc", beta, inner))[:, x]

    variance = ((scores - value * squares) ** 2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        F = np.where(variance > 0, total**2 / variance * shrink, 0.0)
        gain = np.where(d > 0, total**2 / d, 0.0)
        tolerance = np.where(np.diag(G)[x] > 0, d / np.diag(G)[x], 0.0)

    # The kept ones: the sandwich (G_AA)^-1 [sum_b e_b e_b'] (G_AA)^-1.
    bread = scipy.linalg.cho_solve(factor, np.eye(len(A))) / np.outer(size, size)
    sandwich = np.diag(bread @ (e_z[:, A].T @ e_z[:, A]) @ bread)
    F_kept = theta[1:] ** 2 / np.maximum(sandwich[1:], 1e-300) * shrink
    return _ClusterFit(rss, theta, F_kept, F, gain, np.sign(total), tolerance)


def cluster_F_threshold(F: float, dof: float, clusters: int) -> float:
    """F of 1 and B - 1 degrees of freedom with the probability of ``F`` of 1 and ``dof``."""
    return float(scipy.stats.f.isf(scipy.stats.f.sf(F, 1, dof), 1, max(clusters - 1, 1)))


def samples_per_independent_sample(
    products: CrossProducts, weights: Array | None, kept: Sequence[int], dof: float
) -> float:
    """Median ratio of a kept term's ordinary partial F to its cluster-robust one; 1 where none is kept."""
    if not kept:
        return 1.0
    G = products.total(weights)
    fit = _fit(G, _Clusters(products, weights), kept)
    if fit.rss <= PERFECT * G[-1, -1]:
        return 1.0
    A = [0, *(j + 1 for j in kept)]
    size = np.sqrt(np.diag(G)[A])
    variance = np.diag(np.linalg.pinv(G[np.ix_(A, A)] / np.outer(size, size))) / size**2
    F = fit.theta**2 / (variance * fit.rss / max(dof - len(kept), 1.0))
    return float(max(np.median(F[1:] / np.maximum(fit.F_kept, 1e-300)), 1.0))


def cluster_stepwise(
    products: CrossProducts,
    weights: Array | None,
    dof: float,
    *,
    F_in: float = 4.0,
    F_out: float = 4.0,
    include: Sequence[int] = (),
    initial: Sequence[int] = (),
    max_terms: int | None = None,
    min_tolerance: float = 1e-9,
    hierarchy: Hierarchy | None = None,
) -> SearchPath:
    """Modified stepwise regression with cluster-robust partial F.

    Of the candidates whose F reaches F_in, the one with the largest reduction of rss enters; kept terms below F_out
    leave; if none enters, exchanges that lower rss are tried. A term that has left, or was exchanged, does not enter
    again, so the search ends.

    Parameters
    ----------
    products : CrossProducts
        Of one response, not prewhitened.
    weights : (B,) array, optional
        Of the blocks; zero leaves one out.
    dof : float
        Samples less one.
    F_in, F_out : float
        As for `stepwise`; converted to values of equal probability for the number of blocks.
    include, initial : sequence of int
    max_terms : int, optional
    min_tolerance : float
        Least fraction of a candidate's sum of squares that the kept terms do not explain.
    hierarchy : Hierarchy, optional
        Only hierarchical models. A candidate enters with the parents that it lacks, if its F given them reaches F_in.

    Returns
    -------
    SearchPath
        F of each step is the cluster-robust one.
    """
    search = _Search(products, weights, dof, F_in, F_out, include, max_terms, min_tolerance, hierarchy)
    search.begin(initial)
    while not search.stopped:
        search.move()
    kept, fit = search.kept, search.fit
    return SearchPath(tuple(kept), fit.theta[1:], fit.rss, tuple(search.steps), (), search.stopped, search.tss, dof)


class _Search:
    """Terms kept so far and their fit; each move changes both and is recorded."""

    def __init__(
        self,
        products: CrossProducts,
        weights: Array | None,
        dof: float,
        F_in: float,
        F_out: float,
        include: Sequence[int],
        max_terms: int | None,
        min_tolerance: float,
        hierarchy: Hierarchy | None,
    ):
        self.hierarchy = None if hierarchy is None else hierarchy.without(include)
        self.G = products.total(weights)
        self.clusters = _Clusters(products, weights)
        count = self.clusters.count
        self.F_in, self.F_out = (cluster_F_threshold(F, dof, count) for F in (F_in, F_out))
        self.tss = float(self.G[-1, -1] - self.G[0, -1] ** 2 / self.G[0, 0])
        self.include, self.min_tolerance = include, min_tolerance
        self.full = "as many terms as blocks can test" if max_terms is None else "max_terms reached"
        self.most = min(max_terms if max_terms is not None else self.G.shape[0] - 2, count - 2, int(dof) - 1)
        self.kept: list[int] = []
        self.left: set[int] = set()
        self.steps: list[SearchStep] = []
        self.stopped = ""
        self.fit = self.fit_of(self.kept)

    def fit_of(self, kept: Sequence[int]) -> _ClusterFit:
        return _fit(self.G, self.clusters, kept)

    def begin(self, initial: Sequence[int]) -> None:
        """Enter the included and the initial terms."""
        for j in dict.fromkeys([*self.include, *initial]):
            if self.fit.tolerance[j] <= self.min_tolerance:
                self.steps.append(SearchStep("refuse", j, -1, np.nan, np.nan, self.fit.rss, len(self.kept)))
            else:
                self.enter(j)

    def move(self) -> None:
        """Make one move, or set the reason why there is none."""
        stay = {*self.include, *(self.hierarchy.needed_by_others(self.kept) if self.hierarchy is not None else ())}
        free = [m for m, j in enumerate(self.kept) if j not in stay]
        if self.fit.rss <= PERFECT * self.tss:
            # Only rounding error is left, and F is meaningless; terms without a loss leave.
            idle = (m for m in free if self.fit_of(self.kept[:m] + self.kept[m + 1 :]).rss <= PERFECT * self.tss)
            m = next(idle, None)
            if m is None:
                self.stopped = "perfect fit"
            else:
                self.leave(m, F=0.0, sign=0.0)
            return
        weakest = min(free, key=lambda m: self.fit.F_kept[m], default=None)
        if weakest is not None and self.fit.F_kept[weakest] < self.F_out:
            self.left.add(self.kept[weakest])
            self.leave(weakest, float(self.fit.F_kept[weakest]), float(np.sign(self.fit.theta[1 + weakest])))
            return
        if len(self.kept) >= self.most:
            self.stopped = self.full
            return
        j = self.best_entry(self.fit)
        group = [j] if j is not None and self.allows([*self.kept, j]) else self.best_group()
        for j in group:
            self.enter(j)
        if group:
            return
        if not self.swap():
            self.stopped = "no term outside reaches F_in"

    def best_entry(self, fit: _ClusterFit) -> int | None:
        """Candidate with the largest reduction of rss, of those whose F and tolerance suffice."""
        able = (self.F_in <= fit.F) & (fit.tolerance > self.min_tolerance)
        able[[*self.kept, *self.left]] = False
        return int(np.argmax(np.where(able, fit.gain, -1.0))) if able.any() else None

    def allows(self, model: Sequence[int]) -> bool:
        return self.hierarchy is None or self.hierarchy.allows(model)

    def best_group(self) -> list[int]:
        """The candidate of largest reduction of rss that can have its parents, after those that it lacks."""
        if self.hierarchy is None:
            return []
        able = (self.F_in <= self.fit.F) & (self.fit.tolerance > self.min_tolerance)
        able[[*self.kept, *self.left]] = False
        for j in sorted(np.flatnonzero(able).tolist(), key=lambda j: -self.fit.gain[j]):
            group = self.hierarchy.group_of(j, self.kept, self.fit.gain)
            *parents, _ = group
            if len(self.kept) + len(group) > self.most or (self.fit.tolerance[parents] <= self.min_tolerance).any():
                continue
            with_parents = self.fit_of([*self.kept, *parents])
            if with_parents.F[j] >= self.F_in and with_parents.tolerance[j] > self.min_tolerance:
                return group
        return []

    def enter(self, j: int) -> None:
        F, sign = float(self.fit.F[j]), float(self.fit.sign[j])
        self.kept.append(j)
        self.record("enter", j, -1, F, sign, self.fit_of(self.kept))

    def leave(self, m: int, F: float, sign: float) -> None:
        j = self.kept.pop(m)
        self.record("leave", j, -1, F, sign, self.fit_of(self.kept))

    def swap(self) -> bool:
        """Make the exchange of a kept term for one outside with the least rss, if it lowers rss."""
        best: tuple[float, int, int] | None = None
        for m, old in enumerate(self.kept):
            if old in self.include:
                continue
            fit = self.fit_of([*self.kept[:m], *self.kept[m + 1 :]])
            j = self.best_entry(fit)
            if j is not None and not self.allows([*self.kept[:m], *self.kept[m + 1 :], j]):
                continue
            if j is not None and (best is None or fit.rss - float(fit.gain[j]) < best[0]):
                best = fit.rss - float(fit.gain[j]), m, j
        if best is None:
            return False
        _, m, j = best
        old = self.kept[m]
        after = self.fit_of([*self.kept[:m], j, *self.kept[m + 1 :]])
        if after.rss >= self.fit.rss * (1.0 - 1e-10):
            return False
        self.kept[m] = j
        self.left.add(old)
        self.record("swap", j, old, float(after.F_kept[m]), float(np.sign(after.theta[1 + m])), after)
        return True

    def record(self, action: str, j: int, other: int, F: float, sign: float, after: _ClusterFit) -> None:
        before = self.fit.rss
        r2 = max(1.0 - min(before, after.rss) / max(before, after.rss, 1e-300), 0.0)
        self.steps.append(SearchStep(action, j, other, F, float(sign * np.sqrt(r2)), after.rss, len(self.kept)))
        self.fit = after
