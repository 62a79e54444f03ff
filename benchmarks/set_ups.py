"""Set-ups after real ones, generated with noise: mechanisms, processes and vehicles whose simulations state channels.

    python benchmarks/set_ups.py [--seeds 3] [NAMES]

Each has an effect concealed or none. Right is the first name, or "consistent" where nothing is concealed.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.signal

import structsel as ss
from structsel.effects.operators import oscillate
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import actuate, delayed, first_order_lag
from structsel.recording import Recording

RUNS = 4
GRAVITY = 9.81  # m/s^2
Channels = Mapping[str, Array]
Run = tuple[Array, Channels, Channels]
"""Clock, recorded channels and simulated channels."""


@dataclass(frozen=True)
class SetUp:
    """What a simulation lacks, by the names that are right (none: nothing), and how a run of it is made."""

    accept: frozenset[str]
    run: Callable[[np.random.Generator, int], Run]
    aircraft: ss.Aircraft | None = None


def motion(rng: np.random.Generator, t: Array, highest: float, rms: float) -> Array:
    """Random motion below a frequency [Hz]."""
    dt = t[1] - t[0]
    b, a = scipy.signal.butter(2, 2.0 * highest * dt)
    x = scipy.signal.filtfilt(b, a, rng.standard_normal(len(t) + 400))[200:-200]
    return np.asarray(rms * x / x.std())


def drift(rng: np.random.Generator, t: Array, tau: float, rms: float) -> Array:
    """Noise that keeps for a time constant [s]."""
    keep = np.exp(-(t[1] - t[0]) / tau)
    return np.asarray(scipy.signal.lfilter([rms * np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(len(t))))


def integrated(rate: Callable[[int, Array], Array], start: Array, t: Array) -> Array:
    """(n, k) states by Euler's method."""
    x = np.empty((len(t), len(start)))
    x[0] = start
    for i in range(len(t) - 1):
        x[i + 1] = x[i] + (t[1] - t[0]) * rate(i, x[i])
    return x


def joint(rng: np.random.Generator, k: int, states: str, friction: float = 0.06) -> Run:
    """A joint with its current; simulated is the current that the motion needs, or the acceleration."""
    t = 0.01 * np.arange(800)
    place = motion(rng, t, 1.2, 0.5)
    rate = np.gradient(place, t)
    acc = np.gradient(rate, t)
    current = 0.02 * acc + 0.03 * rate + friction * np.tanh(rate / 0.02) + drift(rng, t, 0.3, 0.003)
    noise = {"place": 1e-4, "rate": 0.01, "acc": 0.2, "current": 0.004}
    true = {"place": place, "rate": rate, "acc": acc, "current": current}
    read = {c: x + noise[c] * rng.standard_normal(len(t)) for c, x in true.items()}
    said = {"current": 0.02 * read["acc"] + 0.03 * read["rate"], "acc": (read["current"] - 0.03 * read["rate"]) / 0.02}
    return t, read, {states: said[states]}


def slide(rng: np.random.Generator, k: int, states: str, friction: float = 20.0) -> Run:
    """A mass on a guide, driven by a force; simulated is its speed, its place, or the force that it needs."""
    t = 0.005 * np.arange(3000)
    force = motion(rng, t, 0.5, 60.0 + 10.0 * k) + 20.0 * np.sign(np.sin(0.6 * np.pi * t + k))

    def rate(i: int, x: Array, dry: float) -> Array:
        return np.array([x[1], (force[i] - 200.0 * x[1] - dry * np.tanh(x[1] / 0.002)) / 95.0])

    place, speed = integrated(partial(rate, dry=friction), np.zeros(2), t).T
    simulated = integrated(partial(rate, dry=0.0), np.zeros(2), t)
    if states == "force":
        read = place + 1e-5 * rng.standard_normal(len(t))
        differentiate = partial(scipy.signal.savgol_filter, window_length=41, polyorder=3, delta=t[1])
        v, a = differentiate(read, deriv=1), differentiate(read, deriv=2)
        known = {"place": read, "speed": v, "force": force + 0.5 * rng.standard_normal(len(t))}
        return t, known, {"force": 95.0 * a + 200.0 * v}
    speed_read = speed + 0.002 * rng.standard_normal(len(t))
    place_read = place + 1e-4 * rng.standard_normal(len(t))
    if states == "speed":
        return t, {"force": force, "speed": speed_read}, {"speed": simulated[:, 1]}
    if states == "speed beside place":
        return t, {"force": force, "speed": speed_read, "place": place_read}, {"speed": simulated[:, 1]}
    return t, {"force": force, "place": place_read}, {"place": simulated[:, 0]}


