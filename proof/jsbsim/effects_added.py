"""Effects that JSBSim's aircraft do not have, each with its formula and the way it is drawn; sizes are of order one.

The formulas are from the literature and independent of structsel's effects: among them the separation point after
Goman and Khrabrov, the lag of the wake at the tail, and Wagner's function after Jones.
"""

from __future__ import annotations

import math

import numpy as np

from proof.jsbsim.added_force import (
    ADDED_FORCES,
    Formula,
    Given,
    Memory,
    Now,
    Six,
    Term,
    body_axes,
    either_sign,
    event,
    lagged,
    static,
    term,
    with_memory,
)
from structsel.aircraft import Aircraft

_STALLS, _SPEEDS, _POWER = ("stall",) * 3, ("speed",) * 3, ("throttle", "throttle", "throttle", "speed")

# --- drag, stall, ground ---------------------------------------------------------------------------------------------


@static("drag-polar", "static", ("pull-up", "speed"), ("missing-term",))
def _induced_drag(now: Now, given: Given, a: Aircraft) -> Six:
    CX, CZ = body_axes(0.0, 0.06 * now["CZ"] ** 2, now)
    return CX, 0, CZ, 0, 0, 0


def _draw_stall(rng: np.random.Generator) -> Given:
    return {"alpha": rng.uniform(0.16, 0.21), "steepness": rng.uniform(18.0, 35.0)}


@static("static-stall", "static", _STALLS, ("missing-term", "stall-hysteresis"), _draw_stall, region="alpha",
         local=True)  # fmt: skip
def _stall(now: Now, given: Given, a: Aircraft) -> Six:
    """Lift lost, drag and nose-down moment above an angle of attack."""
    s = 0.5 * (1.0 + math.tanh(given["steepness"] * (now["alpha"] - given["alpha"])))
    s -= 0.5 * (1.0 + math.tanh(-given["steepness"] * given["alpha"]))
    CX, CZ = body_axes(-0.4 * s, 0.12 * s, now)
    return CX, 0, CZ, 0, -0.08 * s, 0


