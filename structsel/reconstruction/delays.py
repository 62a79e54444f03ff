"""Delays of measured channels against the reconstructed path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.numerics import kinematics as fp
from structsel.numerics.score_covariance import score_covariance
from structsel.reconstruction.kinematics_problem import KinematicsProblem

_MIN_SAMPLES = 40
LONGEST_DELAY = 0.5
"""Longest delay of an instrument [s]."""
_DELAYED = ("V", "alpha", "beta", "phi", "theta", "psi")


@dataclass(frozen=True)
class Delay:
    """Delay of a measured channel against its reconstruction.

    Attributes
    ----------
    channel : str
    delay, std : float [s]
        Positive if the reading is delayed.
    effect : float
        Root mean square change of the reading by the delay, in the channel's unit.
    """

    channel: str
    delay: float
    std: float
    effect: float

    @property
    def significant(self) -> bool:
        """Whether the delay exceeds four standard deviations and 5 ms, and is below `LONGEST_DELAY`."""
        return max(4.0 * self.std, 0.005) < abs(self.delay) < LONGEST_DELAY


def find_delays(
    problem: KinematicsProblem, predicted: np.ndarray, residuals: np.ndarray, measured: tuple[str, ...]
) -> tuple[Delay, ...]:
    """Delay of each air-data and attitude channel, from a regression of its residual on the slope of the prediction.

    To first order a delayed reading is y(t) - delay y'(t). Further regressors are y (a scale error) and a constant. The
    standard deviation includes the autocorrelation of the residual.

    Parameters
    ----------
    problem : KinematicsProblem
    predicted, residuals : (n, 12) array
        Readings of ideal instruments, and measured minus predicted readings.
    measured : tuple of str
    """
    found = []
    for name in _DELAYED:
        j = fp.MEASUREMENTS.index(name)
        good = np.isfinite(residuals[:, j])
        if name not in measured or good.sum() < _MIN_SAMPLES:
            continue
        y = predicted[:, j]
        slope = np.gradient(y, problem.t)
        columns = np.column_stack([-slope, y - y.mean(), np.ones(len(y))])[good]
        value, std = _regress(columns, residuals[good, j])
        found.append(Delay(name, value, std, abs(value) * float(np.sqrt(np.mean(slope**2)))))
    return tuple(found)


def _regress(columns: np.ndarray, e: np.ndarray) -> tuple[float, float]:
    """Coefficient of the first column, and its standard deviation for autocorrelated residuals."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    size[size == 0.0] = 1.0
    scaled = columns / size
    R = np.linalg.qr(scaled, mode="r")
    if np.abs(np.diag(R)).min() < 1e-6 * np.abs(np.diag(R)).max():
        return 0.0, np.inf
    theta = np.linalg.lstsq(scaled, e, rcond=None)[0]
    # theta_0 is linear in the readings: its weights D x(i) are the only sensitivity whose covariance is needed.
    weights = scaled @ np.linalg.solve(scaled.T @ scaled, np.eye(3)[0])
    variance = score_covariance(weights[None, :, None], (e - scaled @ theta)[:, None])[0, 0] * len(e) / (len(e) - 3)
    return float(theta[0] / size[0]), float(np.sqrt(variance) / size[0])
