"""Least squares over complete recordings by triangular factors, with memory independent of the number of samples.

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
from structsel.numerics.blocks import JobRunner, Progress, Samples, attach_data, count_samples, cut_blocks
from structsel.numerics.noise_models import WHITE_NOISE, ARNoise, pooled_innovation_std, prewhiten
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
        Number of each response.
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
        # Each row is a variable, the factor so far before the samples; the transpose has the order of LAPACK.
        buffer, filled = np.zeros((q, q + SLAB)), q
        for part in block:
            model = part.noise[r]
            for rows in response_rows(part, terms, scales, response, model.order):
                width = rows.shape[1] - model.order
                if filled + width > buffer.shape[1]:
                    buffer[:, :q], filled = _triangle(buffer[:, :filled]).T, q
                into = buffer[:, filled : filled + width]
                prewhiten(rows, model.ar, level / model.sigma, model.order, into)
                filled += width
        factors.append(_triangle(buffer[:, :filled]).ravel())
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
