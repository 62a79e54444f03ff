"""Ordinary least squares with coloured residuals: the covariance, and the fit from known cross-products in one pass.

Cross-products give parameters with an error of eps cond^2. The pass that the covariance needs also sums the score
``X'e`` of their residual, from which one step of refinement follows: corrected seminormal equations [Bj87]. With
columns that are well determined the error is then that of a triangular factor.

References
----------
[Bj87] for the refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, Progress, Samples, attach_data, complete_manoeuvres
from structsel.numerics.cross_products import CrossProducts, columns_of
from structsel.numerics.least_squares import (
    LeastSquaresFit,
    factor_of_products,
    solve_factor,
    solve_with_own_constants,
)
from structsel.numerics.regressors import (
    DataSource,
    RegressorChunks,
    Scales,
    column_scale,
    find_scales,
    words_of,
)
from structsel.numerics.score_covariance import LONGEST_SEGMENT, score_covariance, split_for_correlation


def streamed_coloured_covariance(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    fit: LeastSquaresFit,
    response: int = 0,
    *,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
    workers: int = 1,
) -> Array:
    """Covariance of an ordinary least-squares fit whose residuals are coloured.

    The formula and the lag window of `structsel.numerics.score_covariance.coloured_covariance`, without forming X.

    Parameters
    ----------
    fit : LeastSquaresFit
        The fit of these terms to this response with white noise.
    scales, runner, workers
        As for `cross_products`.

    Returns
    -------
    (1 + k, 1 + k) array

    References
    ----------
    [KM16], ch. 5, parameter covariance with coloured residuals.
    """
    return _sums_of_residuals(manoeuvres, exponents, fit, response, scales, runner, workers)[0]


def fit_of_products(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    products: CrossProducts,
    shared: CrossProducts,
    kept: Sequence[int],
    response: int = 0,
    *,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> tuple[LeastSquaresFit, Array] | None:
    """Fit of the terms kept of all candidates, and its covariance for coloured residuals.

    Parameters
    ----------
    exponents : (p, s) int array
        Of all candidates.
    products, shared : CrossProducts
        Of this response as searched, perhaps with a constant of each manoeuvre regressed out, and with one constant.
    kept : sequence of int
    response : int
    scales, runner, workers, progress
        As for `cross_products`.

    Returns
    -------
    LeastSquaresFit, (1 + k, 1 + k) array
        None where the cross-products do not determine the parameters well.
    """
    columns = columns_of(products.scale.size, kept)
    product, scale, n = products.part(columns), products.scale[columns], int(products.samples())
    if not products.own_constants:
        R = factor_of_products(product)
        fit = None if R is None else solve_factor(R, scale, n)
    else:
        R = factor_of_products(product[1:, 1:])
        sums = shared.sums_of_manoeuvres()[:, columns]
        means, lengths = sums / sums[:, :1], sums[:, 0]
        fit = None if R is None else solve_with_own_constants(means, lengths, R, scale, n, lengths / n)
    if fit is None:
        return None
    terms = exponents[list(kept)]
    covariance, sums = _sums_of_residuals(manoeuvres, terms, fit, response, scales, runner, workers, progress)
    return _corrected(fit, sums), covariance


def _corrected(fit: LeastSquaresFit, sums: Array) -> LeastSquaresFit:
    """The fit after one step of refinement, from the sums over each manoeuvre of [x, x e, e^2], (K, 2 (1 + k) + 1)."""
    k = fit.theta.size
    of_x, scores, squares = sums[:, :k], sums[:, k:-1], sums[:, -1]
    if not fit.constants.size:
        score = scores.sum(axis=0)
        step = fit.unscaled_covariance @ score
        return replace(fit, theta=fit.theta + step, rss=float(squares.sum() - step @ score))
    n = of_x[:, 0]
    means, mean_error = of_x[:, 1:] / n[:, None], scores[:, 0] / n
    score = (scores[:, 1:] - mean_error[:, None] * of_x[:, 1:]).sum(axis=0)
    step = fit.unscaled_covariance[1:, 1:] @ score
    of_constants = mean_error - means @ step
    return replace(
        fit,
        theta=fit.theta + np.append(n @ of_constants / n.sum(), step),
        rss=float(squares.sum() - mean_error @ scores[:, 0] - step @ score),
        constants=fit.constants + of_constants,
    )


def _sums_of_residuals(
    manoeuvres: Sequence[DataSource],
    exponents: NDArray[np.integer],
    fit: LeastSquaresFit,
    response: int,
    scales: Scales | None,
    runner: JobRunner | None,
    workers: int,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Covariance for coloured residuals, and the sums over each manoeuvre of [x, x e, e^2], in physical units."""
    scales, k = scales or find_scales(manoeuvres), fit.theta.size
    scale = column_scale(exponents, scales)
    size, unit = scale[:k], float(scale[k + response])
    theta = np.tile(fit.theta, (len(manoeuvres), 1))
    if fit.constants.size:
        theta[:, 0] = fit.constants
    blocks = complete_manoeuvres([m.n for m in manoeuvres])
    items = [
        (samples, theta[[part.manoeuvre for part in block]] * size / unit)
        for block, samples in zip(blocks, attach_data(blocks, manoeuvres), strict=True)
    ]
    found = (runner or JobRunner()).run_pass(
        partial(_sums_of_block, exponents, response, scales, fit.constants.size > 0),
        items,
        [k * k + len(block) * (2 * k + 1) for block in blocks],
        workers,
        progress,
    )
    middle, sums, at = np.zeros((k, k)), [], 0
    for block in blocks:
        end = at + k * k
        middle += found[at:end].reshape(k, k)
        at = end + len(block) * (2 * k + 1)
        sums.append(found[end:at].reshape(len(block), -1))
    middle = 0.5 * (middle + middle.T) * np.outer(size, size) * unit**2
    covariance = fit.unscaled_covariance @ middle @ fit.unscaled_covariance * (fit.n / max(fit.dof, 1))
    return covariance, np.vstack(sums) * np.concatenate([size, size * unit, [unit**2]])


def _sums_of_block(
    exponents: NDArray[np.integer],
    response: int,
    scales: Scales,
    own_constants: bool,
    item: tuple[Sequence[Samples], Array],
) -> Array:
    """Sum of x(i) R(i - j) x(j)' over a block, and of [x, x e, e^2] over each manoeuvre, in scaled units.

    ``item`` are the samples, and the parameters in each manoeuvre. With constants of its own the rows of the first sum
    are about their means.
    """
    block, theta = item
    k = theta.shape[1]
    longest = min(max(part.stop - part.start for part in block), LONGEST_SEGMENT)
    chunks = RegressorChunks(words_of(exponents), scales, chunk=longest)
    middle, sums = np.zeros((k, k)), np.zeros((len(block), 2 * k + 1))
    for part, weights, row in zip(block, theta, sums, strict=True):
        for a, b in split_for_correlation(part.stop - part.start):
            (rows,) = chunks.over(part.source, part.start + a, part.start + b)
            x, residual = rows[:k], rows[k + response] - weights @ rows[:k]
            of_x = x @ x[0]
            row += np.concatenate([of_x, x @ residual, [residual @ residual]])
            if own_constants:
                x, residual = x - of_x[:, None] / (b - a), residual - residual.mean()
            middle += score_covariance(x[:, :, None], residual[:, None])
    return np.concatenate([middle.ravel(), sums.ravel()])
