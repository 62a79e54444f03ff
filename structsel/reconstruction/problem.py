"""The estimation problem of a recording and an aircraft, as arrays for the filter."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import DataError, StructselWarning
from structsel.formatting import count_of
from structsel.numerics import kinematics as fp
from structsel.numerics.air_data import body_velocity
from structsel.numerics.signal_quality import MIN_SAMPLES, noise_level, starts_of_runs
from structsel.numerics.smoothing import SmoothedSignal, smooth_spline
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.observability import Reconstructibility
from structsel.reconstruction.sample_validity import LATERAL, require_inertial, valid_input, valid_measurement
from structsel.reconstruction.settings import INERTIAL, PRIOR, ReconstructOptions
from structsel.reconstruction.turbulence_level import CALM, Gusts
from structsel.recording import Finding, Recording

_POSITION = ("x", "y", "vn", "ve")
_MIN_READINGS = 6  # of a channel whose noise is estimated: four second differences, to about 40 %
_MAX_SEARCHED = 6000  # samples in which the smoothness of a rate is estimated; chosen, not critical
_INDEX = {name: i for i, name in enumerate(fp.STATES)}
_LATERAL = ("bay", "bp", "br", "Kay", "Kp", "Kr", "Kphi")
_OWN_CHANNEL = {"Cup": ("alpha",), "Calpha0": ("alpha",), "Csi": ("beta",), "Cbeta0": ("beta",),
                "Kphi": ("phi",), "Ktheta": ("theta",)}  # fmt: skip
BEST = {
    **dict.fromkeys(INERTIAL[:3], 1e-3),
    **dict.fromkeys(INERTIAL[3:], 1e-5),
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), 2e-4),
    **dict.fromkeys(("x", "y", "h"), 0.1),
    **dict.fromkeys(("V", "vn", "ve", "vd"), 0.01),
}
"""Noise of the best flight-test instruments: lower bound of an estimated noise level."""


@dataclass(frozen=True)
class ReconstructionProblem:
    """A problem for the filter, and its origin.

    Attributes
    ----------
    problem : KinematicsProblem
    measured : tuple of str
        Measurements with at least one reading.
    lateral : bool
        Whether v, phi and psi are estimated; without ay, p and r they are constant.
    turning : (n, 3) array [rad/s^2]
        p_dot, q_dot, r_dot, smoothed.
    turning_std : (3,) array [rad/s^2]
        Their standard deviations.
    noise : dict of str to float
        Standard deviation of the noise by channel.
    given : frozenset of str
        Channels whose noise was stated, not estimated.
    findings : tuple of Finding
    gust : Gusts
        Turbulence in the model.
    """

    problem: KinematicsProblem
    measured: tuple[str, ...]
    lateral: bool
    turning: np.ndarray
    turning_std: np.ndarray
    noise: dict[str, float]
    given: frozenset[str]
    findings: tuple[Finding, ...]
    gust: Gusts = CALM

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the active states."""
        return tuple(fp.STATES[i] for i in self.problem.active)

    def with_verdict(self, verdict: Reconstructibility) -> ReconstructionProblem:
        """Problem in which only the states that these data determine are estimated.

        If the ground track is measured and only the initial heading is undetermined, the heading remains a state with a
        known initial value.
        """
        p, names = self.problem, self.names
        active, std = set(verdict.active), p.start_std.copy()
        if "psi" in verdict.fixed and any(name in self.measured for name in _POSITION):
            active.add("psi")
            std[names.index("psi")] = 1e-4
        kept = np.array([name in active for name in names])
        return replace(self, problem=replace(p, start_std=std).with_states(kept))

    def without_ground_track(self, *, psi: bool = False) -> ReconstructionProblem:
        """Problem without measured position and ground velocity, and without the states that only these determine.

        The heading is kept if `psi`, and if it is measured.
        """
        if not any(name in self.measured for name in _POSITION):
            return self
        p, names = self.problem, self.names
        lost = {"x", "y", "wn", "we"} | (set() if psi and "psi" in self.measured else {"psi"})
        readings = p.measurements.copy()
        readings[:, [fp.MEASUREMENTS.index(name) for name in _POSITION]] = np.nan
        kept = np.array([name not in lost for name in names])
        reduced = replace(p, measurements=readings).with_states(kept)
        measured = tuple(name for name in self.measured if name not in _POSITION)
        level = {name: std for name, std in self.noise.items() if name not in _POSITION}
        return replace(self, problem=reduced, measured=measured, noise=level)


