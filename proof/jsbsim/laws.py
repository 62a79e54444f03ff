"""Physics that JSBSim's aircraft have not, put into the truth step by step: coefficients with or without memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from structsel.aircraft import Aircraft

Now = Mapping[str, float]
Formula = Callable[[Now, dict[str, float], float], tuple[float, float, float, float, float, float]]
Make = Callable[[np.random.Generator, Aircraft, dict[int, float]], tuple[Formula, dict[str, float]]]


@dataclass(eq=False)
class AddedForce:
    """A formula of what the aircraft does, times a size; satisfies `flying.AddedEffect`.

    Attributes
    ----------
    formula : callable of (now, memory, dt) to six coefficients
    size : float
    memory : dict
        The formula's own, emptied when a manoeuvre begins.
    shape : bool
        The size is among what the formula remembers, instead of a factor.
    """

    formula: Formula
    size: float = 1.0
    memory: dict[str, float] = field(default_factory=dict)
    dt: float = 0.01
    shape: bool = False

    def start(self, now: Now, dt: float) -> None:
        """Begin a manoeuvre."""
        self.memory.clear()
        self.memory["size"] = self.size
        self.dt = dt

    def coefficients(self, now: Now) -> np.ndarray:
        """CX, CY, CZ, Cl, Cm, Cn."""
        made = np.array(self.formula(now, self.memory, self.dt))
        return made if self.shape else self.size * made


def _lag(memory: dict[str, float], name: str, value: float, dt: float, tau: float) -> float:
    """First-order lag of a value, started on it."""
    held = memory.get(name, value)
    held += (value - held) * (1.0 - math.exp(-dt / tau))
    memory[name] = held
    return held


def draw_nothing(rng: np.random.Generator) -> dict[str, float]:
    """No parameters."""
    return {}


def static(
    build: Callable[[Now, dict[str, float], Aircraft], tuple[float, ...]],
    draw: Callable[[np.random.Generator], dict[str, float]] = draw_nothing,
) -> Make:
    """Maker of a law without memory."""

    def make(
        rng: np.random.Generator, aircraft: Aircraft, events: dict[int, float]
    ) -> tuple[Formula, dict[str, float]]:
        given = draw(rng)
        return (lambda now, memory, dt: build(now, given, aircraft)), given  # type: ignore[return-value]

    return make


def _wind_axes(lift: float, drag: float, now: Now) -> tuple[float, float]:
    sa, ca = math.sin(now["alpha"]), math.cos(now["alpha"])
    return lift * sa - drag * ca, -lift * ca - drag * sa


def polar(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Induced drag."""
    CX, CZ = _wind_axes(0.0, 0.06 * now["CZ"] ** 2, now)
    return CX, 0, CZ, 0, 0, 0


