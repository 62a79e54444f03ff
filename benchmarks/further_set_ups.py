"""Set-ups that were made when the method was finished: their simulations state what inputs alone cause.

    python benchmarks/further_set_ups.py [--seeds 3] [NAMES]

As `set_ups.py`, with an effect concealed or none, and with changes of gain, mass or level that have no name in a plant:
"unknown" is then right.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.signal
from set_ups import GRAVITY, Run, SetUp, drift, integrated, main, motion, set_up

from structsel.effects.operators import oscillate
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import actuate, delayed, first_order_lag

_FINE = 4  # steps of the integration in a sampling interval


def followed(rate: Callable[[Array, float], Array], start: Array, t: Array, u: Array) -> Array:
    """(n, k) states of a plant with input u, by Euler's method in steps that are finer than the clock."""
    fine = np.linspace(t[0], t[-1], _FINE * (len(t) - 1) + 1)
    inputs = np.interp(fine, t, u)
    return integrated(lambda i, x: rate(x, inputs[i]), start, fine)[::_FINE]


def motor(rng: np.random.Generator, k: int, dead: float = 0.0, friction: float = 0.0) -> Run:
    """Speed of a motor by its voltage, with a dead zone or dry friction."""
    t = 0.005 * np.arange(2400)
    voltage = motion(rng, t, 1.0, 3.0 + k) + 2.0 * np.sign(np.sin(1.3 * t + k))
    acts = voltage - np.clip(voltage, -dead, dead)

    def rate(x: Array, u: float, dry: float) -> Array:
        return (8.0 * u - x - dry * np.tanh(x / 0.5)) / 0.15

    true = followed(lambda x, u: rate(x, u, friction), np.zeros(1), t, acts)[:, 0]
    stated = followed(lambda x, u: rate(x, u, 0.0), np.zeros(1), t, voltage)[:, 0]
    return t, {"voltage": voltage, "speed": true + 0.15 * rng.standard_normal(len(t))}, {"speed": stated}


def gear(rng: np.random.Generator, k: int, play: float) -> Run:
    """Angle of a load by that of its motor, both read by encoders."""
    t = 0.01 * np.arange(1500)
    angle = motion(rng, t, 0.6, 0.4) + 0.3 * np.sin(0.7 * t + k)
    load = actuate(t, angle, backlash=2.0 * play) if play else angle
    read = {"motor": angle + 2e-4 * rng.standard_normal(len(t)), "load": load + 5e-4 * rng.standard_normal(len(t))}
    return t, read, {"load": angle}


def boat(rng: np.random.Generator, k: int, square: bool) -> Run:
    """Acceleration of a boat by its thrust and its speed; its drag is linear in the simulation."""
    t = 0.1 * np.arange(1200)
    thrust = first_order_lag(np.repeat(rng.uniform(20.0, 150.0, 12), 100), 0.1, 1.0)

    def acceleration(u: Array, push: Array | float) -> Array:
        return (push - (12.0 * u + 22.0 * u * np.abs(u) if square else 55.0 * u)) / 180.0

    u = followed(acceleration, np.ones(1), t, thrust)[:, 0]
    read = {"thrust": thrust, "u": u + 0.02 * rng.standard_normal(len(t))}
    read["u_dot"] = acceleration(u, thrust) + 0.02 * rng.standard_normal(len(t)) + drift(rng, t, 1.0, 0.01)
    return t, read, {"u_dot": (thrust - 55.0 * read["u"]) / 180.0}


def arm(rng: np.random.Generator, k: int, weight: float) -> Run:
    """Current of an arm by its motion, without its weight."""
    t = 0.004 * np.arange(2500)
    angle = motion(rng, t, 0.8, 0.7) + 0.5 * np.sin(0.5 * t + k)
    rate = np.gradient(angle, t)
    acc = np.gradient(rate, t)
    current = 0.015 * acc + 0.05 * rate + weight * np.sin(angle) + drift(rng, t, 0.2, 0.003)
    true = {"angle": (angle, 2e-4), "rate": (rate, 0.01), "acc": (acc, 0.1), "current": (current, 0.004)}
    read = {c: x + sd * rng.standard_normal(len(t)) for c, (x, sd) in true.items()}
    return t, read, {"current": 0.015 * read["acc"] + 0.05 * read["rate"]}


