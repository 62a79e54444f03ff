"""What instruments make of a truth flight, what the simulation is told, and the coefficients of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.polynomial.aircraft import Term
from proof.polynomial.flight import CONTROLS, TruthFlight
from proof.polynomial.terms import INDEX, compile_terms, evaluate
from proof.scenario.measurement import slow
from structsel.aircraft import Aircraft
from structsel.numerics import rigid_body as rb
from structsel.numerics.rigid_body import cross
from structsel.simulation import Instruments

Channels = dict[str, np.ndarray]
# At the best; a case has these times a factor of 1 to 1.7.
NOISE = {
    "V": 0.15,
    "alpha": 1.0e-3,
    "beta": 1.0e-3,
    **dict.fromkeys("pqr", 3.5e-4),
    "phi": 9e-4,
    "theta": 9e-4,
    "psi": 1.2e-3,
    "h": 0.37,
    "h_agl": 0.095,
    "ax": 0.0125,
    "ay": 0.0125,
    "az": 0.025,
    **dict.fromkeys(CONTROLS, 4e-4),
    "vn": 0.05,
    "ve": 0.05,
    "vd": 0.05,
}
BIAS = {
    "V": 0.2,
    "alpha": 1.5e-3,
    "beta": 1.5e-3,
    **dict.fromkeys("pqr", 6e-4),
    "phi": 1.5e-3,
    "theta": 1.5e-3,
    "psi": 2e-3,
    "h": 1.0,
    "ax": 0.02,
    "ay": 0.02,
    "az": 0.03,
    **dict.fromkeys(CONTROLS, 5e-4),
}
RAW, RECONSTRUCTED = "raw", "reconstructed"


@dataclass
class InstrumentErrors:
    """What is wrong with the instruments, the same in every manoeuvre unless it is a step.

    Attributes
    ----------
    scale, delay : dict of channel to value
    bias : dict of channel to list of (n,) arrays
        Of each manoeuvre.
    place : dict of {"accelerometer", "vane"} to (3,)
        True less stated place [m].
    mix : list of (channel, other, angle)
        The channel takes angle times the other, which loses as much of the channel.
    vanes_blind : bool
        The vanes do not feel gusts.
    without_gusts : bool
        The simulation is told the motion without gusts, though the vanes feel them.
    """

    scale: dict[str, float] = field(default_factory=dict)
    delay: dict[str, float] = field(default_factory=dict)
    bias: dict[str, list[np.ndarray]] = field(default_factory=dict)
    place: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    mix: list[tuple[str, str, float]] = field(default_factory=list)
    vanes_blind: bool = False
    without_gusts: bool = False

    def joined(self, other: InstrumentErrors) -> InstrumentErrors:
        """Both at once."""
        return InstrumentErrors(
            {**self.scale, **other.scale},
            {**self.delay, **other.delay},
            {**self.bias, **other.bias},
            {**self.place, **other.place},
            self.mix + other.mix,
            self.vanes_blind or other.vanes_blind,
            self.without_gusts or other.without_gusts,
        )


def inertial_air(flight: TruthFlight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """V, alpha, beta without gusts."""
    return rb.air_data(*(flight.state(n) for n in "uvw"))


def channels_of(
    flight: TruthFlight, aircraft: Aircraft, ground: float, extra: Sequence[str], errors: InstrumentErrors, k: int
) -> Channels:
    """Channels at the instruments' places without noise, with the faults."""
    t, reads = flight.t, flight.reads
    rates = tuple(flight.state(n) for n in "pqr")
    dots = tuple(reads[n] for n in ("p_dot", "q_dot", "r_dot"))
    gusts = (0.0, 0.0, 0.0) if errors.vanes_blind else tuple(reads[n] for n in ("gu", "gv", "gw"))
    boom = aircraft.position("vane") + np.array(errors.place.get("vane", (0.0, 0.0, 0.0)))
    moved = cross(rates, boom)
    V, alpha, beta = rb.air_data(*(flight.state(n) - g + d for n, g, d in zip("uvw", gusts, moved)))
    seat = aircraft.position("accelerometer") + np.array(errors.place.get("accelerometer", (0.0, 0.0, 0.0)))
    tangential, centripetal = cross(dots, seat), cross(rates, cross(rates, seat))
    force = [reads[n] + a + c for n, a, c in zip(("ax", "ay", "az"), tangential, centripetal)]
    made: Channels = {"V": V, "alpha": alpha, "beta": beta, **dict(zip("pqr", rates))}
    made |= {n: flight.state(n) for n in ("phi", "theta", "psi", "h")}
    made |= dict(zip(("ax", "ay", "az"), force))
    made |= {n: reads[n] for n in (*CONTROLS, "throttle")}
    made |= {"thrust": reads["thrust_model"], "rho": reads["rho"], "h_agl": flight.state("h") - ground}
    if "rpm" in extra:
        made["rpm"] = reads["rpm"]
    if "df" in extra:
        made["df"] = reads["df"]
    if "vn" in extra:
        made |= dict(zip(("vn", "ve", "vd"), _ground_velocity(flight)))
    for name, other, angle in errors.mix:
        made[name], made[other] = made[name] + angle * made[other], made[other] - angle * made[name]
    for name, arrays in errors.bias.items():
        made[name] = made[name] + arrays[k]
    if errors.scale or errors.delay:
        made = Instruments(scale=errors.scale, delay=errors.delay).read(t, made)
    return made


