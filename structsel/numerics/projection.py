"""Whitening of rows whose noise includes nuisance parameters of their own. Arrays only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Projector:
    """Whitening of the rows of one manoeuvre, whose noise includes nuisance parameters P of its own.

    ``I + P P'`` is the covariance of noise and nuisances. With ``P'P = V G V'``, G diagonal, and the columns ``P V``::

        (I + P P')^-1/2 = I - P V diag(1 / (r (1 + r))) V'P'    r = sqrt(1 + G)
        (I + P P')^-1   = I - P V diag(1 / r^2) V'P'

    Attributes
    ----------
    columns : (rows, k) array
        ``P V``.
    shrink, lost : (k,) arrays
        Diagonals of the two formulas.
    """

    columns: Array
    shrink: Array
    lost: Array

    @classmethod
    def of(cls, P: Array) -> Projector:
        """Projector of columns scaled by their prior standard deviations, (rows, k)."""
        G, V = np.linalg.eigh(P.T @ P)
        root = np.sqrt(1.0 + np.maximum(G, 0.0))
        return cls(P @ V, 1.0 / (root * (1.0 + root)), 1.0 / root**2)

    def __call__(self, X: Array) -> Array:
        """Whitened rows."""
        inside = self.columns.T @ X
        return X - self.columns @ (inside * (self.shrink[:, None] if X.ndim == 2 else self.shrink))
