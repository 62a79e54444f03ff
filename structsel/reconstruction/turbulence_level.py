"""Turbulence, which vanes and pitot see and the instruments of inertia do not.

A gust is a first-order process along each body axis. How fast it grows, sigma sqrt(2 / tau), and how soon it dies away,
tau, are those that make the innovations most likely. Without it a gust would have to be noise of the vanes, which has
no memory, or of the accelerometers, which would move the flight path as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from structsel.numerics import kinematics as fp
from structsel.reconstruction.ukf import KinematicsProblem, ukf_filter

_LENGTH = 200.0  # m of air in which a gust dies away, to begin with: Dryden's scales near the ground
_LENGTHS = (50.0, 2000.0)  # m, shortest and longest: what changes faster is noise, and slower is wind
_PROBES = (0.05, 0.2, 0.8, 2.5)  # m/s
_RANGE = (-1.6, 1.6)  # of the logarithm, about what was found so far
_BETWEEN_AXES = (-0.7, 0.7)  # turbulence is much the same along all axes; a faulty vane is not
_LEAST_GAIN = 5.0  # of the log-likelihood


@dataclass(frozen=True)
class Gusts:
    """Turbulence along x, y, z.

    Attributes
    ----------
    std : (3,) array [m/s]
    time : float [s]
        In which it dies away to 1/e.
    """

    std: np.ndarray
    time: float


CALM = Gusts(np.zeros(3), np.inf)


def turbulence_states(problem: KinematicsProblem, std: float) -> Gusts:
    """Gusts of one standard deviation [m/s] along all axes, dying away as they do near the ground."""
    return Gusts(np.full(3, std), _LENGTH / _airspeed(problem)) if std else CALM


def _airspeed(problem: KinematicsProblem) -> float:
    return max(float(np.nanmedian(problem.measurements[:, 0])), 1.0)


def with_gusts(problem: KinematicsProblem, gusts: Gusts, lateral: bool) -> KinematicsProblem:
    """Problem with gusts among its states; the same one in calm air."""
    if not np.any(gusts.std):
        return problem
    axes = np.array([0, 1, 2] if lateral else [0, 2])
    calm = problem.keeping(problem.active < fp.GUST)
    drift = problem.drift.copy()
    drift[fp.GUST :] = gusts.std * np.sqrt(2.0 / gusts.time)
    return replace(
        calm,
        active=np.concatenate([calm.active, fp.GUST + axes]),
        start_std=np.concatenate([calm.start_std, gusts.std[axes]]),
        drift=drift,
        gust_time=gusts.time,
    )


def estimate_turbulence(problem: KinematicsProblem, lateral: bool, still: float) -> Gusts:
    """Likeliest gusts; `CALM` where still air is as likely.

    One size for all axes first, then the time, then each axis by itself: near the ground they differ.

    Parameters
    ----------
    problem : KinematicsProblem
        Vanes and pitot without more noise than they have of themselves.
    lateral : bool
    still : float
        Log-likelihood of still air, vanes and pitot as noisy as they would then have to be.
    """
    probes = [turbulence_states(problem, std) for std in _PROBES]
    costs = [_cost(problem, gusts, lateral) for gusts in probes]
    if min(costs) > -still - _LEAST_GAIN:
        return CALM
    found = probes[int(np.argmin(costs))]
    everything = [0, 1, 2]
    for axes in (everything, None, everything, None, [2], [0], *([[1]] if lateral else [])):
        found = _improved(problem, found, axes, lateral)
    return found


def _improved(problem: KinematicsProblem, gusts: Gusts, axes: list[int] | None, lateral: bool) -> Gusts:
    """Gusts larger or smaller along some axes; or of another time, growing as fast as before."""

    def tried(log_factor: float) -> Gusts:
        factor = float(np.exp(log_factor))
        if axes is None:
            shortest, longest = (length / _airspeed(problem) for length in _LENGTHS)
            time = float(np.clip(gusts.time * factor, shortest, longest))
            return Gusts(gusts.std * np.sqrt(time / gusts.time), time)
        std = gusts.std.copy()
        std[axes] *= factor
        return replace(gusts, std=std)

    bounds = _BETWEEN_AXES if axes is not None and len(axes) == 1 else _RANGE
    found = minimize_scalar(
        lambda x: _cost(problem, tried(x), lateral), bounds=bounds, method="bounded", options={"xatol": 0.1}
    )
    return tried(float(found.x))


def _cost(problem: KinematicsProblem, gusts: Gusts, lateral: bool) -> float:
    run = ukf_filter(with_gusts(problem, gusts, lateral), spread=0.0)
    return 1e12 if run.failed >= 0 else -run.log_likelihood
