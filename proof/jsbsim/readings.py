"""What is recorded of a JSBSim flight, what its simulation is told, and the coefficients of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from proof.jsbsim.faults import Fault, apply
from proof.jsbsim.flight import TruthFlight
from proof.jsbsim.prescribed_motion import SEEN
from proof.scenario.measurement import measured, slow
from structsel.aircraft import Aircraft
from structsel.numerics import rigid_body as rb
from structsel.simulation import Instruments

# At the best; a case has these times a factor of 1 to 1.7.
NOISE = {"V": 0.15, "alpha": 1.0e-3, "beta": 1.0e-3, **dict.fromkeys("pqr", 4e-4), "phi": 9e-4, "theta": 9e-4,
         "psi": 1.2e-3, "h": 0.37, "h_agl": 0.095, "ax": 0.0125, "ay": 0.0125, "az": 0.025,
         **dict.fromkeys(("de", "da", "dr"), 3e-4)}  # fmt: skip
BIAS = {"V": 0.2, "alpha": 1.5e-3, "beta": 1.5e-3, **dict.fromkeys("pqr", 6e-4), "phi": 1.5e-3, "theta": 1.5e-3,
        "psi": 2e-3, "h": 1.0, "ax": 0.02, "ay": 0.02, "az": 0.03,
        **dict.fromkeys(("de", "da", "dr"), 4e-4)}  # fmt: skip
THRUST_NOISE = 0.003  # of its mean


@dataclass(frozen=True, eq=False)
class InstrumentSet:
    """Everything of the instruments that a case keeps from manoeuvre to manoeuvre.

    Attributes
    ----------
    truth : Aircraft
        As it is: true mass, inertia, places.
    stated : Aircraft
        As aircraft.toml has it.
    noise, bias : mapping of channel to standard deviation
        Noise of thrust is a share of its mean.
    scale, delay, tilt : mapping of channel to value
        Errors within the tolerances.
    gust_seen : float
        Share of a gust that the simulation is told of.
    raw : bool
        The simulation is computed at the channels themselves.
    """

    truth: Aircraft
    stated: Aircraft
    noise: Mapping[str, float]
    bias: Mapping[str, float]
    scale: Mapping[str, float]
    delay: Mapping[str, float]
    thrust: float
    raw: bool
    blind: bool
    colour: float
    seed: int


def channels_of(flight: TruthFlight, truth: Aircraft, fault: Fault, blind: bool) -> dict[str, np.ndarray]:
    """Channels at the instruments' places, as the faulty ones give them, without noise."""
    rates = [flight[c] for c in "pqr"]
    dots = [flight[f"{c}_dot"] for c in "pqr"]
    boom = truth.position("vane") + np.asarray(fault.place.get("vane", 0.0))
    seat = truth.position("accelerometer") + np.asarray(fault.place.get("accelerometer", 0.0))
    air = "" if blind else "_air"
    moved = np.cross(np.column_stack(rates), boom)
    V, alpha, beta = rb.air_data(*(flight[f"{c}{air}"] + moved[:, k] for k, c in enumerate("uvw")))
    omega = np.column_stack(rates)
    lever = np.cross(np.column_stack(dots), seat) + np.cross(omega, np.cross(omega, seat))
    force = np.column_stack([flight[f"F{c}"] / flight["mass"] for c in "xyz"]) + lever
    made = {"V": V, "alpha": alpha, "beta": beta, **dict(zip("pqr", rates))}
    made |= {c: flight[c] for c in ("phi", "theta", "psi", "h")}
    made |= {f"a{c}": force[:, k] for k, c in enumerate("xyz")}
    made |= {c: flight[c] for c in ("de", "da", "dr") if c in flight.channels}
    made |= {c: flight[c] for c in ("df", "gear", "brake") if c in flight.channels}
    made |= {"throttle": flight["throttle"], "thrust": flight["thrust"], "rho": flight["rho"], "h_agl": flight["h"]}
    made |= {"sound": flight["V"] / np.maximum(flight["mach"], 1e-3)}
    return apply(flight.t, made, fault)


