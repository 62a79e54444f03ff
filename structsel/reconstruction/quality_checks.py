"""Checks of a reconstruction: warnings, and reasons not to use the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from structsel.nomenclature import unit_of
from structsel.reconstruction.delays import Delay
from structsel.reconstruction.innovations import Consistency
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.noise_levels import largest_inertial_noise, most_active_interval
from structsel.reconstruction.observability import Reconstructibility
from structsel.reconstruction.problem import ReconstructionProblem, noise_of
from structsel.reconstruction.result import CONSTANTS, ESTIMATED_ONLY, Constant
from structsel.reconstruction.settings import INERTIAL, SCALES
from structsel.reconstruction.sign_and_unit_checks import MIN_LEVER_ARM
from structsel.reconstruction.ukf import ukf_filter

_MAX_INTERPOLATED = 0.01  # fraction of an inertial channel's readings
_MAX_REJECTED = 0.1  # fraction of a channel's readings
_IMPLAUSIBLE = {"bax": 2.0, "bay": 2.0, "baz": 2.0, "bp": 0.1, "bq": 0.1, "br": 0.1, "Cup": 0.5, "Csi": 0.5,
                "Calpha0": 0.1, "KV": 0.2, "wn": 80.0, "we": 80.0, "wd": 15.0} | dict.fromkeys(SCALES, 0.2)  # fmt: skip
_MAX_STD = 0.05  # rad, or fraction of the airspeed
_MAX_DELAY = 0.05  # s
# Effect of a delay on the readings that matters: in standard deviations of the noise, rad, m/s. Turbulence can conceal
# a delay, and the path then follows the delayed vane.
_DELAY_NOISE, _DELAY_ANGLE, _DELAY_SPEED = 3.0, 3e-3, 0.5
_MAX_NOISE_RATIO = 5.0  # noise level over the noise in the readings themselves
_MIN_STATED = 3  # channels
_MAX_VARIANCE = 2.5  # of normalised innovations with a stated noise
_MIN_SIGN_GAIN = 15.0  # log-likelihood
_POSITIONS = {"accelerometers": [0], "vanes": [1, 2, 3], "static port": [4], "GPS antenna": [5]}
_LARGE = {"V": 5.0, "alpha": 0.05, "beta": 0.05, "phi": 0.1, "theta": 0.05, "psi": 0.2}


def check_quality(
    problem_setup: ReconstructionProblem,
    path: np.ndarray,
    consistency: Consistency,
    constants: tuple[Constant, ...],
    verdict: Reconstructibility,
    delays: tuple[Delay, ...],
    stds: Mapping[str, np.ndarray],
    white: np.ndarray,
    wide: np.ndarray,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Warnings, and reasons not to use the result; each is a sentence."""
    warnings, contradicted = [], []
    for channel in consistency.channels:
        name, n = channel.channel, channel.n
        rejected, excess = channel.rejected / max(n, 1), np.sqrt(max(channel.variance, 0.0))
        reasons = []
        if rejected > _MAX_REJECTED:
            reasons.append(f"{channel.rejected} of {n} readings are outside the gate")
        elif channel.rejected:
            warnings.append(f"{channel.rejected} of {n} readings of {name} are outside the gate and were not used")
        if name in problem_setup.given and channel.variance > _MAX_VARIANCE:
            stated = f"{problem_setup.noise[name]:.3g}"
            reasons.append(f"innovations are {excess:.1f} times as large as with its stated noise of {stated}")
        elif name in _LARGE and channel.residual_rms > _LARGE[name]:
            reasons.append(f"the rms residual is {channel.residual_rms:.2g}")
        if reasons:
            text = f"{name} contradicts the other channels: {', and '.join(reasons)}"
            contradicted.append((max(excess, 10.0 * rejected), text))
    too_small = _noise_too_small(problem_setup, consistency)
    contradicted.sort(key=lambda found: -found[0])
    worst = max([1.0, *(c.variance * c.inflation for c in consistency.channels if np.isfinite(c.variance))])
    delayed = {delay: _delay_text(delay) for delay in delays if delay.significant}
    named = {text.split()[0] for _, text in contradicted}
    # First the delays: a delayed channel can be mistaken for a wrong sensor position.
    distrust = [
        text
        for delay, text in delayed.items()
        if abs(delay.delay) > _MAX_DELAY
        and (delay.channel in named or _is_large(delay, problem_setup.noise[delay.channel]))
    ]
    distrust += _reversed_positions(problem_setup.problem, worst)
    faults = [f for f in problem_setup.findings if f.severity == "warning"]
    if contradicted:
        # An error of an inertial reading affects all measurements.
        distrust += [
            str(f).removeprefix("warning: ")
            for f in faults
            if f.channel in INERTIAL and f.count > _MAX_INTERPOLATED * len(path)
        ]
    distrust += too_small + _implausible(constants) + [text for _, text in contradicted] + _undetermined(path, stds)
    if contradicted:
        distrust.append(
            "first check time, sign, unit and position of the first channel named here, and the stated noise; a bias "
            "that drifts needs drift, a delayed channel delays='estimate' (--delays estimate)"
        )
    warnings += [text for f in faults if (text := str(f).removeprefix("warning: ")) not in distrust]
    warnings += [text for text in delayed.values() if text not in distrust]
    quiet = [
        c.channel for c in consistency.channels if c.channel in problem_setup.given and c.variance < 1.0 / _MAX_VARIANCE
    ]
    if quiet:
        warnings.append(f"innovations of {', '.join(quiet)} are far smaller than the stated noise: reduce it")
    warnings += _noisier_than_readings(problem_setup)
    coloured = [c.channel for c in consistency.channels if not c.white]
    if coloured:
        factor = float(np.median(wide[-1] / white[-1]))
        warnings.append(
            f"innovations of {', '.join(coloured)} are not white (turbulence, lags or a drifting instrument): standard "
            f"deviations are increased, by the median factor {factor:.2g}"
        )
    weak = [c.name for c in constants if verdict.verdicts.get(c.name) == "weak"]
    if weak:
        warnings.append(f"these data have little information on {', '.join(weak)}: the prior determines the value")
    return tuple(warnings), tuple(distrust)


