"""Filter error: predictions corrected by their innovations, process noise estimated with the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Predict
from structsel.refinement.problem import EstimationProblem, filled
from structsel.refinement.protocols import FilterPredictor

_ROUNDS = 15
_SAME_VARIANCE = 0.02  # change of a variance that no longer counts, relative
_SAME_VALUE = 0.05  # change of a parameter that no longer counts, in its standard deviations
_LEAST_FRACTION = 0.1
"""Least fraction of an innovation's variance that is measurement noise. Without noise a channel would be copied, not
predicted: its residual, and its information about the model, would be zero. [J15] bounds the gain for that."""
_THIRD_DIFFERENCES = 20.0  # variance of the third differences of white noise over its variance


class FilterErrorProblem(EstimationProblem):
    """Outputs predicted for each sample; `variances` (c,) of the measurement noise determine the filter gain.

    The search is for the logarithm of the process noise.
    """

    note = "predicted sample by sample"
    predictors: list[FilterPredictor]

    def prepare_recordings(self) -> list[FilterPredictor]:
        """Predictor of each recording."""
        self.variances = self._variances_from_differences()
        self.is_process = np.array([p.kind == "process" for p in self.parameters])
        return [self.model.filter_predictor(r, self.columns) for r in self.recordings]

    def _variances_from_differences(self) -> np.ndarray:
        """(c,) variances of the measurement noise from third differences."""
        differences, spread = [], np.nanvar(np.concatenate(self.y), axis=0)
        for y in self.y:
            third = np.diff(y, 3, axis=0)
            differences.append(third[np.isfinite(third).all(axis=1)] if len(third) else third)
        pooled = np.concatenate(differences)
        found = np.mean(pooled**2, axis=0) / _THIRD_DIFFERENCES if len(pooled) else 0.01 * spread
        return np.maximum(found, 1e-8 * np.where(spread > 0.0, spread, 1.0))

    def to_search(self, values: np.ndarray) -> np.ndarray:
        """Logarithm of the process noise."""
        with np.errstate(divide="ignore"):
            return np.where(self.is_process, np.log(np.where(self.is_process, values, 1.0)), values)

    def from_search(self, thetas: np.ndarray) -> np.ndarray:
        """Process noise as a standard deviation."""
        return np.where(self.is_process, np.exp(np.where(self.is_process, thetas, 0.0)), thetas)

    def search_slope(self, theta: np.ndarray) -> np.ndarray:
        """(k,) derivative of `outer`."""
        return np.where(self.is_process, self.from_search(theta), 1.0)

    @property
    def scale(self) -> np.ndarray:
        """(k,) typical sizes; of a logarithm, one."""
        return np.where(self.is_process, 1.0, super().scale)

    def _gain(self, j: int, thetas: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, _, _, delay = self.simulation_arguments(thetas, self.recordings[j].name)
        process = self._filled(np.zeros(len(self.model.states)), self.from_search(thetas), "process", self.model.states)
        with np.errstate(all="ignore"):
            return self.predictors[j].gain(values, delay, process, self.variances / factor**2)

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        name, y = self.recordings[j].name, self.y[j]

        def predict(thetas: np.ndarray) -> np.ndarray:
            thetas = filled(thetas, held, free)
            factor, shift = self.instrument(thetas, name)
            gain = self._gain(j, thetas, factor)[0]
            with np.errstate(all="ignore"):
                measured = (y[None] - shift[:, None, :]) / factor[:, None, :]
            outputs = self.predictors[j].predict(*self.simulation_arguments(thetas, name), gain, measured)
            return factor[:, None, :] * outputs + shift[:, None, :]

        return predict

    def estimated_noise(self, fit: OutputErrorFit) -> np.ndarray:
        """(c,) variances of the measurement noise: those of the innovations less the uncertainty of the states."""
        theta = fit.theta[None]
        spread, samples = np.zeros(len(self.outputs)), 0
        for j, r in enumerate(self.recordings):
            factor = self.instrument(theta, r.name)[0]
            spread += len(r) * (factor**2 * self._gain(j, theta, factor)[1])[0]
            samples += len(r)
        innovations = np.diag(fit.R)
        return np.maximum(innovations - spread / samples, _LEAST_FRACTION * innovations)


def iterate_noise(
    problem: FilterErrorProblem, fit: OutputErrorFit, descend: Callable[[np.ndarray], OutputErrorFit]
) -> OutputErrorFit:
    """Measurement noise and fit in turn, from a first fit, until neither changes; the history is that of all rounds."""
    rounds = [fit]
    before = step = np.zeros(len(problem.variances))
    while np.isfinite(fit.costs[-1]) and len(rounds) < _ROUNDS:
        change = np.log(problem.estimated_noise(fit) / problem.variances)
        with np.errstate(all="ignore"):  # secant: fraction of the last step by which the needed change fell
            slope = (before - change) / step
        step = change / np.clip(np.where(np.isfinite(slope), slope, 1.0), 0.3, 3.0)
        before = change
        problem.variances, last = problem.variances * np.exp(step), fit
        fit = descend(last.theta)
        rounds.append(fit)
        with np.errstate(invalid="ignore"):
            moved = np.abs(fit.theta - last.theta)[~problem.is_process] / fit.std[~problem.is_process]
        if not (np.abs(change) >= _SAME_VARIANCE).any():
            break
    else:
        if np.isfinite(fit.costs[-1]) and (moved >= _SAME_VALUE).any():
            message = f"the measurement noise has not converged in {_ROUNDS} rounds"
            best = int(np.argmin([one.costs[-1] for one in rounds]))
            rounds = rounds[: best + 1]
            fit = replace(rounds[best], converged=False, message=message)
    return replace(
        fit,
        costs=np.concatenate([one.costs for one in rounds]),
        thetas=np.concatenate([one.thetas for one in rounds]),
        evaluations=sum(one.evaluations for one in rounds),
    )
