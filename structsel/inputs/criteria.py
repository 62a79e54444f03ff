"""Criteria of optimal inputs as functions of the input's coefficients, with exact slopes and curvatures.

With u = sum_i a_i phi_i and a linear system, sensitivities add, so the information matrix is quadratic in a:

    M(a) = sum_ij a_i a_j M_ij,    M_ij = sum_k S_i(k)' inv(R) S_j(k)

The *elementary* matrices M_ij are computed once [M86]; every value, slope and curvature of a criterion follows by
algebra. a_0 = 1 belongs to the motion without input (biases).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Criterion = Literal["A", "D", "trace", "E"]

_SINGULAR = 1e-13
"""Least eigenvalue of M scaled to unit diagonal, relative to the largest: below it M is singular."""


def elementary_matrices(S: np.ndarray) -> np.ndarray:
    """Symmetric parts (b, b, k, k) of M_ij = S_i' S_j, from sensitivities over the noise (b, rows, k)."""
    b, rows, k = S.shape
    wide = S.transpose(1, 0, 2).reshape(rows, b * k)
    M = (wide.T @ wide).reshape(b, k, b, k).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(0.5 * (M + M.transpose(1, 0, 2, 3)))


@dataclass(frozen=True)
class DesignProblem:
    """Criterion, energy and limits of an optimal input, as arrays; a (b,) are the coefficients.

    Attributes
    ----------
    elementary : (1 + b, 1 + b, k, k) array
        Of parameters in units of their scales; row 0 is the motion without input.
    criterion : {"A", "D", "trace", "E"}
        Least trace of the covariance; least ln det of it; largest trace of M; least largest eigenvalue of the
        covariance.
    of_interest : (s,) int array
        Parameters whose covariance counts, the others being estimated too.
    energy : float
    limits : (c, b) array
        Amplitudes, rates and excursions over their limits: rows a must lie between -1 and 1.
    """

    elementary: np.ndarray
    criterion: Criterion
    of_interest: np.ndarray
    energy: float
    limits: np.ndarray

    def information(self, a: np.ndarray) -> np.ndarray:
        """M(a): (k, k), or (m, k, k) for (m, b)."""
        full = np.concatenate([np.ones((*a.shape[:-1], 1)), a], axis=-1)
        b, k = self.elementary.shape[1:3]
        pairs = (full[..., :, None] * full[..., None, :]).reshape(*a.shape[:-1], b * b)
        return (pairs @ self.elementary.reshape(b * b, k * k)).reshape(*a.shape[:-1], k, k)

    def values(self, a: np.ndarray) -> np.ndarray:
        """Criterion for each row of a (m, b); inf where the information is singular."""
        M = self.information(a)
        s = self.of_interest
        if self.criterion == "trace":
            return -np.trace(M[:, s][:, :, s], axis1=1, axis2=2)
        regular = well_posed(M)
        out = np.full(len(a), np.inf)
        V = np.linalg.inv(M[regular])[:, s][:, :, s]
        if self.criterion == "A":
            out[regular] = np.trace(V, axis1=1, axis2=2)
        elif self.criterion == "D":
            out[regular] = np.linalg.slogdet(V)[1]
        else:
            out[regular] = np.linalg.eigvalsh(V)[:, -1]
        return out

    def derivatives(self, a: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Criterion, slope (b,) and curvature (b, b) by the coefficients, exact.

        With V = inv(M): dV_i = -V M_i V and d2V_ij = V M_i V M_j V + V M_j V M_i V - V M_ij V.
        """
        value = float(self.values(a[None])[0])
        b = len(a)
        if not np.isfinite(value):
            return value, np.full(b, np.nan), np.full((b, b), np.nan)
        full = np.concatenate([[1.0], a])
        M1 = 2.0 * np.tensordot(self.elementary, full, axes=(1, 0))[1:]
        M2 = 2.0 * self.elementary[1:, 1:]
        s = self.of_interest
        if self.criterion == "trace":
            diagonal = np.zeros(M1.shape[-1])
            diagonal[s] = 1.0
            return value, -np.einsum("ill,l->i", M1, diagonal), -np.einsum("ijll,l->ij", M2, diagonal)
        V = np.linalg.inv(self.information(a))
        left = V[s] @ M1  # (b, s, k): rows of V M_i
        V1 = -left @ V[:, s]
        cross = np.einsum("iak,kl,jcl->ijac", left, V, left, optimize=True)
        V2 = cross + cross.transpose(1, 0, 2, 3) - V[s] @ M2 @ V[:, s]
        if self.criterion == "A":
            return value, np.einsum("iaa->i", V1), np.einsum("ijaa->ij", V2)
        Vs = V[np.ix_(s, s)]
        if self.criterion == "D":
            W = np.linalg.inv(Vs)
            first = W @ V1
            return (
                value,
                np.einsum("iaa->i", first),
                np.einsum("ac,ijca->ij", W, V2) - np.einsum("iac,jca->ij", first, first),
            )
        w, Z = np.linalg.eigh(Vs)
        rotated = np.einsum("ac,iad,de->ice", Z, V1, Z, optimize=True)
        top = rotated[:, -1, :-1]
        curvature = np.einsum("a,ijac,c->ij", Z[:, -1], V2, Z[:, -1], optimize=True)
        gap = np.maximum(w[-1] - w[:-1], 1e-9 * w[-1])  # equal eigenvalues have no curvature; the step is damped
        return value, rotated[:, -1, -1], curvature + 2.0 * (top / gap) @ top.T

    def penalty(self, a: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Sum of squares of the excess over the limits, with slope and curvature."""
        beyond = self.limits @ a
        over = np.abs(beyond) > 1.0
        rows, excess = self.limits[over], (np.abs(beyond[over]) - 1.0) * np.sign(beyond[over])
        return float(excess @ excess), 2.0 * rows.T @ excess, 2.0 * rows.T @ rows


def well_posed(M: np.ndarray) -> np.ndarray:
    """Whether information matrices (m, k, k) can be inverted, (m,)."""
    size = np.sqrt(np.maximum(np.einsum("mii->mi", M), 0.0))
    regular = (size > 0.0).all(axis=1) & np.isfinite(M).all(axis=(1, 2))
    scaled = M[regular] / (size[regular][:, :, None] * size[regular][:, None, :])
    w = np.linalg.eigvalsh(scaled)
    regular[regular] = w[:, 0] > _SINGULAR * w[:, -1]
    return regular
