"""Truth flights and simulations by the compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.polynomial.aircraft import Term, TruthAircraft
from proof.polynomial.equations import FOLLOWED, SCHEDULES, SETTINGS, STATE, STATES, Plant
from proof.polynomial.kernel import READS, SURFACE, Pilot, simulate_flight
from proof.polynomial.manoeuvres import DT, SETTLING, Manoeuvre
from proof.polynomial.terms import INDEX, Terms, compile_terms
from proof.scenario.sizing import NotAttainable
from structsel.numerics.air_data import body_velocity
from structsel.numerics.atmosphere import standard_atmosphere

_CLEAN = {"rate": 1e3, "low": -10.0, "high": 10.0}
CONTROLS = ("de", "da", "dr")


@dataclass
class InjectedPhysics:
    """Physics that the truth has and the simulation lacks; parts are combined by `joined`.

    Attributes
    ----------
    terms : list of (axis, text, value)
        Over the variables.
    settings : dict
        Entries of `SETTINGS` that differ.
    surfaces : dict of control to dict
        Entries of `SURFACE` that differ.
    mass, inertia : factors of the true to the stated ones
    mass_of : list of arrays or None
        Factor of the mass through each manoeuvre.
    after : float
        Factor of the inertia after a release.
    schedules : dict of column to list of (steps,) arrays
        Of each manoeuvre, added to the plan's.
    signals : tuple of (variable, time constant [s], delay [s])
        The variables signal1, signal2, ... of the terms; of the parts that are combined, one may have some.
    """

    terms: list[Term] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    surfaces: dict[str, dict[str, float]] = field(default_factory=dict)
    mass: float = 1.0
    inertia: dict[str, float] = field(default_factory=dict)
    mass_of: list[np.ndarray] | None = None
    after: float = 1.0
    schedules: dict[str, list[np.ndarray]] = field(default_factory=dict)
    signals: tuple[tuple[str, float, float], ...] = ()

    def joined(self, other: InjectedPhysics) -> InjectedPhysics:
        """Both at once. Settings of the same name are the other's."""
        surfaces = {
            c: {**self.surfaces.get(c, {}), **other.surfaces.get(c, {})} for c in {*self.surfaces, *other.surfaces}
        }
        schedules = dict(self.schedules)
        for name, arrays in other.schedules.items():
            schedules[name] = [a + b for a, b in zip(schedules[name], arrays)] if name in schedules else arrays
        inertia = dict(self.inertia)
        for name, factor in other.inertia.items():
            inertia[name] = inertia.get(name, 1.0) * factor
        return InjectedPhysics(
            self.terms + other.terms,
            {**self.settings, **other.settings},
            surfaces,
            self.mass * other.mass,
            inertia,
            self.mass_of if other.mass_of is None else other.mass_of,
            self.after * other.after,
            schedules,
            self.signals or other.signals,
        )


@dataclass
class TruthFlight:
    """One manoeuvre as it was: at the centre of gravity, without noise.

    Attributes
    ----------
    t : (n,) array [s]
    states, table, coefs, extras : arrays
        As `STATES`, `VARIABLES`, `AXES`; extras are the coefficients of the added physics alone.
    reads : mapping of str to (n,) array
        As `READS`.
    """

    manoeuvre: Manoeuvre
    t: np.ndarray
    states: np.ndarray
    table: np.ndarray
    coefs: np.ndarray
    extras: np.ndarray
    reads: Mapping[str, np.ndarray]

    def state(self, name: str) -> np.ndarray:
        """A state by name."""
        return self.states[:, STATES.index(name)]

    def variable(self, name: str) -> np.ndarray:
        """A variable by name."""
        return self.table[:, INDEX[name]]


def settings_of(truth: TruthAircraft, manoeuvres: Sequence[Manoeuvre], ground: float) -> dict[str, float]:
    """References of the variables: means over the manoeuvres."""
    V = float(np.mean([p.V for p in manoeuvres]))
    _, _, rho, sound = standard_atmosphere(np.array([p.h for p in manoeuvres]))
    held = {**SETTINGS, "V0": V, "rho0": float(np.mean(rho)), "ground_h": ground}
    held["glauert0"] = float(1.0 / np.sqrt(1.0 - (V / np.mean(sound)) ** 2) - 1.0)
    if truth.aircraft.V0:
        held["V0"] = truth.aircraft.V0
    return held


