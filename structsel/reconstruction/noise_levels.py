"""Noise levels of the channels whose noise is not stated, from the innovations of the filter.

Measurements: the variance of the innovations minus the variance of their prediction [Mehra 1972]. Inertial readings:
one factor for the accelerometers and one for each gyro, on the noise in the readings themselves, that makes the
innovations most likely. These factors include scale errors and vibration, which a constant bias does not describe.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from structsel.errors import DataError
from structsel.nomenclature import AIR_DATA
from structsel.numerics import kinematics as fp
from structsel.numerics.air_data import body_velocity
from structsel.numerics.dynamic_elements import shift
from structsel.numerics.signal_quality import largest_noise_level
from structsel.reconstruction.delays import find_delays
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.problem import ReconstructionProblem, first_readings, noise_of
from structsel.reconstruction.settings import INERTIAL
from structsel.reconstruction.turbulence_level import Gusts, estimate_turbulence, turbulence_states, with_gusts
from structsel.reconstruction.ukf import negative_log_likelihood, ukf_filter, ukf_smoother

# One group for each gyro: the effect of a scale error is proportional to the rate, which differs between axes.
_GROUPS = (INERTIAL[:3], *((name,) for name in INERTIAL[3:]))
_AIR_DATA = np.array([name in AIR_DATA for name in fp.MEASUREMENTS])
_MAX_TURBULENCE = 0.1  # fraction of a vane's variance
_MAX_SAMPLES = 1500  # samples
_ROUNDS = 8
_CONVERGED = 0.03  # relative
_GATE = 6.0
_LARGEST_FACTOR = 100.0
_MIN_GAIN = 2.0  # of the log-likelihood; the gain of an unnecessary factor is smaller in 95 of 100 cases


def estimate_noise_levels(
    problem_setup: ReconstructionProblem, gusts: str | float, progress: Callable[[str, int, int], None] | None = None
) -> ReconstructionProblem:
    """Problem with the noise levels and gusts of maximum likelihood, except those that are given."""
    free, groups = _free(problem_setup), _free_groups(problem_setup)
    complete, lowest = problem_setup.problem, problem_setup.problem.measurement_std
    part = _without_outliers(_estimate_measurement_noise(most_active_interval(complete), free, lowest))
    steps, done = 2 * len(groups) + 3, 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress("noise", min(done, steps), steps)

    report()
    # Vanes and pitot tube with the noise of their own spectra: slower errors can then be turbulence.
    precise = replace(part, measurement_std=np.where(_AIR_DATA, lowest, part.measurement_std))
    if isinstance(gusts, str):
        calm = _likelihood_without_turbulence(part, free | _AIR_DATA, lowest, problem_setup.measured)
        gust = estimate_turbulence(precise, problem_setup.lateral, calm)
    else:
        gust = turbulence_states(part, gusts)
    report()
    return _fit_levels(problem_setup, precise if np.any(gust.std) else part, gust, groups, report)


def refit_noise_levels(problem_setup: ReconstructionProblem, found: ReconstructionProblem) -> ReconstructionProblem:
    """Noise levels of a problem with more states, for the turbulence `found` without these.

    Only the groups of inertial channels are searched that needed more noise than their own without these states.
    """
    groups = [
        group for group in _free_groups(problem_setup)
        if any(found.noise[INERTIAL[i]] > problem_setup.noise[INERTIAL[i]] for i in group)
    ]  # fmt: skip
    part = _without_outliers(most_active_interval(problem_setup.problem))
    return _fit_levels(problem_setup, part, found.gust, groups)


def _free_groups(problem_setup: ReconstructionProblem) -> list[list[int]]:
    """Columns of the inertial channels, by groups, whose noise is not stated."""
    return [
        [INERTIAL.index(name) for name in names if name in problem_setup.noise]
        for names in _GROUPS
        if not problem_setup.given & set(names)
    ]


def _free(problem_setup: ReconstructionProblem) -> np.ndarray:
    """(12,) measurements whose noise is not stated."""
    return np.array([name in problem_setup.measured and name not in problem_setup.given for name in fp.MEASUREMENTS])


def _fit_levels(
    problem_setup: ReconstructionProblem,
    part: KinematicsProblem,
    gust: Gusts,
    groups: list[list[int]],
    report: Callable[[], None] = lambda: None,
) -> ReconstructionProblem:
    """Problem with this turbulence and the noise levels of maximum likelihood on a part of it."""
    complete, lowest, free = problem_setup.problem, problem_setup.problem.measurement_std, _free(problem_setup)
    part = _estimate_measurement_noise(with_gusts(part, gust, problem_setup.lateral), free, lowest)
    factors = np.ones(6)
    for _ in range(2):
        for group in groups:
            factor = _most_likely_factor(part, group)
            part = _scaled(part, group, factor)
            factors[group] *= factor
            report()
        part = _estimate_measurement_noise(part, free, lowest)
    for group in groups:
        limited = _within_limits(problem_setup, part, group, factors[group])
        part = _scaled(part, group, limited / factors[group])
        factors[group] = limited
    report()
    level = dict(problem_setup.noise)
    for j, name in enumerate(fp.MEASUREMENTS):
        if free[j]:
            level[name] = float(part.measurement_std[j])
    for j, name in enumerate(INERTIAL):
        if name in level:
            level[name] *= float(factors[j])
    problem = replace(complete, input_std=complete.input_std * factors, measurement_std=part.measurement_std)
    return replace(problem_setup, problem=with_gusts(problem, gust, problem_setup.lateral), noise=level, gust=gust)


def _likelihood_without_turbulence(
    problem: KinematicsProblem, free: np.ndarray, lowest: np.ndarray, measured: tuple[str, ...]
) -> float:
    """Log-likelihood of the alternatives to turbulence: noise of the air data, or their delays."""
    noisy = _estimate_measurement_noise(problem, free, lowest)
    run, smooth = ukf_smoother(noisy, spread=0.0)
    if smooth is None:
        return np.inf
    predicted = noisy.predict(noisy.path(smooth.x))
    residuals, air_data = noisy.measurements - predicted, tuple(set(AIR_DATA) & set(measured))
    shifted = noisy.measurements.copy()
    for delay in find_delays(noisy, predicted, residuals, air_data):
        j = fp.MEASUREMENTS.index(delay.channel)
        shifted[:, j] = shift(shifted[:, j], noisy.t, delay.delay if delay.significant else 0.0)
        # All alternatives use the same number of samples, so those lost at an end are those of the original.
        lost = ~np.isfinite(shifted[:, j])
        shifted[lost, j] = problem.measurements[lost, j]
    aligned = ukf_filter(_estimate_measurement_noise(replace(noisy, measurements=shifted), free, lowest), spread=0.0)
    return max(run.log_likelihood, aligned.log_likelihood if aligned.failed < 0 else -np.inf)


def drop_confounded_scales(
    problem_setup: ReconstructionProblem,
) -> tuple[ReconstructionProblem, dict[str, str], frozenset[str]]:
    """Problem without the scale factors that are confounded with turbulence, the reasons, and the turbulent channels.

    An aircraft responds to gusts, so its motion and the gusts are correlated. If a vane measures mostly turbulence,
    this correlation determines the estimates of its scale factor and of its delay.
    """
    problem, V = problem_setup.problem, float(np.nanmedian(problem_setup.problem.measurements[:, 0]))
    fixed, turbulent = {}, set()
    for channel, scale, size in zip(("V", "beta", "alpha"), ("", "Csi", "Cup"), problem_setup.gust.std / (1.0, V, V)):
        if not size or channel not in problem_setup.measured:
            continue
        fraction = size**2 / float(np.nanvar(problem.measurements[:, fp.MEASUREMENTS.index(channel)]))
        if fraction > _MAX_TURBULENCE:
            turbulent.add(channel)
            fixed[scale] = (
                f"turbulence is {min(fraction, 1.0):.0%} of the variance of {channel}, and the aircraft responds to "
                "it; use larger manoeuvres, or calm air"
            )
    fixed = {name: why for name, why in fixed.items() if name in problem_setup.names}
    kept = np.array([name not in fixed for name in problem_setup.names])
    return replace(problem_setup, problem=problem.with_states(kept)), fixed, frozenset(turbulent)


def _without_outliers(problem: KinematicsProblem) -> KinematicsProblem:
    """Problem without outliers, which would be taken for noise or gusts."""
    run = ukf_filter(problem, spread=0.0)
    if run.failed >= 0:
        return problem
    far = np.abs(run.innovations) > _GATE * _scatter(run.innovations)
    return replace(problem, measurements=np.where(far, np.nan, problem.measurements))


def _scatter(innovations: np.ndarray) -> np.ndarray:
    """Robust standard deviation of each channel's innovations; NaN where it has none."""
    finite = [column[np.isfinite(column)] for column in innovations.T]
    return np.array([np.sqrt(np.median(column**2) / 0.455) if column.size else np.nan for column in finite])


