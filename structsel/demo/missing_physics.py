"""Recordings of an aircraft, and a simulation of it that lacks one effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.aircraft import Aircraft, Tolerances
from structsel.coefficients import compute_coefficients
from structsel.demo.aircraft import TRUTH, demo_aircraft
from structsel.errors import DataError
from structsel.inputs.signals import combine, doublet
from structsel.model import AeroModel
from structsel.nomenclature import EULER_ANGLES
from structsel.recording import Recording
from structsel.simulation import Instruments, simulate, trim

Terms = Mapping[str, Mapping[str, float]]

EFFECTS: Mapping[str, Terms] = {
    # At the ground 20 % more lift (CL = 0.055 + 5.58 alpha without it), 0.03 CL^2 less drag, and a nose-down moment.
    "ground-effect": {
        "CZ": {"near": -0.011, "near*alpha": -1.12},
        "CX": {"near*alpha": 0.011, "near*alpha^2": 2.05},
        "Cm": {"near": -0.003, "near*alpha": -0.28},
    },
    "cross-coupling": {"Cn": {"alpha*p_hat": -0.8}},
}
"""Effect -> response -> term -> value, as they are added to the model that is the truth."""
_DECAY = 4.0  # of the ground effect, per span of height
_DEFINITIONS = {"near": f"exp(-{_DECAY}*h/14.63)"}
_NOISE = {
    "V": 0.1, **dict.fromkeys(("alpha", "beta"), 5e-4), **dict.fromkeys("pqr", 5e-4), "h": 0.3, "h_agl": 0.05,
    **dict.fromkeys(EULER_ANGLES, 5e-4), **dict.fromkeys(("ax", "ay"), 0.015), "az": 0.01,
}  # fmt: skip
_TOLERANCES = Tolerances(
    main=0.01, secondary=0.03, mass=0.003, inertia=0.01, cg=0.001, thrust=0.01, vane_scale=0.005, alignment=0.002,
    delay=0.002, lever_arm=0.05,
)  # fmt: skip
_CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "ax", "ay", "az", "rho", "thrust")
_LOW, _HIGH = 14.0, 600.0  # m, where a flight begins


@dataclass(frozen=True, eq=False)
class MissingPhysics:
    """Recordings, and a simulation that lacks one effect.

    Attributes
    ----------
    effect : str
        Name of the effect that the simulation lacks; empty if it lacks none.
    terms : mapping of response to mapping of term to value
        The effect, as it was added to the model that is the truth. ``near`` is exp(-4 h/b).
    aircraft : Aircraft
    recordings : tuple of Recording
        One for each flight, with noise of the instruments; ``h_agl`` is the height above the ground [m].
    simulation : AeroModel
        Without the effect; each parameter is off within the tolerances of `aircraft`.
    simulated : mapping of recording's name to Recording
        Coefficients by `simulation` along the true states of each recording.
    """

    effect: str
    terms: Terms
    aircraft: Aircraft
    recordings: tuple[Recording, ...]
    simulation: AeroModel
    simulated: Mapping[str, Recording]


def demo_missing_physics(effect: str = "ground-effect", flights: int = 4, *, seed: int = 1) -> MissingPhysics:
    """Recordings of a light aircraft, and a simulation of it that lacks one effect.

    The aircraft is that of `demo_flights`. The truth is its model with the terms of the effect. `simulate` computes
    each flight: 12 s at 25 Hz, open loop, with doublets of elevator, aileron and rudder. Every second flight descends
    to about 5 m above the ground; the others are at 600 m.

    Parameters
    ----------
    effect : {"ground-effect", "cross-coupling", ""}
        Empty: the simulation lacks nothing.
    flights : int
    seed : int
        Of the noise and of the errors of the simulation.

    Returns
    -------
    MissingPhysics

    Raises
    ------
    DataError
        The effect has no example, or the number of flights is zero.

    Examples
    --------
    >>> case = demo_missing_physics("ground-effect", flights=3)
    >>> diagnosis = diagnose(case.simulated, case.recordings, case.aircraft)  # doctest: +SKIP
    """
    if effect and effect not in EFFECTS:
        raise DataError(f"demo_missing_physics has no effect '{effect}'; it has {', '.join(EFFECTS)}.")
    if flights < 1:
        raise DataError(f"demo_missing_physics needs one flight or more; found {flights}.")
    terms: Terms = EFFECTS.get(effect, {})
    truth = AeroModel.from_terms({r: {**values, **terms.get(r, {})} for r, values in TRUTH.items()})
    rng = np.random.default_rng([seed, 1])
    error = _TOLERANCES.main * 0.5  # type: ignore[operator]
    simulation = AeroModel.from_terms(
        {r: {term: x * (1.0 + error * rng.standard_normal()) for term, x in held.items()} for r, held in TRUTH.items()}
    )
    aircraft = demo_aircraft().model_copy(update={"tolerances": _TOLERANCES, "name": "light aircraft"})
    at_cg = aircraft.model_copy(update={"sensors": type(aircraft.sensors)()})
    recordings, simulated = [], {}
    for k in range(flights):
        exact, read = _fly(truth, aircraft, k, seed)
        recordings.append(read)
        simulated[read.name] = Recording(
            read.name, read.t, simulation.evaluate(compute_coefficients(exact, at_cg), outside="ignore")
        )
    return MissingPhysics(effect, terms, aircraft, tuple(recordings), simulation, simulated)


def _fly(truth: AeroModel, aircraft: Aircraft, k: int, seed: int) -> tuple[Recording, Recording]:
    """Flight number k: exact at the centre of gravity, and as its instruments read it."""
    low = k % 2 == 0
    start = trim(
        truth, aircraft, 44.0 + 2.0 * (k % 5), _LOW + 0.5 * k if low else _HIGH, climb=-0.05 if low else 0.0,
        definitions=_DEFINITIONS,
    )  # fmt: skip
    sign, at = (-1.0) ** (k // 2), {"duration": 12.0, "dt": 0.04}
    pulses = combine(
        doublet("de", -0.035 if low else 0.05 * sign, 0.7, start=3.0 + 0.2 * k, **at),
        doublet("de", -0.02 if low else 0.03 * sign, 0.9, start=6.0, **at),
        doublet("da", 0.04 * sign, 0.6, start=1.0 + 0.3 * k, **at),
        doublet("dr", 0.04 * sign, 0.8, start=8.0 - 0.3 * k, **at),
    )
    climb_away = np.where(pulses.t > 3.2, -0.012, 0.0) if low else np.zeros(len(pulses))
    # Rounded as by a hand: no derivative of the motion jumps between samples.
    moves = {
        c: scipy.ndimage.gaussian_filter1d(pulses[c] + (climb_away if c == "de" else 0.0), 4.0) for c in pulses.names
    }
    inputs = start.inputs(pulses.t, **moves)
    name = f"m{k + 1:02d}"
    instruments = Instruments(noise=_NOISE, seed=100 * seed + k)
    exact, read = (
        simulate(truth, aircraft, inputs, start=start, instruments=i, definitions=_DEFINITIONS)
        for i in (None, instruments)
    )
    height = instruments.read(exact.t, {"h_agl": exact["h"]})
    channels = {c: read[c] for c in (*_CHANNELS, *moves) if c in read.names}
    return exact, Recording(name, read.t, channels | height)
