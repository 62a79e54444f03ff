"""Refit of the terms that were kept: a streamed triangular factor, so the printed numbers keep all their digits.

Moments choose terms; their accuracy is eps cond^2. The chosen few are fitted once more through ``Z = Q R``, whose
error is eps cond, a slab of samples at a time: ``R`` of everything so far is stacked on the next slab and factored
again, so neither ``Q`` nor ``Z`` is held.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.linalg.lapack import dgeqrf

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.cutting import cut_blocks, whole_manoeuvres
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.noise_models import WHITE_NOISE, ARNoise, LagProducts, fit_ar, pooled_innovation_std, prewhiten
from structsel.numerics.passes import Part, Passes, Piece, Progress
from structsel.numerics.rows import SLAB, RowMaker, Scales, Signals, base_scale, column_scale

BLOCKS, BLOCK_ROWS = 8, 16384  # that a refit of a long manoeuvre is shared out in, and samples that one has at least


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
    piece: Piece, exponents: NDArray[np.integer], scales: Scales, response: int, reach: int = 0
) -> Iterator[Array]:
    """Scaled rows [1, x, y] of a piece, each with its reach of past samples, chunk by chunk."""
    p = len(exponents)
    # Few rows: all of a slab's stay in the cache.
    maker = RowMaker(plan_rows(words_of(exponents)), p, scales, reach, SLAB)
    for rows, _, _ in maker.chunks(piece.signals, max(piece.start, reach), piece.stop):
        rows[1 + p] = rows[1 + p + response]
        yield rows[: p + 2]


@dataclass(frozen=True)
class Factors:
    """The job of `refit_each`: a triangular factor of whitened [1, x, y] for each response, one after another.

    Attributes
    ----------
    exponents : sequence of (k, s) int array
        The kept terms of each response.
    responses : sequence of int
    levels : sequence of float
        Innovation that each response's rows are weighted to.
    scales : (s,) array, (m,) array
    """

    exponents: Sequence[NDArray[np.integer]]
    responses: Sequence[int]
    levels: Sequence[float]
    scales: Scales

    def size(self, part: Part) -> int:
        """Entries of all factors, zeros below the diagonal included."""
        return sum((2 + len(kept)) ** 2 for kept in self.exponents)

    def start(self) -> Callable[[Part], Array]:
        """A slab of rows at a time."""

        def one(part: Part) -> Array:
            return np.concatenate([self._factor(part, r).ravel() for r in range(len(self.responses))])

        return one

    def _factor(self, part: Part, r: int) -> Array:
        kept = self.exponents[r]
        q = len(kept) + 2
        # A variable in each row, the factor so far before the samples: transposed, it is as LAPACK wants it.
        buffer, filled = np.zeros((q, q + SLAB)), q
        for piece in part:
            colour = piece.colours[r]
            for rows in _stretches(piece, kept, self.scales, self.responses[r], colour.order):
                width = rows.shape[1] - colour.order
                if filled + width > buffer.shape[1]:
                    buffer[:, :q], filled = _triangle(buffer[:, :filled]).T, q
                into = buffer[:, filled : filled + width]
                prewhiten(rows, colour.ar, self.levels[r] / colour.sigma, colour.order, into)
                filled += width
        return _triangle(buffer[:, :filled])


def _triangle(variables: Array) -> Array:
    """Triangular factor R of (q, n) variables, samples or factors of them; n at least q, and they are overwritten."""
    return np.triu(dgeqrf(variables.T, overwrite_a=1)[0][: len(variables)])


def refit(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    response: int = 0,
    colours: Sequence[ARNoise] | None = None,
) -> Fit:
    """Fit the constant and these terms by a streamed QR factor; one response of `refit_each`."""
    return refit_each(manoeuvres, [exponents], [colours], [response])[0]


def refit_each(
    manoeuvres: Sequence[Signals],
    exponents: Sequence[NDArray[np.integer]],
    colours: Sequence[Sequence[ARNoise] | None],
    responses: Sequence[int],
    *,
    scales: Scales | None = None,
    passes: Passes | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Fit]:
    """Fit the constant and the kept terms of several responses by streamed QR factors, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents : sequence of (k, s) int array
        The kept terms only, of each response.
    colours : sequence of (sequence of ARNoise, or None)
        Of each response, one per manoeuvre; white where None.
    responses : sequence of int
        Which.
    scales, passes, workers, progress
        As for `accumulate`.

    Raises
    ------
    SelectionError
        Where there are fewer samples than parameters, or the terms are exactly dependent.
    """
    scales = scales or base_scale(manoeuvres)
    lengths = [m.n for m in manoeuvres]
    of = [c if c is not None else [WHITE_NOISE] * len(manoeuvres) for c in colours]
    blocks = min(BLOCKS, sum(lengths) // BLOCK_ROWS)  # a block more is a factor more
    cut = cut_blocks(lengths, blocks, max(len(kept) for kept in exponents))
    job = Factors(exponents, responses, [pooled_innovation_std(c, lengths) for c in of], scales)
    made = (passes or Passes()).over(job, cut.parts(manoeuvres, of), workers, progress).table
    fits, at = [], 0
    for kept, colour, response in zip(exponents, of, responses, strict=True):
        p, q = len(kept), len(kept) + 2
        factors = made[:, at : at + q * q].reshape(-1, q)
        at += q * q
        n = int(cut.n([c.order for c in colour]).sum())
        if n < p + 1:
            raise SelectionError(
                f"refit has {n} samples for {p + 1} parameters. Record longer, or ask for fewer terms (max_terms)."
            )
        scale = column_scale(kept, *scales)
        fits.append(
            solve_factor(
                _triangle(np.ascontiguousarray(factors.T)), np.append(scale[: p + 1], scale[p + 1 + response]), n
            )
        )
    return fits


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

    def chunks(self, piece: Piece) -> Iterator[Array]:
        """Residuals of a piece, chunk by chunk."""
        scale = column_scale(self.exponents, *self.scales)
        out = scale[len(self.theta) + self.response]
        weights = self.theta * scale[: len(self.theta)] / out
        for rows in _stretches(piece, self.exponents, self.scales, self.response):
            yield out * (rows[-1] - weights @ rows[:-1])


def residual_chunks(
    manoeuvres: Sequence[Signals], exponents: NDArray[np.integer], theta: Array, response: int = 0
) -> Iterator[tuple[int, Array]]:
    """Residuals y - X theta in the response's units, chunk by chunk, with their manoeuvre's index."""
    residuals = Residuals(exponents, theta, response, base_scale(manoeuvres))
    for k, signals in enumerate(manoeuvres):
        for chunk in residuals.chunks(Piece(signals, 0, signals.n)):
            yield k, chunk


@dataclass(frozen=True)
class Colours:
    """The job of `colours_each`: order, sigma and coefficients, padded, of every response in every manoeuvre.

    Attributes
    ----------
    residuals : sequence of Residuals
    floors : sequence of float
        Least innovation of each response.
    max_order : int
    """

    residuals: Sequence[Residuals]
    floors: Sequence[float]
    max_order: int

    def size(self, part: Part) -> int:
        """A row for each response in each manoeuvre."""
        return len(part) * len(self.residuals) * (2 + self.max_order)

    def start(self) -> Callable[[Part], Array]:
        """Manoeuvre by manoeuvre, so that each is read once for all responses."""

        def one(part: Part) -> Array:
            table = np.zeros((len(part), len(self.residuals), 2 + self.max_order))
            for rows, piece in zip(table, part, strict=True):
                for row, residuals, floor in zip(rows, self.residuals, self.floors, strict=True):
                    moments = LagProducts(max(0, min(self.max_order, piece.signals.n // 12 - 1)))
                    for chunk in residuals.chunks(piece):
                        moments.add(chunk)
                    colour = fit_ar(moments, floor)
                    row[0], row[1], row[2 : 2 + colour.order] = colour.order, colour.sigma, colour.ar
            return table.ravel()

        return one


def residual_colours(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    theta: Array,
    response: int = 0,
    max_order: int = 24,
    floor: float = 0.0,
) -> list[ARNoise]:
    """An AR model of each manoeuvre's residual of one response; see `colours_each`."""
    return list(colours_each(manoeuvres, [exponents], [theta], [response], max_order, [floor])[0])


