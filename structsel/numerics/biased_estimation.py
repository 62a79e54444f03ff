"""Biased estimation: principal-components and ridge regression, which reduce variance at the cost of a bias.

Arrays only. ``C`` is, as everywhere in the search, the (p+1, p+1) centred cross-product matrix of
[x_1 ... x_p, y] and ``dof`` the samples less those swept out for the constant (N - 1). Held-out folds come as pairs of
such matrices; each is centred on its own mean, so a held-out manoeuvre keeps its own constant.

Both methods filter the principal axes of the standardised candidates. With R = V diag(l) V' their correlation matrix,
l descending, D their root sums of squares and z = V'D^-1 X'y::

    theta = D^-1 V diag(f) z,    f_i = 1/l_i of the m largest, else 0     principal components
                                 f_i = 1/(l_i + k)                        ridge
    cov = s^2 D^-1 V diag(f^2 l) V' D^-1,    s^2 = rss / (dof - sum f l)

References
----------
[H17], [KM16]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array, read_only
from structsel.numerics.criteria import check_products, pse


@dataclass(frozen=True)
class BiasedEstimate:
    """Biased estimate of the coefficients.

    Attributes
    ----------
    method : str
        Name of the method with its setting; it states that the estimate is biased.
    theta : (p,) array [response per candidate]
    covariance : (p, p) array
        Of theta about its expected value, without the bias.
    rss : float [response^2]
    effective_terms : float [-]
        Trace of the hat matrix, the constant not counted.
    choice : float
        Number of components, or the ridge constant.
    explained : (p,) array [-]
        Fraction of the standardised candidates' variance along each principal direction, descending.
    biased : bool
    """

    method: str
    theta: Array
    covariance: Array
    rss: float
    effective_terms: float
    choice: float
    explained: Array
    biased: bool = True


class _PrincipalAxes(NamedTuple):
    """Principal axes of the standardised candidates, by the letters of this file's docstring."""

    D: Array  # (p,) root sums of squares
    l: Array  # (p,) variances along the axes, descending
    V: Array  # (p, p)
    z: Array  # (p,)
    tss: float

    @property
    def rank(self) -> int:
        """Directions in which the candidates vary."""
        return int(np.sum(self.l > self.l[0] * self.l.size * 1e-15))

    def theta(self, f: Array) -> Array:
        """Coefficients (p,) or (p, m), from the filter factors (p,) or (p, m) of z."""
        return (
            self.V @ (f * (self.z if f.ndim == 1 else self.z[:, None])) / (self.D if f.ndim == 1 else self.D[:, None])
        )

    def rss(self, f: Array) -> float:
        """Residual sum of squares, tss - sum z^2 f (2 - l f), not below zero."""
        return max(self.tss - float(np.sum(self.z**2 * f * (2.0 - self.l * f))), 0.0)

    def ridge(self, k: float) -> Array:
        """Filter factors of ridge regression."""
        return 1.0 / (np.maximum(self.l, 0.0) + k)


def _principal_axes(C: ArrayLike, dof: float, who: str) -> _PrincipalAxes:
    C = check_products(C, dof, who)
    p = C.shape[0] - 1
    squares = np.diag(C)[:p]
    if not (squares > 0.0).all():
        bad = np.flatnonzero(~(squares > 0.0)).tolist()
        raise SelectionError(f"{who} needs candidates that vary; {bad} are constant. Leave them out.")
    D = np.sqrt(squares)
    l, V = scipy.linalg.eigh(C[:p, :p] / np.outer(D, D))
    l, V = l[::-1], V[:, ::-1]
    return _PrincipalAxes(D, l, V, V.T @ (C[:p, p] / D), float(C[-1, -1]))


def _estimate(axes: _PrincipalAxes, dof: float, f: Array, method: str, choice: float, biased: bool) -> BiasedEstimate:
    """The estimate with filter factors f."""
    l = np.maximum(axes.l, 0.0)
    effective = float(np.sum(f * l))
    rss = axes.rss(f)
    s2 = rss / (dof - effective) if dof > effective else np.nan
    G = axes.V / axes.D[:, None]
    return BiasedEstimate(
        method, read_only(axes.theta(f)), read_only(s2 * (G * (f**2 * l)) @ G.T), rss, effective, choice,
        read_only(axes.l / axes.l.sum()), biased,
    )  # fmt: skip


def principal_components(C: ArrayLike, dof: float, n_components: int) -> BiasedEstimate:
    """Principal-components regression on standardised candidates, back in physical coefficients.

    Parameters
    ----------
    n_components : int
        From 1 to the rank; with p this is ordinary least squares.

    Returns
    -------
    BiasedEstimate

    Raises
    ------
    SelectionError
        A constant candidate, or more components than directions that vary.

    References
    ----------
    [H17], [KM16]
    """
    axes = _principal_axes(C, dof, "principal_components")
    m, p, rank = int(n_components), axes.l.size, axes.rank
    if not 1 <= m <= rank or m >= dof:
        raise SelectionError(
            f"principal_components needs 1 to {min(rank, int(np.ceil(dof)) - 1)} components; found {m}. "
            "These candidates vary in no more directions, or the samples allow no more."
        )
    f = np.append(1.0 / axes.l[:m], np.zeros(p - m))
    method = f"principal components, {m} of {p}: biased" if m < p else "all components"
    return _estimate(axes, dof, f, method, float(m), m < p)


