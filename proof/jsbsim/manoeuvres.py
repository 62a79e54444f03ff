"""Eight manoeuvres of mixed purposes for one aircraft, from trimmed points, with inputs sized to its response."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from proof.jsbsim.aircraft import JSBSimPlant
from proof.jsbsim.flight import LEAD, Additions, Manoeuvre, TruthFlight, simulate_manoeuvre
from proof.scenario.shapes import DOUBLET, THREE_TWO_ONE_ONE, pulses, ramp
from structsel.errors import SimulationError
from structsel.numerics.rigid_body import G0

_RISE = {"alpha": 0.03, "beta": 0.04, "p": 0.15}
_LARGEST = {"de": 0.22, "da": 0.18, "dr": 0.22}
_REFERENCES = ("theta", "phi", "alpha", "h", "climb", "firm")
_NO_SUCH = {"da": 0.0, "dr": 0.0, "de": 0.0}


@dataclass(frozen=True, eq=False)
class Point:
    """A trimmed flight, and what it takes there to move the aircraft."""

    state: np.ndarray
    controls: dict[str, float]
    gains: dict[str, dict[str, float]]
    reach: dict[str, float]
    V: float
    h: float


def find_point(
    plant: JSBSimPlant,
    rng: np.random.Generator,
    *,
    low: bool = False,
    lift: tuple[float, float] = (0.3, 0.6),
    heights: tuple[float, float] = (800.0, 3000.0),
) -> Point:
    """Trim somewhere in a range of lift coefficients and heights; near the ground where `low`.

    Raises
    ------
    SimulationError
        None was found in twelve tries.
    """
    last: Exception | None = None
    for _ in range(12):
        h = plant.clearance + rng.uniform(1.1, 1.5) * plant.aircraft.b if low else rng.uniform(*heights)
        rho = 1.225 * (1.0 - 2.2558e-5 * h) ** 4.2559
        V = math.sqrt(2.0 * plant.mass * G0 / (rho * plant.aircraft.S * rng.uniform(*lift)))
        if 0.85 * 340.0 * math.sqrt(max(0.2, 1.0 - 2.2558e-5 * h)) < V:
            continue
        try:
            trim = plant.trim(V, h)
        except SimulationError as error:
            last = error
            continue
        controls = dict(trim.controls)
        if controls.get("throttle", 0.5) > 0.93 or abs(controls.get("de", 0.0)) > 0.35:
            continue
        return _learn(plant, np.asarray(trim.state), controls, V, h)
    raise SimulationError(f"JSBSim's {plant.name} was not trimmed in twelve tries: {last}")


def _learn(plant: JSBSimPlant, state: np.ndarray, controls: dict[str, float], V: float, h: float) -> Point:
    """Gains of a light pilot, and the deflections that move alpha, p and beta as far as wanted."""
    strength = plant.effectiveness(state, controls)
    gains = {
        "de": {"theta": 0.9, "q": 0.9}, "da": {"phi": 0.5, "p": 0.4}, "dr": {"r": 0.35},
    }  # fmt: skip
    gains = {s: {c: g / max(strength[s], 0.3) for c, g in of.items()} for s, of in gains.items() if s in strength}
    if plant.has_brake:
        controls["brake"] = 0.0
    t = np.arange(-LEAD, 9.0, 0.05)
    small = {c: 0.1 / max(k, 0.3) for c, k in strength.items()}
    commands = {
        c: small[c] * _doublet(t, start, 2.0) for c, start in (("de", 0.0), ("da", 4.0), ("dr", 6.0)) if c in small
    }
    flight = simulate_manoeuvre(plant, Manoeuvre("trial", "trial", t, state, controls, commands, gains), Additions())
    reach = dict(_NO_SUCH)
    for surface, seen, window in (("de", "alpha", (0.0, 3.5)), ("da", "p", (4.0, 6.0)), ("dr", "beta", (6.0, 9.0))):
        if surface in small:
            on = (flight.t >= window[0]) & (flight.t < window[1])
            moved = np.abs(flight[seen][on] - flight[seen][on][0]).max()
            reach[surface] = min(_LARGEST[surface], small[surface] * _RISE[seen] / max(moved, 1e-4))
    return Point(state, controls, gains, reach, V, h)


Purpose = Callable[[JSBSimPlant, Point, np.ndarray, np.random.Generator], dict[str, np.ndarray]]


def make_manoeuvre(
    plant: JSBSimPlant, name: str, purpose: str, point: Point, dt: float, rng: np.random.Generator
) -> Manoeuvre:
    """One manoeuvre of a purpose, of `PURPOSES`."""
    length = rng.uniform(24.0, 34.0)
    t = np.round(np.arange(-LEAD, length, dt), 9)
    t = t - t[np.argmin(np.abs(t))]
    commands = PURPOSES[purpose](plant, point, t, rng)
    for surface in ("de", "da", "dr"):  # nobody's hand is quite still
        commands[surface] = commands.get(surface, 0.0) + 0.06 * point.reach[surface] * _wander(t, rng)
    commands = {c: v for c, v in commands.items() if c in point.controls or c in _REFERENCES}
    return Manoeuvre(name, purpose, t, point.state, point.controls, commands, point.gains)


def _wander(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Unit-size wandering over a second or so, still before the recording."""
    knots = np.arange(0.0, t[-1] + 1.0, 0.7)
    values = rng.standard_normal(len(knots))
    values[:2] = 0.0
    return np.asarray(CubicSpline(knots, values)(np.maximum(t, 0.0)))