def build_problem(recording: Recording, aircraft: Aircraft, options: ReconstructOptions) -> ReconstructionProblem:
    """Problem of one recording."""
    lateral = require_inertial(recording)
    stated = {**aircraft.noise, **(options.noise or {})}
    level: dict[str, float] = {}
    inputs, input_std, turning_std, findings = _inertial_readings(recording, lateral, stated, level)
    measurements, measured, more = _measurements(recording, lateral, stated, level)
    findings += more
    if not lateral:
        findings.append(_longitudinal_only())
    start, start_std = _start(recording.t, measurements, inputs, level)
    names = _active(options.constants, measured, lateral)
    active = np.array(sorted(_INDEX[name] for name in names))
    prior, walk = options.prior or {}, np.zeros(len(fp.STATES))
    for name, value in (options.drift or {}).items():
        walk[_INDEX[name]] = value
    problem = KinematicsProblem(
        t=np.ascontiguousarray(recording.t),
        inputs=inputs,
        input_std=input_std,
        measurements=measurements,
        measurement_std=np.array([level.get(name, 1.0) for name in fp.MEASUREMENTS]),
        start=start,
        start_std=np.array([prior.get(fp.STATES[i], start_std[i]) for i in active]),
        active=active,
        drift=walk,
        place=np.array([aircraft.position(name) for name in fp.PLACES]),
        flank=_reads_flank(aircraft),
        g=options.g,
    )
    given = frozenset(name for name in level if name in stated)
    return ReconstructionProblem(
        problem, tuple(measured), lateral, inputs[:, 6:].copy(), turning_std, level, given, tuple(findings)
    )