def read(
    flight: TruthFlight, clean: Mapping[str, np.ndarray], instruments: InstrumentSet, number: int
) -> dict[str, np.ndarray]:
    """Readings: the errors within tolerance, this manoeuvre's biases, noise."""
    rng = np.random.default_rng([instruments.seed, number, 7])
    bias = {c: s * rng.standard_normal() for c, s in instruments.bias.items() if c in clean}
    level = float(np.abs(clean["thrust"]).mean())
    noise = {c: s for c, s in instruments.noise.items() if c in clean} | {"thrust": instruments.noise["thrust"] * level}
    seed = int(rng.integers(2**31))
    keep = lambda held: {c: v for c, v in held.items() if c in clean}  # noqa: E731
    wrong = Instruments(
        scale=keep(instruments.scale) | {"thrust": instruments.thrust},
        delay=keep(instruments.delay),
        bias=bias,
        noise=noise,
        seed=seed,
    )
    made = wrong.read(flight.t, {c: v for c, v in clean.items() if c != "sound"})
    if instruments.colour:
        for c in ("alpha", "beta", "V", "ax", "ay", "az", "p", "q", "r"):
            made[c] = made[c] + instruments.colour * instruments.noise[c] * slow(len(flight.t), rng, 0.9)
    made["qbar"] = 0.5 * made["rho"] * made["V"] ** 2
    made["mach"] = made["V"] / clean["sound"]
    made["h_agl"] = np.maximum(made["h_agl"], 0.0)
    return made


def measured_as_stated(t: np.ndarray, held: Mapping[str, np.ndarray], aircraft: Aircraft) -> np.ndarray:
    """(n, 6) coefficients by what is read, with the mass and inertia of the aircraft and the thrust recorded."""
    tensor = aircraft.require_inertia("measured").tensor
    mass = float(aircraft.mass or 0.0)
    return measured(t, held, aircraft, mass=mass, inertia=tensor, thrust=held["thrust"])


def state_offsets(
    flight: TruthFlight,
    clean: Mapping[str, np.ndarray],
    faulty: Mapping[str, np.ndarray],
    readings: Mapping[str, np.ndarray],
    instruments: InstrumentSet,
    number: int,
) -> dict[str, np.ndarray]:
    """What is added to the true states where the simulation is computed: `prescribed_motion.SEEN`."""
    rng = np.random.default_rng([instruments.seed, number, 11])
    places = [c for c in SEEN if c in clean]
    if instruments.raw:
        boom = tuple(instruments.stated.position("vane"))
        air, rates = [readings[c] for c in ("V", "alpha", "beta")], [readings[c] for c in "pqr"]
        V, alpha, beta = rb.air_data_at_cg(air[0], air[1], air[2], rates[0], rates[1], rates[2], boom)
        # Near the ground the height above it is what a simulation is asked at; terrain is at zero.
        seen = {**{c: readings[c] for c in places}, "V": V, "alpha": alpha, "beta": beta, "h": readings["h_agl"]}
        true = {c: flight[c] for c in places}
    else:
        seen, true = {c: faulty[c] for c in places}, {c: clean[c] for c in places}
    off = {c: seen[c] - true[c] for c in places}
    for surface in ("de", "da", "dr"):  # the simulation is driven by what was recorded
        if f"real_{surface}" in flight.channels:
            off[surface] = off[surface] + flight[surface] - flight[f"real_{surface}"]
    if not instruments.raw:
        if instruments.blind:
            for c, x in zip(("V", "alpha", "beta"), rb.air_data(*(flight[c] for c in "uvw"))):
                off[c] = off[c] + x - flight[c]
        for c, size in (("V", 0.05), ("alpha", 2e-4), ("beta", 2e-4)):
            off[c] = off[c] + size * slow(len(flight.t), rng, 0.97)
    return off


def joined(faults: Sequence[Fault]) -> Fault:
    """All faults at once, their actuators apart."""
    made = Fault()
    for f in faults:
        made = Fault(
            {**made.scale, **f.scale}, {**made.bias, **f.bias}, {**made.delay, **f.delay}, {**made.place, **f.place},
            (*made.mix, *f.mix), made.mass * f.mass, {**made.inertia, **f.inertia},
        )  # fmt: skip
    return made


def restated(stated: Aircraft, fault: Fault) -> Aircraft:
    """The aircraft as aircraft.toml has it where mass or inertia is wrong."""
    if fault.mass == 1.0 and not fault.inertia:
        return stated
    inertia = stated.require_inertia("a case").model_dump()
    inertia = {c: v * fault.inertia.get(c, 1.0) for c, v in inertia.items()}
    kept = stated.model_dump(exclude={"inertia", "mass", "schema_name"})
    return Aircraft(**kept, mass=float(stated.mass or 0.0) * fault.mass, inertia=inertia)