def _doublet(t: np.ndarray, start: float, length: float) -> np.ndarray:
    return pulses(t, DOUBLET, start, 0.5 * length)[0]


def _3211(t: np.ndarray, start: float, unit: float) -> np.ndarray:
    return pulses(t, THREE_TWO_ONE_ONE, start, unit)[0]


def _pulse(t: np.ndarray, start: float, end: float) -> np.ndarray:
    return pulses(t, (1,), start, end - start)[0]


def _tempo(plant: JSBSimPlant) -> float:
    """Seconds that a push of the aircraft takes: larger ones are slower."""
    return float(np.clip(0.45 * math.sqrt(plant.aircraft.cbar), 0.5, 1.2))


def _lead(at: Point, alpha: np.ndarray) -> np.ndarray:
    """Elevator that a wanted angle of attack takes, about."""
    return np.clip(-0.8 * at.reach["de"] / _RISE["alpha"] * alpha, -0.3, 0.3)


def _pitch(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    a, unit = at.reach["de"] * rng.uniform(0.9, 1.6), _tempo(plant) * rng.uniform(0.8, 1.2)
    end = 1.5 + 7.0 * unit
    back = -rng.uniform(0.5, 1.0) * a * _3211(t, end + 4.0, 0.7 * unit) if end + 12.0 < t[-1] else 0.0
    return {"de": a * _3211(t, 1.5, unit) + back + 0.5 * a * _doublet(t, t[-1] - 4.0, 1.5 * unit)}


def _lateral(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    unit, s = 2.2 * _tempo(plant), rng.choice([-1.0, 1.0])
    size = rng.uniform(0.8, 1.4, 4)
    return {
        "dr": s * at.reach["dr"] * (size[0] * _doublet(t, 1.5, unit) - size[1] * _3211(t, 14.0, 0.5 * unit)),
        "da": s * at.reach["da"] * (size[2] * _doublet(t, 8.0, unit) - size[3] * _doublet(t, t[-1] - 6.0, unit)),
    }


def _multisine(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    made, window = {}, ramp(t, (0.5, 0.0), (2.0, 1.0), (t[-1] - 2.0, 1.0), (t[-1] - 0.5, 0.0))
    base, fastest = 1.0 / (t[-1] - 1.0), 0.75 / _tempo(plant)
    lines = np.arange(2, int(fastest / base))
    for k, (surface, size) in enumerate((("de", 1.2), ("da", 0.9), ("dr", 0.8))):
        used = lines[k::3]
        phase = -math.pi * np.arange(len(used)) ** 2 / len(used) + rng.uniform(0, 2 * math.pi)
        wave = np.cos(2 * math.pi * base * used * t[:, None] + phase).sum(axis=1)
        made[surface] = size * at.reach[surface] * wave / np.abs(wave).max() * window
    return made


def _throttle(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    thr = at.controls.get("throttle", 0.5)
    up, down = min(0.35, 0.98 - thr), -min(0.35, thr - 0.08)
    unit = 2.0 * _tempo(plant)
    first, second = (up, down) if rng.random() < 0.5 else (down, up)
    steps = ramp(t, (2, 0), (2.4, first), (10, first), (10.4, second), (18, second), (18.4, 0.6 * first))
    active = at.reach["de"] * (_doublet(t, 6.0, unit) + _doublet(t, 14.0, unit) + 0.8 * _doublet(t, 21.0, unit))
    return {"throttle": steps, "de": rng.uniform(0.5, 1.1) * active,
            "dr": 0.4 * at.reach["dr"] * _doublet(t, 16.5, unit)}  # fmt: skip


def _speed(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    thr = at.controls.get("throttle", 0.5)
    half, sign = 0.5 * t[-1], rng.choice([-1.0, 1.0])
    a, b = (min(0.6, 0.98 - thr), -min(0.6, thr - 0.08))[:: int(sign)]
    active = sum((_doublet(t, s, 1.6 * _tempo(plant)) for s in np.arange(4.0, t[-1] - 3.0, 6.0)), np.zeros_like(t))
    return {"throttle": ramp(t, (1, 0), (2, a), (half, a), (half + 1, b)), "h": np.zeros_like(t),
            "firm": np.full_like(t, 2.0), "de": 0.5 * at.reach["de"] * active}  # fmt: skip


def _turn(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    bank, s = rng.uniform(0.5, 0.9), rng.choice([-1.0, 1.0])
    phi = s * bank * ramp(t, (2, 0), (4, 1), (11, 1), (14, -0.8), (21, -0.8), (23.5, 0))
    alpha = rng.uniform(0.02, 0.05) * ramp(t, (5, 0), (6.5, 1), (9, 1), (11, 0), (15, 0), (16.5, 1), (19, 1), (21, 0))
    return {"phi": phi, "alpha": alpha, "de": _lead(at, alpha), "throttle": 0.08 * _pulse(t, 4.0, 22.0)}


def _pull_up(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    up, down = rng.uniform(0.04, 0.08), rng.uniform(0.03, 0.05)
    alpha = ramp(t, (2, 0), (3.5, up), (5, up), (6.5, -down), (8, -down), (9.5, 0), (14, 0), (16, 0.7 * up),
                  (17, 0.7 * up), (18.5, -0.6 * down), (20, 0))  # fmt: skip
    return {"alpha": alpha, "de": _lead(at, alpha), "dr": 0.4 * at.reach["dr"] * _doublet(t, 11.0, 2 * _tempo(plant))}


def _stall(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    top = rng.uniform(0.27, 0.34) - math.atan2(at.state[2], at.state[0])
    top = max(top, 0.1)
    quick = rng.uniform(0.7, 1.6)
    peak = 3.0 + 7.0 / quick
    alpha = ramp(t, (1.5, 0), (peak, 0.9 * top), (peak + 1.5, top), (peak + 3.0, 0.02), (peak + 6, 0),
                  (peak + 9.5, 0.85 * top), (peak + 11.5, 0.0))  # fmt: skip
    small = sum((_doublet(t, s, 1.2 * _tempo(plant)) for s in np.arange(3.0, t[-1] - 4.0, 5.0)), np.zeros_like(t))
    return {"alpha": alpha, "throttle": -0.3 * _pulse(t, 1.5, peak + 2.0),
            "de": _lead(at, alpha) + 0.4 * at.reach["de"] * small}  # fmt: skip


def _low(plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    floor = max(plant.clearance + 1.2, rng.uniform(0.14, 0.32) * plant.aircraft.b)
    drop = at.h - floor
    down, up = rng.uniform(2.0, 4.0), t[-1] - rng.uniform(4.0, 8.0)
    bottom = down + max(5.0, drop / (0.06 * at.V))
    rise = (min(t[-1], up + 6.0), -0.3 * drop)
    h = ramp(t, (down, 0), (bottom, -drop), (max(up, bottom + 4.0), -drop), (max(rise[0], bottom + 8.0), rise[1]))
    h = np.convolve(np.pad(h, 25, mode="edge"), np.ones(51) / 51, mode="valid")
    active = sum((_doublet(t, s, 1.3 * _tempo(plant)) for s in np.arange(2.0, t[-1] - 2.0, 4.5)), np.zeros_like(t))
    return {"h": h, "climb": np.gradient(h, t), "firm": np.full_like(t, 4.0), "de": 0.25 * at.reach["de"] * active,
            "dr": 0.2 * at.reach["dr"] * _doublet(t, 9.0, 1.6 * _tempo(plant))}  # fmt: skip


def _config(
    plant: JSBSimPlant, at: Point, t: np.ndarray, rng: np.random.Generator, which: str
) -> dict[str, np.ndarray]:
    start = rng.uniform(6.0, 9.0)
    end = start + rng.uniform(2.0, 4.0)
    out = rng.uniform(17.0, 19.0)
    size = plant.flap * rng.uniform(0.3, 0.5) if which == "df" else 1.0
    travel = size * ramp(t, (start, 0), (end, 1), (out, 1), (out + 3.0, 0.0))
    active = sum((_doublet(t, s, 1.6 * _tempo(plant)) for s in (2.0, 12.0, 23.0)), np.zeros_like(t))
    return {which: travel, "theta": np.zeros_like(t), "firm": np.full_like(t, 3.0), "de": 0.7 * at.reach["de"] * active}


PURPOSES: dict[str, Purpose] = {
    "pitch": _pitch, "lateral": _lateral, "multisine": _multisine, "throttle": _throttle, "speed": _speed,
    "turn": _turn, "pull-up": _pull_up, "stall": _stall, "low": _low,
    **{which: partial(_config, which=which) for which in ("df", "gear", "brake")},
}  # fmt: skip

USUAL = ("pitch", "lateral", "multisine", "throttle", "turn", "pull-up", "speed", "pitch", "lateral", "multisine")


def plan_flights(
    plant: JSBSimPlant,
    wanted: Sequence[str],
    dt: float,
    rng: np.random.Generator,
    lift: tuple[float, float] = (0.3, 0.6),
    heights: tuple[float, float] = (800.0, 3000.0),
) -> list[TruthFlight]:
    """Eight manoeuvres: those wanted, the rest from `USUAL`, in a drawn order, from a few trimmed points; simulated.

    Raises
    ------
    SimulationError
        The aircraft does not trim, or departs in a manoeuvre after three tries.
    """
    rest = [p for p in USUAL if p not in wanted or p in ("pitch", "multisine")]
    purposes = [*wanted, *rest][:8]
    purposes = [purposes[k] for k in rng.permutation(8)]
    high = [find_point(plant, rng, lift=lift, heights=heights) for _ in range(3)]
    low = [find_point(plant, rng, low=True, lift=(0.45, 0.7)) for _ in range(2)] if "low" in purposes else []
    made = []
    for k, purpose in enumerate(purposes):
        for attempt in range(4):
            point = (low if purpose == "low" else high)[int(rng.integers(2 if purpose == "low" else 3))]
            manoeuvre = make_manoeuvre(plant, f"m{k + 1:02d}", purpose, point, dt, rng)
            try:
                made.append(simulate_manoeuvre(plant, manoeuvre, Additions()))
            except SimulationError:
                if attempt == 3:
                    raise
                purpose = purpose if attempt < 2 or purpose == "low" else "multisine"
            else:
                break
    return made