def unconfirmed(consistency: Consistency) -> tuple[str, ...]:
    """A reason if the noise was estimated and the innovations are not as large as it predicts."""
    if consistency.inside or not consistency.noise_estimated:
        return ()
    low, high = consistency.nis_band
    return (f"{ESTIMATED_ONLY}: NIS is {consistency.nis:.3f}, and its 95 % band is {low:.3f} to {high:.3f}",)


def noise_above_limit(problem_setup: ReconstructionProblem) -> tuple[str, ...]:
    """A reason if inertial channels have more estimated noise than their own high frequencies allow."""
    found = []
    for j, name in enumerate(INERTIAL):
        if name in problem_setup.given or name not in problem_setup.noise:
            continue
        largest, level = largest_inertial_noise(problem_setup.problem, j), problem_setup.noise[name]
        if level > largest * (1.0 + 1e-9):  # a level at its limit is within it
            found.append(f"{name} {level:.3g} {unit_of(name)} (at most {largest:.3g})")
    if not found:
        return ()
    return (
        f"{ESTIMATED_ONLY}: more noise was estimated than high frequencies of the channel allow: {', '.join(found)}; "
        "the estimates use no more for accelerometers",
    )


def _is_large(delay: Delay, noise: float) -> bool:
    """Whether a delay changes the readings of its channel by much more than their noise."""
    smallest = _DELAY_SPEED if delay.channel == "V" else _DELAY_ANGLE
    return delay.effect > max(_DELAY_NOISE * noise, smallest)


def _delay_text(delay: Delay) -> str:
    direction = "delayed" if delay.delay > 0.0 else "advanced"
    return (
        f"{delay.channel} is {direction} by {abs(delay.delay):.3f} s (+- {2 * delay.std:.3f}); delays='estimate' "
        "(--delays estimate) corrects it"
    )