def servo(rng: np.random.Generator, k: int, **actuator: float) -> Run:
    """A servo with a lag of 0.06 s behind play or a limited rate."""
    t = 0.01 * np.arange(1500)
    slow = 0.5 + 0.5 * np.sin(0.1 * np.pi * t)
    command = 0.3 * slow * np.sin(2.0 * np.pi * (0.2 + 0.15 * k) * t + k) + motion(rng, t, 0.8, 0.08)
    place = first_order_lag(actuate(t, command, **actuator), t[1], 0.06) + 0.001 * rng.standard_normal(len(t))
    return t, {"command": command, "place": place}, {"place": first_order_lag(command, t[1], 0.06)}


def heater(rng: np.random.Generator, k: int, most: float = np.inf, late: float = 0.0) -> Run:
    """A process of 80 s whose heater saturates, or whose warmth arrives late."""
    t = np.arange(1200.0)
    power = np.repeat(rng.uniform(0.0, 1.0, 20), 60)
    acts = np.minimum(power, most)
    read = 40.0 * first_order_lag(delayed(acts, 1.0, late) if late else acts, 1.0, 80.0)
    read = read + 0.05 * rng.standard_normal(len(t)) + drift(rng, t, 30.0, 0.05)
    return t, {"power": power, "warmth": read}, {"warmth": 40.0 * first_order_lag(power, 1.0, 80.0)}


def tank(rng: np.random.Generator, k: int, orifice: bool) -> Run:
    """A tank that a pump fills, linearised; it empties as the root of its level."""
    t = np.arange(1500.0)
    pump = np.repeat(rng.uniform(0.3, 1.0, 30), 50)
    straight = integrated(lambda i, h: 0.08 * pump[i] - 0.025 * (h + 1.0), np.ones(1), t)[:, 0]
    read = straight
    if orifice:
        read = integrated(lambda i, h: 0.08 * pump[i] - 0.05 * np.sqrt(np.maximum(h, 0.0)), np.ones(1), t)[:, 0]
    return t, {"pump": pump, "level": read + 0.01 * rng.standard_normal(len(t))}, {"level": straight}


def pendulum(rng: np.random.Generator, k: int) -> Run:
    """A pendulum at large angles, linearised."""
    t = 0.02 * np.arange(1500)
    torque = motion(rng, t, 1.0, 1.5 + 0.7 * k)

    def rate(i: int, x: Array, restoring: Callable[[Array], Array]) -> Array:
        return np.array([x[1], -30.0 * restoring(x[0]) - 0.6 * x[1] + torque[i]])

    true, stated = (integrated(partial(rate, restoring=f), np.zeros(2), t)[:, 0] for f in (np.sin, lambda x: x))
    return t, {"torque": torque, "angle": true + 0.001 * rng.standard_normal(len(t))}, {"angle": stated}