def _ground_velocity(flight: TruthFlight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, h = (flight.state(n) for n in ("x", "y", "h"))
    return tuple(np.gradient(z, flight.t, edge_order=2) * s for z, s in ((x, 1.0), (y, 1.0), (h, -1.0)))  # type: ignore[return-value]


def read(
    t: np.ndarray,
    channels: Channels,
    noise: Mapping[str, float],
    bias: Mapping[str, float],
    seed: int,
    wrong: Mapping[str, Mapping[str, float]],
) -> Channels:
    """Readings: noise, this manoeuvre's biases, and the errors that the tolerances allow for."""
    keep = lambda held: {n: v for n, v in held.items() if n in channels}  # noqa: E731
    made = Instruments(
        noise=keep(noise),
        bias=keep(bias),
        scale=keep(wrong.get("scale", {})),
        delay=keep(wrong.get("delay", {})),
        seed=seed,
    ).read(t, channels)
    made["qbar"] = 0.5 * made["rho"] * made["V"] ** 2
    made["h_agl"] = np.maximum(made["h_agl"], 0.0)
    return made


def simulated(
    terms: Sequence[Term], flight: TruthFlight, aircraft: Aircraft, given: Mapping[str, np.ndarray], V0: float
) -> np.ndarray:
    """(n, 6) coefficients of the simulation at what it is told.

    `given`: V, alpha, beta at the centre of gravity, p, q, r, de, da, dr, thrust, rho.
    """
    table = flight.table.copy()
    V = given["V"]
    for name in ("alpha", "beta", *CONTROLS):
        table[:, INDEX[name]] = given[name]
    for rate, length in (("p", aircraft.b), ("q", aircraft.cbar), ("r", aircraft.b)):
        table[:, INDEX[f"{rate}_hat"]] = given[rate] * length / (2.0 * V)
    table[:, INDEX["CT"]] = given["thrust"] / (0.5 * given["rho"] * V**2 * aircraft.S)
    table[:, INDEX["dV"]] = V / V0 - 1.0
    return evaluate(*compile_terms(terms), table)


def reconstructed_states(
    flight: TruthFlight, clean: Channels, faulty: Channels, calm: bool, rng: np.random.Generator
) -> Channels:
    """Nearly what was: the truth, what a fault makes of it, and a slow error as a reconstruction has."""
    V, alpha, beta = (
        inertial_air(flight) if calm else (flight.reads["V"], flight.variable("alpha"), flight.variable("beta"))
    )
    held = {
        "V": V,
        "alpha": alpha,
        "beta": beta,
        **{n: flight.state(n) for n in "pqr"},
        **{n: clean[n] for n in CONTROLS},
    }
    held = {n: x + faulty[n] - clean[n] for n, x in held.items()}
    for name, size in (("V", 0.05), ("alpha", 2e-4), ("beta", 2e-4)):
        held[name] = held[name] + size * slow(len(flight.t), rng, 0.97)
    return {**held, "thrust": faulty["thrust"], "rho": clean["rho"]}


def raw_states(readings: Channels, aircraft: Aircraft) -> Channels:
    """The channels themselves, vanes carried to the centre of gravity."""
    V, alpha, beta, p, q, r = (readings[n] for n in ("V", "alpha", "beta", "p", "q", "r"))
    V, alpha, beta = rb.air_data_at_cg(V, alpha, beta, p, q, r, tuple(aircraft.position("vane")))
    return {
        **{n: readings[n] for n in ("p", "q", "r", *CONTROLS, "thrust", "rho")},
        "V": V,
        "alpha": alpha,
        "beta": beta,
    }
