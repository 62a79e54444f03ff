"""Wrong signs and units of channels, found before the filter is run.

Every correction in a list is tried: the sign of a channel is reversed, or its unit changed. The kinematics show whether
the instruments are then more consistent. Readings are compared as means over half a second, which needs no derivative
and no estimate::

    mean(q cos(phi) - r sin(phi)) = change of theta / time           and so on for phi and psi
    mean(ax - g sin(theta) - q w + r v) = change of u / time         and so on for v, w and h

with u, v, w from the air data. The two sides of equation j differ by a bias b_j with a stated prior, and by a
variance that is the fraction s_j of theirs. Minus the log-likelihood is the sum of n_j log(s_j) / 2 + (b_j /
prior_j)^2 / 2, with n_j the number of independent windows; a correction is reported if it reduces this by a large
amount. The bias shows the size and direction of gravity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import BODY_RATES, EULER_ANGLES, SPECIFIC_FORCES
from structsel.numerics import kinematics as fp
from structsel.numerics import rigid_body as rb
from structsel.numerics.dynamic_elements import delayed
from structsel.numerics.kinematic_closure import closure_sides
from structsel.numerics.signal_quality import noise_level
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.noise_levels import most_active_interval
from structsel.recording import Recording

_WINDOW = 0.5  # s
_MIN_SAMPLES = 40
_LONGEST = 6000  # samples of a long recording, those with the largest rates: two minutes at 50 Hz; chosen, not critical
# Least gain in log-likelihood of a correction: a constant, and a term for each window, so that a slightly better fit of
# a poor recording is not sufficient. Gusts favour a smaller airspeed (by 20 in 60 windows), but no other sign. The
# effect of a delayed gyro is similar to that of another position of the vanes.
_MIN_GAIN = {"sign": (10.0, 0.2), "unit": (15.0, 0.4), "place": (15.0, 0.7), "delay": (10.0, 0.2)}
_DELAYS = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Delays of the vanes that are tried [s]. Delayed vanes contradict the other instruments, as a reversed ay or another
place of the vanes does; they are no reason to refuse a recording, since their delay is estimated."""
_EQUAL = 5.0  # log-likelihood; corrections that differ by less are not separated
_POSITION = "position of the vanes"
MIN_LEVER_ARM = 0.25
"""Shortest distance [m] of a sensor from the centre of gravity whose sign can be checked."""
_MAX_NOISE_RATIO = 1.3  # of variances; 1.36 in 5 of 100 cases of 60 windows with noise only
_MAX_CORRECTIONS = 3  # in one recording
# Equation: prior standard deviation of its bias, and the error of the best instruments, in its unit.
_EQUATIONS = {
    **dict.fromkeys(SPECIFIC_FORCES, (0.5, 0.02)),
    **dict.fromkeys(BODY_RATES, (0.02, 1e-3)),
    "h": (2.0, 0.1),
}
_ACCELERATIONS, _RATES, _ATTITUDE, _VANES = (
    SPECIFIC_FORCES,
    BODY_RATES,
    EULER_ANGLES,
    ("alpha", "beta"),
)
_DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class _Correction:
    channels: tuple[str, ...]
    factor: float
    looks: str
    does: str
    where: str = "channel map"
    delay: float = 0.0  # s


@dataclass(frozen=True)
class _EquationResidual:
    """Minus the log-likelihood of one equation, from its variance and its bias; whether it exceeds the noise."""

    variance: float
    bias: float
    contradicts: bool