def components_by_variance(C: ArrayLike, fraction: float = 0.99) -> int:
    """Least number of principal components with a fraction of the standardised candidates' variance; C (p+1, p+1)."""
    if not 0.0 < fraction <= 1.0:
        raise SelectionError(
            f"components_by_variance needs a fraction between 0 and 1; found {fraction:g}. 0.99 is usual."
        )
    l = _principal_axes(C, np.inf, "components_by_variance").l
    # Slightly below, so that rounding does not add a component.
    return int(np.searchsorted(np.cumsum(l) / l.sum(), fraction - 1e-12) + 1)


def components_by_pse(C: ArrayLike, dof: float, sigma_max2: float | None = None) -> int:
    """Number of principal components, largest first, of least predicted squared error; sigma_max2 as in `pse`."""
    axes = _principal_axes(C, dof, "components_by_pse")
    m = min(axes.rank, int(np.ceil(dof)) - 1)
    rss = np.maximum(axes.tss - np.cumsum(axes.z[:m] ** 2 / axes.l[:m]), 0.0)
    return 1 + int(np.argmin(pse(rss, axes.tss, dof + 1.0, np.arange(1, m + 1), sigma_max2)))


def components_by_folds(train: Sequence[ArrayLike], test: Sequence[ArrayLike]) -> tuple[int, Array]:
    """Number of principal components that predicts held-out manoeuvres best.

    Parameters
    ----------
    train, test : sequence of (p+1, p+1) array
        For each fold, centred cross-products of the manoeuvres kept and of those held out.

    Returns
    -------
    n_components : int
    error : (m,) array [response^2]
        Held-out sum of squared errors with 1, 2, ... components, summed over folds; m is the smallest rank.
    """
    parts = _axes_of_folds(train, test, "components_by_folds")
    m = min(axes.rank for axes, _ in parts)
    error = np.zeros(m)
    for axes, held_out in parts:
        f = np.triu(np.ones((axes.l.size, m))) / np.where(axes.l > 0.0, axes.l, 1.0)[:, None]
        error += _squared_error(axes.theta(f), held_out)
    return 1 + int(np.argmin(error)), read_only(error)


def ridge(C: ArrayLike, dof: float, k: float) -> BiasedEstimate:
    """Ridge regression on standardised candidates, back in physical coefficients.

    Parameters
    ----------
    k : float [-]
        Ridge constant, above zero, added to correlations of 1.

    Returns
    -------
    BiasedEstimate

    Raises
    ------
    SelectionError
        k not above zero, or a constant candidate.
    """
    if not 0.0 < k < np.inf:
        raise SelectionError(f"ridge needs a constant above zero; found {k:g}. Use least squares for zero.")
    axes = _principal_axes(C, dof, "ridge")
    return _estimate(axes, dof, axes.ridge(k), f"ridge, k = {k:.3g}: biased", float(k), True)


def ridge_by_gcv(C: ArrayLike, dof: float) -> float:
    """Ridge constant of least generalised cross-validation error, between 1e-10 and 1e2.

    N rss(k) / (N - 1 - tr H(k))^2 with N = dof + 1. It assumes independent samples; with
    coloured residuals use prewhitened products or :func:`ridge_by_folds`.
    """
    axes = _principal_axes(C, dof, "ridge_by_gcv")

    def gcv(k: float) -> float:
        f = axes.ridge(k)
        left = dof - float(np.sum(f * np.maximum(axes.l, 0.0)))
        return (dof + 1.0) * axes.rss(f) / (axes.tss * left**2) if left > 0.0 else np.inf

    return _best_constant(gcv)


def ridge_by_folds(train: Sequence[ArrayLike], test: Sequence[ArrayLike]) -> float:
    """Ridge constant that predicts held-out manoeuvres best, between 1e-10 and 1e2; as :func:`components_by_folds`."""
    parts = _axes_of_folds(train, test, "ridge_by_folds")

    def error(k: float) -> float:
        return sum(float(_squared_error(axes.theta(axes.ridge(k)[:, None]), held)[0]) for axes, held in parts)

    return _best_constant(error)


def _best_constant(objective: Callable[[float], float]) -> float:
    """Ridge constant of least objective: a grid of its logarithm, since it may dip more than once, then Brent."""
    grid = np.linspace(-10.0, 2.0, 61)
    values = np.array([objective(10.0**g) for g in grid])
    at = int(np.argmin(values))
    bounds = grid[max(at - 1, 0)], grid[min(at + 1, grid.size - 1)]
    answer = scipy.optimize.minimize_scalar(lambda g: objective(10.0**g), bounds=bounds, method="bounded")
    return float(10.0 ** (float(answer.x) if answer.fun <= values[at] else float(grid[at])))


def _axes_of_folds(
    train: Sequence[ArrayLike], test: Sequence[ArrayLike], who: str
) -> list[tuple[_PrincipalAxes, ArrayLike]]:
    if not len(train) or len(train) != len(test):
        raise SelectionError(
            f"{who} needs one held-out matrix for each fold; found {len(train)} to fit and {len(test)} held "
            "out. Give both for every fold."
        )
    return [(_principal_axes(fit, np.inf, who), held_out) for fit, held_out in zip(train, test, strict=True)]


def _squared_error(thetas: Array, test: ArrayLike) -> Array:
    """Sum of squared errors on a held-out fold of each column of coefficients."""
    C = np.asarray(test, dtype=float)
    cross = C[:-1, -1] @ thetas
    return C[-1, -1] - 2.0 * cross + np.einsum("im,ij,jm->m", thetas, C[:-1, :-1], thetas, optimize=True)
