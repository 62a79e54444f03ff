"""Principal-components and ridge regression: estimates that trade bias for variance.

Arrays only. ``C`` is the (p+1, p+1) centred cross-product matrix of [x_1 ... x_p, y], ``dof`` the
samples less those swept out for the constant (N - 1). Held-out folds come as pairs of such matrices;
each is centred on its own mean, so a held-out manoeuvre keeps its own constant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.criteria import pse
from structsel.numerics.stepwise import check_products


@dataclass(frozen=True)
class BiasedEstimate:
    """Coefficients that accept a bias to reduce variance.

    Attributes
    ----------
    method : str
        What was done, in words; it always says that the estimate is biased.
    theta : (p,) array [response per candidate]
    covariance : (p, p) array
        Of theta about its own mean: the bias is *not* in it.
    rss : float [response^2]
    effective_terms : float [-]
        Trace of the hat matrix, the constant not counted.
    choice : float
        Number of components, or the ridge constant.
    explained : (p,) array [-]
        Share of the standardised candidates' variance along each principal direction, descending.
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


def principal_components(C: ArrayLike, dof: float, n_components: int) -> BiasedEstimate:
    """Principal-components regression on standardised candidates, back in physical coefficients.

    With R = V diag(l) V' the candidates' correlation matrix, l descending, D their root sums of squares and
    r = D^-1 X'y::

        theta = D^-1 V_m diag(1/l) V_m' r,   cov = s^2 D^-1 V_m diag(1/l) V_m' D^-1,   s^2 = rss / (dof - m)

    Parameters
    ----------
    C : (p+1, p+1) array
    dof : float [-]
    n_components : int
        m, from 1 to the rank; with m = p this is ordinary least squares.

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
    C = check_products(C, dof, "principal_components")
    root, size, V, z = _principal(C, "principal_components")
    m = int(n_components)
    rank = int(np.sum(size > size[0] * size.size * 1e-15))
    if not 1 <= m <= rank or m >= dof:
        raise SelectionError(
            f"principal_components needs 1 to {min(rank, int(np.ceil(dof)) - 1)} components; found {m}. "
            "These candidates vary in no more directions, or the samples allow no more."
        )
    G = V[:, :m] / root[:, None]
    theta = G @ (z[:m] / size[:m])
    rss = max(float(C[-1, -1] - np.sum(z[:m] ** 2 / size[:m])), 0.0)
    covariance = rss / (dof - m) * (G / size[:m]) @ G.T
    method = f"principal components, {m} of {size.size}: biased" if m < size.size else "all components"
    return BiasedEstimate(
        method,
        _fixed(theta),
        _fixed(covariance),
        rss,
        float(m),
        float(m),
        _fixed(size / size.sum()),
        m < size.size,
    )


def components_by_variance(C: ArrayLike, share: float = 0.99) -> int:
    """Fewest principal components that hold a share of the standardised candidates' variance.

    Parameters
    ----------
    C : (p+1, p+1) array
    share : float [-]

    Returns
    -------
    n_components : int
    """
    if not 0.0 < share <= 1.0:
        raise SelectionError(f"components_by_variance needs a share between 0 and 1; found {share:g}. 0.99 is usual.")
    C = check_products(C, np.inf, "components_by_variance")
    _, size, _, _ = _principal(C, "components_by_variance")
    # A hair below, so that rounding does not ask for a component more.
    return int(np.searchsorted(np.cumsum(size) / size.sum(), share - 1e-12) + 1)


def components_by_pse(C: ArrayLike, dof: float, sigma_max2: float | None = None) -> int:
    """Number of principal components, largest first, of least predicted squared error.

    Parameters
    ----------
    C : (p+1, p+1) array
    dof : float [-]
    sigma_max2 : float [response^2], optional
        Default tss / N.

    Returns
    -------
    n_components : int
    """
    C = check_products(C, dof, "components_by_pse")
    _, size, _, z = _principal(C, "components_by_pse")
    rank = min(int(np.sum(size > size[0] * size.size * 1e-15)), int(np.ceil(dof)) - 1)
    tss = float(C[-1, -1])
    rss = np.maximum(tss - np.cumsum(z[:rank] ** 2 / size[:rank]), 0.0)
    return 1 + int(np.argmin(pse(rss, tss, dof + 1.0, np.arange(1, rank + 1), sigma_max2)))


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
    _check_folds(train, test, "components_by_folds")
    curves = []
    for fit, held_out in zip(train, test, strict=True):
        C = check_products(fit, np.inf, "components_by_folds")
        root, size, V, z = _principal(C, "components_by_folds")
        rank = int(np.sum(size > size[0] * size.size * 1e-15))
        thetas = np.cumsum((V * (z / np.where(size > 0.0, size, 1.0)))[:, :rank], axis=1) / root[:, None]
        curves.append(_held_out(thetas, held_out))
    m = min(curve.size for curve in curves)
    error = np.sum([curve[:m] for curve in curves], axis=0)
    return 1 + int(np.argmin(error)), _fixed(error)


def ridge(C: ArrayLike, dof: float, k: float) -> BiasedEstimate:
    """Ridge regression on standardised candidates, back in physical coefficients.

    With R, r, D as in :func:`principal_components`::

        theta = D^-1 (R + k I)^-1 r,   cov = s^2 D^-1 (R + k I)^-1 R (R + k I)^-1 D^-1
        s^2 = rss / (dof - tr(R (R + k I)^-1))

    Parameters
    ----------
    C : (p+1, p+1) array
    dof : float [-]
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
    C = check_products(C, dof, "ridge")
    if not 0.0 < k < np.inf:
        raise SelectionError(f"ridge needs a constant above zero; found {k:g}. Use least squares for zero.")
    root, size, V, z = _principal(C, "ridge")
    G = V / root[:, None]
    size = np.maximum(size, 0.0)
    theta = G @ (z / (size + k))
    effective = float(np.sum(size / (size + k)))
    rss = max(_ridge_rss(float(C[-1, -1]), size, z, k), 0.0)
    s2 = rss / (dof - effective) if dof > effective else np.nan
    covariance = s2 * (G * (size / (size + k) ** 2)) @ G.T
    method = f"ridge, k = {k:.3g}: biased"
    return BiasedEstimate(
        method, _fixed(theta), _fixed(covariance), rss, effective, float(k), _fixed(size / size.sum())
    )