@with_memory("stall-hysteresis", "memory", _STALLS, ("static-stall",), region="alpha", local=True)
def _separation(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Separation point X of Goman and Khrabrov: tau1 X' + X = X0(alpha - tau2 alpha')."""
    a1, onset = rng.uniform(20, 35), rng.uniform(0.16, 0.21)
    tau1, tau2 = rng.uniform(8.0, 20.0), rng.uniform(3.0, 8.0)  # chords

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        chord = a.cbar / now["V"]
        steady = 0.5 * (1.0 - math.tanh(a1 * (now["alpha"] - tau2 * chord * now["alpha_dot"] - onset)))
        X = lagged(memory, "X", steady, dt, tau1 * chord)
        loss = 5.0 * now["alpha"] * (1.0 - (0.5 * (1.0 + math.sqrt(max(X, 0.0)))) ** 2)
        CX, CZ = body_axes(-loss, 0.1 * (1.0 - X), now)
        return CX, 0.0, CZ, 0.0, -0.08 * (1.0 - X), 0.0

    return formula, {"tau1 in chords": tau1, "tau2 in chords": tau2, "alpha*": onset, "a1": a1}


@static("ground-effect", "static", ("low",) * 3, (), lambda rng: {"rate": rng.uniform(3.0, 5.0)}, region="h_agl",
         local=True)  # fmt: skip
def _ground(now: Now, given: Given, a: Aircraft) -> Six:
    """Lift, drag and moment that decay with height over span."""
    g = math.exp(-given["rate"] * max(now["h"], 0.0) / a.b)
    CL = -now["CZ"]
    CX, CZ = body_axes(0.2 * CL * g, -0.025 * CL * CL * g, now)
    return CX, 0, CZ, 0, -0.05 * CL * g, 0


# --- similarity, flexibility -----------------------------------------------------------------------------------------


@static("compressibility", "static", _SPEEDS, ("flexibility", "wrong-derivative"), power="jet", lift=(0.12, 0.5))
def _mach(now: Now, given: Given, a: Aircraft) -> Six:
    """Slopes after Prandtl and Glauert, drag rise, and shift of the aerodynamic centre."""
    g = 1.0 / math.sqrt(max(1.0 - now["mach"] ** 2, 0.1)) - 1.0
    rise = 20.0 * max(now["mach"] - 0.6, 0.0) ** 3
    CX, CZ = body_axes(4.0 * now["alpha"] * g, rise, now)
    return CX, 0, CZ, 0, -0.4 * now["alpha"] * g, 0


@static("reynolds", "static", _SPEEDS, ("compressibility", "wrong-derivative"))
def _reynolds(now: Now, given: Given, a: Aircraft) -> Six:
    """Drag that falls with the Reynolds number."""
    return 0.02 * math.log(now["rho"] * now["V"] / 60.0), 0, 0, 0, 0, 0


@static("flexibility", "structural", _SPEEDS, ("compressibility", "wrong-derivative"), lift=(0.15, 0.6))
def _flexible(now: Now, given: Given, a: Aircraft) -> Six:
    """Derivatives that fall with dynamic pressure."""
    soft = 0.3 * now["qbar"] / 5000.0
    alpha, beta = now["alpha"], now["beta"]
    moment = 0.5 * alpha + 0.8 * now.get("de", 0.0)
    return 0, soft * 0.3 * beta, soft * 5.0 * alpha, soft * 0.05 * beta, soft * moment, 0


@static("control-stretch", "structural", ("speed", "speed", "pitch", "pitch"),
         ("wrong-derivative", "flexibility", "compressibility"), lift=(0.15, 0.6))  # fmt: skip
def _control_stretch(now: Now, given: Given, a: Aircraft) -> Six:
    """Elevator whose effect falls with dynamic pressure."""
    soft = now["qbar"] / 5000.0
    return 0, 0, 0.2 * soft * now["de"], 0, 0.8 * soft * now["de"], 0


# --- events ----------------------------------------------------------------------------------------------------------


@event("configuration-change", "static", ("icing",), (0.5, 3.0))
def _moved(now: Now, fraction: float, given: Given) -> Six:
    """A flap that is not recorded: lift, drag, moment."""
    CX, CZ = body_axes(0.1 * fraction * given["lift"], 0.03 * fraction, now)
    return CX, 0.0, CZ, 0.0, -0.02 * fraction * given["lift"], 0.0


@with_memory("icing", "static", ("pitch", "pull-up"), ("configuration-change", "mass-error"))
def _icing(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Drag and lost lift that grow from manoeuvre to manoeuvre."""
    first = int(rng.integers(1, 5))

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        ice = min(1.0, max(0.0, (now["number"] - first + now["t"] / 30.0) / (9.0 - first)))
        CX, CZ = body_axes(-1.0 * ice * now["alpha"], 0.03 * ice, now)
        return CX, 0.0, CZ, 0.0, 0.1 * ice * now["de"], 0.0

    return formula, {"starts in manoeuvre": float(first)}


# --- terms -----------------------------------------------------------------------------------------------------------

_SATURATES = ("missing-term", "actuator-saturation")
_PULL_UPS, _LATERAL = ("pitch", "pull-up", "pull-up"), ("lateral", "lateral")
term("control-nonlinearity", "static", 4, lambda n, a: 4.0 * n["de"] ** 3, _PULL_UPS, _SATURATES, largest=10.0)
term(
    "control-nonlinearity", "static", 4, lambda n, a: 1.0 * n["de"] * abs(n["de"]), _PULL_UPS, _SATURATES, largest=10.0
)
term("control-nonlinearity", "static", 3, lambda n, a: 1.0 * n["da"] * abs(n["da"]), (*_LATERAL, "turn"), _SATURATES,
      largest=10.0)  # fmt: skip
term("cross-coupling", "static", 4, lambda n, a: 2.0 * n["beta"] ** 2, _LATERAL, ("missing-term",), largest=10)
term("cross-coupling", "static", 3, lambda n, a: 1.0 * n["alpha"] * n["beta"], ("lateral", "turn", "pull-up"),
      ("missing-term", "wrong-derivative"), largest=10)  # fmt: skip
term("cross-coupling", "static", 2, lambda n, a: 5.0 * n["beta"] ** 2, _LATERAL, ("missing-term",), largest=10)
term("missing-term", "static", 4, lambda n, a: 1.0 * n["alpha"] ** 2, ("pull-up", "pull-up"),
      ("static-stall", "wrong-derivative"), largest=10)  # fmt: skip
term("missing-term", "static", 2, lambda n, a: 5.0 * n["alpha"] ** 2, ("pull-up", "pull-up"),
      ("static-stall", "wrong-derivative"), largest=10)  # fmt: skip