def beam(rng: np.random.Generator, k: int, law: str, acceleration: bool = False) -> Run:
    """Place, or acceleration, of a structure with a mode of 40 Hz, at 1 kHz."""
    t = 0.001 * np.arange(8000)
    force, w = motion(rng, t, 90.0, 4.0 * (1 + k)), 2.0 * np.pi * 40.0
    laws: dict[str, Callable[[Array], Array]] = {
        "none": lambda x: 0.0 * x[0],
        "cube": lambda x: 2.5e11 * x[0] ** 3,
        "gap": lambda x: 2e4 * (x[0] - np.clip(x[0], -2e-4, 2e-4)),
        "dry": lambda x: 1.2 * np.tanh(x[1] / 0.004),
    }

    def swung(law: str) -> tuple[Array, Array]:
        def acc(x: Array, u: Array | float) -> Array:
            return np.asarray(u - w**2 * x[0] - 0.02 * w * x[1] - laws[law](x))

        fine = np.linspace(t[0], t[-1], 16 * (len(t) - 1) + 1)
        x, u, dt = np.zeros((2, len(fine))), np.interp(fine, t, force), fine[1]
        for i in range(len(fine) - 1):  # the place by the new speed: no energy is gained
            x[1, i + 1] = x[1, i] + dt * acc(x[:, i], u[i])
            x[0, i + 1] = x[0, i] + dt * x[1, i + 1]
        return x[0, ::16], acc(x[:, ::16], force)

    (place, moved), (stated, stated_acc) = swung(law), swung("none")
    if acceleration:
        return t, {"force": force, "acc": moved + 0.1 * rng.standard_normal(len(t))}, {"acc": stated_acc}
    return t, {"force": force, "y": place + 2e-6 * rng.standard_normal(len(t))}, {"y": stated}


def car(rng: np.random.Generator, k: int, saturates: bool) -> Run:
    """Yaw rate and lateral acceleration of a car whose tyres saturate."""
    t = 0.01 * np.arange(2000)
    steer = np.clip(motion(rng, t, 0.5, 0.02 + 0.012 * k), -0.12, 0.12)

    def forces(x: Array, d: Array | float, bends: bool) -> tuple[Array, Array]:
        slips = d - (x[0] + 1.4 * x[1]) / 25.0, -(x[0] - 1.4 * x[1]) / 25.0
        front, rear = (5200.0 * np.tanh(9e4 * s / 5200.0) if bends else 9e4 * s for s in slips)
        return front, rear

    def driven(bends: bool) -> tuple[Array, Array]:
        def rate(x: Array, d: float) -> Array:
            front, rear = forces(x, d, bends)
            return np.array([(front + rear) / 1500.0 - 25.0 * x[1], 1.4 * (front - rear) / 2500.0])

        x = followed(rate, np.zeros(2), t, steer).T
        return x[1], sum(forces(x, steer, bends)) / 1500.0

    (r, a), (stated_r, stated_a) = driven(saturates), driven(False)
    read = {"steer": steer, "yaw_rate": r + 0.004 * rng.standard_normal(len(t))}
    read["a_lat"] = a + 0.1 * rng.standard_normal(len(t))
    return t, read, {"yaw_rate": stated_r, "a_lat": stated_a}


def multicopter(rng: np.random.Generator, k: int, drop: float = 0.0, parcel: float = 0.0) -> Run:
    """Vertical specific force by the throttle, while the battery drains, or a parcel is dropped at 15 s of run 2."""
    t = 0.02 * np.arange(1500)
    throttle, since = 0.5 + motion(rng, t, 0.6, 0.06), t + 30.0 * k
    acts = throttle * (1.0 - drop * since / 120.0) / np.where(since > 75.0, 1.0 - parcel, 1.0)
    az = -2.0 * GRAVITY * acts + 0.2 * rng.standard_normal(len(t))
    return t, {"throttle": throttle, "az": az}, {"az": -2.0 * GRAVITY * throttle}


def roller(rng: np.random.Generator, k: int, lag: float) -> Run:
    """Roll acceleration of a multicopter by its mixer, behind motors that lag."""
    t = 0.01 * np.arange(1500)
    mix = motion(rng, t, 3.0, 0.05 + 0.02 * k)
    acts = first_order_lag(mix, 0.01, lag) if lag else mix
    p = integrated(lambda i, x: 120.0 * acts[i] - 1.5 * x, np.zeros(1), t)[:, 0]
    p_dot = 120.0 * acts - 1.5 * p + 0.4 * rng.standard_normal(len(t)) + drift(rng, t, 0.1, 0.15)
    read = {"mix": mix, "p": p + 0.02 * rng.standard_normal(len(t)), "p_dot": p_dot}
    return t, read, {"p_dot": 120.0 * mix - 1.5 * read["p"]}