def simulate_truth(
    truth: TruthAircraft,
    manoeuvres: Sequence[Manoeuvre],
    physics: InjectedPhysics,
    settings: Mapping[str, float],
    rate: float,
) -> list[TruthFlight]:
    """Simulate the manoeuvres with the added physics, at a sample rate [1/s].

    Raises
    ------
    NotAttainable
    """
    held = {**settings, **physics.settings}
    tensor = truth.aircraft.require_inertia("simulate_truth").tensor.copy()
    for name, factor in physics.inertia.items():
        i, j = "xyz".index(name[1]), "xyz".index(name[-1])
        tensor[i, j] *= factor
        tensor[j, i] = tensor[i, j]
    plant = _plant(
        truth, compile_terms(truth.terms), compile_terms(physics.terms), tensor, physics.after, held, physics.signals
    )
    surfaces = _actuators(physics.surfaces)
    flights = []
    for k, manoeuvre in enumerate(manoeuvres):
        schedules = manoeuvre.schedules.copy()
        for name, arrays in physics.schedules.items():
            schedules[:, _column(name)] += arrays[k]
        schedules[:, _column("mass")] *= physics.mass * (1.0 if physics.mass_of is None else physics.mass_of[k])
        trim = manoeuvre.trim
        trims = np.array([trim["de"], trim["alpha"], trim["alpha"], trim["throttle"], manoeuvre.V])
        pilot = Pilot(truth.gains(manoeuvre.V, manoeuvre.h), trims, surfaces, float(manoeuvre.hold))
        flights.append(_run(manoeuvre, _start(manoeuvre, truth), schedules, rate, round(SETTLING / DT), plant, pilot))
    return flights


def simulate_model(
    truth: TruthAircraft,
    terms: Sequence[Term],
    flight: TruthFlight,
    start: np.ndarray,
    controls: Mapping[str, np.ndarray],
    thrust: np.ndarray,
    settings: Mapping[str, float],
    rate: float,
) -> TruthFlight:
    """Simulate open loop from a start, with recorded controls and thrust held over each sample.

    Raises
    ------
    NotAttainable
    """
    hold = round(1.0 / (rate * DT))
    schedules = np.zeros(((len(flight.t) - 1) * hold + 1, flight.manoeuvre.schedules.shape[1]))
    for name, values in {**controls, "thrust": np.maximum(thrust, 0.0)}.items():
        schedules[:, _column(name)] = np.repeat(values, hold)[: len(schedules)]
    for name, value in {"alpha": -9.0, "mass": truth.aircraft.mass or 0.0, "throttle": 0.5}.items():
        schedules[:, _column(name)] = value
    tensor = truth.aircraft.require_inertia("simulate_model").tensor
    plant = _plant(truth, compile_terms(terms), compile_terms([]), tensor, 1.0, settings)
    pilot = Pilot(np.zeros(9), np.zeros(5), _actuators({}), float(flight.manoeuvre.hold))
    return _run(flight.manoeuvre, start, schedules, rate, 0, plant, pilot)


def _plant(
    truth: TruthAircraft,
    base: Terms,
    added: Terms,
    tensor: np.ndarray,
    after: float,
    settings: Mapping[str, float],
    signals: Sequence[tuple[str, float, float]] = (),
) -> Plant:
    """Arrays of the aircraft for the kernel; `after` is the factor of the inertia after a release."""
    tensors = np.array([tensor, tensor * after])
    values = np.array([settings[name] for name in SETTINGS])
    followed = np.array([(INDEX[of], lag, delay) for of, lag, delay in signals]).reshape(-1, len(FOLLOWED))
    return Plant(*base, *added, tensors, np.linalg.inv(tensors), truth.constants(), values, followed)


def _actuators(differing: Mapping[str, Mapping[str, float]]) -> np.ndarray:
    """(3, SURFACE) actuators without faults, except those that differ."""
    return np.array(
        [[{**dict.fromkeys(SURFACE, 0.0), **_CLEAN, **differing.get(c, {})}[f] for f in SURFACE] for c in CONTROLS]
    )


def _run(
    manoeuvre: Manoeuvre, start: np.ndarray, schedules: np.ndarray, rate: float, first: int, plant: Plant, pilot: Pilot
) -> TruthFlight:
    every = round(1.0 / (rate * DT))
    rows, log = simulate_flight(start, schedules, DT, every, first, plant, pilot)
    if rows < len(log.states):
        raise NotAttainable(manoeuvre.purpose)
    t = np.arange(rows) / rate
    reads = dict(zip(READS, log.reads.T))
    return TruthFlight(manoeuvre, t, log.states, log.variables, log.coefficients, log.added, reads)


def _start(manoeuvre: Manoeuvre, truth: TruthAircraft) -> np.ndarray:
    start = np.zeros(len(STATES))
    start[0:3] = body_velocity(manoeuvre.V, manoeuvre.trim["alpha"], 0.0)
    start[STATE.theta], start[STATE.psi], start[STATE.h] = manoeuvre.trim["alpha"], 0.3, manoeuvre.h
    return start


def _column(name: str) -> int:
    return SCHEDULES.index(name)
