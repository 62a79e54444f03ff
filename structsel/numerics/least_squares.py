"""Least squares over whole recordings, a few thousand samples at a time: fit, residual noise and standard errors.

Cross-products choose the terms; their accuracy is eps cond^2. The terms chosen are fitted once more through
``Z = Q R``, whose error is eps cond: ``R`` of everything so far is stacked on the next rows and factored again, so
that neither ``Q`` nor ``Z`` is held. The printed numbers are those of this fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.linalg.lapack import dgeqrf

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.blocks import Samples, attach_data, count_samples, cut_blocks, whole_manoeuvres
from structsel.numerics.jobs import JobRunner, Progress
from structsel.numerics.noise_models import (
    WHITE_NOISE,
    ARNoise,
    LagProducts,
    fit_ar,
    pooled_innovation_std,
    prewhiten,
    score_covariance,
    split_for_correlation,
)
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
SAMPLES_PER_ORDER = 12  # of a manoeuvre, for each order of its noise model


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
        Samples that counted.
    condition : float
        Condition number of the regressors scaled to unit length, constant included.
    """

    theta: Array
    unscaled_covariance: Array
    rss: float
    n: int
    condition: float

    @property
    def dof(self) -> int:
        """Residual degrees of freedom."""
        return self.n - self.theta.size

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
        Which.
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
    blocks = min(BLOCKS, sum(lengths) // BLOCK_ROWS)  # a block more is a factor more
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
    for terms, of, response in zip(exponents, models, responses, strict=True):
        p, q = len(terms), len(terms) + 2
        stacked = factors[:, at : at + q * q].reshape(-1, q)
        at += q * q
        n = int(count_samples(cut, [model.order for model in of]).sum())
        if n < p + 1:
            raise SelectionError(
                f"the fit has {n} samples for {p + 1} parameters. Record longer, or ask for fewer terms (max_terms)."
            )
        scale = column_scale(terms, scales)
        R = _triangle(np.ascontiguousarray(stacked.T))
        fits.append(solve_factor(R, np.append(scale[: p + 1], scale[p + 1 + response]), n))
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
        # A variable in each row, the factor so far before the samples: transposed, it is as LAPACK wants it.
        buffer, filled = np.zeros((q, q + SLAB)), q
        for part in block:
            model = part.noise[r]
            for rows in _rows_of(part, terms, scales, response, model.order):
                width = rows.shape[1] - model.order
                if filled + width > buffer.shape[1]:
                    buffer[:, :q], filled = _triangle(buffer[:, :filled]).T, q
                into = buffer[:, filled : filled + width]
                prewhiten(rows, model.ar, level / model.sigma, model.order, into)
                filled += width
        factors.append(_triangle(buffer[:, :filled]).ravel())
    return np.concatenate(factors)


def _rows_of(
    part: Samples, exponents: NDArray[np.integer], scales: Scales, response: int, reach: int = 0
) -> Iterator[Array]:
    """Scaled rows [1, x, y] of one response, each with its reach of past samples, a slab at a time."""
    p = len(exponents)
    chunks = RegressorChunks(words_of(exponents), scales, reach, SLAB)  # few rows: all of a slab's stay in the cache
    for rows in chunks.over(part.source, max(part.start, reach), part.stop):
        rows[1 + p] = rows[1 + p + response]
        yield rows[: p + 2]


def _triangle(variables: Array) -> Array:
    """Triangular factor R of (q, n) variables, samples or factors of them; n at least q, and they are overwritten."""
    return np.triu(dgeqrf(variables.T, overwrite_a=1)[0][: len(variables)])


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
    theta = linalg.solve_triangular(R[:-1, :-1], R[:-1, -1])
    inverse = linalg.solve_triangular(unit, np.eye(unit.shape[0])) / length[:, None]
    back = scale[-1] / scale[:-1]
    covariance = inverse @ inverse.T / np.outer(scale[:-1], scale[:-1])
    rss = float((R[-1, -1] * scale[-1]) ** 2)
    return LeastSquaresFit(theta * back, covariance, rss, n, float(singular[0] / singular[-1]))


# ---------------------------------------------------------------- residuals, their noise models and covariance


@dataclass(frozen=True)
class Residuals:
    """The residual y - X theta of one response, in its units.

    Attributes
    ----------
    exponents : (k, s) int array
    theta : (1 + k,) array
    response : int
    scales : (s,) array, (m,) array
    """

    exponents: NDArray[np.integer]
    theta: Array
    response: int
    scales: Scales

    def over(self, part: Samples) -> Iterator[Array]:
        """Residuals of a stretch, a slab at a time."""
        scale = column_scale(self.exponents, self.scales)
        unit = scale[len(self.theta) + self.response]
        weights = self.theta * scale[: len(self.theta)] / unit
        for rows in _rows_of(part, self.exponents, self.scales, self.response):
            yield unit * (rows[-1] - weights @ rows[:-1])


def fit_residual_noise(
    manoeuvres: Sequence[DataSource],
    exponents: Sequence[NDArray[np.integer]],
    theta: Sequence[Array],
    responses: Sequence[int],
    max_order: int,
    floors: Sequence[float],
    *,
    scales: Scales | None = None,
    runner: JobRunner | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[tuple[ARNoise, ...]]:
    """AR models of each manoeuvre's residuals, order by BIC, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
    exponents, theta : sequence of (k, s) int array, of (1 + k,) array
        Terms and parameters of each response.
    responses : sequence of int
        Which.
    max_order : int
        Highest order offered; shorter manoeuvres are offered lower ones.
    floors : sequence of float
        Least innovation of each response.
    scales, runner, workers, progress
        As for `cross_products`.

    Returns
    -------
    list of tuple of ARNoise
        For each response, one per manoeuvre.
    """
    scales = scales or find_scales(manoeuvres)
    residuals = [Residuals(*of, scales) for of in zip(exponents, theta, responses, strict=True)]
    blocks = attach_data(whole_manoeuvres([m.n for m in manoeuvres]), manoeuvres)
    width = len(residuals) * (2 + max_order)
    function = partial(_noise_of_block, residuals, floors, max_order)
    sizes = [len(block) * width for block in blocks]
    values = (runner or JobRunner()).run_pass(function, blocks, sizes, workers, progress)
    table = values.reshape(len(manoeuvres), len(residuals), 2 + max_order)
    return [tuple(ARNoise(row[2 : 2 + int(row[0])].copy(), float(row[1])) for row in of) for of in table.swapaxes(0, 1)]


def _noise_of_block(
    residuals: Sequence[Residuals], floors: Sequence[float], max_order: int, block: Sequence[Samples]
) -> Array:
    """Order, sigma and coefficients, padded, of every response in every manoeuvre of a block."""
    table = np.zeros((len(block), len(residuals), 2 + max_order))
    for rows, part in zip(table, block, strict=True):  # each manoeuvre is read once for all responses
        for row, residual, floor in zip(rows, residuals, floors, strict=True):
            lags = LagProducts(max(0, min(max_order, part.source.n // SAMPLES_PER_ORDER - 1)))
            for chunk in residual.over(part):
                lags.add(chunk)
            model = fit_ar(lags, floor)
            row[0], row[1], row[2 : 2 + model.order] = model.order, model.sigma, model.ar
    return table.ravel()


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

    The formula and the lag window of `structsel.numerics.noise_models.coloured_covariance`, without forming X.

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
    scales = scales or find_scales(manoeuvres)
    blocks = attach_data(whole_manoeuvres([m.n for m in manoeuvres]), manoeuvres)
    k = fit.theta.size
    function = partial(_scatter_of_block, exponents, fit.theta, response, scales)
    sizes = [k * k] * len(blocks)
    meat = (runner or JobRunner()).run_pass(function, blocks, sizes, workers).reshape(-1, k, k).sum(axis=0)
    scale = column_scale(exponents, scales)
    meat = 0.5 * (meat + meat.T) * np.outer(scale[:k], scale[:k]) * scale[k + response] ** 2
    bread = fit.unscaled_covariance
    return bread @ meat @ bread * (fit.n / max(fit.dof, 1))


def _scatter_of_block(
    exponents: NDArray[np.integer], theta: Array, response: int, scales: Scales, block: Sequence[Samples]
) -> Array:
    """Sum of x(i) R(i - j) x(j)' over a block, in scaled units."""
    k = theta.size
    chunks = RegressorChunks(words_of(exponents), scales)
    scale = column_scale(exponents, scales)
    weights = theta * scale[:k] / scale[k + response]
    meat = np.zeros((k, k))
    for part in block:
        for a, b in split_for_correlation(part.stop - part.start):
            parts = [rows.copy() for rows in chunks.over(part.source, part.start + a, part.start + b)]
            rows = np.concatenate(parts, axis=1)
            residual = rows[k + response] - weights @ rows[:k]
            meat += score_covariance(rows[:k, :, None], residual[:, None])
    return meat.ravel()
