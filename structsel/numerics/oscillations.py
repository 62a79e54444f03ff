"""Period, damping and phase of a decaying oscillation in sampled signals. Arrays only.

::

    x_j(t) = a_j + b_j t + exp(-s t) (c_j cos w t + d_j sin w t)

With s and w given the others are linear, so the search has two parameters (variable projection). Several signals have s
and w in common.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

_STARTS = 12  # frequencies from which the search starts; chosen, not critical


@dataclass(frozen=True)
class Oscillation:
    """A decaying oscillation.

    Attributes
    ----------
    decay : float [1/s]
        s; below zero the oscillation grows.
    omega : float [rad/s]
    phases : (c,) array [rad]
        Each signal is exp(-s t) cos(w t - phase) besides its line.
    r2 : float
        Fraction of the power of the signals about their lines, each in proportion to its own.
    """

    decay: float
    omega: float
    phases: np.ndarray
    r2: float

    @property
    def period(self) -> float:
        """2 pi / w [s]."""
        return float(2.0 * np.pi / self.omega)

    @property
    def half_time(self) -> float:
        """Time to half amplitude [s]; below zero, to double amplitude."""
        return float(np.log(2.0) / self.decay) if self.decay else float("inf")

    @property
    def damping(self) -> float:
        """Damping ratio."""
        return float(self.decay / np.hypot(self.decay, self.omega))


def fit_oscillation(t: np.ndarray, x: np.ndarray) -> Oscillation | None:
    """Fit a decaying oscillation to signals (n, c) over time [s]; None if there are too few samples.

    Frequencies from half a cycle in the time to a quarter of the samples are searched.
    """
    t = np.asarray(t, dtype=float) - t[0]
    n = len(t)
    if n < 12 or not np.isfinite(x).all():
        return None
    lines = np.column_stack([np.ones(n), t])
    about = x - lines @ np.linalg.lstsq(lines, x, rcond=None)[0]
    size = np.linalg.norm(about, axis=0)
    if not (size > 0.0).all():
        return None

    def basis(p: np.ndarray) -> np.ndarray:
        wave = np.exp(-p[0] * t)[:, None] * np.column_stack([np.cos(p[1] * t), np.sin(p[1] * t)])
        return np.column_stack([lines, wave])

    def residuals(p: np.ndarray) -> np.ndarray:
        B = basis(p)
        scaled = x / size
        return np.asarray((scaled - B @ np.linalg.lstsq(B, scaled, rcond=None)[0]).ravel())

    low, high = np.pi / t[-1], 0.25 * 2.0 * np.pi * n / t[-1]
    limits = ([-3.0 / t[-1], 0.5 * low], [max(20.0 / t[-1], high), high])
    starts = np.geomspace(1.01 * low, min(high, 40.0 * low), _STARTS)
    found = [scipy.optimize.least_squares(residuals, [0.3 * w / np.pi / 2.0, w], bounds=limits) for w in starts]
    decay, omega = min(found, key=lambda one: one.cost).x
    scaled = x / size
    B = basis(np.array([decay, omega]))
    c = np.linalg.lstsq(B, scaled, rcond=None)[0]
    lost = float(np.sum((scaled - B @ c) ** 2))
    return Oscillation(float(decay), float(omega), np.arctan2(c[3], c[2]), 1.0 - lost / x.shape[1])