def oven(rng: np.random.Generator, k: int, bends: bool) -> Run:
    """Temperature by power, a sample each minute; the loss of heat grows with temperature."""
    t = 60.0 * np.arange(900)
    power = np.repeat(rng.uniform(0.0, 2.0, 30), 30)

    def warmed(loss: Callable[[Array], Array]) -> Array:
        return followed(lambda x, u: (100.0 * u - loss(x)) / 3600.0, np.zeros(1), t, power)[:, 0]

    stated = warmed(lambda x: 1.075 * x - 19.7 if bends else x)
    true = warmed(lambda x: 0.55 * x + 0.0035 * x * np.abs(x)) if bends else stated
    return (
        t,
        {"power": power, "T": true + 0.15 * rng.standard_normal(len(t)) + drift(rng, t, 1200.0, 0.1)},
        {"T": stated},
    )


def cylinder(rng: np.random.Generator, k: int, rate: float = np.inf, stop: float = np.inf) -> Run:
    """Place of a hydraulic cylinder by its command, of limited rate or stroke."""
    t = 0.01 * np.arange(1500)
    command = 0.25 * np.sign(np.sin(0.8 * t + k)) * (0.4 + 0.3 * k) + motion(rng, t, 1.0, 0.05)
    place = followed(lambda x, u: np.clip(20.0 * (u - x), -rate, rate), np.zeros(1), t, command)[:, 0]
    stated = followed(lambda x, u: 20.0 * (u - x), np.zeros(1), t, command)[:, 0]
    return (
        t,
        {"command": command, "place": np.clip(place, -stop, stop) + 8e-4 * rng.standard_normal(len(t))},
        {"place": stated},
    )


def elastic(rng: np.random.Generator, k: int, swing: float) -> Run:
    """Acceleration of a motor by its torque, with a load that swings at 7 Hz."""
    t = 0.004 * np.arange(3000)
    torque = motion(rng, t, 15.0, 1.0)
    acc = 20.0 * torque + swing * oscillate(torque, 0.004, 7.0, 0.04)
    return t, {"torque": torque, "acc": acc + rng.standard_normal(len(t))}, {"acc": 20.0 * torque}


def vehicle(rng: np.random.Generator, k: int, late: float) -> Run:
    """Speed by throttle, reported late."""
    t = 0.02 * np.arange(1500)
    throttle = motion(rng, t, 0.8, 1.0)
    stated = first_order_lag(3.0 * throttle, 0.02, 0.5)
    speed = delayed(stated, 0.02, late) if late else stated
    return t, {"throttle": throttle, "speed": speed + 0.05 * rng.standard_normal(len(t))}, {"speed": stated}


def rocket(rng: np.random.Generator, k: int, burnt: float) -> Run:
    """Axial specific force by throttle and speed; a third of the mass is burnt."""
    t = 0.02 * np.arange(1500)
    throttle, V = 1.0 + motion(rng, t, 0.5, 0.12), 20.0 + motion(rng, t, 0.1, 2.0)
    stated = 15.0 * throttle - 0.004 * V**2
    read = {"throttle": throttle, "V": V + 0.2 * rng.standard_normal(len(t))}
    read["ax"] = stated / (1.0 - burnt * t / t[-1]) + 0.15 * rng.standard_normal(len(t))
    return t, read, {"ax": stated}


def parafoil(rng: np.random.Generator, k: int, wind: tuple[float, float]) -> Run:
    """Ground velocity by airspeed and heading, simulated in still air."""
    t = 0.2 * np.arange(900)
    V = 9.0 + motion(rng, t, 0.05, 0.4)
    psi = 0.2 * np.cumsum(motion(rng, t, 0.04, 0.15) + 0.05 * (-1.0) ** k)
    read = {"V": V + 0.15 * rng.standard_normal(len(t)), "psi": psi + 0.02 * rng.standard_normal(len(t))}
    for c, along, air in (("vn", np.cos(psi), wind[0]), ("ve", np.sin(psi), wind[1])):
        read[c] = V * along + air + drift(rng, t, 4.0, 0.2) + 0.05 * rng.standard_normal(len(t))
    return t, read, {"vn": read["V"] * np.cos(read["psi"]), "ve": read["V"] * np.sin(read["psi"])}


def valve(rng: np.random.Generator, k: int, sticks: float) -> Run:
    """Flow by the command of a valve that moves once the command is off by some amount."""
    t = 0.5 * np.arange(2000)
    command = np.repeat(rng.uniform(0.2, 0.8, 50), 40) + motion(rng, t, 0.05, 0.03)
    place = command.copy()
    for i in range(1, len(t)):
        if abs(command[i] - place[i - 1]) <= sticks:
            place[i] = place[i - 1]
    true, stated = (first_order_lag(2.0 * x, 0.5, 4.0) for x in (place, command))
    return t, {"command": command, "flow": true + 0.01 * rng.standard_normal(len(t))}, {"flow": stated}


