"""Manoeuvres of the polynomial plant: schedules of control inputs and of references of the pilot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.polynomial.aircraft import TruthAircraft
from proof.polynomial.equations import SCHEDULES
from proof.scenario.shapes import DOUBLET, ONE_TWO_ONE, THREE_TWO_ONE_ONE, pulses
from structsel.numerics.atmosphere import standard_atmosphere

DT = 0.01
"""Step of the flight [s]."""
SETTLING = 5.0
"""Time simulated before the recording begins [s]."""
_COLUMN = {name: i for i, name in enumerate(SCHEDULES)}


@dataclass
class Manoeuvre:
    """One manoeuvre.

    Attributes
    ----------
    purpose : str
        A name of `PURPOSES`.
    V, h : float [m/s, m]
        At the start; h above sea level.
    duration : float [s]
        Of the recording.
    trim : dict
        As `TruthAircraft.trim` gives it.
    schedules : (steps, SCHEDULES) array
        From `SETTLING` before the recording to its end.
    hold : bool
        Whether height and speed are held.
    """

    purpose: str
    V: float
    h: float
    duration: float
    trim: dict[str, float]
    schedules: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    hold: bool = False

    @property
    def t(self) -> np.ndarray:
        """Clock of the schedules; the recording begins at zero."""
        return DT * np.arange(len(self.schedules)) - SETTLING

    def column(self, name: str) -> np.ndarray:
        """A schedule, to be changed in place."""
        return self.schedules[:, _COLUMN[name]]

    def pulses(self, name: str, pattern: Sequence[int], start: float, unit: float, size: float) -> float:
        """Add pulses; returns when they end."""
        shape, end = pulses(self.t, pattern, start, unit)
        self.column(name)[:] += size * shape
        return end

    def ramp(self, name: str, start: float, end: float, change: float) -> None:
        """Add a ramp that stays."""
        self.column(name)[:] += change * np.clip((self.t - start) / max(end - start, DT), 0.0, 1.0)


@dataclass(frozen=True)
class InputSizes:
    """Usual amplitudes of the surfaces [rad], and unit of 3-2-1-1 inputs [s]."""

    de: float
    da: float
    dr: float
    unit: float


def input_sizes(truth: TruthAircraft, V: float, h: float, alpha: float = 0.0) -> InputSizes:
    """Amplitudes for about 0.05 rad of angle of attack and sideslip and 0.2 rad/s of roll, by the main derivatives."""
    air = truth.aircraft
    rho = float(standard_atmosphere(h)[2])
    qS = 0.5 * rho * V**2 * air.S
    stiff = max(-truth.value("Cm", "alpha") - 2.0 * alpha * truth.value("Cm", "alpha^2"), 0.25)
    omega = np.sqrt(qS * air.cbar * stiff / air.require_inertia("sizes").Iy)
    de = 0.045 * stiff / abs(truth.value("Cm", "de")) * 1.4
    da = 0.20 * air.b / (2 * V) * abs(truth.value("Cl", "p_hat") / truth.value("Cl", "da"))
    dr = 0.05 * max(truth.value("Cn", "beta"), 0.05) / abs(truth.value("Cn", "dr"))
    return InputSizes(
        float(np.clip(de, 0.01, 0.12)),
        float(np.clip(da, 0.02, 0.2)),
        float(np.clip(dr, 0.02, 0.15)),
        float(np.clip(1.6 / omega, 0.3, 0.9)),
    )


def _follow(manoeuvre: Manoeuvre, truth: TruthAircraft, t0: float, t1: float, wanted: np.ndarray) -> None:
    """Let the pilot follow an angle of attack, with the elevator of static equilibrium."""
    on = (manoeuvre.t >= t0) & (manoeuvre.t < t1)
    manoeuvre.column("alpha")[on] = wanted[on]
    slope = -(truth.value("Cm", "alpha") + 2.0 * manoeuvre.trim["alpha"] * truth.value("Cm", "alpha^2"))
    manoeuvre.column("de")[on] += slope / truth.value("Cm", "de") * (wanted[on] - manoeuvre.trim["alpha"])


Purpose = Callable[[Manoeuvre, TruthAircraft, InputSizes, np.random.Generator], None]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _elevator(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    sign, k = _sign(rng), rng.uniform(0.7, 1.2)
    end = manoeuvre.pulses("de", THREE_TWO_ONE_ONE, 2.0, s.unit, sign * k * s.de)
    end = manoeuvre.pulses("de", DOUBLET, end + rng.uniform(2.0, 4.0), 1.2 * s.unit, -sign * k * s.de)
    if end + 8.0 < manoeuvre.duration:
        manoeuvre.pulses("de", THREE_TWO_ONE_ONE, end + 3.0, 0.7 * s.unit, -sign * 0.6 * s.de)
    _free(manoeuvre, 1.5, manoeuvre.duration)


def _aileron(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    sign, k = _sign(rng), rng.uniform(0.7, 1.2)
    end = manoeuvre.pulses("da", ONE_TWO_ONE, 2.0, 1.0, sign * k * s.da)
    end = manoeuvre.pulses("da", THREE_TWO_ONE_ONE, end + 2.5, 0.5, -sign * k * s.da)
    end = manoeuvre.pulses("de", DOUBLET, end + 1.5, s.unit, 0.7 * s.de)
    if end + 5.0 < manoeuvre.duration:
        manoeuvre.pulses("da", DOUBLET, end + 2.0, 0.8, sign * s.da)
    _free(manoeuvre, 1.5, manoeuvre.duration)


def _rudder(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    sign, k = _sign(rng), rng.uniform(0.7, 1.2)
    end = manoeuvre.pulses("dr", DOUBLET, 2.0, 1.1, sign * k * s.dr)
    end = manoeuvre.pulses("dr", THREE_TWO_ONE_ONE, end + 4.0, 0.6, -sign * k * s.dr)
    end = manoeuvre.pulses("da", DOUBLET, end + 2.0, 0.8, sign * s.da)
    if end + 5.0 < manoeuvre.duration:
        manoeuvre.pulses("de", DOUBLET, end + 1.0, s.unit, 0.6 * s.de)
    _free(manoeuvre, 1.5, manoeuvre.duration)


def _multisine(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """All three controls on harmonics of their own, random phases."""
    t = manoeuvre.t
    on = np.clip(t / 2.0, 0.0, 1.0) * np.clip((manoeuvre.duration - t) / 2.0, 0.0, 1.0)
    for i, (name, size) in enumerate((("de", s.de), ("da", s.da), ("dr", s.dr))):
        k = np.arange(2 + i, int(1.6 * manoeuvre.duration), 3)
        wave = np.cos(2 * np.pi * np.outer(t, k) / manoeuvre.duration + rng.uniform(0, 2 * np.pi, k.size)).sum(axis=1)
        manoeuvre.column(name)[:] += on * 0.45 * size * wave / np.sqrt(0.5 * k.size)
    _free(manoeuvre, 0.0, manoeuvre.duration)


def _turns(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    sign, bank = _sign(rng), rng.uniform(0.5, 0.85)
    third = manoeuvre.duration / 3.2
    manoeuvre.ramp("phi", 1.0, 2.2, sign * bank)
    manoeuvre.ramp("phi", third, third + 2.0, -2.0 * sign * bank)
    manoeuvre.ramp("phi", 2.3 * third, 2.3 * third + 1.5, sign * bank)
    manoeuvre.column("theta")[:] += 0.06 * np.abs(manoeuvre.column("phi")) * np.abs(manoeuvre.column("phi"))
    manoeuvre.pulses("de", DOUBLET, 0.6 * third, s.unit, 0.8 * s.de)
    manoeuvre.pulses("de", DOUBLET, 1.8 * third, s.unit, -0.8 * s.de)


def _throttle(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    base = manoeuvre.trim["throttle"]
    high, low = min(base + rng.uniform(0.3, 0.55), 1.0), max(base - rng.uniform(0.25, 0.45), 0.05)
    fifth = manoeuvre.duration / 5.0
    for start, level, before in (
        (1.0, high, base),
        (1.0 + fifth, low, high),
        (1.0 + 2.3 * fifth, high, low),
        (1.0 + 3.4 * fifth, base, high),
    ):
        manoeuvre.ramp("throttle", start, start + 0.25, level - before)
    manoeuvre.pulses("de", DOUBLET, 1.0 + 0.4 * fifth, s.unit, 0.8 * s.de)
    manoeuvre.pulses("de", DOUBLET, 1.0 + 1.5 * fifth, s.unit, -0.8 * s.de)
    manoeuvre.pulses("de", THREE_TWO_ONE_ONE, 1.0 + 2.6 * fifth, 0.6 * s.unit, 0.6 * s.de)
    manoeuvre.pulses("dr", DOUBLET, 1.0 + 3.5 * fifth, 0.9, 0.7 * s.dr)


def _speeds(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Decelerate, then accelerate, level."""
    base = manoeuvre.trim["throttle"]
    half, first = manoeuvre.duration / 2.0, _sign(rng)
    low, high = max(base - 0.5, 0.03), min(base + 0.6, 1.0)
    one, two = (low, high) if first > 0 else (high, low)
    manoeuvre.ramp("throttle", 0.5, 1.5, one - base)
    manoeuvre.ramp("throttle", half, half + 1.0, two - one)
    manoeuvre.pulses("de", DOUBLET, 0.6 * half, s.unit, 0.6 * s.de)
    manoeuvre.pulses("de", DOUBLET, 1.6 * half, s.unit, -0.6 * s.de)


