"""How noisy each channel is, as far as nobody said: from what the filter could not foresee.

Measurements: the variance the innovations have beyond what the prediction is unsure of (Mehra 1972). Inertial
readings: one factor for the accelerometers and one for each gyro, above the noise seen in the readings
themselves, that makes the innovations most likely. Scale errors and vibration that a constant bias does not
describe end up in these factors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from structsel.nomenclature import AIR_DATA
from structsel.numerics import kinematics as fp
from structsel.numerics.air_data import body_velocity
from structsel.numerics.dynamic_elements import shift
from structsel.reconstruction.delays import find_delays
from structsel.reconstruction.problem import ReconstructionProblem
from structsel.reconstruction.settings import INERTIAL
from structsel.reconstruction.turbulence_level import estimate_turbulence, turbulence_states, with_gusts
from structsel.reconstruction.ukf import KinematicsProblem, ukf_filter, ukf_smoother

# Each gyro by itself: its scale error counts by what it turns, and that differs from axis to axis by far.
_GROUPS = (INERTIAL[:3], *((name,) for name in INERTIAL[3:]))
_FEELS_GUSTS = np.array([name in AIR_DATA for name in fp.MEASUREMENTS])
_MOST_GUSTS = 0.1  # share of a vane's variance
_EXCERPT = 1500  # samples
_ROUNDS = 8
_SETTLED = 0.03  # relative
_GATE = 6.0
_LARGEST_FACTOR = 100.0
_LEAST_GAIN = 2.0  # of the log-likelihood: chance alone gains less in 95 of 100


def estimate_noise_levels(
    problem_setup: ReconstructionProblem, gusts: str | float, progress: Callable[[str, int, int], None] | None = None
) -> ReconstructionProblem:
    """Problem whose unstated noise levels, and gusts unless they are given, make its innovations most likely."""
    free = np.array([name in problem_setup.measured and name not in problem_setup.given for name in fp.MEASUREMENTS])
    groups = [
        [INERTIAL.index(name) for name in names if name in problem_setup.noise]
        for names in _GROUPS
        if not problem_setup.given & set(names)
    ]
    whole, least = problem_setup.problem, problem_setup.problem.measurement_std
    part = _without_outliers(_estimate_measurement_noise(most_active_interval(whole), free, least))
    steps, done = 2 * len(groups) + 3, 0

    def tell() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress("noise", min(done, steps), steps)

    tell()
    # Vanes and pitot at the noise their own spectra show: what is slower than noise is theirs to tell of the air.
    fine = np.where(_FEELS_GUSTS, least, part.measurement_std)
    seen = replace(part, measurement_std=fine)
    if isinstance(gusts, str):
        still = _likelihood_without_turbulence(part, free | _FEELS_GUSTS, least, problem_setup.measured)
        gust = estimate_turbulence(seen, problem_setup.lateral, still)
    else:
        gust = turbulence_states(part, gusts)
    part = seen if np.any(gust.std) else part
    part = _estimate_measurement_noise(with_gusts(part, gust, problem_setup.lateral), free, least)
    tell()
    factors = np.ones(6)
    for _ in range(2):
        for group in groups:
            factor = _likeliest_factor(part, group)
            part = _scaled(part, group, factor)
            factors[group] *= factor
            tell()
        part = _estimate_measurement_noise(part, free, least)
    tell()
    level = dict(problem_setup.noise)
    for j, name in enumerate(fp.MEASUREMENTS):
        if free[j]:
            level[name] = float(part.measurement_std[j])
    for j, name in enumerate(INERTIAL):
        if name in level:
            level[name] *= float(factors[j])
    problem = replace(whole, input_std=whole.input_std * factors, measurement_std=part.measurement_std)
    return replace(problem_setup, problem=with_gusts(problem, gust, problem_setup.lateral), noise=level, gust=gust)


def _likelihood_without_turbulence(
    problem: KinematicsProblem, free: np.ndarray, least: np.ndarray, measured: tuple[str, ...]
) -> float:
    """Log-likelihood of what else than gusts could move the air data: noise, or vanes that are late."""
    noisy = _estimate_measurement_noise(problem, free, least)
    run, smooth = ukf_smoother(noisy, spread=0.0)
    if smooth is None:
        return np.inf
    told = fp.readings(noisy.path(smooth.x), noisy.inputs, noisy.place, noisy.flank)
    shifted = noisy.measurements.copy()
    for late in find_delays(noisy, told, noisy.measurements - told, tuple({"V", "alpha", "beta"} & set(measured))):
        j = fp.MEASUREMENTS.index(late.channel)
        shifted[:, j] = shift(shifted[:, j], noisy.t, late.delay if late.significant else 0.0)
        # What is lost at an end is lost to the other explanations as well.
        lost = ~np.isfinite(shifted[:, j])
        shifted[lost, j] = problem.measurements[lost, j]
    aligned = ukf_filter(_estimate_measurement_noise(replace(noisy, measurements=shifted), free, least), spread=0.0)
    return max(run.log_likelihood, aligned.log_likelihood if aligned.failed < 0 else -np.inf)


def drop_confounded_scales(
    problem_setup: ReconstructionProblem,
) -> tuple[ReconstructionProblem, dict[str, str], frozenset[str]]:
    """Problem without the vanes' scales that turbulence imitates, why each was left out, and the channels it rules.

    An aircraft answers gusts, so its own motion and the gusts are alike; where the vane sees little else, its scale
    (or its delay) would be whatever that likeness is.
    """
    problem, V = problem_setup.problem, float(np.nanmedian(problem_setup.problem.measurements[:, 0]))
    fixed, ruled = {}, set()
    for channel, scale, size in zip(("V", "beta", "alpha"), ("", "Csi", "Cup"), problem_setup.gust.std / (1.0, V, V)):
        if not size or channel not in problem_setup.measured:
            continue
        share = size**2 / float(np.nanvar(problem.measurements[:, fp.MEASUREMENTS.index(channel)]))
        if share > _MOST_GUSTS:
            ruled.add(channel)
            fixed[scale] = (
                f"turbulence makes {min(share, 1.0):.0%} of what {channel} does, and the aircraft answers it; fly "
                "larger manoeuvres, or in calm air"
            )
    fixed = {name: why for name, why in fixed.items() if name in problem_setup.names}
    kept = np.array([name not in fixed for name in problem_setup.names])
    return replace(problem_setup, problem=problem.keeping(kept)), fixed, frozenset(ruled)


def _without_outliers(problem: KinematicsProblem) -> KinematicsProblem:
    """Problem without the readings far outside their channel's own scatter: they would pass for noise or gusts."""
    run = ukf_filter(problem, spread=0.0)
    if run.failed >= 0:
        return problem
    far = np.abs(run.innovations) > _GATE * _scatter(run.innovations)
    return replace(problem, measurements=np.where(far, np.nan, problem.measurements))


