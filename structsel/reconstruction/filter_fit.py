"""Path and constants by a Kalman filter, each measurement weighted for the autocorrelation of its innovations.

The noise levels describe white noise. An error that lasts for seconds (position error, lag, a coarse altitude) counts
as one reading, not as many: the variance of a channel is enlarged for the autocorrelation of its residuals, and the
estimates have the same weights as their standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from structsel.errors import ReconstructionError
from structsel.reconstruction.innovations import Consistency, check_innovations, widened_noise
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.noise_levels import limit_accelerometer_noise
from structsel.reconstruction.problem import ReconstructionProblem
from structsel.reconstruction.settings import ReconstructOptions
from structsel.reconstruction.ukf import FilterResult, SmootherResult, ukf_smoother
from structsel.recording import Recording


@dataclass(frozen=True)
class PathFit:
    """Estimates of one problem, n samples.

    Attributes
    ----------
    problem : KinematicsProblem
        With its noise.
    run, smooth : FilterResult, SmootherResult
    path : (n, 34) array
        Full vectors, as `kinematics.STATES`.
    predicted, residuals : (n, 12) array
        Of the measurements along the path.
    """

    problem: KinematicsProblem
    run: FilterResult
    smooth: SmootherResult
    path: np.ndarray
    predicted: np.ndarray
    residuals: np.ndarray

    @classmethod
    def of(cls, problem: KinematicsProblem, run: FilterResult, smooth: SmootherResult) -> PathFit:
        """Fit of these estimates; a heading that is not estimated is integrated from north."""
        path = problem.path(smooth.x)
        if 5 not in problem.active:
            path[:, 5] = problem.integrated_heading(path)
        predicted = problem.predict(path)
        return cls(problem, run, smooth, path, predicted, problem.residuals(predicted))

    def consistency(self, problem_setup: ReconstructionProblem, dt: float) -> Consistency:
        """Consistency of the innovations."""
        return check_innovations(self.run, self.residuals, problem_setup.measured, dt, problem_setup.given)


def fit_by_filter(
    problem_setup: ReconstructionProblem, lowest: np.ndarray, recording: Recording, options: ReconstructOptions
) -> tuple[PathFit, PathFit, np.ndarray, Consistency]:
    """Fit with the noise levels, the weighted fit, its standard deviations, and the consistency of the first.

    If the noise of the accelerometers is above its limit, the weighted fit has no more than the limit. Its standard
    deviations (n, L) are at least those of the more likely noise.
    """
    fit = _fit(problem_setup.problem, recording, options)
    consistency = fit.consistency(problem_setup, recording.dt)
    weighted = _weighted(fit, consistency, recording, options)
    std = np.maximum(fit.smooth.std, weighted.smooth.std)
    limited = limit_accelerometer_noise(problem_setup, lowest)
    if limited is not problem_setup:
        first = _fit(limited.problem, recording, options)
        weighted = _weighted(first, first.consistency(limited, recording.dt), recording, options)
        std = np.maximum(std, weighted.smooth.std)
    return fit, weighted, std, consistency.with_residuals(weighted.residuals, weighted.run.rejected)


def _weighted(fit: PathFit, consistency: Consistency, recording: Recording, options: ReconstructOptions) -> PathFit:
    """Fit with the noise of each measurement enlarged for its autocorrelation; the same if all are white."""
    std = widened_noise(fit.problem.measurement_std, consistency)
    return fit if std is None else _fit(replace(fit.problem, measurement_std=std), recording, options)


def _fit(problem: KinematicsProblem, recording: Recording, options: ReconstructOptions) -> PathFit:
    run, smooth = ukf_smoother(problem, spread=options.filter_spread, gate=options.gate)
    if smooth is None:
        i = run.failed
        raise ReconstructionError(
            f"reconstruct failed on '{recording.name}' at sample {i} (t = {recording.t[i]:g} s): {run.reason}.\n"
            "Check the channels near that time, and their units and signs (structsel describe).",
            run,
        )
    return PathFit.of(problem, run, smooth)