def most_active_interval(problem: KinematicsProblem, longest: int = _MAX_SAMPLES) -> KinematicsProblem:
    """The interval of so many samples with the largest body rates, if the complete recording would take too long."""
    n = len(problem.t)
    if n <= longest:
        return problem
    activity = np.sum(
        np.diff(problem.inputs[:, 3:6], axis=0) ** 2 / problem.input_std[1:, 3:6].clip(1e-12) ** 2, axis=1
    )
    total = np.concatenate(([0.0], np.cumsum(activity)))
    first = int(np.argmax(total[longest:] - total[:-longest])) if len(total) > longest else 0
    heading = problem.measurements[:, fp.MEASUREMENTS.index("psi")]
    estimated = fp.STATES.index("psi") in problem.active
    if first == 0 or (estimated and not np.isfinite(heading).any()):  # the later heading is not known
        return problem.rows(0, longest)
    # The initial motion is that of the measurements there; the constants keep their initial values.
    start = problem.start.copy()
    read = first_readings(problem.measurements[first : first + longest])
    start[:3] = body_velocity(*(read[name][1] if name in read else 0.0 for name in AIR_DATA))
    for name in ("phi", "theta", "psi", "x", "y", "h"):
        if name in read:
            start[fp.STATES.index(name)] = read[name][1]
    return replace(problem.rows(first, first + longest), start=start)