term("missing-term", "static", 5, lambda n, a: 1.0 * n["beta"] ** 3, _LATERAL, ("wrong-derivative",), largest=30)
static("asymmetry", "static", ("lateral",), ("sensor-bias", "asymmetric-thrust"))(
    lambda now, given, a: (0.0, 0.01, 0.0, 0.003, 0.0, 0.003)
)

# --- unsteady flow ---------------------------------------------------------------------------------------------------


@with_memory("downwash-lag", "memory", ("pitch", "pull-up", "turn"), ("wrong-derivative", "unsteady-lift"), largest=6)
def _wake(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Downwash that reaches the tail later."""
    chords = rng.uniform(2.5, 4.0)

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        behind = now["alpha"] - lagged(memory, "a", now["alpha"], dt, chords * a.cbar / now["V"])
        return 0.0, 0.0, -0.5 * behind, 0.0, -1.3 * behind, 0.0

    return formula, {"delay in chords": chords}


@with_memory("sidewash-lag", "memory", _LATERAL, ("wrong-derivative", "sensor-delay"), largest=6)
def _fin_wake(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Sidewash that reaches the fin later."""

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        behind = now["beta"] - lagged(memory, "b", now["beta"], dt, 0.5 * a.b / now["V"])
        return 0.0, 0.25 * behind, 0.0, 0.0, 0.0, -0.25 * behind

    return formula, {}


@with_memory("unsteady-lift", "memory", ("pitch", "pitch"), ("downwash-lag", "sensor-delay"), largest=6)
def _wagner(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Lift that builds up over chords: Wagner's function after Jones."""

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        rate, alpha = 2.0 * now["V"] / a.cbar, now["alpha"]
        slow = lagged(memory, "1", alpha, dt, 1.0 / (0.0455 * rate))
        fast = lagged(memory, "2", alpha, dt, 1.0 / (0.3 * rate))
        missing = 5.0 * (0.165 * (alpha - slow) + 0.335 * (alpha - fast))
        return 0.0, 0.0, missing, 0.0, 0.1 * missing, 0.0

    return formula, {}


# --- propulsion ------------------------------------------------------------------------------------------------------


def _thrust_coefficient(now: Now, a: Aircraft) -> float:
    return now["thrust"] / (now["qbar"] * a.S)


def _along_thrust(now: Now, force: float, a: Aircraft) -> Six:
    """Force [N] along the declared thrust line."""
    line, Tc = a.thrust, force / (now["qbar"] * a.S)
    d, arm = line.direction, line.arm
    return Tc * d[0], 0.0, Tc * d[2], 0.0, Tc * arm[1] / a.cbar, 0.0


@static("slipstream", "propulsive", _POWER, ("thrust-line", "propeller-normal-force"), power="propeller")
def _slipstream(now: Now, given: Given, a: Aircraft) -> Six:
    """Slipstream over wing and tail."""
    Tc = _thrust_coefficient(now, a)
    return 0, 0, -Tc * (0.5 * now["alpha"] + 0.1), 0, Tc * (0.15 - 1.5 * now["de"]), Tc * (0.01 - 0.08 * now["dr"])


term("thrust-line", "propulsive", 4, lambda n, a: 0.1 * n["thrust"] / (n["qbar"] * a.S), _POWER, ("slipstream",))
static("thrust-scale", "propulsive", _POWER, ("drag-polar",), smallest=0.3)(
    lambda now, given, a: _along_thrust(now, 0.1 * now["thrust"], a)
)


@with_memory("thrust-lag", "propulsive", _POWER, ("thrust-scale",), smallest=0.15, shape=True)
def _thrust_lag(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Thrust that lags by the size [s]."""

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        behind = lagged(memory, "T", now["thrust"], dt, memory["size"])
        return _along_thrust(now, behind - now["thrust"], a)

    return formula, {}


@static("propeller-normal-force", "propulsive", _POWER, ("slipstream", "wrong-derivative"), either_sign,
         power="propeller")  # fmt: skip
def _normal_force(now: Now, given: Given, a: Aircraft) -> Six:
    """Side force, normal force and yawing moment of an inclined propeller."""
    Tc, alpha = _thrust_coefficient(now, a), now["alpha"]
    return 0, -Tc * now["beta"], -2.0 * Tc * alpha, 0, 1.5 * Tc * alpha, given["sense"] * 1.0 * Tc * alpha


@static("engine-gyroscopic", "propulsive", ("pitch", "lateral", "multisine"), ("cross-coupling", "inertia-error"),
         either_sign, largest=20)  # fmt: skip
def _gyroscopic(now: Now, given: Given, a: Aircraft) -> Six:
    """Rotors whose angular momentum resists pitch and yaw."""
    H = given["sense"] * 0.05 * float(a.mass or 0.0)  # kg m^2/s
    qS = now["qbar"] * a.S
    return 0, 0, 0, 0, -H * now["r"] / (qS * a.cbar), H * now["q"] / (qS * a.b)


term("asymmetric-thrust", "propulsive", 5, lambda n, a: 0.02 * n["thrust"] / n["qbar"] / a.S, _POWER,
      ("slipstream", "propeller-normal-force", "asymmetry"))  # fmt: skip

# --- mass and structure ----------------------------------------------------------------------------------------------


@static("cg-shift", "inertial", ("pull-up", "lateral", "pitch"), ("wrong-derivative",), smallest=0.06)
def _centre(now: Now, given: Given, a: Aircraft) -> Six:
    """Centre of gravity ahead of or behind the stated one."""
    return 0, 0, 0, 0, 0.05 * now["CZ"], -0.05 * now["CY"] * a.cbar / a.b


@event("store-release", "inertial", ("configuration-change",), (0.05, 0.1))
def _dropped(now: Now, fraction: float, given: Given) -> Six:
    """Drag and moments of a store that is gone; its mass is JSBSim's."""
    gone = 1.0 if fraction > 0.0 else 0.0
    return 0.01 * gone, 0.0, 0.0, 0.01 * given["side"] * gone, 0.012 * gone, 0.002 * gone


@with_memory("structural-mode", "structural", ("pitch", "multisine"), ("turbulence",))
def _mode(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """A bending mode driven by elevator and angle of attack."""
    w, zeta = 2 * math.pi * rng.uniform(2.2, 4.5), rng.uniform(0.02, 0.06)

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        e, v = memory.get("e", 0.0), memory.get("v", 0.0)
        de = now["de"] - memory.setdefault("de", now["de"])
        v += dt * (w * w * (0.5 * (now["alpha"] - memory.setdefault("a", now["alpha"])) + de - e) - 2 * zeta * w * v)
        e += dt * v
        memory["e"], memory["v"] = e, v
        ring = v / w  # without the quasi-static part
        return 0.0, 0.0, -0.5 * ring, 0.0, -0.2 * ring, 0.0

    return formula, {"frequency in Hz": w / (2 * math.pi), "damping": zeta}


@with_memory("slosh", "inertial", ("lateral", "turn", "lateral"), ("structural-mode",))
def _slosh(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
    """Fuel that swings sideways."""
    w, zeta = 2 * math.pi * rng.uniform(0.4, 0.9), rng.uniform(0.03, 0.08)

    def formula(now: Now, memory: Memory, dt: float) -> Six:
        y, v = memory.get("y", 0.0), memory.get("v", 0.0)
        v += dt * (-w * w * y - 2 * zeta * w * v - now["ay"] / 9.81 * w * w)
        y += dt * v
        memory["y"], memory["v"] = y, v
        swing = y * float(a.mass or 0.0) * 9.81 / (now["qbar"] * a.S)
        return 0.0, 0.15 * swing, 0.0, 0.02 * swing, 0.0, 0.0

    return formula, {"frequency in Hz": w / (2 * math.pi)}


# --- effects outside the library ------------------------------------------------------------------------------

_OUTSIDE: tuple[tuple[int, Term, tuple[str, ...]], ...] = (
    (4, lambda n, a: 0.02 * math.sin(60.0 * n["alpha"]), ("pull-up", "pitch")),
    (3, lambda n, a: 0.01 * math.sin(2.0 * n["psi"] + 40.0 * n["alpha"]), ("turn", "lateral")),
    (2, lambda n, a: 0.05 * math.tanh(40.0 * n["q"]) * math.tanh(20 * n["phi"]), ("turn", "pitch")),
    (5, lambda n, a: 0.004 * math.sin(math.exp(0.15 * n["t"])), ("lateral",)),
    (0, lambda n, a: 0.02 * math.sin(25.0 * n["theta"]) * math.cos(15.0 * n["phi"]), ("turn", "pull-up")),
    (4, lambda n, a: 0.01 * math.cos(n["h"] / 4.0), ("turn", "speed")),
)
for _k, _formula, _needs in _OUTSIDE:
    term("unknown", "static", _k, _formula, _needs, ())
UNMODELLED = tuple(ADDED_FORCES.pop("unknown"))
"""Repeatable functions of the flight that are not in the library."""