def amplifier(rng: np.random.Generator, k: int, limit: float) -> Run:
    """Output of a filter that clips, at 10 kHz."""
    t = 1e-4 * np.arange(10000)
    u = motion(rng, t, 300.0, 0.5 + 0.3 * k)
    b, a = scipy.signal.butter(2, 0.08)
    stated = scipy.signal.lfilter(2.0 * b, a, u)
    return t, {"u": u, "y": np.clip(stated, -limit, limit) + 0.004 * rng.standard_normal(len(t))}, {"y": stated}


def hitch(rng: np.random.Generator, k: int, swing: float) -> Run:
    """Force on the hitch of a tank trailer by its deceleration; the liquid swings at 0.6 Hz."""
    t = 0.02 * np.arange(2000)
    a = motion(rng, t, 1.2, 1.5)
    force = 5.0 * a + swing * oscillate(a, 0.02, 0.6, 0.03)
    return t, {"a": a, "force": force + 0.3 * rng.standard_normal(len(t))}, {"force": 5.0 * a}


SET_UPS: dict[str, SetUp] = {
    "motor, dead zone": set_up(motor, "control-nonlinearity", "friction", "backlash", dead=1.2),
    "motor, friction": set_up(motor, "friction", friction=4.0),
    "motor, without": set_up(motor),
    "gear, play": set_up(gear, "backlash", play=0.02),
    "gear, without": set_up(gear, play=0.0),
    "boat": set_up(boat, "missing-term", "stiffening", square=True),
    "boat, without": set_up(boat, square=False),
    "arm, weight": set_up(arm, "missing-term", "stiffening", "wrong-derivative", weight=0.08),
    "arm, without": set_up(arm, weight=0.0),
    "beam, cube": set_up(beam, "stiffening", law="cube"),
    "beam, gap": set_up(beam, "stiffening", "backlash", "unknown", law="gap"),
    "beam, friction": set_up(beam, "friction", law="dry"),
    "beam, without": set_up(beam, law="none"),
    "beam, acceleration, cube": set_up(beam, "stiffening", law="cube", acceleration=True),
    "beam, acceleration, without": set_up(beam, law="none", acceleration=True),
    "car": set_up(car, "saturation", "missing-term", "control-nonlinearity", "stiffening", saturates=True),
    "car, without": set_up(car, saturates=False),
    "multicopter, battery": set_up(multicopter, "thrust-scale", "unknown", drop=0.25),
    "multicopter, parcel": set_up(multicopter, "store-release", "mass-error", "unknown", parcel=0.2),
    "multicopter, without": set_up(multicopter),
    "roller": set_up(roller, "actuator-lag", lag=0.06),
    "roller, without": set_up(roller, lag=0.0),
    "oven": set_up(oven, "stiffening", "missing-term", "unknown", bends=True),
    "oven, without": set_up(oven, bends=False),
    "cylinder, rate": set_up(cylinder, "actuator-rate-limit", rate=0.5),
    "cylinder, stroke": set_up(cylinder, "saturation", "actuator-saturation", stop=0.2),
    "cylinder, without": set_up(cylinder),
    "elastic": set_up(elastic, "structural-mode", "slosh", swing=8.0),
    "elastic, without": set_up(elastic, swing=0.0),
    "vehicle, late": set_up(vehicle, "sensor-delay", "actuator-lag", late=0.08),
    "vehicle, without": set_up(vehicle, late=0.0),
    "rocket": set_up(rocket, "mass-error", "thrust-scale", "unknown", burnt=0.35),
    "rocket, without": set_up(rocket, burnt=0.0),
    "parafoil, wind": set_up(parafoil, "steady-wind", wind=(4.0, 2.0)),
    "parafoil, without": set_up(parafoil, wind=(0.0, 0.0)),
    "valve": set_up(valve, "friction", "backlash", sticks=0.06),
    "valve, without": set_up(valve, sticks=0.0),
    "amplifier": set_up(amplifier, "saturation", limit=2.2),
    "amplifier, without": set_up(amplifier, limit=np.inf),
    "hitch": set_up(hitch, "slosh", "structural-mode", swing=2.0),
    "hitch, without": set_up(hitch, swing=0.0),
}


if __name__ == "__main__":
    main(SET_UPS, __doc__)
