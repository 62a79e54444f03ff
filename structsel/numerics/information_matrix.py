"""Solutions with an information matrix that may be singular: damped steps, covariances."""

from __future__ import annotations

import numpy as np
from scipy import linalg

_RANK = 1e-11  # of the eigenvalues of the information scaled to unit diagonal: singular values 3e-6
_INSENSITIVE = 1e-6  # standard deviations of all the noise that a parameter as large as its scale moves the outputs


def sandwich(D: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """D middle D, infinite where D is."""
    lost = np.isinf(np.diag(D))
    held = np.where(np.isinf(D), 0.0, D)
    found = held @ middle @ held
    found[lost, lost] = np.inf
    return found


def _decompose(H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale to unit diagonal, eigenvalues and vectors of the scaled matrix."""
    d = np.sqrt(np.diag(H))
    inverse = np.where(d > 0.0, 1.0 / np.where(d > 0.0, d, 1.0), 0.0)
    values, vectors = linalg.eigh(H * np.outer(inverse, inverse))
    return inverse, values, vectors


def solve_damped(H: np.ndarray, g: np.ndarray, damping: float) -> np.ndarray:
    """(H + damping diag(H))^-1 g, without the directions that H says nothing about."""
    inverse, values, vectors = _decompose(H)
    kept = values > _RANK * values[-1]
    V = vectors[:, kept]
    return inverse * (V @ ((V.T @ (inverse * g)) / (values[kept] + damping)))


def invert_information(H: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of H, infinite on the diagonal where it has none, and which parameters these are."""
    with np.errstate(all="ignore"):
        insensitive = np.sqrt(np.diag(H)) * scale < _INSENSITIVE
    kept = ~insensitive
    D = np.zeros_like(H)
    undetermined = insensitive.copy()
    if kept.any():
        inverse, values, vectors = _decompose(H[np.ix_(kept, kept)])
        null = values <= _RANK * values[-1]
        V = vectors[:, ~null]
        D[np.ix_(kept, kept)] = np.outer(inverse, inverse) * ((V / values[~null]) @ V.T)
        undetermined[kept] = (vectors[:, null] ** 2).sum(axis=1) > 1e-3
    D[undetermined] = D[:, undetermined] = 0.0
    D[undetermined, undetermined] = np.inf
    return D, undetermined