def _inertial_readings(
    recording: Recording, lateral: bool, stated: Mapping[str, float], level: dict[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[Finding]]:
    """Inputs (n, 9), their noise (n, 6), accuracy of the angular accelerations (3,), and findings; fills `level`."""
    n, t = len(recording), recording.t
    inputs, input_std, turning_std = np.zeros((n, 9)), np.zeros((n, 6)), np.zeros(3)
    findings: list[Finding] = []
    for j, name in enumerate(INERTIAL):
        if name in LATERAL and not lateral:
            continue
        channel = valid_input(recording, name)
        findings += channel.findings
        inputs[:, j] = channel.values
        level[name] = stated.get(name) or noise_of(name, channel.values, recording.dt)
        std = max(float(channel.values.std()), level[name])
        # Interpolation errors of one gap have one sign, those of noise do not: the factor makes the integrals equal.
        input_std[:, j] = np.where(channel.interpolated > 0, std * np.sqrt(channel.interpolated), level[name])
        if j >= 3:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", StructselWarning)
                smooth = _smooth(channel.values, t)
            findings += [Finding("oscillation", name, str(w.message), "note") for w in caught]
            inputs[:, 3 + j] = smooth.derivative
            turning_std[j - 3] = float(np.sqrt(np.mean(smooth.derivative_std**2)))
    return inputs, input_std, turning_std, findings


def _smooth(values: np.ndarray, t: np.ndarray) -> SmoothedSignal:
    """Smoothing spline; that of a long recording has the order and cut-off of the interval with the fastest changes."""
    if len(values) <= _MAX_SEARCHED:
        return smooth_spline(values, t)
    total = np.concatenate(([0.0], np.cumsum(np.diff(values) ** 2)))
    first = int(np.argmax(total[_MAX_SEARCHED - 1 :] - total[: 1 - _MAX_SEARCHED]))
    part = slice(first, first + _MAX_SEARCHED)
    found = smooth_spline(values[part], t[part])
    return smooth_spline(values, t, order=found.order, cutoff=found.cutoff)


def _measurements(
    recording: Recording, lateral: bool, stated: Mapping[str, float], level: dict[str, float]
) -> tuple[np.ndarray, list[str], list[Finding]]:
    """Measurements (n, 12), the names of those that have readings, and findings; fills `level`."""
    measurements = np.full((len(recording), len(fp.MEASUREMENTS)), np.nan)
    measured: list[str] = []
    findings: list[Finding] = []
    for j, name in enumerate(fp.MEASUREMENTS):
        if name not in recording or (not lateral and name in ("beta", "phi", "psi", *_POSITION)):
            continue
        channel = valid_measurement(recording, name)
        findings += channel.findings
        values = channel.values
        sampled = np.isfinite(values)
        count = int(sampled.sum())
        if count < _MIN_READINGS and name not in stated and name != "V":
            if count:
                findings.append(_few_readings(recording, name, sampled, "too few to estimate its noise; not used"))
            continue
        if name in ("phi", "psi"):
            values[sampled] = np.unwrap(values[sampled])
        if count < MIN_SAMPLES and name not in stated:
            text = "too few for a spectrum; its noise is that of their second differences"
            findings.append(_few_readings(recording, name, sampled, text))
        measurements[:, j] = values
        measured.append(name)
        level[name] = stated.get(name) or noise_of(name, values[sampled], recording.dt)
    return measurements, measured, findings


def _few_readings(recording: Recording, name: str, sampled: np.ndarray, what: str) -> Finding:
    """Finding for a channel that is much slower than the recording."""
    count = count_of(int(sampled.sum()), "reading")
    return Finding("slow", name, f"{count} in {recording.duration:.3g} s, {what}", remedy="state the noise")


def _reads_flank(aircraft: Aircraft) -> bool:
    sensor = aircraft.sensors.get("beta_vane") or aircraft.sensors.get("vane")
    return sensor is not None and sensor.angle == "flank"


def noise_of(name: str, values: np.ndarray, dt: float) -> float:
    """White noise of a channel from its spectrum; from differences, which include motion, if the channel is slow."""
    try:
        level = noise_level(values, dt)
    except DataError:
        readings = values[starts_of_runs(values)]
        # 1 + 4 + 1 is the variance of second differences of white noise.
        level = float(np.sqrt(np.mean(np.diff(readings, 2) ** 2) / 6.0)) if len(readings) > 2 else float(values.std())
    return max(level, BEST[name])


def _active(constants: Iterable[str], measured: list[str], lateral: bool) -> list[str]:
    """Requested states; the reconstructibility analysis finds those that cannot be determined."""
    names = ["u", "w", "theta"] + (["v", "phi", "psi"] if lateral else [])
    names += [name for name in ("x", "y", "h") if name in measured]
    for name in constants:
        if not lateral and name in (*_LATERAL, "wn", "we", "Csi", "Cbeta0"):
            continue
        if name == "wd" and not {"h", "vd"} & set(measured):
            continue
        if all(channel in measured for channel in _OWN_CHANNEL.get(name, ())):
            names.append(name)
    if lateral and "beta" in measured:
        names.append("Cbeta0")  # the analysis reports the reason why it is not estimated
    return list(dict.fromkeys(names))


def first_readings(measurements: np.ndarray) -> dict[str, tuple[int, float]]:
    """Sample and value of the first reading of every measurement that has one; (n, 12) measurements."""
    found = {}
    for name, values in zip(fp.MEASUREMENTS, measurements.T):
        sampled = np.flatnonzero(np.isfinite(values))
        if sampled.size:
            found[name] = int(sampled[0]), float(values[sampled[0]])
    return found


def _start(
    t: np.ndarray, y: np.ndarray, inputs: np.ndarray, noise: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Full vector at the first sample from the first readings, and its standard deviations."""
    read = first_readings(y)

    def first(name: str, otherwise: float) -> tuple[float, bool]:
        if name not in read:
            return otherwise, False
        sample, value = read[name]
        return value, bool(t[sample] <= t[0] + 1.0)

    V, _ = first("V", np.nan)
    alpha, alpha_seen = first("alpha", 0.05)
    beta, beta_seen = first("beta", 0.0)
    phi, phi_seen = first("phi", 0.0)
    theta, theta_seen = first("theta", alpha)
    vn, on_course = first("vn", 0.0)
    ve, _ = first("ve", 0.0)
    psi, psi_seen = first("psi", float(np.arctan2(ve, vn)) if on_course else 0.0)
    x, _ = first("x", 0.0)
    y0, _ = first("y", 0.0)
    h, _ = first("h", 0.0)
    start, std = np.zeros(len(fp.STATES)), np.zeros(len(fp.STATES))
    start[:9] = (*body_velocity(V, alpha, beta), phi, theta, psi, x, y0, h)
    angle = 0.05
    std[0] = 2.0 + 5.0 * noise.get("V", 0.5)
    std[1] = V * (max(angle, 5.0 * noise.get("beta", 0.0)) if beta_seen else 0.2)
    std[2] = V * (max(angle, 5.0 * noise.get("alpha", 0.0)) if alpha_seen else 0.2)
    std[3] = max(angle, 5.0 * noise.get("phi", 0.0)) if phi_seen else 0.5
    std[4] = max(angle, 5.0 * noise.get("theta", 0.0)) if theta_seen else 0.3
    std[5] = max(angle, 5.0 * noise.get("psi", 0.0)) if psi_seen else 1.0
    for i, name in ((6, "x"), (7, "y"), (8, "h")):
        std[i] = 10.0 + 5.0 * noise.get(name, 1.0)
    for name, value in PRIOR.items():
        std[_INDEX[name]] = value
    return start, std


def _longitudinal_only() -> Finding:
    message = "without ay, p and r only the longitudinal motion is reconstructed; v, phi, p and r are assumed zero"
    return Finding("assumed", "ay", message, "note", "map ay, p and r")