def ship(rng: np.random.Generator, k: int) -> Run:
    """Zig-zags of a ship; the simulated yaw acceleration lacks r |r|."""
    t = 0.2 * np.arange(900)
    angle = np.radians((10.0, 20.0, 30.0, 35.0)[k])
    side, rudder = 1.0, np.zeros(len(t))

    def rate(i: int, x: Array) -> Array:
        nonlocal side
        u, v, r, psi = x
        side = -side if psi * side > angle else side
        if i + 1 < len(t):
            rudder[i + 1] = rudder[i] + np.clip(angle * side - rudder[i], -0.01, 0.01)
        turn = -0.002 * v - 0.12 * r + 0.006 * rudder[i] * (u / 7.5) ** 2 - 2.0 * r * abs(r)
        return np.array([-0.01 * (u - 7.5) - 0.6 * v * r, -0.08 * v - 0.48 * r * u + 0.016 * rudder[i] * u, turn, r])

    u, v, r, _ = integrated(rate, np.array([7.5, 0.0, 0.0, 0.0]), t).T
    turning = np.gradient(r, t) + drift(rng, t, 3.0, 2e-5) + 2e-5 * rng.standard_normal(len(t))
    noise = zip((u, v, r), (0.02, 0.01, 1e-4))
    u, v, r = (x + sd * rng.standard_normal(len(t)) for x, sd in noise)
    stated = -0.002 * v - 0.12 * r + 0.006 * rudder * (u / 7.5) ** 2
    return t, {"u": u, "v": v, "r": r, "rudder": rudder, "r_dot": turning}, {"r_dot": stated}


def quadrotor(rng: np.random.Generator, k: int, wind: str) -> Run:
    """The drag of a quadrotor along its body axes, simulated in still air."""
    t, drag = 0.02 * np.arange(1500), 0.35
    vn, ve, vd = (motion(rng, t, f, rms) for f, rms in ((0.25, 1.5), (0.25, 1.5), (0.3, 0.4)))
    psi = motion(rng, t, 0.05, 0.8)
    north = {"none": 0.0 * t, "steady": 4.0 + 0.0 * t, "fan": 3.0 * np.sin(0.4 * np.pi * (t + 7.0 * k))}[wind]
    east = -2.0 if wind == "steady" else 0.0

    def forces(vn: Array, ve: Array, psi: Array) -> tuple[Array, Array]:
        return -drag * (np.cos(psi) * vn + np.sin(psi) * ve), -drag * (np.cos(psi) * ve - np.sin(psi) * vn)

    ax, ay = forces(vn - north, ve - east, psi)
    an, ae = np.gradient(vn, t), np.gradient(ve, t)
    theta = (ax - np.cos(psi) * an - np.sin(psi) * ae) / GRAVITY
    phi = (np.cos(psi) * ae - np.sin(psi) * an - ay) / GRAVITY
    true = {"vn": vn, "ve": ve, "vd": vd, "phi": phi, "theta": theta, "psi": psi, "az": -GRAVITY + 0.0 * t}
    sizes = {**dict.fromkeys(("vn", "ve", "vd"), 0.03), **dict.fromkeys(("phi", "theta", "psi"), 0.004), "az": 0.1}
    read = {c: x + sizes[c] * rng.standard_normal(len(t)) for c, x in true.items()}
    for c, x in (("ax", ax), ("ay", ay)):
        read[c] = x + 0.08 * rng.standard_normal(len(t)) + drift(rng, t, 0.5, 0.05)
    return t, read, dict(zip(("ax", "ay"), forces(read["vn"], read["ve"], read["psi"])))


def hover(rng: np.random.Generator, k: int, wind: tuple[float, float]) -> Run:
    """Velocities of a quadrotor, integrated in still air from the same start."""
    t, drag = 0.02 * np.arange(1500), 0.35
    theta, phi = motion(rng, t, 0.3, 0.1), motion(rng, t, 0.3, 0.1)

    def rate(i: int, v: Array, air: Array) -> Array:
        return GRAVITY * np.array([-np.tan(theta[i]), np.tan(phi[i])]) - drag * (v - air)

    true, stated = (integrated(partial(rate, air=np.array(air)), np.zeros(2), t) for air in (wind, (0.0, 0.0)))
    read = {"vn": true[:, 0], "ve": true[:, 1], "vd": 0.0 * t}
    read = {c: x + 0.03 * rng.standard_normal(len(t)) for c, x in read.items()}
    held = {"phi": phi, "theta": theta, "psi": 0.0 * t}
    read |= {c: x + 0.003 * rng.standard_normal(len(t)) for c, x in held.items()}
    return t, read, {"vn": stated[:, 0], "ve": stated[:, 1]}


