"""Filter error: the flight corrected by its innovations, process noise estimated beside the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Predict
from structsel.refinement.problem import Problem, Tracker, filled

_ROUNDS = 15
_ALIKE = 0.02  # change of a variance that no longer counts, relative
_STILL = 0.05  # change of a parameter that no longer counts, in its standard deviations
_OWN = 0.1
"""Least share of an innovation's variance that is the instrument's own. A channel trusted to the last digit would be
copied, not predicted: its residual, and what it says of the model, would be gone. [J15] bounds the gain for that."""
_THIRD = 20.0  # variance of the third differences of white noise over its own


class PredictionProblem(Problem):
    """Outputs expected of each sample; `variances` (c,) are those of the measurements that weigh the feedback.

    Process noise is searched for as its logarithm.
    """

    said = "predicted sample by sample"
    flyers: list[Tracker]

    def make_ready(self) -> list[Tracker]:
        """What predicts each recording."""
        self.variances = self._roughness()
        self.noisy = np.array([p.kind == "process" for p in self.parameters])
        return [self.model.track(r, self.columns) for r in self.recordings]

    def _roughness(self) -> np.ndarray:
        """(c,) variances of the noise as the third differences have them."""
        rough, spread = [], np.nanvar(np.concatenate(self.y), axis=0)
        for y in self.y:
            third = np.diff(y, 3, axis=0)
            rough.append(third[np.isfinite(third).all(axis=1)] if len(third) else third)
        pooled = np.concatenate(rough)
        found = np.mean(pooled**2, axis=0) / _THIRD if len(pooled) else 0.01 * spread
        return np.maximum(found, 1e-8 * np.where(spread > 0.0, spread, 1.0))

    def inner(self, values: np.ndarray) -> np.ndarray:
        """Logarithm of the process noise."""
        with np.errstate(divide="ignore"):
            return np.where(self.noisy, np.log(np.where(self.noisy, values, 1.0)), values)

    def outer(self, thetas: np.ndarray) -> np.ndarray:
        """Process noise as a standard deviation."""
        return np.where(self.noisy, np.exp(np.where(self.noisy, thetas, 0.0)), thetas)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """(k,) derivative of `outer`."""
        return np.where(self.noisy, self.outer(theta), 1.0)

    @property
    def scale(self) -> np.ndarray:
        """(k,) typical sizes; of a logarithm, one."""
        return np.where(self.noisy, 1.0, super().scale)

    def _gain(self, j: int, thetas: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, _, _, delay = self.flown(thetas, self.recordings[j].name)
        process = self._filled(np.zeros(len(self.model.states)), self.outer(thetas), "process", self.model.states)
        with np.errstate(all="ignore"):
            return self.flyers[j].gain(values, delay, process, self.variances / factor**2)

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        name, y = self.recordings[j].name, self.y[j]

        def predict(thetas: np.ndarray) -> np.ndarray:
            thetas = filled(thetas, held, free)
            factor, shift = self.instrument(thetas, name)
            gain = self._gain(j, thetas, factor)[0]
            with np.errstate(all="ignore"):
                measured = (y[None] - shift[:, None, :]) / factor[:, None, :]
            outputs = self.flyers[j].fly(*self.flown(thetas, name), gain, measured)
            return factor[:, None, :] * outputs + shift[:, None, :]

        return predict

    def own_noise(self, fit: OutputErrorFit) -> np.ndarray:
        """(c,) variances of the measurements: what the states' uncertainty leaves of the innovations'."""
        theta = fit.theta[None]
        spread, samples = np.zeros(len(self.outputs)), 0
        for j, r in enumerate(self.recordings):
            factor = self.instrument(theta, r.name)[0]
            spread += len(r) * (factor**2 * self._gain(j, theta, factor)[1])[0]
            samples += len(r)
        innovations = np.diag(fit.R)
        return np.maximum(innovations - spread / samples, _OWN * innovations)


def settle(
    problem: PredictionProblem, fit: OutputErrorFit, descend: Callable[[np.ndarray], OutputErrorFit]
) -> OutputErrorFit:
    """From a first fit on, measurements' noise and fit in turn until neither changes; its history is that of all."""
    rounds = [fit]
    before = step = np.zeros(len(problem.variances))
    while np.isfinite(fit.costs[-1]) and len(rounds) < _ROUNDS:
        wanted = np.log(problem.own_noise(fit) / problem.variances)
        with np.errstate(all="ignore"):  # secants: the change wanted falls by so much of the step taken
            fall = (before - wanted) / step
        step = wanted / np.clip(np.where(np.isfinite(fall), fall, 1.0), 0.3, 3.0)
        before = wanted
        problem.variances, last = problem.variances * np.exp(step), fit
        fit = descend(last.theta)
        rounds.append(fit)
        with np.errstate(invalid="ignore"):
            moved = np.abs(fit.theta - last.theta)[~problem.noisy] / fit.std[~problem.noisy]
        if not (np.abs(wanted) >= _ALIKE).any():
            break
    else:
        if np.isfinite(fit.costs[-1]) and (moved >= _STILL).any():
            message = f"the measurements' own noise has not settled in {_ROUNDS} rounds"
            best = int(np.argmin([one.costs[-1] for one in rounds]))
            rounds = rounds[: best + 1]
            fit = replace(rounds[best], converged=False, message=message)
    return replace(
        fit,
        costs=np.concatenate([one.costs for one in rounds]),
        thetas=np.concatenate([one.thetas for one in rounds]),
        evaluations=sum(one.evaluations for one in rounds),
    )
