"""Whitening of rows whose noise includes nuisance parameters of their own. Arrays only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Projector:
    """Whitening of the rows of one manoeuvre, whose noise includes nuisance parameters P of its own.

    ``I + P P'`` is the covariance of noise and nuisances. Its inverse square root shrinks the directions of P only:
    `basis` holds these directions, `shrink` the fraction that each loses.
    """

    basis: Array
    shrink: Array

    @classmethod
    def of(cls, P: Array) -> Projector:
        """Projector of columns scaled by their prior standard deviations, (rows, k)."""
        if not P.shape[1]:
            return cls(np.zeros((P.shape[0], 0)), np.zeros(0))
        U, s, _ = np.linalg.svd(P, full_matrices=False)
        return cls(U, 1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def __call__(self, X: Array) -> Array:
        """Whitened rows."""
        inside = self.basis.T @ X
        return X - self.basis @ (inside * (self.shrink[:, None] if X.ndim == 2 else self.shrink))

    @property
    def lost(self) -> Array:
        """Fraction of the power that each direction of `basis` loses."""
        return 2.0 * self.shrink - self.shrink**2
