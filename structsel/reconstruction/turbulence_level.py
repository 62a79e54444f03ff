"""Turbulence: air data measure it, inertial instruments do not.

A gust is a first-order process along each body axis, with the growth rate sigma sqrt(2 / tau) and the correlation time
tau that make the innovations most likely. In a model without turbulence, gusts would be noise of the vanes, which is
white, or of the accelerometers, which would change the flight path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.numerics import kinematics as fp
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.ukf import negative_log_likelihood

_LENGTH = 200.0  # m, initial correlation length: Dryden's scales near the ground
_LENGTHS = (50.0, 2000.0)  # m, shortest and longest correlation length; faster changes are noise, slower ones are wind
_PROBES = (0.05, 0.2, 0.8, 2.5)  # m/s
_RANGE = (-1.6, 1.6)  # of the logarithm, about the last estimate
_BETWEEN_AXES = (-0.7, 0.7)  # turbulence is similar along all axes; errors of a faulty vane are not
_MIN_GAIN = 5.0  # of the log-likelihood


@dataclass(frozen=True)
class Gusts:
    """Turbulence along x, y, z.

    Attributes
    ----------
    std : (3,) array [m/s]
    time : float [s]
        Correlation time.
    """

    std: np.ndarray
    time: float


CALM = Gusts(np.zeros(3), np.inf)


def turbulence_states(problem: KinematicsProblem, std: float) -> Gusts:
    """Gusts of one standard deviation [m/s] along all axes, with a correlation length as near the ground."""
    return Gusts(np.full(3, std), _LENGTH / _airspeed(problem)) if std else CALM


def _airspeed(problem: KinematicsProblem) -> float:
    """Median measured airspeed, at least 1 m/s."""
    return max(float(np.nanmedian(problem.measurements[:, 0])), 1.0)


def with_gusts(problem: KinematicsProblem, gusts: Gusts, lateral: bool) -> KinematicsProblem:
    """Problem with gusts as additional states; unchanged in calm air."""
    if not np.any(gusts.std):
        return problem
    axes = np.array([0, 1, 2] if lateral else [0, 2])
    calm = problem.with_states(problem.active < fp.GUST)
    drift = problem.drift.copy()
    drift[fp.GUST :] = gusts.std * np.sqrt(2.0 / gusts.time)
    return replace(
        calm,
        active=np.concatenate([calm.active, fp.GUST + axes]),
        start_std=np.concatenate([calm.start_std, gusts.std[axes]]),
        drift=drift,
        gust_time=gusts.time,
    )


def estimate_turbulence(problem: KinematicsProblem, lateral: bool, calm: float) -> Gusts:
    """Gusts of maximum likelihood; `CALM` if calm air is as likely.

    First one standard deviation for all axes and the correlation time, then each axis alone: near the ground the axes
    differ.

    Parameters
    ----------
    problem : KinematicsProblem
        With the noise of vanes and pitot tube from their own spectra.
    lateral : bool
    calm : float
        Log-likelihood of calm air, with the noise of vanes and pitot tube that this requires.
    """
    probes = [turbulence_states(problem, std) for std in _PROBES]
    costs = [_cost(problem, gusts, lateral) for gusts in probes]
    if min(costs) > -calm - _MIN_GAIN:
        return CALM
    found = probes[int(np.argmin(costs))]
    everything = [0, 1, 2]
    for axes in (everything, None, everything, None, [2], [0], *([[1]] if lateral else [])):
        found = _improved(problem, found, axes, lateral)
    return found


def _improved(problem: KinematicsProblem, gusts: Gusts, axes: list[int] | None, lateral: bool) -> Gusts:
    """Gusts with the best factor on the standard deviation of some axes, or on the time at constant growth rate."""

    def scaled(log_factor: float) -> Gusts:
        factor = float(np.exp(log_factor))
        if axes is None:
            shortest, longest = (length / _airspeed(problem) for length in _LENGTHS)
            time = float(np.clip(gusts.time * factor, shortest, longest))
            return Gusts(gusts.std * np.sqrt(time / gusts.time), time)
        std = gusts.std.copy()
        std[axes] *= factor
        return replace(gusts, std=std)

    bounds = _BETWEEN_AXES if axes is not None and len(axes) == 1 else _RANGE
    found = scipy.optimize.minimize_scalar(
        lambda x: _cost(problem, scaled(x), lateral), bounds=bounds, method="bounded", options={"xatol": 0.1}
    )
    return scaled(float(found.x))


def _cost(problem: KinematicsProblem, gusts: Gusts, lateral: bool) -> float:
    return negative_log_likelihood(with_gusts(problem, gusts, lateral))
