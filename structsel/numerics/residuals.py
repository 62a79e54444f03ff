"""Residuals of a least-squares fit over recordings, and their noise models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, Progress, Samples, attach_data, complete_manoeuvres
from structsel.numerics.least_squares import response_rows
from structsel.numerics.noise_models import ARNoise, LagProducts, fit_ar_of_manoeuvres
from structsel.numerics.regressors import DataSource, Scales, column_scale, find_scales

SAMPLES_PER_ORDER = 12  # least number of samples of a manoeuvre for each order of its noise model


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
        """Residuals of these samples, by slabs."""
        scale = column_scale(self.exponents, self.scales)
        unit = scale[len(self.theta) + self.response]
        weights = self.theta * scale[: len(self.theta)] / unit
        for rows in response_rows(part, self.exponents, self.scales, self.response):
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
    """AR models of the residuals, of each manoeuvre or common to all, by BIC, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
    exponents, theta : sequence of (k, s) int array, of (1 + k,) array
        Terms and parameters of each response.
    responses : sequence of int
        Number of each response.
    max_order : int
        Maximum order; it is lower for short manoeuvres.
    floors : sequence of float
        Least standard deviation of the innovation of each response.
    scales, runner, workers, progress
        As for `cross_products`.

    Returns
    -------
    list of tuple of ARNoise
        For each response, one per manoeuvre.
    """
    scales = scales or find_scales(manoeuvres)
    residuals = [Residuals(*of, scales) for of in zip(exponents, theta, responses, strict=True)]
    blocks = attach_data(complete_manoeuvres([m.n for m in manoeuvres]), manoeuvres)
    width = (max_order + 1) ** 2
    function = partial(_lags_of_block, residuals, max_order)
    sizes = [len(block) * len(residuals) * width for block in blocks]
    values = (runner or JobRunner()).run_pass(function, blocks, sizes, workers, progress)
    table = values.reshape(len(manoeuvres), len(residuals), width)
    orders = [_longest_lag(m.n, max_order) for m in manoeuvres]
    return [
        fit_ar_of_manoeuvres(
            [
                LagProducts.of(row[: (order + 1) ** 2].reshape(order + 1, -1), m.n - order)
                for row, order, m in zip(of, orders, manoeuvres, strict=True)
            ],
            floor,
        )
        for of, floor in zip(table.swapaxes(0, 1), floors, strict=True)
    ]


def _longest_lag(n: int, max_order: int) -> int:
    """Maximum order of a manoeuvre of n samples."""
    return max(0, min(max_order, n // SAMPLES_PER_ORDER - 1))


def _lags_of_block(residuals: Sequence[Residuals], max_order: int, block: Sequence[Samples]) -> Array:
    """Lag products, padded, of every response in every manoeuvre of a block."""
    table = np.zeros((len(block), len(residuals), (max_order + 1) ** 2))
    for rows, part in zip(table, block, strict=True):  # each manoeuvre is read once for all responses
        for row, residual in zip(rows, residuals, strict=True):
            lags = LagProducts(_longest_lag(part.source.n, max_order))
            for chunk in residual.over(part):
                lags.add(chunk)
            row[: lags.products.size] = lags.products.ravel()
    return table.ravel()