def _corrections() -> list[_Correction]:
    turned = [(name,) for name in (*_ACCELERATIONS, *_RATES, *_VANES, *_ATTITUDE)] + [_ACCELERATIONS, _RATES]
    degrees = [(name,) for name in (*_RATES, *_ATTITUDE, *_VANES)] + [
        _RATES, _ATTITUDE, _VANES, (*_ATTITUDE, *_VANES), (*_RATES, *_ATTITUDE, *_VANES)
    ]  # fmt: skip
    weights = [(name,) for name in _ACCELERATIONS] + [_ACCELERATIONS]
    found = [_Correction(names, -1.0, "to have the wrong sign", "sign = -1") for names in turned]
    for names in degrees:
        units = dict.fromkeys("deg/s" if name in _RATES else "deg" for name in names)
        unit = "unit = " + " and ".join(f'"{unit}"' for unit in units)
        found.append(_Correction(names, _DEGREE, "to be in degrees, fed as radians", unit))
    found += [_Correction(names, rb.G0, "to be in g, fed as m/s^2", 'unit = "g"') for names in weights]
    found += [
        _Correction((_POSITION,), -1.0, "to have the wrong sign", "x is forward", "aircraft file"),
        _Correction(("V",), 1852.0 / 3600.0, "to be in knots, fed as m/s", 'unit = "kt"'),
        _Correction(("V",), 0.3048, "to be in ft/s, fed as m/s", 'unit = "ft/s"'),
        _Correction(("V",), 1.0 / 3.6, "to be in km/h, fed as m/s", 'unit = "km/h"'),
        _Correction(("h",), 0.3048, "to be in feet, fed as metres", 'unit = "ft"'),
    ]
    late = ((name,) for name in _VANES)
    return found + [_Correction(c, 1.0, "to be late", "delays", delay=x) for c in (*late, _VANES) for x in _DELAYS]


def reject_wrong_sign_or_unit(recording: Recording, problem: KinematicsProblem, lateral: bool) -> None:
    """Refuse a recording if the kinematics show a wrong sign or unit.

    Raises
    ------
    DataError
        The message has the channels and the correction, or the corrections that are equally likely.
    """
    problem = most_active_interval(problem, _LONGEST)
    channels = _channels(problem, lateral)
    now = _equation_residuals(channels, problem, lateral)
    windows = float(problem.t[-1] - problem.t[0]) / _WINDOW
    made: list[str] = []
    corrections = [r for r in _corrections() if all(np.isfinite(channels[c]).any() for c in r.channels)]
    if np.linalg.norm(problem.place[1]) < MIN_LEVER_ARM:
        corrections = [r for r in corrections if _POSITION not in r.channels]
    while now is not None and corrections and len(made) < _MAX_CORRECTIONS:
        tried = []
        for correction in corrections:
            left = _equation_residuals(_corrected(channels, correction), problem, lateral)
            tried.append(-np.inf if left is None else _gain(now, left))
        # Of equally likely corrections, the one that changes the fewest channels.
        best = max(tried)
        near = sorted((r for r, gain in zip(corrections, tried) if gain > best - _EQUAL), key=lambda r: len(r.channels))
        constant, for_each = _MIN_GAIN[_kind(near[0])]
        if best < max(constant, for_each * windows):
            break
        if late := next((r for r in near if r.delay), None):
            channels = _corrected(channels, late)
            corrections = [r for r in corrections if not r.delay and _POSITION not in r.channels]
        else:
            fewest = [r for r in near if len(r.channels) == len(near[0].channels)]
            made.append(" or ".join(f"{_subject(r.channels)} {r.looks} ({r.does} in the {r.where})" for r in fewest))
            channels = _corrected(channels, near[0])
        now = _equation_residuals(channels, problem, lateral)
    if made:
        raise DataError(
            f"reconstruct: {'; and '.join(made)}: with this correction the instruments of '{recording.name}' are "
            "consistent, without it they contradict one another.\n"
            "Body axes are x forward, y right, z down; az is near -9.8 m/s^2 in level flight."
        )


def _kind(correction: _Correction) -> str:
    if _POSITION in correction.channels:
        return "place"
    if correction.delay:
        return "delay"
    return "sign" if correction.factor < 0.0 else "unit"


def _gain(now: dict[str, _EquationResidual], then: dict[str, _EquationResidual]) -> float:
    """Gain of a correction in log-likelihood; equations without a contradiction contribute no gain, only losses."""
    total = 0.0
    for name in now.keys() & then.keys():
        better = now[name].variance - then[name].variance
        total += better if now[name].contradicts else min(better, 0.0)
        total += now[name].bias - then[name].bias
    return total


def _subject(names: tuple[str, ...]) -> str:
    quoted = [f"'{name}'" for name in names]
    verb = "seems" if len(names) == 1 else "seem"
    return f"{quoted[0] if len(names) == 1 else ', '.join(quoted[:-1]) + ' and ' + quoted[-1]} {verb}"