def stall(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Lift lost, drag and nose-down moment above an incidence."""
    s = 0.5 * (1.0 + math.tanh(given["steepness"] * (now["alpha"] - given["alpha"])))
    s -= 0.5 * (1.0 + math.tanh(-given["steepness"] * given["alpha"]))
    CX, CZ = _wind_axes(-0.4 * s, 0.12 * s, now)
    return CX, 0, CZ, 0, -0.08 * s, 0


def hysteresis(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Separation with a memory, after Goman and Khrabrov."""
    given = {"a1": rng.uniform(20, 35), "alpha": rng.uniform(0.16, 0.21), "tau1": rng.uniform(8.0, 20.0),
             "tau2": rng.uniform(3.0, 8.0)}  # fmt: skip

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        chord = a.cbar / now["V"]
        want = 0.5 * (
            1.0 - math.tanh(given["a1"] * (now["alpha"] - given["tau2"] * chord * now["alpha_dot"] - given["alpha"]))
        )
        X = _lag(memory, "X", want, dt, given["tau1"] * chord)
        loss = 5.0 * now["alpha"] * (1.0 - (0.5 * (1.0 + math.sqrt(max(X, 0.0)))) ** 2)
        CX, CZ = _wind_axes(-loss, 0.1 * (1.0 - X), now)
        return CX, 0.0, CZ, 0.0, -0.08 * (1.0 - X), 0.0

    return formula, {"tau1 in chords": given["tau1"], "tau2 in chords": given["tau2"], "alpha*": given["alpha"],
                     "a1": given["a1"]}  # fmt: skip


def ground(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Lift, drag and moment that fade with height."""
    g = math.exp(-given["rate"] * max(now["h"], 0.0) / a.b)
    CL = -now["CZ"]
    CX, CZ = _wind_axes(0.2 * CL * g, -0.025 * CL * CL * g, now)
    return CX, 0, CZ, 0, -0.05 * CL * g, 0


def mach(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Growth of slopes, drag rise and shift of the aerodynamic centre with Mach."""
    g = 1.0 / math.sqrt(max(1.0 - now["mach"] ** 2, 0.1)) - 1.0
    rise = 20.0 * max(now["mach"] - 0.6, 0.0) ** 3
    CX, CZ = _wind_axes(4.0 * now["alpha"] * g, rise, now)
    return CX, 0, CZ, 0, -0.4 * now["alpha"] * g, 0


def reynolds(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Drag that falls with the Reynolds number."""
    return 0.02 * math.log(now["rho"] * now["V"] / 60.0), 0, 0, 0, 0, 0


def flexible(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Derivatives that fall with dynamic pressure."""
    soft = 0.3 * now["qbar"] / 5000.0
    return 0, soft * 0.3 * now["beta"], soft * 5.0 * now["alpha"], soft * 0.05 * now["beta"], \
        soft * (0.5 * now["alpha"] + 0.8 * now.get("de", 0.0)), 0  # fmt: skip


def stretch(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """An elevator that gives way with dynamic pressure."""
    soft = now["qbar"] / 5000.0
    return 0, 0, 0.2 * soft * now["de"], 0, 0.8 * soft * now["de"], 0


def gyro(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Rotors that resist pitch and yaw."""
    H = given["sense"] * 0.05 * float(a.mass or 0.0)  # kg m2/s
    qS = now["qbar"] * a.S
    return 0, 0, 0, 0, -H * now["r"] / (qS * a.cbar), H * now["q"] / (qS * a.b)


def normal_force(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """A propeller's side force, normal force and asymmetric disc."""
    Tc = now["thrust"] / (now["qbar"] * a.S)
    s = given["sense"]
    return 0, -Tc * now["beta"], -2.0 * Tc * now["alpha"], 0, 1.5 * Tc * now["alpha"], s * 1.0 * Tc * now["alpha"]


def slipstream(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """Wash over wing and tail."""
    Tc = now["thrust"] / (now["qbar"] * a.S)
    return 0, 0, -Tc * (0.5 * now["alpha"] + 0.1), 0, Tc * (0.15 - 1.5 * now["de"]), Tc * (0.01 - 0.08 * now["dr"])


def thrust_force(now: Now, factor: float, a: Aircraft) -> tuple[float, ...]:
    """Force and moment of more thrust along the declared line."""
    line, Tc = a.thrust, factor / (now["qbar"] * a.S)
    d, arm = line.direction, line.arm
    return Tc * d[0], 0.0, Tc * d[2], 0.0, Tc * arm[1] / a.cbar, 0.0


def thrust_lag(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Thrust that follows late by the size [s]."""

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        late = _lag(memory, "T", now["thrust"], dt, memory["size"])
        return thrust_force(now, late - now["thrust"], a)  # type: ignore[return-value]

    return formula, {}


def wake(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Downwash that reaches the tail late."""
    chords = rng.uniform(2.5, 4.0)

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        late = now["alpha"] - _lag(memory, "a", now["alpha"], dt, chords * a.cbar / now["V"])
        return 0.0, 0.0, -0.5 * late, 0.0, -1.3 * late, 0.0

    return formula, {"delay in chords": chords}


def fin_wake(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Sidewash that reaches the fin late."""

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        late = now["beta"] - _lag(memory, "b", now["beta"], dt, 0.5 * a.b / now["V"])
        return 0.0, 0.25 * late, 0.0, 0.0, 0.0, -0.25 * late

    return formula, {}


def wagner(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Lift that builds up over chords."""

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        rate, alpha = 2.0 * now["V"] / a.cbar, now["alpha"]
        slow = _lag(memory, "1", alpha, dt, 1.0 / (0.0455 * rate))
        fast = _lag(memory, "2", alpha, dt, 1.0 / (0.3 * rate))
        missing = 5.0 * (0.165 * (alpha - slow) + 0.335 * (alpha - fast))
        return 0.0, 0.0, missing, 0.0, 0.1 * missing, 0.0

    return formula, {}


def event(build: Callable[[Now, float, Aircraft, dict[str, float]], tuple[float, ...]], length: tuple[float, float]):  # type: ignore[no-untyped-def]
    """Something that comes over at an instant, in some manoeuvres."""

    def make(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
        takes, given = (
            float(rng.uniform(*length)),
            {"lift": rng.uniform(0.5, 1.5), "side": float(rng.choice([-1.0, 1.0]))},
        )

        def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
            at = events.get(int(now["number"]))
            share = 0.0 if at is None else min(1.0, max(0.0, (now["t"] - at) / takes))
            return build(now, share, a, given)  # type: ignore[return-value]

        return formula, {"takes": takes}

    return make


def icing(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Drag and lost lift that grow from manoeuvre to manoeuvre."""
    first = int(rng.integers(1, 5))

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        ice = min(1.0, max(0.0, (now["number"] - first + now["t"] / 30.0) / (9.0 - first)))
        CX, CZ = _wind_axes(-1.0 * ice * now["alpha"], 0.03 * ice, now)
        return CX, 0.0, CZ, 0.0, 0.1 * ice * now["de"], 0.0

    return formula, {"starts in manoeuvre": float(first)}


def mode(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """A bending mode that rings."""
    w, zeta = 2 * math.pi * rng.uniform(2.2, 4.5), rng.uniform(0.02, 0.06)

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        e, v = memory.get("e", 0.0), memory.get("v", 0.0)
        de = now["de"] - memory.setdefault("de", now["de"])
        v += dt * (w * w * (0.5 * (now["alpha"] - memory.setdefault("a", now["alpha"])) + de - e) - 2 * zeta * w * v)
        e += dt * v
        memory["e"], memory["v"] = e, v
        ring = v / w  # what leaves with the quasi-static part taken away
        return 0.0, 0.0, -0.5 * ring, 0.0, -0.2 * ring, 0.0

    return formula, {"frequency in Hz": w / (2 * math.pi), "damping": zeta}


def slosh(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, dict[str, float]]:
    """Fuel that swings sideways."""
    w, zeta = 2 * math.pi * rng.uniform(0.4, 0.9), rng.uniform(0.03, 0.08)

    def formula(now: Now, memory: dict[str, float], dt: float) -> tuple[float, float, float, float, float, float]:
        y, v = memory.get("y", 0.0), memory.get("v", 0.0)
        v += dt * (-w * w * y - 2 * zeta * w * v - now["ay"] / 9.81 * w * w)
        y += dt * v
        memory["y"], memory["v"] = y, v
        swing = y * float(a.mass or 0.0) * 9.81 / (now["qbar"] * a.S)
        return 0.0, 0.15 * swing, 0.0, 0.02 * swing, 0.0, 0.0

    return formula, {"frequency in Hz": w / (2 * math.pi)}


def centre(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
    """A centre of gravity elsewhere."""
    return 0, 0, 0, 0, 0.05 * now["CZ"], -0.05 * now["CY"] * a.cbar / a.b


def dropped(now: Now, share: float, a: Aircraft, given: dict[str, float]) -> tuple[float, ...]:
    """A store gone: drag, and moments."""
    gone = 1.0 if share > 0.0 else 0.0
    return 0.01 * gone, 0.0, 0.0, 0.01 * given["side"] * gone, 0.012 * gone, 0.002 * gone


def moved(now: Now, share: float, a: Aircraft, given: dict[str, float]) -> tuple[float, ...]:
    """An unrecorded flap: lift, drag, moment."""
    CX, CZ = _wind_axes(0.1 * share * given["lift"], 0.03 * share, now)
    return CX, 0.0, CZ, 0.0, -0.02 * share * given["lift"], 0.0


def draw_sense(rng: np.random.Generator) -> dict[str, float]:
    """Either sign."""
    return {"sense": float(rng.choice([-1.0, 1.0]))}


def draw_stall(rng: np.random.Generator) -> dict[str, float]:
    """Where it stalls, and how sharply."""
    return {"alpha": rng.uniform(0.16, 0.21), "steepness": rng.uniform(18.0, 35.0)}


def one_term(k: int, term: Callable[[Now, Aircraft], float]):  # type: ignore[no-untyped-def]
    """One term in one coefficient, CX first."""

    def build(now: Now, given: dict[str, float], a: Aircraft) -> tuple[float, ...]:
        made = [0.0] * 6
        made[k] = given["sense"] * term(now, a)
        return tuple(made)

    return static(build, draw_sense)
