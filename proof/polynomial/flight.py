"""Truth flights and simulations by the compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.polynomial.aircraft import Craft, Term
from proof.polynomial.kernel import READS, SCHEDULES, SETTINGS, STATES, SURFACE, fly
from proof.polynomial.manoeuvres import DT, SETTLING, Plan
from proof.polynomial.terms import INDEX, Terms, compile_terms
from proof.scenario.sizing import NotAttainable
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.numerics.rigid_body import body_velocity

_CLEAN = {"rate": 1e3, "low": -10.0, "high": 10.0}
CONTROLS = ("de", "da", "dr")


@dataclass
class Physics:
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

    def joined(self, other: Physics) -> Physics:
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
        return Physics(
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
class Flown:
    """One manoeuvre as it was: at the centre of gravity, without noise.

    Attributes
    ----------
    t : (n,) array [s]
    states, table, coefs, extras : arrays
        As `STATES`, `VARIABLES`, `AXES`; extras are the coefficients of the added physics alone.
    reads : mapping of str to (n,) array
        As `READS`.
    """

    plan: Plan
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


def settings_of(craft: Craft, plans: Sequence[Plan], ground: float) -> dict[str, float]:
    """References of the variables: the middle of what is flown."""
    V = float(np.mean([p.V for p in plans]))
    _, _, rho, sound = standard_atmosphere(np.array([p.h for p in plans]))
    held = {**SETTINGS, "V0": V, "rho0": float(np.mean(rho)), "ground_h": ground}
    held["glauert0"] = float(1.0 / np.sqrt(1.0 - (V / np.mean(sound)) ** 2) - 1.0)
    if craft.aircraft.V0:
        held["V0"] = craft.aircraft.V0
    return held


def fly_truth(
    craft: Craft, plans: Sequence[Plan], physics: Physics, settings: Mapping[str, float], rate: float
) -> list[Flown]:
    """Fly the manoeuvres with the added physics, at a rate of samples [1/s].

    Raises
    ------
    NotAttainable
    """
    base, added = compile_terms(craft.terms), compile_terms(physics.terms)
    held = {**settings, **physics.settings}
    values = np.array([held[name] for name in SETTINGS])
    tensor = craft.aircraft.require_inertia("fly_truth").tensor.copy()
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
    flown = []
    for k, plan in enumerate(plans):
        schedules = plan.schedules.copy()
        for name, arrays in physics.schedules.items():
            schedules[:, _column(name)] += arrays[k]
        schedules[:, _column("mass")] *= physics.mass * (1.0 if physics.mass_of is None else physics.mass_of[k])
        start = _start(plan, craft)
        trim = plan.trim
        trims = np.array([trim["de"], trim["alpha"], trim["alpha"], trim["throttle"], plan.V])
        flown.append(
            _run(
                plan,
                start,
                schedules,
                rate,
                round(SETTLING / DT),
                base,
                added,
                tensors,
                inverses,
                craft.constants(),
                values,
                craft.gains(plan.V, plan.h),
                trims,
                surfaces,
            )
        )
    return flown


def fly_simulation(
    craft: Craft,
    terms: Sequence[Term],
    flown: Flown,
    start: np.ndarray,
    controls: Mapping[str, np.ndarray],
    thrust: np.ndarray,
    settings: Mapping[str, float],
    rate: float,
) -> Flown:
    """Fly a simulation open loop from a start, with recorded controls and thrust held over each sample.

    Raises
    ------
    NotAttainable
    """
    hold = round(1.0 / (rate * DT))
    schedules = np.zeros(((len(flown.t) - 1) * hold + 1, flown.plan.schedules.shape[1]))
    for name, values in {**controls, "thrust": np.maximum(thrust, 0.0)}.items():
        schedules[:, _column(name)] = np.repeat(values, hold)[: len(schedules)]
    for name, value in {"alpha": -9.0, "mass": craft.aircraft.mass or 0.0, "throttle": 0.5}.items():
        schedules[:, _column(name)] = value
    clean = np.array([[{**dict.fromkeys(SURFACE, 0.0), **_CLEAN}[f] for f in SURFACE]] * 3)
    tensor = craft.aircraft.require_inertia("fly_simulation").tensor
    tensors = np.array([tensor, tensor])
    nothing = compile_terms([])
    return _run(
        flown.plan,
        start,
        schedules,
        rate,
        0,
        compile_terms(terms),
        nothing,
        tensors,
        np.linalg.inv(tensors),
        craft.constants(),
        np.array([settings[n] for n in SETTINGS]),
        np.zeros(9),
        np.zeros(5),
        clean,
    )


def _run(
    plan: Plan,
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
) -> Flown:
    every = round(1.0 / (rate * DT))
    rows, *logged = fly(
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
        float(plan.hold),
    )
    states, table, coefs, extras, reads = logged
    if rows < len(states):
        raise NotAttainable(plan.purpose)
    t = np.arange(rows) / rate
    return Flown(plan, t, states, table, coefs, extras, dict(zip(READS, reads.T)))


def _start(plan: Plan, craft: Craft) -> np.ndarray:
    start = np.zeros(len(STATES))
    start[0:3] = body_velocity(plan.V, plan.trim["alpha"], 0.0)
    start[7], start[8], start[11] = plan.trim["alpha"], 0.3, plan.h
    return start


def _column(name: str) -> int:
    return SCHEDULES.index(name)
