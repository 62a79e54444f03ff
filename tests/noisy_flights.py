"""Noisy flights of the demonstration aircraft with physics that its simulation lacks, and their differences."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from structsel.aircraft import Aircraft
from structsel.coefficients import compute_coefficients
from structsel.comparison.flight import prepare_flight
from structsel.comparison.surrogate import identify
from structsel.demo.aircraft import TRUTH, demo_aircraft
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import work_out
from structsel.effects import EFFECTS
from structsel.nomenclature import COEFFICIENTS
from structsel.recording import Recording
from structsel.simulation import Instruments, simulate, trim
from tests.models import model_of

AIRCRAFT = demo_aircraft()
DT = 0.04
T = np.arange(0.0, 20.0, DT)
NOISE = {
    "V": 0.02, **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), 2e-4), **dict.fromkeys("pqr", 2e-5),
    **dict.fromkeys(("ax", "ay", "az"), 0.01),
}  # fmt: skip


def step_train(t, starts, length, size):
    """Doublets at given times, by a hand: no derivative taken of samples follows a step of a moment."""
    made = np.zeros(len(t))
    for start in starts:
        made += size * (((t >= start) & (t < start + length)).astype(float))
        made -= size * (((t >= start + length) & (t < start + 2 * length)).astype(float))
    return gaussian_filter1d(made, 4.0)


def excite(t, k=0, pitch=0.04, roll=0.05, yaw=0.04):
    """Departures of the controls from trim, another sequence for each k."""
    return {
        "de": step_train(t, (1.0 + 0.7 * k, 12.0 - k), 0.9, pitch),
        "da": step_train(t, (5.0 - 0.5 * k, 16.5 - k), 0.8, roll * (-1.0) ** k),
        "dr": step_train(t, (8.0 + 0.6 * k, 15.0 + k), 1.0, yaw),
    }


def fly(
    extra,
    speeds=(42.0, 50.0),
    inputs=excite,
    h=(1000.0, 1000.0),
    definitions=None,
    states=None,
    base=TRUTH,
    aircraft=AIRCRAFT,
    **more,
):
    """Flights, each with the simulation `base` at its exact states, of a truth with `extra` terms by response.

    `states` are those of the truth, `definitions` its formulas, both by the name that the terms use.
    `more` are further inputs by name, arrays or functions of the number of the flight. They are recorded even where
    neither the simulation nor the truth has a term of them.
    """
    simulation = model_of(base)
    truth = model_of({r: {**base[r], **extra.get(r, {})} for r in base}, states=states or {})
    seen = Aircraft(**{**aircraft.model_dump(exclude={"schema_name"}), "sensors": {}})
    recordings, stated = [], []
    for k, V in enumerate(speeds):
        start = trim(simulation, aircraft, V, h[k])
        further = {n: x(k) if callable(x) else x for n, x in more.items()}
        moves = start.inputs(T, **inputs(T, k)) | further
        simulated = [
            simulate(truth, aircraft, moves, start=start, definitions=definitions, instruments=i, outside="ignore")
            for i in (Instruments(noise=NOISE, seed=k), None)
        ]
        kept = {n: np.broadcast_to(x, T.shape) for n, x in further.items() if n not in simulated[0]}
        recordings.append(Recording(f"m{k + 1:02d}", simulated[0].t, {**simulated[0].channels, **kept}))
        stated.append(simulation.evaluate(compute_coefficients(simulated[1], seen), outside="ignore"))
    return recordings, stated


def ready(recordings, stated, aircraft=AIRCRAFT):
    """Flights to be explained, with a stand-in for the simulation."""
    flights = [prepare_flight(r, aircraft, s) for r, s in zip(recordings, stated)]
    stand_in = identify(flights, stated, [r for r in COEFFICIENTS if r in stated[0]])
    return [replace(f, surrogate=stand_in) for f in flights]


def flights_with(extra, **options):
    return ready(*fly(extra, **options))


def tried(flights, *effects):
    """Comparison problem of some flights, and the library of the effects to be tried."""
    library = work_out([h for h in EFFECTS if h.name in effects], flights, flights[0].responses)
    return DiagnosisProblem.set_up(flights, library.signatures), library