def _noisier_than_readings(problem_setup: ReconstructionProblem) -> list[str]:
    """Inertial channels whose noise level is far above the noise in their readings."""
    problem = problem_setup.problem
    dt = float(np.median(np.diff(problem.t)))
    found = []
    for j, name in enumerate(INERTIAL):
        if name in problem_setup.given or name not in problem_setup.noise:
            continue
        own = noise_of(name, problem.inputs[:, j], dt)
        if problem_setup.noise[name] > _MAX_NOISE_RATIO * own:
            found.append(f"{name} ({problem_setup.noise[name] / own:.0f} times)")
    if not found:
        return []
    return [
        f"{', '.join(found)} are consistent with the other instruments only if their noise is so much larger than in "
        "the readings: scale errors, a delay, vibration or a bias that drifts (see drift)"
    ]


def _noise_too_small(problem_setup: ReconstructionProblem, consistency: Consistency) -> list[str]:
    """A reason if all stated noise levels are exceeded: they are wrong rather than all instruments."""
    excess = [np.sqrt(c.variance) for c in consistency.channels if c.channel in problem_setup.given]
    if len(excess) < _MIN_STATED or min(excess) ** 2 <= _MAX_VARIANCE:
        return []
    return [
        f"innovations are {min(excess):.1f} to {max(excess):.1f} times as large as stated in all {len(excess)} "
        "channels: the stated noise is probably too small (remove it, and it is estimated)"
    ]


def _implausible(constants: tuple[Constant, ...]) -> list[str]:
    """Constants that are too large for an instrument without faults."""
    return [
        f"{c.name}, {CONSTANTS[c.name][0]}, is estimated as {c.value:.3g} {c.unit}, too large for an instrument "
        "without faults (check signs, units and sensor positions)"
        for c in constants
        if abs(c.value) - 2.0 * c.std > _IMPLAUSIBLE.get(c.name, np.inf)
    ]


def _undetermined(path: np.ndarray, stds: Mapping[str, np.ndarray]) -> list[str]:
    """Motion that these instruments do not determine."""
    V = np.sqrt(np.sum(path[:, :3] ** 2, axis=1))
    known = {"alpha": stds["alpha"], "theta": stds["theta"], "V": stds["V"] / V}
    return [
        f"the standard deviation of {name} is {np.median(std):.2g} "
        f"{'of its value' if name == 'V' else 'rad'}: these instruments do not determine it"
        for name, std in known.items()
        if not np.median(std) < _MAX_STD
    ]


def _reversed_positions(problem: KinematicsProblem, excess: float) -> list[str]:
    """Sensor position whose opposite sign is far more likely, tested on the interval with the largest rates.

    `excess` is the variance of the innovations over the stated one; it divides the log-likelihoods.
    """
    part = most_active_interval(problem)
    base = ukf_filter(part, spread=0.0)
    if base.failed >= 0:
        return []
    found = []
    for instrument, rows in _POSITIONS.items():
        for axis, label in enumerate(("x (forward)", "y (right)", "z (down)")):
            arm = float(part.place[rows[0], axis])
            if abs(arm) < MIN_LEVER_ARM:
                continue
            place = part.place.copy()
            place[np.ix_(rows, [axis])] *= -1.0
            reversed_run = ukf_filter(replace(part, place=place), spread=0.0)
            gain = (reversed_run.log_likelihood - base.log_likelihood) / excess
            if reversed_run.failed < 0 and gain > _MIN_SIGN_GAIN:
                text = (
                    f"the position of the {instrument} in the aircraft file probably has the wrong sign: {label} = "
                    f"{-arm:+.2f} m fits far better than {arm:+.2f} m (log-likelihood +{gain:.0f})"
                )
                found.append((gain, text))
    # One wrong position affects the likelihood of the others, but less than its own.
    return [max(found)[1]] if found else []
