"""Which effects can be put into a truth as laws, and what no name covers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proof.jsbsim.laws import (
    Formula,
    centre,
    draw_sense,
    draw_stall,
    dropped,
    event,
    fin_wake,
    flexible,
    ground,
    gyro,
    hysteresis,
    icing,
    mach,
    mode,
    moved,
    normal_force,
    one_term,
    polar,
    reynolds,
    slipstream,
    slosh,
    stall,
    static,
    stretch,
    thrust_force,
    thrust_lag,
    wagner,
    wake,
)
from proof.keys import Kind
from structsel.aircraft import Aircraft


@dataclass(frozen=True)
class AddedForceSpec:
    """A law as it may be drawn.

    Attributes
    ----------
    make : callable of (rng, aircraft, events) to (formula, parameters)
        `events` maps the number of a manoeuvre to the instant at which something happens in it [s].
    kind : str
    needs : tuple of str
    tie, accept : tuple of str
    region : str
        Channel that bounds it.
    local : bool
        Acts in stretches of time only.
    power : {"", "propeller", "jet"}
        Only aircraft with this.
    shape : bool
        As of `AddedForce`.
    smallest, largest : float
        Sizes that are plausible, and more than a tolerance.
    """

    make: Callable[[np.random.Generator, Aircraft, dict[int, float]], tuple[Formula, dict[str, float]]]
    kind: Kind
    needs: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    region: str = ""
    local: bool = False
    power: str = ""
    largest: float = 3.0
    smallest: float = 0.003
    shape: bool = False
    lift: tuple[float, float] = (0.3, 0.6)


_STALLS, _SPEEDS, _POWER = ("stall",) * 3, ("speed",) * 3, ("throttle", "throttle", "throttle", "speed")

ADDED_FORCES: dict[str, tuple[AddedForceSpec, ...]] = {
    "drag-polar": (AddedForceSpec(static(polar), "static", ("pull", "speed"), ("missing-term",)),),
    "static-stall": (
        AddedForceSpec(
            static(stall, draw_stall),
            "static",
            _STALLS,
            ("missing-term", "stall-hysteresis"),
            region="alpha",
            local=True,
        ),
    ),
    "stall-hysteresis": (AddedForceSpec(hysteresis, "memory", _STALLS, ("static-stall",), region="alpha", local=True),),
    "ground-effect": (
        AddedForceSpec(
            static(ground, lambda rng: {"rate": rng.uniform(3.0, 5.0)}),
            "static",
            ("low",) * 3,
            region="h_agl",
            local=True,
        ),
    ),
    "compressibility": (
        AddedForceSpec(
            static(mach), "static", _SPEEDS, ("flexibility", "wrong-derivative"), power="jet", lift=(0.12, 0.5)
        ),
    ),
    "reynolds": (AddedForceSpec(static(reynolds), "static", _SPEEDS, ("compressibility", "wrong-derivative")),),
    "flexibility": (
        AddedForceSpec(
            static(flexible), "structural", _SPEEDS, ("compressibility", "wrong-derivative"), lift=(0.15, 0.6)
        ),
    ),
    "control-stretch": (
        AddedForceSpec(
            static(stretch),
            "structural",
            ("speed", "speed", "pitch", "pitch"),
            ("wrong-derivative", "flexibility", "compressibility"),
            lift=(0.15, 0.6),
        ),
    ),
    "configuration-change": (
        AddedForceSpec(event(moved, (0.5, 3.0)), "static", ("pitch", "pull"), ("icing",), local=True),
    ),
    "icing": (AddedForceSpec(icing, "static", ("pitch", "pull"), ("configuration-change", "mass-error")),),
    "control-nonlinearity": (
        AddedForceSpec(
            one_term(4, lambda n, a: 4.0 * n["de"] ** 3),
            "static",
            ("pitch", "pull", "pull"),
            ("missing-term", "actuator-saturation"),
            largest=10.0,
        ),
        AddedForceSpec(
            one_term(4, lambda n, a: 1.0 * n["de"] * abs(n["de"])),
            "static",
            ("pitch", "pull", "pull"),
            ("missing-term", "actuator-saturation"),
            largest=10.0,
        ),
        AddedForceSpec(
            one_term(3, lambda n, a: 1.0 * n["da"] * abs(n["da"])),
            "static",
            ("lateral", "lateral", "turn"),
            ("missing-term", "actuator-saturation"),
            largest=10.0,
        ),
    ),
    "cross-coupling": (
        AddedForceSpec(
            one_term(4, lambda n, a: 2.0 * n["beta"] ** 2),
            "static",
            ("lateral", "lateral"),
            ("missing-term",),
            largest=10,
        ),
        AddedForceSpec(
            one_term(3, lambda n, a: 1.0 * n["alpha"] * n["beta"]),
            "static",
            ("lateral", "turn", "pull"),
            ("missing-term", "wrong-derivative"),
            largest=10,
        ),
        AddedForceSpec(
            one_term(2, lambda n, a: 5.0 * n["beta"] ** 2),
            "static",
            ("lateral", "lateral"),
            ("missing-term",),
            largest=10,
        ),
    ),
    "missing-term": (
        AddedForceSpec(
            one_term(4, lambda n, a: 1.0 * n["alpha"] ** 2),
            "static",
            ("pull", "pull"),
            ("static-stall", "wrong-derivative"),
            largest=10,
        ),
        AddedForceSpec(
            one_term(2, lambda n, a: 5.0 * n["alpha"] ** 2),
            "static",
            ("pull", "pull"),
            ("static-stall", "wrong-derivative"),
            largest=10,
        ),
        AddedForceSpec(
            one_term(5, lambda n, a: 1.0 * n["beta"] ** 3),
            "static",
            ("lateral", "lateral"),
            ("wrong-derivative",),
            largest=30,
        ),
    ),
    "downwash-lag": (
        AddedForceSpec(wake, "memory", ("pitch", "pull", "turn"), ("wrong-derivative", "unsteady-lift"), largest=6),
    ),
    "sidewash-lag": (
        AddedForceSpec(fin_wake, "memory", ("lateral", "lateral"), ("wrong-derivative", "sensor-delay"), largest=6),
    ),
    "unsteady-lift": (
        AddedForceSpec(wagner, "memory", ("pitch", "pitch"), ("downwash-lag", "sensor-delay"), largest=6),
    ),
    "slipstream": (
        AddedForceSpec(
            static(slipstream), "propulsive", _POWER, ("thrust-line", "propeller-normal-force"), power="propeller"
        ),
    ),
    "thrust-line": (
        AddedForceSpec(
            one_term(4, lambda n, a: 0.1 * n["thrust"] / (n["qbar"] * a.S)), "propulsive", _POWER, ("slipstream",)
        ),
    ),
    "thrust-scale": (
        AddedForceSpec(
            static(lambda n, g, a: thrust_force(n, 0.1 * n["thrust"], a)),
            "propulsive",
            _POWER,
            ("drag-polar",),
            smallest=0.3,
        ),
    ),
    "thrust-lag": (AddedForceSpec(thrust_lag, "propulsive", _POWER, ("thrust-scale",), smallest=0.15, shape=True),),
    "propeller-normal-force": (
        AddedForceSpec(
            static(normal_force, draw_sense),
            "propulsive",
            _POWER,
            ("slipstream", "wrong-derivative"),
            power="propeller",
        ),
    ),
    "engine-gyroscopic": (
        AddedForceSpec(
            static(gyro, draw_sense),
            "propulsive",
            ("pitch", "lateral", "multisine"),
            ("cross-coupling", "inertia-error"),
            largest=20,
        ),
    ),
    "asymmetric-thrust": (
        AddedForceSpec(
            one_term(5, lambda n, a: 0.02 * n["thrust"] / n["qbar"] / a.S),
            "propulsive",
            _POWER,
            ("slipstream", "propeller-normal-force", "asymmetry"),
        ),
    ),
    "cg-shift": (
        AddedForceSpec(static(centre), "inertial", ("pull", "lateral", "pitch"), ("wrong-derivative",), smallest=0.06),
    ),
    "asymmetry": (
        AddedForceSpec(
            static(lambda n, g, a: (0.0, 0.01, 0.0, 0.003, 0.0, 0.003)),
            "static",
            ("lateral",),
            ("sensor-bias", "asymmetric-thrust"),
        ),
    ),
    "store-release": (
        AddedForceSpec(
            event(dropped, (0.05, 0.1)), "inertial", ("pitch", "pull"), ("configuration-change",), local=True
        ),
    ),
    "structural-mode": (AddedForceSpec(mode, "structural", ("pitch", "multisine"), ("turbulence",)),),
    "slosh": (AddedForceSpec(slosh, "inertial", ("lateral", "turn", "lateral"), ("structural-mode",)),),
}
"""Effects of EFFECTS.md as laws; their sizes are of order one where they are plausible."""

UNMODELLED: tuple[AddedForceSpec, ...] = (
    AddedForceSpec(one_term(4, lambda n, a: 0.02 * math.sin(60.0 * n["alpha"])), "static", ("pull", "pitch")),
    AddedForceSpec(
        one_term(3, lambda n, a: 0.01 * math.sin(2.0 * n["psi"] + 40.0 * n["alpha"])), "static", ("turn", "lateral")
    ),
    AddedForceSpec(
        one_term(2, lambda n, a: 0.05 * math.tanh(40.0 * n["q"]) * math.tanh(20 * n["phi"])),
        "static",
        ("turn", "pitch"),
    ),
    AddedForceSpec(one_term(5, lambda n, a: 0.004 * math.sin(math.exp(0.15 * n["t"]))), "static", ("lateral",)),
    AddedForceSpec(
        one_term(0, lambda n, a: 0.02 * math.sin(25.0 * n["theta"]) * math.cos(15.0 * n["phi"])),
        "static",
        ("turn", "pull"),
    ),
    AddedForceSpec(one_term(4, lambda n, a: 0.01 * math.cos(n["h"] / 4.0)), "static", ("turn", "speed")),
)
"""Repeatable functions of the flight that no name covers."""
