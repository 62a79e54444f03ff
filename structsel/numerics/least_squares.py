"""Least squares over complete recordings by triangular factors, with memory independent of the number of samples.

Cross-products choose the terms; their accuracy is eps cond^2. The terms chosen are fitted once more through
``Z = Q R``, whose error is eps cond: ``R`` of everything so far is stacked on the next rows and factored again, so
that neither ``Q`` nor ``Z`` is held. The printed numbers are those of this fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, Progress, Samples, attach_data, count_samples, cut_blocks
from structsel.numerics.noise_models import WHITE_NOISE, ARNoise, pooled_innovation_std, prewhiten
from structsel.numerics.normal_equations import WELL_DETERMINED
from structsel.numerics.regressors import (
    SLAB,
    DataSource,
    RegressorChunks,
    Scales,
    column_scale,
    find_scales,
    words_of,
)

BLOCKS, BLOCK_ROWS = 8, 16384  # number of jobs of a fit, and samples that each has at least
PANEL = 4  # columns factored at once; with all of them 20 variables take 1.4 times as long


@dataclass(frozen=True)
class LeastSquaresFit:
    """Least squares of one response on the constant and k terms.

    Attributes
    ----------
    theta : (1 + k,) array
        Parameters in physical units, the constant first.
    unscaled_covariance : (1 + k, 1 + k) array
        inv(X'X) of the (prewhitened) regressors; times `s2` it is the covariance of `theta`.
    rss : float
        Residual sum of squares of the (prewhitened) response.
    n : int
        Number of samples.
    condition : float
        Condition number of the regressors scaled to unit length, constant included.
    constants : (K,) array
        Of each manoeuvre, where each has its own; the first of ``theta`` is then their mean by samples. Else empty.
    """

    theta: Array
    unscaled_covariance: Array
    rss: float
    n: int
    condition: float
    constants: Array = field(default_factory=lambda: np.empty(0))

    @property
    def dof(self) -> int:
        """Residual degrees of freedom."""
        return self.n - (self.theta.size - 1) - max(self.constants.size, 1)

    @property
    def s2(self) -> float:
        """Residual variance rss / dof; of the innovation, where the fit was prewhitened."""
        return self.rss / max(self.dof, 1)

    @property
    def covariance(self) -> Array:
        """s2 inv(X'X)."""
        return self.s2 * self.unscaled_covariance

    @property
    def partial_F(self) -> Array:
        """theta^2 / var(theta) of every parameter, the constant first."""
        with np.errstate(divide="ignore"):
            return self.theta**2 / np.diag(self.covariance)


def fit_terms(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    noise: Sequence[ARNoise] | None = None,
    response: int = 0,
) -> LeastSquaresFit:
    """Fit the constant and these terms to one response; see `fit_each`."""
    return fit_each(manoeuvres, [exponents], [noise], [response])[0]


def fit_each(
    manoeuvres: Sequence[DataSource],
    exponents: Sequence[NDArray[np.integer]],
    noise: Sequence[Sequence[ARNoise] | None],
    responses: Sequence[int],
    *,
    own_constants: Sequence[bool] | None = None,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[LeastSquaresFit]:
    """Fit the constant and the terms of several responses by streamed QR factors, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
    exponents : sequence of (k, s) int array
        The terms of each response.
    noise : sequence of (sequence of ARNoise, or None)
        Of each response, one per manoeuvre; white where None.
    responses : sequence of int
        Number of each response.
    own_constants : sequence of bool, optional
        Which responses have a constant of each manoeuvre; by default none.
    scales, runner, workers, progress
        As for `cross_products`.

    Raises
    ------
    SelectionError
        Where there are fewer samples than parameters, or the terms are exactly dependent.
    """
    scales = scales or find_scales(manoeuvres)
    lengths = [m.n for m in manoeuvres]
    models = [of if of is not None else [WHITE_NOISE] * len(manoeuvres) for of in noise]
    blocks = min(BLOCKS, sum(lengths) // BLOCK_ROWS)  # every block has its own factor
    cut = cut_blocks(lengths, blocks, max(len(terms) for terms in exponents))
    size = sum((2 + len(terms)) ** 2 for terms in exponents)
    levels = [pooled_innovation_std(of, lengths) for of in models]
    factors = (
        (runner or JobRunner())
        .run_pass(
            partial(_factors_of_block, exponents, responses, levels, scales),
            attach_data(cut, manoeuvres, models),
            [size] * len(cut),
            workers,
            progress,
        )
        .reshape(len(cut), size)
    )
    fits, at = [], 0
    own = [False] * len(models) if own_constants is None else own_constants
    for terms, of, response, separate in zip(exponents, models, responses, own, strict=True):
        p, q = len(terms), len(terms) + 2
        stacked = factors[:, at : at + q * q].reshape(-1, q)
        at += q * q
        n = int(count_samples(cut, [model.order for model in of]).sum())
        if n < p + 1:
            raise SelectionError(
                f"the fit has {n} samples for {p + 1} parameters. Record longer, or ask for fewer terms (max_terms)."
            )
        scale = column_scale(terms, scales)
        scale = np.append(scale[: p + 1], scale[p + 1 + response])
        if separate:
            by_block = stacked.reshape(len(cut), q, q)
            groups = [[b for b, block in enumerate(cut) if block[0].manoeuvre == k] for k in range(len(manoeuvres))]
            parts = [_factor(by_block[group].reshape(-1, q).T) for group in groups]
            # The first row of a manoeuvre's factor is the component along its constant, the others what this leaves.
            means, squares = zip(*((R[0] / R[0, 0], R[0, 0] ** 2) for R in parts))
            within = _factor(np.vstack([R[1:, 1:] for R in parts]).T)
            weights = np.array(lengths) / sum(lengths)
            fits.append(solve_with_own_constants(np.array(means), np.array(squares), within, scale, n, weights))
        else:
            fits.append(solve_factor(_factor(stacked.T), scale, n))
    return fits


def _factors_of_block(
    exponents: Sequence[NDArray[np.integer]],
    responses: Sequence[int],
    levels: Sequence[float],
    scales: Scales,
    block: Sequence[Samples],
) -> Array:
    """A triangular factor of prewhitened [1, x, y] for each response, zeros below the diagonal included."""
    factors = []
    for r, (terms, response, level) in enumerate(zip(exponents, responses, levels, strict=True)):
        q = len(terms) + 2
        R, workspace = np.zeros((q, q), order="F"), np.empty(q * SLAB)
        for part in block:
            model = part.noise[r]
            for rows in response_rows(part, terms, scales, response, model.order):
                width = rows.shape[1] - model.order
                filtered = workspace[: q * width].reshape(q, width)
                prewhiten(rows, model.ar, level / model.sigma, model.order, filtered)
                R = _factor_with(R, filtered)
        factors.append(R.ravel())
    return np.concatenate(factors)


def response_rows(
    part: Samples, exponents: NDArray[np.integer], scales: Scales, response: int, reach: int = 0
) -> Iterator[Array]:
    """Scaled rows [1, x, y] of one response by slabs, each with `reach` past samples."""
    p = len(exponents)
    chunks = RegressorChunks(words_of(exponents), scales, reach, SLAB)  # few rows: those of a slab fit in the cache
    for rows in chunks.over(part.source, max(part.start, reach), part.stop):
        rows[1 + p] = rows[1 + p + response]
        yield rows[: p + 2]


def _factor(rows: Array) -> Array:
    """Triangular factor R (q, q) of variables, or of the columns of factors that are stacked, in rows (q, n)."""
    q = len(rows)
    return _factor_with(np.zeros((q, q), order="F"), np.ascontiguousarray(rows))


def _factor_with(R: Array, rows: Array) -> Array:
    """Triangular factor of what R (q, q), in Fortran order, is of and of further rows (q, n); both are overwritten."""
    return scipy.linalg.lapack.dtpqrt(0, min(PANEL, len(R)), R, rows.T, overwrite_a=1, overwrite_b=1)[0]


def solve_factor(R: Array, scale: Array, n: int) -> LeastSquaresFit:
    """Parameters, covariance and condition from the factor of scaled [1, x, y].

    Raises
    ------
    SelectionError
        Where the terms are exactly dependent.
    """
    length = np.linalg.norm(R[:-1, :-1], axis=0)
    if not np.all(length > 0):
        raise SelectionError("the fit has a term that is zero in every sample. Leave it out, or record its motion.")
    unit = R[:-1, :-1] / length
    singular = np.linalg.svd(unit, compute_uv=False)
    if singular[-1] <= singular[0] * np.finfo(float).eps * unit.shape[0]:
        raise SelectionError(
            "the fit has terms that are exactly dependent in these data. "
            "Drop one of them, or record data in which they differ."
        )
    theta = scipy.linalg.solve_triangular(R[:-1, :-1], R[:-1, -1])
    inverse = scipy.linalg.solve_triangular(unit, np.eye(unit.shape[0])) / length[:, None]
    back = scale[-1] / scale[:-1]
    covariance = inverse @ inverse.T / np.outer(scale[:-1], scale[:-1])
    rss = float((R[-1, -1] * scale[-1]) ** 2)
    return LeastSquaresFit(theta * back, covariance, rss, n, float(singular[0] / singular[-1]))


def factor_of_products(product: Array) -> Array | None:
    """Triangular factor of [x, y] from their products; None where these do not determine the parameters well."""
    root = np.sqrt(product.diagonal())
    if not root.size > 1 or not root.min() > 0.0:
        return None
    unit = product / np.outer(root, root)
    factor, failed = scipy.linalg.lapack.dpotrf(unit[:-1, :-1])
    if failed or factor.diagonal().min() <= WELL_DETERMINED:
        return None
    along = scipy.linalg.solve_triangular(factor, unit[:-1, -1], trans="T")
    R = np.zeros(product.shape)
    R[:-1, :-1], R[:-1, -1], R[-1, -1] = factor, along, np.sqrt(max(1.0 - along @ along, 0.0))
    return R * root


def solve_with_own_constants(
    means: Array, squares: Array, R: Array, scale: Array, n: int, weights: Array
) -> LeastSquaresFit:
    """Parameters with a constant of each manoeuvre, from scaled [1, x, y].

    The constant reported is the mean of the constants by ``weights``; its covariance is that of the mean of these
    manoeuvres, without their scatter.

    Parameters
    ----------
    means : (K, 2 + k) array
        Coefficients of [1, x, y] on the constant of each manoeuvre.
    squares : (K,) array
        Sum of squares of each constant column.
    R : (1 + k, 1 + k) array
        Triangular factor of what the constants leave of [x, y].
    scale, n
        Of [1, x, y], and the number of samples.
    weights : (K,) array

    Raises
    ------
    SelectionError
        Where the terms are exactly dependent within the manoeuvres, or none is left.
    """
    alone = float(weights**2 @ (1.0 / squares))
    if len(scale) == 2:
        constants = means[:, -1] * scale[-1]
        rss = float(R[0, 0] ** 2) * scale[-1] ** 2
        return LeastSquaresFit(np.array([weights @ constants]), np.array([[alone]]), rss, n, 1.0, constants)
    slopes = solve_factor(R, scale[1:], n)
    constants = (means[:, -1] - means[:, 1:-1] @ (slopes.theta * scale[1:-1] / scale[-1])) * scale[-1]
    mean = weights @ means[:, 1:-1] * scale[1:-1]
    covariance = with_mean_constant(slopes.unscaled_covariance, mean, alone)
    theta = np.append(weights @ constants, slopes.theta)
    return LeastSquaresFit(theta, covariance, slopes.rss, n, slopes.condition, constants)


def with_mean_constant(slopes: Array, means: Array, alone: float) -> Array:
    """Covariance (1 + k, 1 + k) of the mean of the manoeuvres' constants and of the slopes.

    Parameters
    ----------
    slopes : (k, k) array
        Covariance of the slopes.
    means : (k,) array
        Mean of each regressor over the manoeuvres, with the weights of the mean constant.
    alone : float
        Variance of the mean constant for known slopes.
    """
    across = -slopes @ means
    return np.block([[np.array([[alone - means @ across]]), across[None, :]], [across[:, None], slopes]])