def _scatter(innovations: np.ndarray) -> np.ndarray:
    """Robust standard deviation of each channel's innovations; NaN where it has none."""
    finite = [column[np.isfinite(column)] for column in innovations.T]
    return np.array([np.sqrt(np.median(column**2) / 0.455) if column.size else np.nan for column in finite])


def most_active_interval(problem: KinematicsProblem) -> KinematicsProblem:
    """The stretch that moves most, where the whole would take too long."""
    n = len(problem.t)
    if n <= _EXCERPT:
        return problem
    activity = np.sum(
        np.diff(problem.inputs[:, 3:6], axis=0) ** 2 / problem.input_std[1:, 3:6].clip(1e-12) ** 2, axis=1
    )
    total = np.concatenate(([0.0], np.cumsum(activity)))
    first = int(np.argmax(total[_EXCERPT:] - total[:-_EXCERPT])) if len(total) > _EXCERPT else 0
    asked, measured = fp.STATES.index("psi") in problem.active, problem.measurements[:, fp.MEASUREMENTS.index("psi")]
    if first == 0 or (asked and not np.isfinite(measured).any()):  # the heading later on is not known
        return problem.rows(0, _EXCERPT)
    # The start is that of the measurements there, as at the first sample; the constants are not known better.
    start = problem.start.copy()
    angles = _first_readings(problem.measurements[first : first + _EXCERPT])
    start[:3] = body_velocity(*(angles.get(name, 0.0) for name in AIR_DATA))
    for name in ("phi", "theta", "psi", "x", "y", "h"):
        if name in angles:
            start[fp.STATES.index(name)] = angles[name]
    return replace(problem.rows(first, first + _EXCERPT), start=start)


def _first_readings(measurements: np.ndarray) -> dict[str, float]:
    found = {}
    for j, name in enumerate(fp.MEASUREMENTS):
        seen = np.flatnonzero(np.isfinite(measurements[:, j]))
        if seen.size:
            found[name] = float(measurements[seen[0], j])
    return found


def _estimate_measurement_noise(problem: KinematicsProblem, free: np.ndarray, least: np.ndarray) -> KinematicsProblem:
    if not free.any():
        return problem
    for _ in range(_ROUNDS):
        run = ukf_filter(problem, spread=0.0)
        if run.failed >= 0:
            return problem
        # The first samples find the start; they say little about the noise.
        rows = slice(len(problem.t) // 20, None)
        nu, std = run.innovations[rows], run.innovation_std[rows]
        usable = np.isfinite(nu) & (np.abs(nu) < _GATE * _scatter(nu))
        count = usable.sum(axis=0)
        beyond = np.where(usable, nu**2 - std**2, 0.0).sum(axis=0) / np.maximum(count, 1)
        now = problem.measurement_std
        # Beyond is R_true - R_used; where the filter hangs on the channel, small steps keep it from overshooting.
        variance = np.maximum(now**2 + beyond, np.maximum(least**2, 0.1 * now**2))
        new = np.where(free & (count > 10), np.sqrt(variance), now)
        change = float(np.max(np.abs(np.log(new / now))))
        problem = replace(problem, measurement_std=new)
        if change < _SETTLED:
            break
    return problem


def _scaled(problem: KinematicsProblem, group: list[int], factor: float) -> KinematicsProblem:
    std = problem.input_std.copy()
    std[:, group] *= factor
    return replace(problem, input_std=std)


def _likeliest_factor(problem: KinematicsProblem, group: list[int]) -> float:
    def cost(log_factor: float) -> float:
        run = ukf_filter(_scaled(problem, group, float(np.exp(log_factor))), spread=0.0)
        return 1e12 if run.failed >= 0 else -run.log_likelihood

    # Less than what the readings themselves show cannot be.
    limits = (0.0, float(np.log(_LARGEST_FACTOR)))
    found = minimize_scalar(cost, bounds=limits, method="bounded", options={"xatol": 0.1})
    return float(np.exp(found.x)) if found.fun < cost(0.0) - _LEAST_GAIN else 1.0