def ridge_by_gcv(C: ArrayLike, dof: float) -> float:
    """Ridge constant of least generalised cross-validation error, between 1e-10 and 1e2.

    N rss(k) / (N - 1 - tr H(k))^2 with N = dof + 1. Samples must be independent for this to be fair; with
    coloured residuals use whitened products or :func:`ridge_by_folds`.

    Parameters
    ----------
    C : (p+1, p+1) array
    dof : float [-]

    Returns
    -------
    k : float [-]
    """
    C = check_products(C, dof, "ridge_by_gcv")
    _, size, _, z = _principal(C, "ridge_by_gcv")
    size, tss = np.maximum(size, 0.0), float(C[-1, -1])

    def gcv(log_k: float) -> float:
        k = 10.0**log_k
        room = dof - float(np.sum(size / (size + k)))
        return (dof + 1.0) * _ridge_rss(tss, size, z, k) / (tss * room**2) if room > 0.0 else np.inf

    return _least(gcv)


def ridge_by_folds(train: Sequence[ArrayLike], test: Sequence[ArrayLike]) -> float:
    """Ridge constant that predicts held-out manoeuvres best, between 1e-10 and 1e2.

    Parameters
    ----------
    train, test : sequence of (p+1, p+1) array
        As in :func:`components_by_folds`.

    Returns
    -------
    k : float [-]
    """
    _check_folds(train, test, "ridge_by_folds")
    parts = [_principal(check_products(fit, np.inf, "ridge_by_folds"), "ridge_by_folds") for fit in train]

    def error(log_k: float) -> float:
        k = 10.0**log_k
        total = 0.0
        for (root, size, V, z), held_out in zip(parts, test, strict=True):
            theta = V @ (z / (np.maximum(size, 0.0) + k)) / root
            total += float(_held_out(theta[:, None], held_out)[0])
        return total

    return _least(error)


def _principal(C: Array, who: str) -> tuple[Array, Array, Array, Array]:
    """Root sums of squares, eigenvalues (descending), eigenvectors of R, and V'r."""
    p = C.shape[0] - 1
    length = np.diag(C)[:p]
    if not (length > 0.0).all():
        bad = np.flatnonzero(~(length > 0.0)).tolist()
        raise SelectionError(f"{who} needs candidates that vary; {bad} are constant. Leave them out.")
    root = np.sqrt(length)
    size, V = eigh(C[:p, :p] / np.outer(root, root))
    size, V = size[::-1], V[:, ::-1]
    return root, size, V, V.T @ (C[:p, p] / root)


def _ridge_rss(tss: float, size: Array, z: Array, k: float) -> float:
    return tss - float(np.sum(z**2 * (size + 2.0 * k) / (size + k) ** 2))


def _held_out(thetas: Array, test: ArrayLike) -> Array:
    """Sum of squared errors on a held-out fold of each column of coefficients."""
    C = np.asarray(test, dtype=float)
    cross = C[:-1, -1] @ thetas
    return C[-1, -1] - 2.0 * cross + np.einsum("im,ij,jm->m", thetas, C[:-1, :-1], thetas, optimize=True)


def _least(objective: Callable[[float], float]) -> float:
    """Constant of least objective(log10 k): a grid, since it may dip more than once, then Brent."""
    grid = np.linspace(-10.0, 2.0, 61)
    values = np.array([objective(g) for g in grid])
    at = int(np.argmin(values))
    low, high = grid[max(at - 1, 0)], grid[min(at + 1, grid.size - 1)]
    answer = minimize_scalar(objective, bounds=(low, high), method="bounded")
    best = float(answer.x) if answer.fun <= values[at] else float(grid[at])
    return float(10.0**best)


def _check_folds(train: Sequence[ArrayLike], test: Sequence[ArrayLike], who: str) -> None:
    if not len(train) or len(train) != len(test):
        raise SelectionError(
            f"{who} needs one held-out matrix for each fold; found {len(train)} to fit and {len(test)} held "
            "out. Give both for every fold."
        )


def _fixed(array: Array) -> Array:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