def _channels(problem: KinematicsProblem, lateral: bool) -> dict[str, np.ndarray]:
    found = {name: problem.measurements[:, j] for j, name in enumerate(fp.MEASUREMENTS)}
    found[_POSITION] = problem.place[1]
    found["time"] = problem.t
    dt = float(np.median(np.diff(problem.t)))
    # Interpolated readings have a larger noise level; they have no information here.
    interpolated = problem.input_std > 2.0 * np.median(problem.input_std, axis=0)
    inputs = np.where(interpolated, np.nan, problem.inputs[:, :6])
    found |= {name: inputs[:, j] for j, name in enumerate(fp.INPUTS[:6])}
    for j, name in enumerate(fp.MEASUREMENTS):
        values = problem.measurements[:, j]
        stated = float(problem.measurement_std[j])
        try:
            own = noise_level(values, dt)
        except DataError:
            own = stated  # too few readings for an estimate
        found[f"noise of {name}"] = np.array(min(stated, own))
    if not np.isfinite(found["beta"]).any():
        found["beta"] = np.zeros(len(problem.t))
    if not lateral:
        found |= {name: np.zeros(len(problem.t)) for name in ("phi", "beta")}
    return found


def _corrected(channels: dict[str, np.ndarray], correction: _Correction) -> dict[str, np.ndarray]:
    if correction.delay:
        t = channels["time"]
        return {**channels, **{name: delayed(channels[name], t, -correction.delay) for name in correction.channels}}
    made = {name: correction.factor * channels[name] for name in correction.channels}
    noise = {
        key: abs(correction.factor) * channels[key] for n in correction.channels if (key := f"noise of {n}") in channels
    }
    return {**channels, **made, **noise}


def _slopes_noise(speed: float) -> dict[str, tuple[str, float]]:
    """Equation: the measurement whose slope is in it, and the factor of that slope."""
    own = {"p": "phi", "q": "theta", "r": "psi", "h": "h", "ax": "V"}
    return {**{name: (of, 1.0) for name, of in own.items()}, "ay": ("beta", speed), "az": ("alpha", speed)}


def _equation_residuals(
    c: dict[str, np.ndarray], problem: KinematicsProblem, lateral: bool
) -> dict[str, _EquationResidual] | None:
    """Residuals of all equations with readings; None if the recording is too short."""
    t = problem.t
    k = max(1, round(_WINDOW / float(np.median(np.diff(t)))))
    if len(t) < 2 * k + _MIN_SAMPLES:
        return None

    equations = ("q", "ax", "az", "h", "p", "r", "ay") if lateral else ("q", "ax", "az", "h")
    sides = closure_sides(t, c, equations, g=problem.g, vane_position=c[_POSITION])
    speed = float(np.nanmedian(np.abs(c["V"])))
    each = np.sqrt(2.0) / (k * float(np.median(np.diff(t))))
    noise = {name: each * c[f"noise of {of}"] * by for name, (of, by) in _slopes_noise(speed).items()}
    found = {}
    for name, (left, right) in sides.items():
        measured, expected = left(k), right(k)
        good = np.isfinite(measured) & np.isfinite(expected)
        if good.sum() < _MIN_SAMPLES:
            continue
        measured, expected = measured[good], expected[good]
        prior, floor = _EQUATIONS[name]
        bias = float(np.mean(measured - expected))
        # The variance is relative to that of both sides, since a factor that reduces all of them is no improvement.
        # Noise is subtracted, since a factor that reduces a channel of mostly noise is no improvement either.
        variance = float(np.var(measured - expected))
        excess = max(variance - noise[name] ** 2, 0.0)
        fraction = (excess + floor**2) / (float(np.var(measured) + np.var(expected)) + floor**2)
        found[name] = _EquationResidual(
            variance=0.5 * float(good.sum()) / k * float(np.log(fraction)),
            bias=0.5 * (bias / prior) ** 2,
            contradicts=variance > _MAX_NOISE_RATIO * noise[name] ** 2 + floor**2,
        )
    return found
