"""Signs and units fed wrongly, found before any filter runs.

Each mistake there is a remedy for is tried: the channel is turned round, or its unit changed, and the kinematics
are asked whether the instruments then agree better. Readings are compared as means over half a second, which needs
no derivative and no estimate::

    mean(q cos(phi) - r sin(phi)) = change of theta / time           and so on for phi and psi
    mean(ax - g sin(theta) - q w + r v) = change of u / time         and so on for v, w and h

with u, v, w from the air data. The two sides of equation j differ by a bias b_j, believed to be within its prior, and
by a variance that is the share s_j of theirs; the misfit is the sum of n_j log(s_j) / 2 + (b_j / prior_j)^2 / 2, with
n_j the independent windows, and a remedy is believed when it lessens that by far. The bias tells gravity's size and
direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import BODY_RATES, EULER_ANGLES, SPECIFIC_FORCES
from structsel.numerics import kinematics as fp
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import body_velocity, cross
from structsel.numerics.signal_quality import noise_level
from structsel.reconstruction.ukf import KinematicsProblem
from structsel.recording import Recording

_WINDOW = 0.5  # s
_LEAST_SAMPLES = 40
# Log-likelihood from which a remedy is believed: so much, and so much for each window, so that a slightly better fit
# of a poor record is nothing. Gusts make a smaller airspeed look better (by 20 in 60 windows), no other sign; a late
# gyro looks a little like another place of the vanes.
_SURE = {"sign": (10.0, 0.2), "unit": (15.0, 0.4), "place": (15.0, 0.7)}
_AS_LIKELY = 5.0  # log-likelihood by which remedies are no longer told apart
_PLACE = "place of the vanes"
_LEAST_PLACE = 0.25  # m
_MORE_THAN_NOISE = 1.3  # times its variance; in 60 windows chance makes 1.36 in 5 of 100
_MOST = 3  # mistakes in one recording
# Equation: what may stay constant in it, and what no instrument does better, in its unit.
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


@dataclass(frozen=True)
class _EquationResidual:
    """Minus the log-likelihood of one equation, from its spread and its bias; whether more than noise is left."""

    spread: float
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
        _Correction((_PLACE,), -1.0, "to have the wrong sign", "x is forward", "aircraft file"),
        _Correction(("V",), 1852.0 / 3600.0, "to be in knots, fed as m/s", 'unit = "kt"'),
        _Correction(("V",), 0.3048, "to be in ft/s, fed as m/s", 'unit = "ft/s"'),
        _Correction(("V",), 1.0 / 3.6, "to be in km/h, fed as m/s", 'unit = "km/h"'),
        _Correction(("h",), 0.3048, "to be in feet, fed as metres", 'unit = "ft"'),
    ]
    return found


def reject_wrong_sign_or_unit(recording: Recording, problem: KinematicsProblem, lateral: bool) -> None:
    """Refuse channels of wrong sign or unit, as the kinematics show them.

    Raises
    ------
    DataError
        Naming the channels and the remedy, or the remedies that serve as well.
    """
    channels = _channels(problem, lateral)
    now = _equation_residuals(channels, problem, lateral)
    windows = float(problem.t[-1] - problem.t[0]) / _WINDOW
    made: list[str] = []
    remedies = [r for r in _corrections() if all(np.isfinite(channels[c]).any() for c in r.channels)]
    if np.linalg.norm(problem.place[1]) < _LEAST_PLACE:
        remedies = [r for r in remedies if _PLACE not in r.channels]
    while now is not None and remedies and len(made) < _MOST:
        tried = []
        for remedy in remedies:
            left = _equation_residuals(_remedied(channels, remedy), problem, lateral)
            tried.append(-np.inf if left is None else _gain(now, left))
        # Of remedies that do the same, the one that touches fewest channels.
        best = max(tried)
        near = sorted(
            (r for r, gain in zip(remedies, tried) if gain > best - _AS_LIKELY), key=lambda r: len(r.channels)
        )
        least, for_each = _SURE[_kind(near[0])]
        if best < max(least, for_each * windows):
            break
        fewest = [r for r in near if len(r.channels) == len(near[0].channels)]
        made.append(" or ".join(f"{_listed(r.channels)} {r.looks} ({r.does} in the {r.where})" for r in fewest))
        channels = _remedied(channels, near[0])
        now = _equation_residuals(channels, problem, lateral)
    if made:
        raise DataError(
            f"reconstruct: {'; and '.join(made)}: so read, the instruments of '{recording.name}' agree, and as they "
            "are they contradict one another.\nBody axes are x forward, y right, z down; az is near -9.8 m/s^2 in "
            "level flight."
        )


def _kind(remedy: _Correction) -> str:
    if _PLACE in remedy.channels:
        return "place"
    return "sign" if remedy.factor < 0.0 else "unit"


def _gain(now: dict[str, _EquationResidual], then: dict[str, _EquationResidual]) -> float:
    """Log-likelihood a remedy gains; where there was no contradiction there is nothing to gain."""
    total = 0.0
    for name in now.keys() & then.keys():
        better = now[name].spread - then[name].spread
        total += better if now[name].contradicts else min(better, 0.0)
        total += now[name].bias - then[name].bias
    return total


def _listed(names: tuple[str, ...]) -> str:
    quoted = [f"'{name}'" for name in names]
    verb = "seems" if len(names) == 1 else "seem"
    return f"{quoted[0] if len(names) == 1 else ', '.join(quoted[:-1]) + ' and ' + quoted[-1]} {verb}"


def _channels(problem: KinematicsProblem, lateral: bool) -> dict[str, np.ndarray]:
    found = {name: problem.measurements[:, j] for j, name in enumerate(fp.MEASUREMENTS)}
    found[_PLACE] = problem.place[1]
    dt = float(np.median(np.diff(problem.t)))
    # Readings that were made up, for holes, are held to be noisier; they tell nothing here.
    made_up = problem.input_std > 2.0 * np.median(problem.input_std, axis=0)
    inputs = np.where(made_up, np.nan, problem.inputs[:, :6])
    found |= {name: inputs[:, j] for j, name in enumerate(fp.INPUTS[:6])}
    for j, name in enumerate(fp.MEASUREMENTS):
        values = problem.measurements[:, j]
        stated = float(problem.measurement_std[j])
        try:
            own = noise_level(values, dt)
        except DataError:
            own = stated  # too few readings to see any noise
        found[f"noise of {name}"] = np.array(min(stated, own))
    if not np.isfinite(found["beta"]).any():
        found["beta"] = np.zeros(len(problem.t))
    if not lateral:
        found |= {name: np.zeros(len(problem.t)) for name in ("phi", "beta")}
    return found


def _remedied(channels: dict[str, np.ndarray], remedy: _Correction) -> dict[str, np.ndarray]:
    made = {name: remedy.factor * channels[name] for name in remedy.channels}
    noise = {key: abs(remedy.factor) * channels[key] for n in remedy.channels if (key := f"noise of {n}") in channels}
    return {**channels, **made, **noise}


def _slopes_noise(speed: float) -> dict[str, tuple[str, float]]:
    """Equation: the measurement whose slope is in it, and what it counts for there."""
    own = {"p": "phi", "q": "theta", "r": "psi", "h": "h", "ax": "V"}
    return {**{name: (of, 1.0) for name, of in own.items()}, "ay": ("beta", speed), "az": ("alpha", speed)}


def _equation_residuals(
    c: dict[str, np.ndarray], problem: KinematicsProblem, lateral: bool
) -> dict[str, _EquationResidual] | None:
    """What is left of every equation there are readings for; None where the recording is too short."""
    t = problem.t
    k = max(1, round(_WINDOW / float(np.median(np.diff(t)))))
    if len(t) < 2 * k + _LEAST_SAMPLES:
        return None
    width = t[k:] - t[:-k]

    def mean(x: np.ndarray) -> np.ndarray:
        # Not a running sum, in which one missing sample would spoil all that follow.
        steps = 0.5 * np.diff(t) * (x[1:] + x[:-1])
        lost = np.cumsum(np.concatenate(([0], ~np.isfinite(steps))))
        total = np.cumsum(np.concatenate(([0.0], np.where(np.isfinite(steps), steps, 0.0))))
        return np.where(lost[k:] == lost[:-k], (total[k:] - total[:-k]) / width, np.nan)

    def change(x: np.ndarray) -> np.ndarray:
        return (x[k:] - x[:-k]) / width

    phi, theta, p, q, r = (c[name] for name in ("phi", "theta", "p", "q", "r"))
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    u, v, w = body_velocity(c["V"], c["alpha"], c["beta"])
    swing = cross((p, q, r), tuple(c[_PLACE]))
    u, v, w = u - swing[0], v - swing[1], w - swing[2]
    g = problem.g
    pairs = {
        "q": (mean(q), change(theta) + mean(r * sf + q * (1.0 - cf))),
        "ax": (mean(c["ax"]), change(u) + mean(g * st + q * w - r * v)),
        "az": (mean(c["az"]), change(w) - mean(g * ct * cf - p * v + q * u)),
        "h": (change(c["h"]), mean(u * st - (v * sf + w * cf) * ct)),
    }
    if lateral:
        pairs["p"] = mean(p), change(phi) - mean((q * sf + r * cf) * st / ct)
        pairs["r"] = mean(r), change(c["psi"]) - mean((q * sf + r * cf) / ct - r)
        pairs["ay"] = mean(c["ay"]), change(v) - mean(g * ct * sf - r * u + p * w)
    speed = float(np.nanmedian(np.abs(c["V"])))
    each = np.sqrt(2.0) / (k * float(np.median(np.diff(t))))
    noise = {name: each * c[f"noise of {of}"] * by for name, (of, by) in _slopes_noise(speed).items()}
    found = {}
    for name, (read, told) in pairs.items():
        good = np.isfinite(read) & np.isfinite(told)
        if good.sum() < _LEAST_SAMPLES:
            continue
        read, told = read[good], told[good]
        believed, floor = _EQUATIONS[name]
        bias = float(np.mean(read - told))
        # Relative to what is compared: a factor that makes everything small explains nothing.
        # What the measurements' own noise explains contradicts nothing: else a factor that shrinks a quiet, noisy
        # channel would look like a remedy.
        left = float(np.var(read - told))
        excess = max(left - noise[name] ** 2, 0.0)
        share = (excess + floor**2) / (float(np.var(read) + np.var(told)) + floor**2)
        found[name] = _EquationResidual(
            spread=0.5 * float(good.sum()) / k * float(np.log(share)),
            bias=0.5 * (bias / believed) ** 2,
            contradicts=left > _MORE_THAN_NOISE * noise[name] ** 2 + floor**2,
        )
    return found
