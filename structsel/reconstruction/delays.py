"""How late the channels are against a path that all of them should have seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.numerics import kinematics as fp
from structsel.numerics.noise_models import coloured_covariance
from structsel.reconstruction.ukf import KinematicsProblem

_LEAST_SAMPLES = 40
LONGEST_DELAY = 0.5
"""More [s] is no delay of an instrument."""
_DELAYED = ("V", "alpha", "beta", "phi", "theta", "psi")


@dataclass(frozen=True)
class Delay:
    """How late a measured channel is against its reconstruction.

    Attributes
    ----------
    channel : str
    delay, std : float [s]
        Positive when the reading is late.
    effect : float
        What the delay does to the reading, rms, in the channel's unit.
    """

    channel: str
    delay: float
    std: float
    effect: float

    @property
    def significant(self) -> bool:
        """Whether it is more than chance, more than a few milliseconds, and no more than a delay can be."""
        return max(4.0 * self.std, 0.005) < abs(self.delay) < LONGEST_DELAY


def find_delays(
    problem: KinematicsProblem, told: np.ndarray, residuals: np.ndarray, measured: tuple[str, ...]
) -> tuple[Delay, ...]:
    """How late each air-data and attitude channel is, from what its residual has of the reading's slope.

    To first order a late reading is y(t) - delay y'(t). What is left of it is regressed on y' beside y (a scale) and
    a constant; the standard deviation allows for coloured residuals.

    Parameters
    ----------
    problem : KinematicsProblem
    told, residuals : (n, 12) array
        What the instruments should have read, and what they read beyond it.
    measured : tuple of str
    """
    found = []
    for name in _DELAYED:
        j = fp.MEASUREMENTS.index(name)
        good = np.isfinite(residuals[:, j])
        if name not in measured or good.sum() < _LEAST_SAMPLES:
            continue
        y = told[:, j]
        slope = np.gradient(y, problem.t)
        columns = np.column_stack([-slope, y - y.mean(), np.ones(len(y))])[good]
        value, std = _regress(columns, residuals[good, j])
        found.append(Delay(name, value, std, abs(value) * float(np.sqrt(np.mean(slope**2)))))
    return tuple(found)


def _regress(columns: np.ndarray, e: np.ndarray) -> tuple[float, float]:
    """Coefficient of the first column, and its standard deviation with the residual as coloured as it is."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = columns / size
    R = np.linalg.qr(scaled, mode="r")
    if np.abs(np.diag(R)).min() < 1e-6 * np.abs(np.diag(R)).max():
        return 0.0, np.inf
    theta = np.linalg.lstsq(scaled, e, rcond=None)[0]
    covariance = coloured_covariance([scaled], [e - scaled @ theta])
    return float(theta[0] / size[0]), float(np.sqrt(covariance[0, 0]) / size[0])
