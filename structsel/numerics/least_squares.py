"""Refit of the terms that were kept: a streamed triangular factor, so the printed numbers keep all their digits.

Moments choose terms; their accuracy is eps cond^2. The chosen few are fitted once more through ``Z = Q R``, whose
error is eps cond, a slab of samples at a time: ``R`` of everything so far is stacked on the next slab and factored
again, so neither ``Q`` nor ``Z`` is held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from structsel.errors import SelectionError
from structsel.numerics.colour import WHITE, Colour, LagMoments, fit_ar, reference_sigma, whiten_rows
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.rows import Array, RowMaker, Signals, base_scale, column_scale

SLAB_ROWS = 4096


@dataclass(frozen=True)
class Fit:
    """Least squares of one response on the constant and k terms.

    Attributes
    ----------
    theta : (1 + k,) array
        Parameters in physical units, the constant first.
    unscaled_covariance : (1 + k, 1 + k) array
        inv(X'X) of the (whitened) regressors; times `s2` it is the covariance of `theta`.
    rss : float
        Residual sum of squares of the (whitened) response.
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
        """Residual variance rss / dof; of the innovation, where the fit was whitened."""
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


def _stretches(
    manoeuvres: Sequence[Signals], exponents: NDArray[np.integer], reach: Sequence[int], response: int
) -> Iterator[tuple[int, Array, int]]:
    """(manoeuvre, scaled rows [1, x, y] with its reach of past samples, reach) in order, chunk by chunk."""
    scales = base_scale(manoeuvres)
    words = words_of(exponents)
    p = len(words)
    plan = plan_rows(words)
    for k, signals in enumerate(manoeuvres):
        maker = RowMaker(plan, p, scales, reach[k])
        for rows, _, _ in maker.chunks(signals, reach[k], signals.n):
            rows[1 + p] = rows[1 + p + response]
            yield k, rows[: p + 2], reach[k]


def refit(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    response: int = 0,
    colours: Sequence[Colour] | None = None,
) -> Fit:
    """Fit the constant and these terms by a streamed QR factor.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : (k, s) int array
        The kept terms only.
    response : int
        Which response.
    colours : sequence of Colour, optional
        One per manoeuvre; white where absent.

    Raises
    ------
    SelectionError
        Where there are fewer samples than parameters, or the terms are exactly dependent.
    """
    p = len(exponents)
    of = colours if colours is not None else [WHITE] * len(manoeuvres)
    level = reference_sigma(of, [m.n for m in manoeuvres])
    buffer = np.empty((p + 2, SLAB_ROWS))
    factor = np.zeros((0, p + 2))
    filled = n = 0

    def reduce(filled: int) -> Array:
        stacked = np.vstack([factor, buffer[:, :filled].T])
        return np.asarray(np.linalg.qr(stacked, mode="r"))

    for k, rows, reach in _stretches(manoeuvres, exponents, [c.order for c in of], response):
        width = rows.shape[1] - reach
        if filled + width > SLAB_ROWS:
            factor, filled = reduce(filled), 0
        whiten_rows(rows, of[k].ar, level / of[k].sigma, reach, buffer[:, filled : filled + width])
        filled += width
        n += width
    if n < p + 1:
        raise SelectionError(
            f"refit has {n} samples for {p + 1} parameters. Record longer, or ask for fewer terms (max_terms)."
        )
    R = reduce(filled)
    R = np.vstack([R, np.zeros((max(p + 2 - R.shape[0], 0), p + 2))])
    scale = column_scale(exponents, *base_scale(manoeuvres))
    scale = np.append(scale[: p + 1], scale[p + 1 + response])
    return solve_factor(R, scale, n)


def solve_factor(R: Array, scale: Array, n: int) -> Fit:
    """Parameters, covariance and condition from the factor of scaled [1, x, y].

    Raises
    ------
    SelectionError
        Where the terms are exactly dependent.
    """
    length = np.linalg.norm(R[:-1, :-1], axis=0)
    if not np.all(length > 0):
        raise SelectionError("refit: a term is zero in every sample. Leave it out, or record data that excites it.")
    unit = R[:-1, :-1] / length
    singular = np.linalg.svd(unit, compute_uv=False)
    if singular[-1] <= singular[0] * np.finfo(float).eps * unit.shape[0]:
        raise SelectionError(
            "refit: the terms are exactly dependent in these data. "
            "Drop one of them, or record data in which they differ."
        )
    theta = linalg.solve_triangular(R[:-1, :-1], R[:-1, -1])
    inverse = linalg.solve_triangular(unit, np.eye(unit.shape[0])) / length[:, None]
    back = scale[-1] / scale[:-1]
    covariance = inverse @ inverse.T / np.outer(scale[:-1], scale[:-1])
    return Fit(theta * back, covariance, float((R[-1, -1] * scale[-1]) ** 2), n, float(singular[0] / singular[-1]))


def residual_chunks(
    manoeuvres: Sequence[Signals], exponents: NDArray[np.integer], theta: Array, response: int = 0
) -> Iterator[tuple[int, Array]]:
    """Residuals y - X theta in the response's units, chunk by chunk, with their manoeuvre's index."""
    scale = column_scale(exponents, *base_scale(manoeuvres))
    out = scale[len(theta) + response]
    weights = theta * scale[: len(theta)] / out
    for k, rows, _ in _stretches(manoeuvres, exponents, [0] * len(manoeuvres), response):
        yield k, out * (rows[-1] - weights @ rows[:-1])


def residual_colours(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    theta: Array,
    response: int = 0,
    max_order: int = 24,
    floor: float = 0.0,
) -> list[Colour]:
    """An AR model of each manoeuvre's residual, order by BIC; shorter manoeuvres are offered lower orders."""
    moments = [LagMoments(max(0, min(max_order, m.n // 12 - 1))) for m in manoeuvres]
    for k, residual in residual_chunks(manoeuvres, exponents, theta, response):
        moments[k].add(residual)
    return [fit_ar(m, floor) for m in moments]
