"""Data compatibility check: one deterministic flight path through all instruments, by maximum likelihood.

The kinematics are integrated from the measured accelerations and rates minus constant biases. Initial motion, biases,
wind and the errors of the vanes are estimated such that the outputs are nearest the readings. There is no process
noise, so an input error that is not constant gives a growing residual. The prior, with the standard deviations of the
initial values, determines only directions that the readings do not determine. `output_error` has the cost and search.

References
----------
[K79] for the check; [KM16], output error, data compatibility and covariance with coloured residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.numerics.kinematics import CIRCULAR, MEASUREMENTS, STATES, fly, readings
from structsel.numerics.output_error import OutputErrorFit, fit_output_error
from structsel.numerics.output_error_problem import OutputErrorProblem
from structsel.reconstruction.kinematics_problem import KinematicsProblem

_DIFFERENCE = 1e-3  # of the central differences, in standard deviations of the start
_LEAST_STD = 1e-3  # of the stated standard deviation; limits the weight of a channel that is fitted to the last digit
_SHORTEST = 200  # samples in the first fit
_TURN = 2.0 * np.pi
_ANGLES = tuple(MEASUREMENTS.index(name) for name in ("phi", "theta", "psi"))
_SCALE_STD = 0.2  # prior standard deviation of the scale error of an attitude angle, as of a vane


@dataclass(frozen=True)
class DataCompatibility:
    """The deterministic flight path with the least output error; n samples, L active states.

    Attributes
    ----------
    path : (n, 34) array
        Full vectors, as `kinematics.STATES`; inputs' biases still in the inputs.
    values : (L,) array
        Active states at the first sample; the constants among them hold throughout.
    crlb : (L, L) array
        Their covariance for white residuals: the Cramer-Rao bound. NaN where the path diverges.
    covariance : (L, L) array
        Their covariance with the autocorrelation of the residuals.
    residuals : (n, 12) array
        Measured minus fitted; NaN where not sampled.
    measurement_std : (12,) array
        Of the residuals; that of the problem for channels without residuals.
    costs : (k,) array
        J after each step over the complete flight.
    converged : bool
    message : str
        Reason why the search ended.
    iterations : int
        Steps, including those over the first part of the flight.
    """

    path: np.ndarray
    values: np.ndarray
    crlb: np.ndarray
    covariance: np.ndarray
    residuals: np.ndarray
    measurement_std: np.ndarray
    costs: np.ndarray
    converged: bool
    message: str
    iterations: int

    @property
    def std(self) -> np.ndarray:
        """(L,) standard deviations of the values, residuals coloured."""
        return np.sqrt(np.diag(self.covariance))


def check_data_compatibility(
    problem: KinematicsProblem, *, iterations: int = 50, near: np.ndarray | None = None
) -> DataCompatibility:
    """Fit one deterministic flight path to all readings by output error.

    The first part of the flight is fitted first, then one twice as long, up to the complete flight: over a short time
    the path is nearly linear in the biases, but with poor values the path over minutes would diverge.

    Parameters
    ----------
    problem : KinematicsProblem
        Its `input_std` and `drift` are not used: there is no process noise, and constants are constant.
    iterations : int
        Maximum number of steps over one part.
    near : (L,) array, optional
        Values near the solution: the complete flight is then fitted at once, and in parts only if that fails.

    Returns
    -------
    DataCompatibility
        The best fit; if the search did not converge, `converged` is False and `message` is the reason.

    References
    ----------
    [K79], [KM16].
    """
    n = len(problem.t)
    lengths = [n]
    while lengths[0] > 2 * _SHORTEST:
        lengths.insert(0, -(-lengths[0] // 2))
    tried = None if near is None else _fit(problem, n, near, iterations)
    if tried is not None and tried.converged:
        fit, steps, length = tried, len(tried.costs) - 1, n
    else:
        fit, steps, length = _fit_in_parts(problem, lengths, iterations)
    values = fit.theta
    message = fit.message
    if not np.isfinite(fit.costs[-1]):
        message = f"the path from the start values diverges within {length} samples"
    elif not fit.converged:
        message += f" over {length} samples"
    # The path and its residuals are those of the complete flight, even where a part of it diverges.
    path, outputs = _simulate(problem, n, values)
    residuals = problem.residuals(outputs)
    return DataCompatibility(
        *(path, values, fit.crlb, fit.covariance, residuals, _noise(problem, residuals), fit.costs),
        *(fit.converged, message, steps),
    )


def _fit_in_parts(
    problem: KinematicsProblem, lengths: Sequence[int], iterations: int
) -> tuple[OutputErrorFit, int, int]:
    """Fit of the first samples, each part from the estimate of the one before; steps, and samples of the last part."""
    values, steps = problem.start[problem.active], 0
    for length in lengths:
        fit = _fit(problem, length, values, iterations)
        values, steps = fit.theta, steps + len(fit.costs) - 1
        if not np.isfinite(fit.costs[-1]):
            break
    return fit, steps, length


def _fit(problem: KinematicsProblem, length: int, values: np.ndarray, iterations: int) -> OutputErrorFit:
    """Fit of the first samples."""
    measured = problem.measurements[:length]
    channels = np.flatnonzero(np.isfinite(measured).any(axis=0))
    circular = CIRCULAR[channels]
    y = measured[:, channels]

    def predict(thetas: np.ndarray) -> np.ndarray:
        outputs = np.empty((len(thetas), *y.shape))
        for one, theta in zip(outputs, thetas):
            one[:] = _simulate(problem, length, theta)[1][:, channels]
            # The turn nearest the reading: a heading of 359 deg is 1 deg from one of 0 deg.
            one[:, circular] += _TURN * np.round((y - one)[:, circular] / _TURN)
        return outputs

    return fit_output_error(
        OutputErrorProblem(
            predict, y, floor=(_LEAST_STD * problem.measurement_std[channels]) ** 2,
            prior=(problem.start[problem.active], problem.start_std), steps=_DIFFERENCE * problem.start_std,
        ),
        values, scale=problem.start_std, tolerance=0.0, iterations=iterations,
    )  # fmt: skip


def fit_attitude_scales(problem: KinematicsProblem, start: np.ndarray) -> tuple[OutputErrorFit, list[int]] | None:
    """Output error with a scale error of each measured attitude angle whose own is not among the active states.

    An angle that is measured as x + K (x - x_0), with x_0 that of the first sample, has the scale error K [KM16].

    Parameters
    ----------
    problem : KinematicsProblem
    start : (L,) array
        Active states at the first sample, of the fit without scale errors.

    Returns
    -------
    OutputErrorFit and the columns of the angles in `kinematics.MEASUREMENTS`, or None if there is no such angle.
    """
    sampled = np.isfinite(problem.measurements).any(axis=0)
    modelled = [STATES.index(name) for name in ("Kphi", "Ktheta")]
    angles = [c for c, state in zip(_ANGLES, (*modelled, -1)) if sampled[c] and state not in problem.active]
    if not angles:
        return None
    none, unit = np.zeros(len(angles)), np.full(len(angles), _SCALE_STD)
    widened = np.concatenate([problem.start_std, unit])
    channels = np.flatnonzero(sampled)
    circular, y = CIRCULAR[channels], problem.measurements[:, channels]

    def predict(thetas: np.ndarray) -> np.ndarray:
        outputs = np.stack([simulate_outputs(problem, theta, angles)[:, channels] for theta in thetas])
        for one in outputs:
            one[:, circular] += _TURN * np.round((y - one)[:, circular] / _TURN)
        return outputs

    fit = fit_output_error(
        OutputErrorProblem(
            predict, y, floor=(_LEAST_STD * problem.measurement_std[channels]) ** 2,
            prior=(np.concatenate([problem.start[problem.active], none]), widened), steps=_DIFFERENCE * widened,
        ),
        np.concatenate([start, none]), scale=widened, tolerance=0.0, iterations=50,
    )  # fmt: skip
    return fit, angles


def simulate_outputs(problem: KinematicsProblem, values: np.ndarray, angles: Sequence[int] = ()) -> np.ndarray:
    """(n, 12) outputs of the deterministic path; NaN where it diverges.

    `values` are the active states at the first sample, then the scale errors of the angles in these columns.
    """
    L = len(problem.active)
    outputs = _simulate(problem, len(problem.t), values[:L])[1]
    for column, scale in zip(angles, values[L:]):
        outputs[:, column] += scale * (outputs[:, column] - outputs[0, column])
    return outputs


def _simulate(problem: KinematicsProblem, length: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Path and outputs; an output is NaN where the path diverges."""
    start = problem.start.copy()
    start[problem.active] = values
    inputs = problem.inputs[:length]
    path = fly(problem.t[:length], inputs, start, problem.place, problem.g, problem.located)
    outputs = readings(path, inputs, problem.place, problem.flank)
    outputs[~np.isfinite(outputs)] = np.nan  # infinities would spread to sums over channels
    return path, outputs


def _noise(problem: KinematicsProblem, residuals: np.ndarray) -> np.ndarray:
    """(12,) standard deviations of residuals; the stated ones for channels without residuals."""
    counts, stated = np.isfinite(problem.measurements).sum(axis=0), problem.measurement_std
    with np.errstate(over="ignore"):  # infinite then: the path diverges
        square = np.sum(np.where(np.isfinite(problem.measurements), residuals, 0.0) ** 2, axis=0)
    return np.where(counts > 0, np.maximum(np.sqrt(square / np.maximum(counts, 1)), _LEAST_STD * stated), stated)