def _pull_up(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Push-overs and pull-ups, within the usual range and somewhat beyond."""
    trim = manoeuvre.trim["alpha"]
    up = min(0.80 * truth.stall, trim + 0.09) - trim
    period = rng.uniform(4.0, 7.0)
    wanted = trim + 0.7 * up * np.sin(2 * np.pi * (manoeuvre.t - 1.0) / period) + 0.15 * up
    _follow(manoeuvre, truth, 1.0, manoeuvre.duration - 2.5, wanted)
    manoeuvre.ramp("throttle", 0.5, 1.0, 0.1)


def _stall(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Slowly up to beyond the stall with the power back, then one or two quick excursions about it."""
    trim, peak = manoeuvre.trim["alpha"], truth.stall + rng.uniform(0.04, 0.07)
    rise = min(0.5 * manoeuvre.duration, rng.uniform(7.0, 11.0))
    shape_t = [1.0, 1.0 + rise, 3.0 + rise, 4.2 + rise, 5.2 + rise, 6.2 + rise, 7.4 + rise, manoeuvre.duration]
    low, near = min(trim, 0.5 * truth.stall), truth.stall - 0.03
    shape = [trim, peak, near - 0.03, peak - 0.01, near - 0.05, peak, low, low]
    _follow(manoeuvre, truth, 1.0, manoeuvre.duration + 1.0, np.interp(manoeuvre.t, shape_t, shape))
    manoeuvre.ramp("throttle", 0.5, 1.5, -0.7 * manoeuvre.trim["throttle"])
    manoeuvre.ramp("throttle", 7.5 + rise, 8.5 + rise, 0.5)


def _low_pass(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Down towards the ground, along it, and away."""
    b, t = truth.aircraft.b, manoeuvre.t
    depth = rng.uniform(0.16, 0.30)
    d = manoeuvre.duration
    profile = np.interp(t, [0.0, 0.12 * d, 0.42 * d, 0.62 * d, 0.9 * d, d], [0.0, 0.0, 1.0, 1.0, 0.1, 0.1])
    manoeuvre.column("h")[:] = manoeuvre.h - profile * (1.5 - depth) * b
    manoeuvre.hold = True
    manoeuvre.pulses("de", DOUBLET, 0.5 * d, s.unit, 0.25 * s.de)


def _sideslip(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Steady sideslips to both sides, with elevator pulses in them."""
    sign, d = _sign(rng), manoeuvre.duration
    for start, side in ((1.0, sign), (0.5 * d, -sign)):
        manoeuvre.ramp("dr", start, start + 1.0, side * 1.5 * s.dr)
        manoeuvre.ramp("phi", start, start + 1.0, -side * 0.06)
        manoeuvre.ramp("dr", start + 0.36 * d, start + 0.36 * d + 1.0, -side * 1.5 * s.dr)
        manoeuvre.ramp("phi", start + 0.36 * d, start + 0.36 * d + 1.0, side * 0.06)
        manoeuvre.pulses("de", DOUBLET, start + 3.0, s.unit, 0.5 * s.de)


def _large(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Pulses of all sizes on all controls, some quick and large."""
    start = 1.0
    while start < manoeuvre.duration - 3.0:
        name = str(rng.choice(["de", "da", "dr"]))
        k = float(rng.choice([0.4, 0.9, 1.6]))
        start = manoeuvre.pulses(name, (1, -1), start, rng.uniform(0.35, 0.7), _sign(rng) * k * getattr(s, name)) + 1.2
    _free(manoeuvre, 0.5, manoeuvre.duration)


def _flap(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """Elevator and aileron work about the time at which the configuration changes."""
    manoeuvre.pulses("de", DOUBLET, 2.0, s.unit, 0.6 * s.de)
    manoeuvre.pulses("da", DOUBLET, 0.3 * manoeuvre.duration, 0.9, 0.7 * s.da)
    manoeuvre.pulses("de", THREE_TWO_ONE_ONE, 0.62 * manoeuvre.duration, 0.7 * s.unit, 0.6 * s.de)


def _flap_extension(manoeuvre: Manoeuvre, truth: TruthAircraft, s: InputSizes, rng: np.random.Generator) -> None:
    """The flap extends by 6 to 11 deg and retracts, with elevator doublets before, between and after."""
    travel, takes, d = rng.uniform(0.1, 0.2), rng.uniform(1.5, 3.0), manoeuvre.duration
    for start, change in ((0.25 * d, travel), (0.65 * d, -travel)):
        manoeuvre.ramp("df", start, start + takes, change)
    for start in (1.0, 0.45 * d, 0.85 * d):
        manoeuvre.pulses("de", DOUBLET, start, s.unit, 0.6 * s.de)


def _free(manoeuvre: Manoeuvre, start: float, end: float) -> None:
    """The pilot lets go: a quarter of the gains remains."""
    t = manoeuvre.t
    manoeuvre.column("free")[(t >= start) & (t < end)] = 1.0


PURPOSES: dict[str, Purpose] = {
    "elevator": _elevator, "aileron": _aileron, "rudder": _rudder, "multisine": _multisine, "turns": _turns,
    "throttle": _throttle, "speeds": _speeds, "pull-up": _pull_up, "stall": _stall, "low-pass": _low_pass,
    "sideslip": _sideslip, "large": _large, "flap": _flap,
    "flap-extension": _flap_extension,
}  # fmt: skip
USUAL = ("elevator", "aileron", "rudder", "multisine", "turns", "throttle", "speeds", "pull-up", "sideslip", "large")


def make_manoeuvre(
    purpose: str,
    truth: TruthAircraft,
    V: float,
    h: float,
    duration: float,
    rng: np.random.Generator,
    ground: float = 0.0,
) -> Manoeuvre:
    """A manoeuvre from a trimmed start.

    Parameters
    ----------
    purpose : str
    V, h : float [m/s, m]
        A low pass begins 1.5 spans above the `ground` [m] whatever h is.
    """
    if purpose == "low-pass":
        h = ground + 1.5 * truth.aircraft.b
    V = _speed_at(truth, h, 0.7) if purpose == "stall" else max(V, _speed_at(truth, h, 0.6))
    manoeuvre = Manoeuvre(purpose, V, h, duration, truth.trim(V, h))
    steps = round((duration + SETTLING) / DT) + 1
    manoeuvre.schedules = np.zeros((steps, len(SCHEDULES)))
    for name, value in {
        "da": manoeuvre.trim["da"],
        "dr": manoeuvre.trim["dr"],
        "theta": manoeuvre.trim["alpha"],
        "alpha": -9.0,
        "h": h,
        "throttle": manoeuvre.trim["throttle"],
        "mass": truth.aircraft.mass or 0.0,
        "aug": 1.0,
        "thrust": -1.0,
    }.items():
        manoeuvre.column(name)[:] = value
    PURPOSES[purpose](manoeuvre, truth, input_sizes(truth, V, h, manoeuvre.trim["alpha"]), rng)
    return manoeuvre


def _speed_at(truth: TruthAircraft, h: float, fraction: float) -> float:
    """Speed of level flight at a fraction of the stalling angle of attack."""
    low, high = 0.4 * truth.speeds[0], 1.3 * truth.speeds[1]
    for _ in range(12):
        V = 0.5 * (low + high)
        low, high = (V, high) if truth.trim(V, h)["alpha"] > fraction * truth.stall else (low, V)
    return V


def draw_manoeuvres(
    truth: TruthAircraft,
    needed: Sequence[str],
    rng: np.random.Generator,
    *,
    count: int = 8,
    duration: float = 30.0,
    ground: float = 0.0,
    bands: Sequence[tuple[float, float]] | None = None,
) -> list[Manoeuvre]:
    """A mixed set: what is needed, and other manoeuvres, at speeds and heights of the aircraft's range.

    `bands` are (low, high) heights to choose from; by default one band somewhere in the range.
    """
    others = list(rng.permutation([p for p in USUAL if p not in needed]))
    purposes = [*needed, *others][:count]
    while len(purposes) < count:
        purposes.append(str(rng.choice(USUAL)))
    (low, high), (bottom, top) = truth.speeds, truth.heights
    if bands is None:
        middle = rng.uniform(bottom + 0.15 * (top - bottom), top - 0.15 * (top - bottom))
        bands = [(middle - 0.12 * (top - bottom), middle + 0.12 * (top - bottom))]
    made = []
    for k in rng.permutation(len(purposes)):
        purpose = str(purposes[k])
        V = low + (high - low) * {"stall": 0.15, "low-pass": 0.15}.get(purpose, rng.uniform(0.12, 0.92))
        band = bands[int(rng.integers(len(bands)))]
        made.append(make_manoeuvre(purpose, truth, float(V), float(rng.uniform(*band)), duration, rng, ground))
    return made
