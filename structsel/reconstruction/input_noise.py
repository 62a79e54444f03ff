"""Effect of the noise of accelerometers and gyros on the estimates of output error, which takes them as exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from structsel.reconstruction.data_compatibility import simulate_outputs
from structsel.reconstruction.kinematics_problem import KinematicsProblem

_DRAWS = 25  # of the noise of the inertial readings; standard deviations to 14 %
_DIFFERENCE = 1e-3  # of the differences of the outputs, in prior standard deviations; chosen, not critical


def input_noise_variance(
    problem: KinematicsProblem, values: np.ndarray, crlb: np.ndarray, std: np.ndarray, angles: Sequence[int] = ()
) -> np.ndarray:
    """Variance of the estimates of output error due to the noise of the inertial readings, which it leaves out.

    With noisy inputs the outputs change by dy, and the estimates by C S' R^-1 dy to first order [KM16]: C is their
    covariance for white residuals, S the sensitivities and R the variances of the outputs.
    """
    seen = np.isfinite(problem.measurements)
    outputs = simulate_outputs(problem, values, angles)
    weighted = []
    for j, change in enumerate(_DIFFERENCE * np.concatenate([problem.start_std, np.ones(len(angles))])):
        moved = values.copy()
        moved[j] += change
        slope = np.where(seen, simulate_outputs(problem, moved, angles) - outputs, 0.0) / change
        weighted.append(np.where(seen, slope / std**2, 0.0))
    rng, variance = np.random.default_rng(0), np.zeros(len(values))
    for _ in range(_DRAWS):
        inputs = problem.inputs.copy()
        inputs[:, :6] += problem.input_std * rng.standard_normal(problem.input_std.shape)
        noisy = simulate_outputs(replace(problem, inputs=inputs), values, angles)
        change = np.where(seen, noisy - outputs, 0.0)
        variance += (crlb @ np.array([np.sum(one * change) for one in weighted])) ** 2 / _DRAWS
    return variance
