"""Channels of a JSBSim flight, its readings, and the states that its simulation is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from proof.jsbsim.effects_faults import Fault
from proof.jsbsim.flight import TruthFlight
from proof.jsbsim.prescribed_motion import SEEN
from proof.scenario.instruments import (
    SOUND,
    Channels,
    InstrumentErrors,
    at_cg,
    derived,
    first_order_noise,
    reconstruction_errors,
)
from structsel.aircraft import Aircraft
from structsel.numerics.air_data import air_data
from structsel.simulation import Instruments


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
        Noise of thrust is a fraction of its mean.
    scale, delay : mapping of channel to value
        Errors within the tolerances.
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
    correlated: float
    seed: int


def channels_of(
    flight: TruthFlight, truth: Aircraft, errors: InstrumentErrors = SOUND, vanes_blind: bool = False
) -> Channels:
    """Channels at the instruments' places, with the errors, without noise."""
    rates, dots = [flight[c] for c in "pqr"], [flight[f"{c}_dot"] for c in "pqr"]
    velocity = [flight[c if vanes_blind else f"{c}_air"] for c in "uvw"]
    felt = errors.at_sensors(truth, velocity, rates, dots, [flight[f"F{c}"] / flight["mass"] for c in "xyz"])
    made = {c: felt[c] for c in ("V", "alpha", "beta")} | dict(zip("pqr", rates))
    made |= {c: flight[c] for c in ("phi", "theta", "psi", "h")} | {c: felt[c] for c in ("ax", "ay", "az")}
    made |= {c: flight[c] for c in ("de", "da", "dr", "df", "gear", "brake") if c in flight.channels}
    made |= {"throttle": flight["throttle"], "thrust": flight["thrust"], "rho": flight["rho"], "h_agl": flight["h"]}
    made |= {"sound": flight["V"] / np.maximum(flight["mach"], 1e-3)}
    return errors.applied(flight.t, made)


def read(
    flight: TruthFlight, clean: Mapping[str, np.ndarray], instruments: InstrumentSet, number: int
) -> dict[str, np.ndarray]:
    """Readings: the errors within tolerance, this manoeuvre's biases, noise."""
    rng = np.random.default_rng([instruments.seed, number, 7])
    bias = {c: s * rng.standard_normal() for c, s in instruments.bias.items() if c in clean}
    level = float(np.abs(clean["thrust"]).mean())
    noise = {c: s for c, s in instruments.noise.items() if c in clean} | {"thrust": instruments.noise["thrust"] * level}
    seed = int(rng.integers(2**31))
    scale, delay = ({c: v for c, v in held.items() if c in clean} for held in (instruments.scale, instruments.delay))
    scale["thrust"] = instruments.thrust
    wrong = Instruments(scale=scale, delay=delay, bias=bias, noise=noise, seed=seed)
    made = wrong.read(flight.t, {c: v for c, v in clean.items() if c != "sound"})
    if instruments.correlated:
        for c in ("alpha", "beta", "V", "ax", "ay", "az", "p", "q", "r"):
            made[c] = made[c] + instruments.correlated * instruments.noise[c] * first_order_noise(
                len(flight.t), rng, 0.9
            )
    made = derived(made)
    return {**made, "mach": made["V"] / clean["sound"]}


def state_offsets(
    flight: TruthFlight,
    clean: Mapping[str, np.ndarray],
    faulty: Mapping[str, np.ndarray],
    readings: Mapping[str, np.ndarray],
    instruments: InstrumentSet,
    number: int,
) -> dict[str, np.ndarray]:
    """Errors of the states at which the simulation is computed, for the channels of `prescribed_motion.SEEN`."""
    rng = np.random.default_rng([instruments.seed, number, 11])
    places = [c for c in SEEN if c in clean]
    if instruments.raw:
        # Near the ground a simulation is evaluated at the height above it; terrain is at zero.
        seen = {c: readings[c] for c in places} | at_cg(dict(readings), instruments.stated) | {"h": readings["h_agl"]}
        true = {c: flight[c] for c in places}
    else:
        seen, true = {c: faulty[c] for c in places}, {c: clean[c] for c in places}
    off = {c: seen[c] - true[c] for c in places}
    for surface in ("de", "da", "dr"):  # the simulation responds to the recorded surfaces
        if f"real_{surface}" in flight.channels:
            off[surface] = off[surface] + flight[surface] - flight[f"real_{surface}"]
    if not instruments.raw:
        if instruments.blind:
            for c, x in zip(("V", "alpha", "beta"), air_data(*(flight[c] for c in "uvw"))):
                off[c] = off[c] + x - flight[c]
        for c, error in reconstruction_errors(len(flight.t), rng).items():
            off[c] = off[c] + error
    return off


def restated(stated: Aircraft, fault: Fault) -> Aircraft:
    """The aircraft as aircraft.toml has it where mass or inertia is wrong."""
    if fault.mass == 1.0 and not fault.inertia:
        return stated
    inertia = stated.require_inertia("a case").model_dump()
    inertia = {c: v * fault.inertia.get(c, 1.0) for c, v in inertia.items()}
    kept = stated.model_dump(exclude={"inertia", "mass", "schema_name"})
    return Aircraft(**kept, mass=float(stated.mass or 0.0) * fault.mass, inertia=inertia)
