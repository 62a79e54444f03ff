"""Faults of sensors, actuators and stated constants of a JSBSim aircraft.

The actuators here (lag, rate limit, stop, backlash) are written for the proof and independent of structsel's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.jsbsim.flight import TruthFlight
from proof.keys import Kind
from proof.scenario.instruments import SOUND, InstrumentErrors

Follower = Callable[[float, float, Mapping[str, float]], float]


@dataclass(frozen=True, eq=False)
class Fault:
    """A fault of some size.

    Attributes
    ----------
    errors : InstrumentErrors
        Of what is recorded.
    mass, inertia : mapping
        Factors of the stated ones: ``mass``, ``Ix``, ``Iy``, ``Iz``.
    actuator : (surface, maker of a follower), optional
    key_parameters : mapping
        For the key.
    """

    errors: InstrumentErrors = SOUND
    mass: float = 1.0
    inertia: Mapping[str, float] = field(default_factory=dict)
    actuator: tuple[str, Callable[[], Follower]] | None = None
    key_parameters: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class FaultSpec:
    """A fault as it may be drawn: `make` of (rng) gives a fault for each size, in (low, high)."""

    make: Callable[[np.random.Generator], Callable[[float], Fault]]
    kind: Kind
    low: float
    high: float
    needs: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _bias(rng: np.random.Generator) -> Callable[[float], Fault]:
    channel, s = str(rng.choice(["alpha", "beta", "alpha", "de", "az"])), _sign(rng)
    unit = {"az": 30.0}.get(channel, 1.0)
    return lambda x: Fault(
        InstrumentErrors(bias={channel: s * x * unit}), key_parameters={"channel": channel, "bias": s * x * unit}
    )


def _scale(rng: np.random.Generator) -> Callable[[float], Fault]:
    channel, s = str(rng.choice(["alpha", "alpha", "beta", "az", "de", "q"])), _sign(rng)
    return lambda x: Fault(
        InstrumentErrors(scale={channel: s * x}), key_parameters={"channel": channel, "scale": 1.0 + s * x}
    )


def _delay(rng: np.random.Generator) -> Callable[[float], Fault]:
    channel = str(rng.choice(["alpha", "beta", "q", "p", "alpha"]))
    return lambda x: Fault(InstrumentErrors(delay={channel: x}), key_parameters={"channel": channel, "delay": x})


def _place(rng: np.random.Generator) -> Callable[[float], Fault]:
    sensor, s = str(rng.choice(["accelerometer", "vane"])), _sign(rng)
    axis = int(rng.choice([0, 2])) if sensor == "accelerometer" else 0
    names = "xyz"
    return lambda x: Fault(
        InstrumentErrors(place={sensor: np.eye(3)[axis] * s * x}),
        key_parameters={"sensor": sensor, f"d{names[axis]}": s * x},
    )


def _misaligned(rng: np.random.Generator) -> Callable[[float], Fault]:
    one, other = [("ax", "az"), ("r", "p"), ("ay", "az"), ("alpha", "beta")][int(rng.choice([0, 0, 1, 2]))]
    s = _sign(rng)
    return lambda x: Fault(
        InstrumentErrors(mix=((one, other, s * x),)), key_parameters={"channels": f"{one}, {other}", "angle": s * x}
    )


def _static_pressure_error(rng: np.random.Generator) -> Callable[[float], Fault]:
    s = _sign(rng)
    return lambda x: Fault(InstrumentErrors(scale={"V": s * x}), key_parameters={"scale of V": 1.0 + s * x})


def _mass(rng: np.random.Generator) -> Callable[[float], Fault]:
    s = _sign(rng)
    return lambda x: Fault(mass=1.0 + s * x, key_parameters={"stated over true": 1.0 + s * x})


def _inertia(rng: np.random.Generator) -> Callable[[float], Fault]:
    which, s = str(rng.choice(["Ix", "Iy", "Iz"])), _sign(rng)
    # A stated tensor must stay one of a body: heavier in yaw, lighter in the others, is always possible to half.
    return lambda x: Fault(
        inertia={which: 1.0 + s * x}, key_parameters={"moment": which, "stated over true": 1.0 + s * x}
    )


def _surface(rng: np.random.Generator) -> str:
    return str(rng.choice(["de", "de", "da", "dr"]))


def _actuator(
    step: Callable[[float, float, float, float], float], key: str, stated: Callable[[float], float] = float
) -> Callable[[np.random.Generator], Callable[[float], Fault]]:
    """A drawn surface whose position is `step` of (last position, command, dt, size), and begins at the command."""

    def draw(rng: np.random.Generator) -> Callable[[float], Fault]:
        surface = _surface(rng)

        def at(size: float) -> Fault:
            def make() -> Follower:
                held: dict[str, float] = {}

                def follow(command: float, dt: float, now: Mapping[str, float]) -> float:
                    held["x"] = step(held.get("x", command), command, dt, size)
                    return held["x"]

                return follow

            return Fault(actuator=(surface, make), key_parameters={"surface": surface, key: stated(size)})

        return at

    return draw


def _lagged(x: float, command: float, dt: float, tau: float) -> float:
    return x + (command - x) * (1.0 - math.exp(-dt / tau))


def _rate(size: float) -> float:
    return 1.0 / size


def _limited(x: float, command: float, dt: float, size: float) -> float:
    return x + max(-_rate(size) * dt, min(_rate(size) * dt, command - x))


def _backlash(x: float, command: float, dt: float, width: float) -> float:
    return max(command - 0.5 * width, min(command + 0.5 * width, x))


def _stopped(rng: np.random.Generator) -> Callable[[float], Fault]:
    surface = _surface(rng)
    s = _sign(rng)

    def make(depth: float) -> Follower:
        # Beyond the position at rest by what leaves 1 / depth of the travel.
        held: dict[str, float] = {}

        def follow(command: float, dt: float, now: Mapping[str, float]) -> float:
            rest = held.setdefault("rest", command)
            stop = s * 0.03 / depth
            return min(command, rest + stop) if s > 0 else max(command, rest + stop)

        return follow

    return lambda x: Fault(
        actuator=(surface, lambda: make(x)), key_parameters={"surface": surface, "stop from trim": s * 0.03 / x}
    )


def _stability_augmentation(rng: np.random.Generator) -> Callable[[float], Fault]:
    surface, rate = [("de", "q"), ("dr", "r"), ("da", "p")][int(rng.integers(3))]

    def make(gain: float) -> Follower:
        return lambda command, dt, now: command + gain * now[rate]

    return lambda x: Fault(
        actuator=(surface, lambda: make(x)), key_parameters={"surface": surface, "gain": x, "rate": rate}
    )


FAULTS: dict[str, FaultSpec] = {
    "sensor-bias": FaultSpec(_bias, "sensor", 0.008, 0.08, tie=("steady-wind", "asymmetry", "sensor-scale")),
    "sensor-scale": FaultSpec(_scale, "sensor", 0.02, 0.4, ("pitch", "lateral"), ("wrong-derivative", "sensor-bias")),
    "sensor-delay": FaultSpec(_delay, "sensor", 0.02, 0.35, ("pitch", "lateral"), ("unsteady-lift", "actuator-lag")),
    "sensor-position": FaultSpec(_place, "sensor", 0.25, 12.0, ("pitch", "lateral", "multisine"), ("sensor-delay",)),
    "sensor-misalignment": FaultSpec(
        _misaligned, "sensor", 0.008, 0.12, ("pitch", "pull-up"), ("sensor-bias", "drag-polar")
    ),
    "position-error": FaultSpec(_static_pressure_error, "sensor", 0.01, 0.12, ("speed",), ("mass-error",)),
    "mass-error": FaultSpec(_mass, "inertial", 0.012, 0.25, ("pull-up", "pitch"), ("position-error",)),
    "inertia-error": FaultSpec(
        _inertia, "inertial", 0.04, 0.3, ("pitch", "lateral"), ("wrong-derivative", "sensor-scale")
    ),
    "actuator-lag": FaultSpec(
        _actuator(_lagged, "tau"), "actuator", 0.03, 0.35, ("pitch", "lateral"), ("sensor-delay",)
    ),
    "actuator-rate-limit": FaultSpec(
        _actuator(_limited, "rate", _rate), "actuator", 1.0, 60.0, ("pitch", "lateral"), ("actuator-lag",)
    ),
    "actuator-saturation": FaultSpec(_stopped, "actuator", 0.15, 5.0, ("pitch", "lateral"), ("control-nonlinearity",)),
    "backlash": FaultSpec(
        _actuator(_backlash, "width"), "actuator", 0.002, 0.06, ("pitch", "lateral", "multisine"), ("actuator-lag",)
    ),
    "augmentation": FaultSpec(
        _stability_augmentation, "actuator", 0.01, 1.0, ("pitch", "lateral"), ("wrong-derivative",)
    ),
}


def joined(faults: Sequence[Fault]) -> Fault:
    """All faults at once, their actuators apart."""
    made = Fault()
    for f in faults:
        made = Fault(made.errors.joined(f.errors), made.mass * f.mass, {**made.inertia, **f.inertia})
    return made


def follow_along(flight: TruthFlight, surface: str, make: Callable[[], Follower]) -> np.ndarray:
    """Where the surface would have been along a flight without the fault (n,) [rad]."""
    follow, dt = make(), float(flight.t[1] - flight.t[0])
    fine = 4
    command = np.interp(np.arange(len(flight.t) * fine) / fine, np.arange(len(flight.t)), flight[surface])
    rates = {c: flight[c].tolist() for c in "pqr"}
    made = [follow(x, dt / fine, {c: v[i // fine] for c, v in rates.items()}) for i, x in enumerate(command.tolist())]
    return np.array(made[::fine])
