"""Standard errors of ordinary least squares with coloured residuals, streamed over the recordings.

The formula and the lag window are those of `structsel.numerics.noise_models`; here no regressor matrix is formed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.cutting import whole_manoeuvres
from structsel.numerics.least_squares import Fit
from structsel.numerics.monomials import plan_rows, words_of
from structsel.numerics.noise_models import score_covariance, split_for_correlation
from structsel.numerics.passes import Part, Passes
from structsel.numerics.rows import RowMaker, Scales, Signals, base_scale, column_scale


@dataclass(frozen=True)
class Scatter:
    """The job of `streamed_coloured_covariance`: sum of x(i) R(i - j) x(j)' over a part, in scaled units.

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

    def size(self, part: Part) -> int:
        """Entries of the matrix."""
        return int(self.theta.size**2)

    def start(self) -> Callable[[Part], Array]:
        """A stretch of `split_for_correlation` at a time."""
        p = len(self.exponents)
        maker = RowMaker(plan_rows(words_of(self.exponents)), p, self.scales)
        scale = column_scale(self.exponents, *self.scales)
        weights = self.theta * scale[: 1 + p] / scale[1 + p + self.response]

        def one(part: Part) -> Array:
            meat = np.zeros((1 + p, 1 + p))
            for piece in part:
                for a, b in split_for_correlation(piece.stop - piece.start):
                    chunks = maker.chunks(piece.signals, piece.start + a, piece.start + b)
                    rows = np.concatenate([r.copy() for r, _, _ in chunks], axis=1)
                    X = rows[: 1 + p]
                    e = rows[1 + p + self.response] - weights @ X
                    meat += score_covariance(X[:, :, None], e[:, None])
            return meat.ravel()

        return one


def streamed_coloured_covariance(
    manoeuvres: Sequence[Signals],
    exponents: NDArray[np.integer],
    fit: Fit,
    response: int = 0,
    *,
    scales: Scales | None = None,
    passes: Passes | None = None,
    workers: int = 1,
) -> Array:
    """Covariance of an ordinary least-squares fit whose residuals are coloured.

    As `structsel.numerics.noise_models.coloured_covariance`.

    Parameters
    ----------
    fit : Fit
        The white fit of these terms to this response.
    scales, passes, workers
        As for `accumulate`.

    Returns
    -------
    (1 + k, 1 + k) array

    References
    ----------
    [KM16], ch. 5, parameter covariance with coloured residuals.
    """
    scales = scales or base_scale(manoeuvres)
    parts = whole_manoeuvres([m.n for m in manoeuvres]).parts(manoeuvres)
    job = Scatter(exponents, fit.theta, response, scales)
    k = fit.theta.size
    meat = (passes or Passes()).over(job, parts, workers).table.sum(axis=0).reshape(k, k)
    scale = column_scale(exponents, *scales)
    meat = 0.5 * (meat + meat.T) * np.outer(scale[:k], scale[:k]) * scale[k + response] ** 2
    bread = fit.unscaled_covariance
    return bread @ meat @ bread * (fit.n / max(fit.dof, 1))
