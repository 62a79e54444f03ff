"""Truth flights and simulations by the compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.polynomial.aircraft import Term, TruthAircraft
from proof.polynomial.kernel import READS, SCHEDULES, SETTINGS, STATES, SURFACE, simulate_flight
from proof.polynomial.manoeuvres import DT, SETTLING, Manoeuvre
from proof.polynomial.terms import INDEX, Terms, compile_terms
from proof.scenario.sizing import NotAttainable
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.numerics.rigid_body import body_velocity

_CLEAN = {"rate": 1e3, "low": -10.0, "high": 10.0}
CONTROLS = ("de", "da", "dr")


@dataclass
class InjectedPhysics:
    """What the truth has and the simulation lacks; parts add up with `joined`.

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
    """

    terms: list[Term] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    surfaces: dict[str, dict[str, float]] = field(default_factory=dict)
    mass: float = 1.0
    inertia: dict[str, float] = field(default_factory=dict)
    mass_of: list[np.ndarray] | None = None
    after: float = 1.0
    schedules: dict[str, list[np.ndarray]] = field(default_factory=dict)

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
    """References of the variables: the middle of what is flown."""
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
    """Fly the manoeuvres with the added physics, at a rate of samples [1/s].

    Raises
    ------
    NotAttainable
    """
    base, added = compile_terms(truth.terms), compile_terms(physics.terms)
    held = {**settings, **physics.settings}
    values = np.array([held[name] for name in SETTINGS])
    tensor = truth.aircraft.require_inertia("fly_truth").tensor.copy()
    for name, factor in physics.inertia.items():
        i, j = "xyz".index(name[1]), "xyz".index(name[-1])
        tensor[i, j] *= factor
        tensor[j, i] = tensor[i, j]
    tensors = np.array([tensor, tensor * physics.after])
    inverses = np.linalg.inv(tensors)
    surfaces = np.array(
        [
            [{**dict.fromkeys(SURFACE, 0.0), **_CLEAN, **physics.surfaces.get(c, {})}[f] for f in SURFACE]
            for c in CONTROLS
        ]
    )
    flights = []
    for k, manoeuvre in enumerate(manoeuvres):
        schedules = manoeuvre.schedules.copy()
        for name, arrays in physics.schedules.items():
            schedules[:, _column(name)] += arrays[k]
        schedules[:, _column("mass")] *= physics.mass * (1.0 if physics.mass_of is None else physics.mass_of[k])
        start = _start(manoeuvre, truth)
        trim = manoeuvre.trim
        trims = np.array([trim["de"], trim["alpha"], trim["alpha"], trim["throttle"], manoeuvre.V])
        flights.append(
            _run(
                manoeuvre,
                start,
                schedules,
                rate,
                round(SETTLING / DT),
                base,
                added,
                tensors,
                inverses,
                truth.constants(),
                values,
                truth.gains(manoeuvre.V, manoeuvre.h),
                trims,
                surfaces,
            )
        )
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
    """Fly a simulation open loop from a start, with recorded controls and thrust held over each sample.

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
    clean = np.array([[{**dict.fromkeys(SURFACE, 0.0), **_CLEAN}[f] for f in SURFACE]] * 3)
    tensor = truth.aircraft.require_inertia("fly_simulation").tensor
    tensors = np.array([tensor, tensor])
    nothing = compile_terms([])
    return _run(
        flight.manoeuvre,
        start,
        schedules,
        rate,
        0,
        compile_terms(terms),
        nothing,
        tensors,
        np.linalg.inv(tensors),
        truth.constants(),
        np.array([settings[n] for n in SETTINGS]),
        np.zeros(9),
        np.zeros(5),
        clean,
    )


def _run(
    manoeuvre: Manoeuvre,
    start: np.ndarray,
    schedules: np.ndarray,
    rate: float,
    first: int,
    base: Terms,
    added: Terms,
    tensors: np.ndarray,
    inverses: np.ndarray,
    constants: np.ndarray,
    settings: np.ndarray,
    gains: np.ndarray,
    trims: np.ndarray,
    surfaces: np.ndarray,
) -> TruthFlight:
    every = round(1.0 / (rate * DT))
    rows, *logged = simulate_flight(
        start,
        schedules,
        DT,
        every,
        first,
        *base,
        *added,
        tensors,
        inverses,
        constants,
        settings,
        gains,
        trims,
        surfaces,
        float(manoeuvre.hold),
    )
    states, table, coefs, extras, reads = logged
    if rows < len(states):
        raise NotAttainable(manoeuvre.purpose)
    t = np.arange(rows) / rate
    return TruthFlight(manoeuvre, t, states, table, coefs, extras, dict(zip(READS, reads.T)))


def _start(manoeuvre: Manoeuvre, truth: TruthAircraft) -> np.ndarray:
    start = np.zeros(len(STATES))
    start[0:3] = body_velocity(manoeuvre.V, manoeuvre.trim["alpha"], 0.0)
    start[7], start[8], start[11] = manoeuvre.trim["alpha"], 0.3, manoeuvre.h
    return start


def _column(name: str) -> int:
    return SCHEDULES.index(name)