def _estimate_measurement_noise(problem: KinematicsProblem, free: np.ndarray, lowest: np.ndarray) -> KinematicsProblem:
    """Problem in which the noise of the free channels is that of their innovations, at least `lowest`."""
    if not free.any():
        return problem
    for _ in range(_ROUNDS):
        run = ukf_filter(problem, spread=0.0)
        if run.failed >= 0:
            return problem
        # The filter starts up in the first samples, which are not used.
        rows = slice(len(problem.t) // 20, None)
        nu, std = run.innovations[rows], run.innovation_std[rows]
        usable = np.isfinite(nu) & (np.abs(nu) < _GATE * _scatter(nu))
        count = usable.sum(axis=0)
        excess = np.where(usable, nu**2 - std**2, 0.0).sum(axis=0) / np.maximum(count, 1)
        now = problem.measurement_std
        # Excess is R_true - R_used; if the filter follows the channel closely, small steps prevent an overshoot.
        variance = np.maximum(now**2 + excess, np.maximum(lowest**2, 0.1 * now**2))
        new = np.where(free & (count > 10), np.sqrt(variance), now)
        change = float(np.max(np.abs(np.log(new / now))))
        problem = replace(problem, measurement_std=new)
        if change < _CONVERGED:
            break
    return problem


def largest_inertial_noise(problem: KinematicsProblem, column: int) -> float:
    """Largest noise that high frequencies of an inertial channel allow; infinite if it is too slow for a spectrum."""
    values, dt = problem.inputs[:, column], float(np.median(np.diff(problem.t)))
    try:
        largest = largest_noise_level(values, dt)
    except DataError:
        return np.inf
    # The noise in the readings is the smallest level that is estimated.
    return max(largest, noise_of(INERTIAL[column], values, dt))


def _within_limits(
    problem_setup: ReconstructionProblem, part: KinematicsProblem, group: list[int], factors: np.ndarray
) -> np.ndarray:
    """Factors of a group of inertial channels, reduced to the largest noise of each channel if that is as likely.

    The likelihood of a short recording hardly changes with the noise of the accelerometers, and one factor for all
    three can exceed the limit of a channel that needs no additional noise.
    """
    names = [INERTIAL[j] for j in group]
    limits = [largest_inertial_noise(problem_setup.problem, j) / problem_setup.noise[n] for j, n in zip(group, names)]
    limited = np.minimum(factors, np.maximum(limits, 1.0))
    if np.array_equal(limited, factors):
        return factors
    loss = negative_log_likelihood(_scaled(part, group, limited / factors)) - negative_log_likelihood(part)
    return limited if loss < _MIN_GAIN else factors


def limit_accelerometer_noise(problem_setup: ReconstructionProblem, lowest: np.ndarray) -> ReconstructionProblem:
    """Problem with no more noise of the accelerometers than their high frequencies allow; the same if there is no more.

    Vanes, pitot tube and static port have errors of position and lag that last for seconds. More noise of the
    accelerometers makes these more likely, but it is not in their readings: the path would follow the air data, and
    their errors would change the constants. With the limit, these errors are noise of the measurements.

    Parameters
    ----------
    problem_setup : ReconstructionProblem
        With the estimated noise.
    lowest : (12,) array
        Noise of the measurements in their own spectra, the lower limit of their noise.
    """
    complete, factors, level = problem_setup.problem, np.ones(6), dict(problem_setup.noise)
    for j, name in enumerate(INERTIAL[:3]):
        if name in level and name not in problem_setup.given:
            factors[j] = min(1.0, largest_inertial_noise(complete, j) / level[name])
            level[name] *= float(factors[j])
    if np.all(factors == 1.0):
        return problem_setup
    complete, free = replace(complete, input_std=complete.input_std * factors), _free(problem_setup)
    part = _estimate_measurement_noise(_without_outliers(most_active_interval(complete)), free, lowest)
    level |= {n: float(std) for n, std, one in zip(fp.MEASUREMENTS, part.measurement_std, free) if one}
    return replace(problem_setup, problem=replace(complete, measurement_std=part.measurement_std), noise=level)


def _scaled(problem: KinematicsProblem, group: list[int], factor: float | np.ndarray) -> KinematicsProblem:
    std = problem.input_std.copy()
    std[:, group] *= factor
    return replace(problem, input_std=std)


def _most_likely_factor(problem: KinematicsProblem, group: list[int]) -> float:
    """Factor of maximum likelihood on the noise of a group of inertial channels; 1 without a significant gain."""

    def cost(log_factor: float) -> float:
        return negative_log_likelihood(_scaled(problem, group, float(np.exp(log_factor))))

    # The noise cannot be smaller than in the readings themselves.
    limits = (0.0, float(np.log(_LARGEST_FACTOR)))
    found = scipy.optimize.minimize_scalar(cost, bounds=limits, method="bounded", options={"xatol": 0.1})
    return float(np.exp(found.x)) if found.fun < cost(0.0) - _MIN_GAIN else 1.0
