"""Channels of the polynomial plant, the states that its simulation is given, and the simulation's coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from proof.polynomial.aircraft import Term
from proof.polynomial.flight import CONTROLS, TruthFlight
from proof.polynomial.terms import INDEX, compile_terms, evaluate
from proof.scenario.instruments import Channels, InstrumentErrors, at_cg, derived, reconstruction_errors
from structsel.aircraft import Aircraft
from structsel.numerics.air_data import air_data
from structsel.simulation import Instruments

RAW, RECONSTRUCTED = "raw", "reconstructed"


def inertial_air(flight: TruthFlight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """V, alpha, beta without gusts."""
    return air_data(*(flight.state(n) for n in "uvw"))


def channels_of(
    flight: TruthFlight, aircraft: Aircraft, ground: float, extra: Sequence[str], errors: InstrumentErrors, k: int
) -> Channels:
    """Channels at the instruments' places without noise, with the errors, of manoeuvre k."""
    reads = flight.reads
    rates = [flight.state(n) for n in "pqr"]
    dots = [reads[n] for n in ("p_dot", "q_dot", "r_dot")]
    gusts = (0.0, 0.0, 0.0) if errors.vanes_blind else [reads[n] for n in ("gu", "gv", "gw")]
    velocity = [flight.state(n) - g for n, g in zip("uvw", gusts)]
    felt = errors.at_sensors(aircraft, velocity, rates, dots, [reads[n] for n in ("ax", "ay", "az")])
    made: Channels = {n: felt[n] for n in ("V", "alpha", "beta")} | dict(zip("pqr", rates))
    made |= {n: flight.state(n) for n in ("phi", "theta", "psi", "h")} | {n: felt[n] for n in ("ax", "ay", "az")}
    made |= {n: reads[n] for n in (*CONTROLS, "throttle")}
    made |= {"thrust": reads["thrust_model"], "rho": reads["rho"], "h_agl": flight.state("h") - ground}
    made |= {n: reads[n] for n in ("rpm", "df") if n in extra}
    if "vn" in extra:
        made |= dict(zip(("vn", "ve", "vd"), _ground_velocity(flight)))
    return errors.applied(flight.t, made, k)


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
    noise, bias, scale, delay = (
        {n: v for n, v in held.items() if n in channels} for held in (noise, bias, wrong["scale"], wrong["delay"])
    )
    return derived(Instruments(noise=noise, bias=bias, scale=scale, delay=delay, seed=seed).read(t, channels))


def simulated(
    terms: Sequence[Term], flight: TruthFlight, aircraft: Aircraft, given: Mapping[str, np.ndarray], V0: float
) -> np.ndarray:
    """(n, 6) coefficients of the simulation at the states it is given.

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
    flight: TruthFlight, clean: Channels, faulty: Channels, without_gusts: bool, rng: np.random.Generator
) -> Channels:
    """The true states, the errors of the instruments, and the slow errors of a reconstruction."""
    felt = flight.reads["V"], flight.variable("alpha"), flight.variable("beta")
    air = inertial_air(flight) if without_gusts else felt
    states = {**dict(zip(("V", "alpha", "beta"), air)), **{n: flight.state(n) for n in "pqr"}}
    states |= {n: clean[n] for n in CONTROLS}
    states = {n: x + faulty[n] - clean[n] for n, x in states.items()}
    for name, error in reconstruction_errors(len(flight.t), rng).items():
        states[name] = states[name] + error
    return {**states, "thrust": faulty["thrust"], "rho": clean["rho"]}


def raw_states(readings: Channels, aircraft: Aircraft) -> Channels:
    """The readings themselves, the vanes' carried to the centre of gravity."""
    return {**{n: readings[n] for n in ("p", "q", "r", *CONTROLS, "thrust", "rho")}, **at_cg(readings, aircraft)}