def glider(rng: np.random.Generator, k: int, states: str, wind: tuple[float, float]) -> Run:
    """A small aircraft's log; simulated in still air is its ground velocity, or its airspeed."""
    t = 0.1 * np.arange(600)
    V = 18.0 + motion(rng, t, 0.1, 1.5)
    psi = 0.1 * np.cumsum(motion(rng, t, 0.05, 0.25) + 0.1 * (-1.0) ** k) + k
    theta = 0.05 + motion(rng, t, 0.15, 0.06)
    alpha = 0.05 + motion(rng, t, 0.2, 0.01)
    phi = np.arctan(V * np.gradient(psi, t) / GRAVITY)
    climb = theta - alpha * np.cos(phi)
    true = {
        "V": V + drift(rng, t, 1.0, 0.2), "phi": phi, "theta": theta, "psi": psi,
        "vn": V * np.cos(climb) * np.cos(psi) + wind[0] + drift(rng, t, 3.0, 0.25),
        "ve": V * np.cos(climb) * np.sin(psi) + wind[1] + drift(rng, t, 3.0, 0.25),
        "vd": -V * np.sin(climb), "ax": np.gradient(V, t) + GRAVITY * np.sin(theta), "ay": 0.0 * t,
        "az": -GRAVITY / np.cos(phi), "alpha": alpha,
    }  # fmt: skip
    sizes = {"V": 0.2, "psi": 0.01, "vn": 0.05, "ve": 0.05, "vd": 0.05, "ax": 0.2, "ay": 0.2, "az": 0.3}
    read = {c: x + sizes.get(c, 0.005) * rng.standard_normal(len(t)) for c, x in true.items()}
    if states != "velocity, with alpha":
        del read["alpha"]
    if states == "airspeed":
        return t, read, {"V": np.sqrt(read["vn"] ** 2 + read["ve"] ** 2 + read["vd"] ** 2)}
    along = read["V"] * np.cos(read["theta"])
    return t, read, {"vn": along * np.cos(read["psi"]), "ve": along * np.sin(read["psi"])}


def roll(rng: np.random.Generator, k: int, concealed: str) -> Run:
    """The roll acceleration of an aircraft by its ailerons, which bend or shake a mode of 5 Hz."""
    t = 0.02 * np.arange(1500)
    da = motion(rng, t, 3.0 if concealed == "mode" else 0.7, 0.12 + 0.03 * k)
    acts = da - 6.0 * da**3 if concealed == "bend" else da
    p = integrated(lambda i, x: -4.0 * x + 30.0 * acts[i], np.zeros(1), t)[:, 0]
    swing = 6.0 * oscillate(da, t[1], 5.0, 0.03)
    p_dot = -4.0 * p + 30.0 * acts + (swing if concealed == "mode" else 0.0)
    read = {"p": p + 0.004 * rng.standard_normal(len(t)), "da": da}
    read["phi"] = t[1] * np.cumsum(p) + 0.002 * rng.standard_normal(len(t))
    read["p_dot"] = p_dot + 0.15 * rng.standard_normal(len(t)) + drift(rng, t, 0.2, 0.08)
    return t, read, {"p_dot": -4.0 * read["p"] + 30.0 * da}


def pedal(rng: np.random.Generator, k: int) -> Run:
    """A yaw rate by a pedal with a dead zone."""
    t = 0.02 * np.arange(1500)
    moved = motion(rng, t, 0.4, 0.2 + 0.1 * k)
    true, stated = (2.7 * first_order_lag(x, t[1], 0.67) for x in (moved - np.clip(moved, -0.1, 0.1), moved))
    return t, {"pedal": moved, "r": true + 0.01 * rng.standard_normal(len(t))}, {"r": stated}


_UAV = ss.Aircraft.from_dict({"name": "glider", "mass": 3.0, "S": 0.5, "b": 2.0, "cbar": 0.25})
_WIND, _STILL = (6.0, -3.0), (0.0, 0.0)


