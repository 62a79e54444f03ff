"""Simulates one manoeuvre of a JSBSim aircraft with attitude hold, and logs all that the key needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from proof.jsbsim.aircraft import JSBSimPlant
from structsel.errors import SimulationError
from structsel.numerics.rigid_body import STATES
from structsel.simulation.jsbsim.fdm import silence_output

STEP = 0.01  # s
LEAD = 1.5  # s simulated before the recording starts, the commands at rest
_FASTEST = 0.8  # rad/s
RATES = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
_READ = (*STATES, *RATES, "vd", "rho", "mach", "mass", *(f"{a}{c}" for a in "FPA" for c in "xyz"),
         *(f"{a}{c}" for a in "MA" for c in "lmn"))  # fmt: skip
_LIVE = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "h", *RATES, "rho", "mach", "mass",
         "Px", "Py", "Pz", "Ax", "Ay", "Az", "Fx", "Fy", "Fz")  # fmt: skip


class AddedEffect(Protocol):
    """Physics that JSBSim lacks: coefficients from the state of the aircraft, step by step."""

    def start(self, now: Mapping[str, float], dt: float) -> None:
        """Forget everything: a manoeuvre begins."""

    def coefficients(self, now: Mapping[str, float]) -> np.ndarray:
        """CX, CY, CZ, Cl, Cm, Cn."""


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """One manoeuvre.

    Attributes
    ----------
    name : str
    purpose : str
    t : (n,) array [s]
        From -LEAD on.
    start : (12,) array
        Trimmed state.
    controls : mapping
        Settings at the start.
    commands : mapping of str to (n,) array
        Added to the settings (``de``, ``da``, ``dr``, ``throttle``), in place of them (``df``, ``gear``, ``brake``), or
        references of the pilot: departures ``theta``, ``phi`` [rad], ``alpha`` [rad], ``h`` [m].
    gains : mapping of surface to {state: gain}
    store : (mass [kg], time of release [s]) or None
    """

    name: str
    purpose: str
    t: np.ndarray
    start: np.ndarray
    controls: Mapping[str, float]
    commands: Mapping[str, np.ndarray]
    gains: Mapping[str, Mapping[str, float]]
    store: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class TruthFlight:
    """Truth at each sample, at the centre of gravity.

    Attributes
    ----------
    manoeuvre : Manoeuvre
    t : (n,) array [s]
    channels : mapping of str to (n,) array
        States, accelerations, air data, forces [N], moments [N m]; ``de`` ... as commanded, ``real_de`` ... where an
        actuator stands between; ``thrust``.
    properties : mapping of property to (n,) array
    extra : (n, 6) array
        Coefficients of all that was added, together.
    fractions : tuple of (n, 6) arrays
        Of each `AddedEffect`, in their order.
    now : tuple of mappings
        What an `AddedEffect` is given, at each sample.
    """

    manoeuvre: Manoeuvre
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    properties: Mapping[str, np.ndarray]
    extra: np.ndarray
    fractions: tuple[np.ndarray, ...] = ()
    now: tuple[Mapping[str, float], ...] = ()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]


@dataclass(frozen=True, eq=False)
class Additions:
    """Differences from a flight of the unchanged aircraft.

    Attributes
    ----------
    added : sequence of AddedEffect
    actuators : mapping of surface to a maker of (command, dt, now) -> angle
    wind : callable of (n,) clock to (n, 3) array [m/s], north east down, optional
    pilot : bool
        Without, the commands act open loop.
    """

    added: Sequence[AddedEffect] = ()
    actuators: Mapping[str, Callable[[], Callable[[float, float, Mapping[str, float]], float]]] = field(
        default_factory=dict
    )
    wind: Mapping[str, np.ndarray] = field(default_factory=dict)
    pilot: bool = True


def simulate_manoeuvre(plant: JSBSimPlant, manoeuvre: Manoeuvre, additions: Additions) -> TruthFlight:
    """Simulate a manoeuvre.

    Raises
    ------
    SimulationError
        It left what the aircraft can do: not finite, near the ground, or beyond 60 degrees of attitude.
    """
    t = manoeuvre.t
    count = max(1, round(float(t[1] - t[0]) / STEP))
    dt = float(t[1] - t[0]) / count
    wind = additions.wind.get(manoeuvre.name)
    pilot = AttitudeHold(manoeuvre, additions.pilot)
    number = float("".join(filter(str.isdigit, manoeuvre.name)) or 0)
    moved = {surface: make() for surface, make in additions.actuators.items()}
    lengths = np.array([plant.aircraft.b, plant.aircraft.cbar, plant.aircraft.b])
    pushed = np.zeros(6)
    rows: list[list[float]] = []
    with silence_output():
        machine = plant.machine
        plant.set_wind(np.zeros(3) if wind is None else wind[0])
        plant.set_store_mass(manoeuvre.store[0] if manoeuvre.store else 0.0)
        plant.set_external_force(np.zeros(3), np.zeros(3))
        settings = pilot.settings(0, 0.0, None)
        plant.set_controls(settings)
        machine.place(manoeuvre.start, {c: v for c, v in settings.items() if c not in ("df", "brake")})
        plant.set_controls(settings)
        now = _now(plant, settings, float(t[0]), number)
        for extra in additions.added:
            extra.start(now, dt)
        applied, real = np.zeros(6), {c: settings[c] for c in moved}
        rows.append(_row(plant, settings, real, applied))
        seen, each, fractions = [now], np.zeros((len(additions.added), 6)), [np.zeros((len(additions.added), 6))]
        for i in range(len(t) - 1):
            for k in range(1, count + 1):
                at = float(t[i]) + k * dt
                if manoeuvre.store and at >= manoeuvre.store[1]:
                    plant.set_store_mass(0.0)
                if wind is not None:
                    plant.set_wind(wind[i] + (wind[i + 1] - wind[i]) * (k / count))
                settings = pilot.settings(i, k / count, now)
                real = {c: follow(settings[c], dt, now) for c, follow in moved.items()}
                plant.set_controls({**settings, **real})
                if additions.added:
                    each = np.array([extra.coefficients(now) for extra in additions.added]) * now["qbar"]
                    pushed = each.sum(axis=0) / now["qbar"] * now["qbar"] * plant.aircraft.S
                    plant.set_external_force(pushed[:3], pushed[3:] * lengths)
                machine.step(dt)
                complete = k == count or additions.added or moved
                now = _now(plant, {**settings, **real}, at, number) if complete else _brief(plant)
            if additions.added:  # the force was held over the step, airspeed was not
                applied = pushed / (now["qbar"] * plant.aircraft.S)
            fractions.append(each / now["qbar"])
            seen.append(now)
            rows.append(_row(plant, settings, real, applied))
            _check_limits(plant, now, at, manoeuvre.name)
    simulated = _flight(plant, manoeuvre, settings, real, np.array(rows))
    first = len(seen) - len(simulated.t)
    by = np.array(fractions)[first:]
    return replace(simulated, now=tuple(seen[first:]), fractions=tuple(by[:, k] for k in range(by.shape[1])))


def _now(plant: JSBSimPlant, settings: Mapping[str, float], t: float, number: float) -> dict[str, float]:
    value = plant.machine.value
    now = {c: value(c) for c in _LIVE}
    leaf = plant.machine.fdm
    u, v, w = now["u"], now["v"], now["w"]
    if plant.in_wind:
        u, v, w = (leaf[f"velocities/{c}-aero-fps"] * 0.3048 for c in "uvw")
    V = math.sqrt(u * u + v * v + w * w)
    now |= settings
    now |= {
        "t": t, "V": V, "alpha": math.atan2(w, u), "beta": math.asin(max(-1.0, min(1.0, v / V))),
        "qbar": 0.5 * now["rho"] * V * V,
        "alpha_dot": (u * now["w_dot"] - w * now["u_dot"]) / (u * u + w * w),
        "beta_dot": (now["v_dot"] - v / V * (u * now["u_dot"] + v * now["v_dot"] + w * now["w_dot"]) / V) / V,
        "number": number,
    }  # fmt: skip
    line = plant.aircraft.thrust.direction
    now["thrust"] = float(line[0] * now["Px"] + line[1] * now["Py"] + line[2] * now["Pz"])
    qS = max(now["qbar"], 1.0) * plant.aircraft.S
    now |= {f"C{c.upper()}": now[f"A{c}"] / qS for c in "xyz"}
    now |= {f"a{c}": now[f"F{c}"] / now["mass"] for c in "xyz"}
    return now


def _brief(plant: JSBSimPlant) -> dict[str, float]:
    """Values that the pilot uses."""
    value = plant.machine.value
    now = {c: value(c) for c in ("u", "v", "w", "p", "q", "r", "phi", "theta", "h")}
    now["alpha"] = math.atan2(now["w"], now["u"])
    now["V"] = math.sqrt(now["u"] ** 2 + now["v"] ** 2 + now["w"] ** 2)
    return now


def _row(
    plant: JSBSimPlant, settings: Mapping[str, float], real: Mapping[str, float], extra: np.ndarray
) -> list[float]:
    value = plant.machine.value
    aero = [plant.machine.fdm[f"velocities/{c}-aero-fps"] * 0.3048 for c in "uvw"]
    return [*(value(c) for c in _READ), *aero, *settings.values(), *real.values(), *extra, *plant.read_properties()]


def _flight(
    plant: JSBSimPlant, manoeuvre: Manoeuvre, settings: Mapping[str, float], real: Mapping[str, float], rows: np.ndarray
) -> TruthFlight:
    names = [*_READ, "u_air", "v_air", "w_air", *settings, *(f"real_{c}" for c in real)]
    n = len(names)
    channels = {name: rows[:, k].copy() for k, name in enumerate(names)}
    u, v, w = (channels[f"{c}_air"] for c in "uvw")
    V = np.sqrt(u * u + v * v + w * w)
    channels |= {"V": V, "alpha": np.arctan2(w, u), "beta": np.arcsin(v / V), "qbar": 0.5 * channels["rho"] * V * V}
    channels["psi"] = np.unwrap(channels["psi"])
    line = plant.aircraft.thrust.direction
    channels["thrust"] = sum(line[k] * channels[f"P{c}"] for k, c in enumerate("xyz"))
    properties = {p: rows[:, n + 6 + k].copy() for k, p in enumerate(plant.properties)}
    on = manoeuvre.t > -1e-9
    t = np.round(manoeuvre.t[on], 9)
    channels, properties = ({c: v[on] for c, v in held.items()} for held in (channels, properties))
    return TruthFlight(manoeuvre, t, channels, properties, rows[on, n : n + 6])


def _check_limits(plant: JSBSimPlant, now: Mapping[str, float], t: float, name: str) -> None:
    if not all(math.isfinite(x) for x in now.values()):
        raise SimulationError(f"'{name}' is no longer finite at {t:.1f} s.")
    if now["h"] < plant.clearance + 0.05:
        raise SimulationError(f"'{name}' touches the ground at {t:.1f} s.")
    if abs(now["theta"]) > 0.8 or abs(now["phi"]) > 1.2 or abs(now["alpha"]) > 0.5 or abs(now["beta"]) > 0.35:
        raise SimulationError(f"'{name}' departs at {t:.1f} s.")


class AttitudeHold:
    """Commands and light stabilisation."""

    def __init__(self, manoeuvre: Manoeuvre, closed: bool):
        self.m, self.closed = manoeuvre, closed
        self.base = dict(manoeuvre.controls)
        self.about = dict(zip(STATES, manoeuvre.start.tolist()))
        self.about["alpha"] = math.atan2(self.about["w"], self.about["u"])
        self.about["V"] = math.sqrt(sum(self.about[c] ** 2 for c in "uvw"))
        self.commands = {c: v.tolist() for c, v in manoeuvre.commands.items()}
        self.last = len(manoeuvre.t) - 1
        self.held: dict[str, float] = {}

    def settings(self, i: int, fraction: float, now: Mapping[str, float] | None) -> dict[str, float]:
        """Controls at a fraction of the way from sample i to the next."""
        fraction = fraction if self.closed else 0.0  # without a pilot they are held over each sample
        after = min(i + 1, self.last)
        asked = {c: v[i] + (v[after] - v[i]) * fraction for c, v in self.commands.items()}
        made = {c: (asked[c] if c in asked and c in ("df", "gear", "brake") else v) for c, v in self.base.items()}
        for c in ("de", "da", "dr", "throttle"):
            if c in made:
                made[c] += asked.get(c, 0.0)
        if now is not None and self.closed:
            for surface, gains in self.m.gains.items():
                made[surface] += sum(g * self._error(c, now, asked) for c, g in gains.items())
        if now is not None and self.closed and "climb" in asked:
            made["throttle"] -= max(-0.3, min(0.3, 2.5 * self._above(now, asked) / now["V"]))
        if "throttle" in made:
            made["throttle"] = min(1.0, max(0.05, made["throttle"]))
        if now is not None and self.closed:  # surfaces of a real aircraft do not jump
            for c in ("de", "da", "dr"):
                if c in made:
                    limit = _FASTEST * STEP
                    last = self.held.get(c, made[c])
                    made[c] = min(last + limit, max(last - limit, made[c]))
                    made[c] = min(0.45, max(-0.45, made[c]))
        self.held = dict(made)
        return made

    def _error(self, c: str, now: Mapping[str, float], asked: Mapping[str, float]) -> float:
        if c == "h":  # a climb is a change of pitch
            return 0.0
        error = now[c] - self.about.get(c, 0.0) - asked.get(c, 0.0)
        if c != "theta":
            return error
        if "alpha" in asked:
            return 4.0 * (now["alpha"] - self.about["alpha"] - asked["alpha"])
        if "h" in asked:
            V = now["V"]
            error += max(-0.2, min(0.2, 1.5 * self._above(now, asked) / V))
        return asked.get("firm", 1.0) * error

    def _above(self, now: Mapping[str, float], asked: Mapping[str, float]) -> float:
        """How far above the height wanted, and rising [m/s]."""
        high = max(-0.15 * now["V"], min(0.15 * now["V"], now["h"] - self.about["h"] - asked["h"]))
        climb = now["u"] * math.sin(now["theta"]) - now["w"] * math.cos(now["theta"])
        return 0.4 * high + 0.8 * (climb - asked.get("climb", 0.0))