def colours_each(
    manoeuvres: Sequence[Signals],
    exponents: Sequence[NDArray[np.integer]],
    theta: Sequence[Array],
    responses: Sequence[int],
    max_order: int,
    floors: Sequence[float],
    *,
    scales: Scales | None = None,
    passes: Passes | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[tuple[ARNoise, ...]]:
    """AR models of each manoeuvre's residuals, order by BIC, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of Signals
    exponents, theta : sequence of (k, s) int array, of (1 + k,) array
        Terms and parameters of each response.
    responses : sequence of int
        Which.
    max_order : int
        Highest order offered; shorter manoeuvres are offered lower ones.
    floors : sequence of float
        Least innovation of each response.
    scales, passes, workers, progress
        As for `accumulate`.

    Returns
    -------
    list of tuple of ARNoise
        For each response, one per manoeuvre.
    """
    scales = scales or base_scale(manoeuvres)
    residuals = [Residuals(*of, scales) for of in zip(exponents, theta, responses, strict=True)]
    parts = whole_manoeuvres([m.n for m in manoeuvres]).parts(manoeuvres)
    made = (passes or Passes()).over(Colours(residuals, floors, max_order), parts, workers, progress)
    table = made.values.reshape(len(manoeuvres), len(residuals), 2 + max_order)
    return [tuple(ARNoise(row[2 : 2 + int(row[0])].copy(), float(row[1])) for row in of) for of in table.swapaxes(0, 1)]