def set_up(run: Callable[..., Run], *accept: str, aircraft: ss.Aircraft | None = None, **given: object) -> SetUp:
    return SetUp(frozenset(accept), partial(run, **given), aircraft)


SET_UPS: dict[str, SetUp] = {
    **{f"joint, {c}": set_up(joint, "friction", states=c) for c in ("current", "acc")},
    **{f"joint, {c}, without": set_up(joint, states=c, friction=0.0) for c in ("current", "acc")},
    **{f"slide, {c}": set_up(slide, "friction", states=c) for c in ("speed", "speed beside place", "place", "force")},
    **{f"slide, {c}, without": set_up(slide, states=c, friction=0.0) for c in ("speed", "place", "force")},
    "servo, play": set_up(servo, "backlash", backlash=0.03),
    "servo, rate": set_up(servo, "actuator-rate-limit", rate=0.4),
    "servo, without": set_up(servo),
    "heater, limit": set_up(heater, "saturation", most=0.7),
    "heater, delay": set_up(heater, "actuator-lag", "sensor-delay", late=8.0),
    "heater, without": set_up(heater),
    "tank, orifice": set_up(tank, "missing-term", "stiffening", "unknown", orifice=True),
    "tank, without": set_up(tank, orifice=False),
    "pendulum": set_up(pendulum, "stiffening"),
    "ship": set_up(ship, "missing-term"),
    "quadrotor, steady wind": set_up(quadrotor, "steady-wind", wind="steady"),
    "quadrotor, fan": set_up(quadrotor, "wind-shear", "gust", wind="fan"),
    "quadrotor, without": set_up(quadrotor, wind="none"),
    "hover, steady wind": set_up(hover, "steady-wind", wind=(3.0, -2.0)),
    "hover, without": set_up(hover, wind=_STILL),
    **{
        f"glider, {c}": set_up(glider, "steady-wind", aircraft=_UAV, states=c, wind=_WIND)
        for c in ("velocity", "velocity, with alpha", "airspeed")
    },
    "glider, without": set_up(glider, aircraft=_UAV, states="velocity", wind=_STILL),
    "roll, bend": set_up(roll, "control-nonlinearity", "missing-term", concealed="bend"),
    "roll, mode": set_up(roll, "structural-mode", concealed="mode"),
    "roll, without": set_up(roll, concealed="none"),
    "pedal": set_up(pedal, "control-nonlinearity", "backlash"),
}


def main(set_ups: Mapping[str, SetUp] = SET_UPS, about: str | None = __doc__) -> None:
    """Print a row for each set-up and seed, and how many are right."""
    parser = argparse.ArgumentParser(description=(about or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help="by default all")
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    right = total = 0
    print("| set-up | seed | verdict | probability | findings | right | s |\n|---|---|---|---|---|---|---|")
    for name in given.names or set_ups:
        one = set_ups[name]
        for seed in range(given.seeds):
            rng = np.random.default_rng(seed)
            runs = [one.run(rng, k) for k in range(RUNS)]
            recordings = [Recording(f"run {k}", t, read) for k, (t, read, _) in enumerate(runs)]
            simulated = {f"run {k}": Recording(f"run {k}", t, stated) for k, (t, _, stated) in enumerate(runs)}
            began = time.process_time()
            found = ss.diagnose(simulated, recordings, one.aircraft)
            taken = time.process_time() - began
            named = ["; ".join(f"{p.effect} {p.probability:.2f}" for p in f.physics[:2]) for f in found.findings]
            first = found.findings[0].physics[0].effect if found.findings else ""
            is_right = first in one.accept if one.accept else found.verdict == "consistent"
            right, total = right + is_right, total + 1
            row = (
                name,
                seed,
                found.verdict,
                f"{found.probability:.2f}",
                ", then ".join(named),
                is_right,
                f"{taken:.1f}",
            )
            print(f"| {' | '.join(map(str, row))} |", flush=True)
    print(f"\n{right} of {total} right")


if __name__ == "__main__":
    main()
