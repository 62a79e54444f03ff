"""Two manoeuvres without noise whose truth differs from the simulation, and their differences."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight, prepare_flight
from structsel.comparison.simulations import open_simulation
from structsel.comparison.surrogate import identify
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import COEFFICIENTS
from structsel.recording import Recording
from structsel.simulation import Instruments, Trim, simulate, trim

TERMS = {
    "CX": {"1": -0.035, "alpha": 0.003, "alpha^2": 4.5},
    "CY": {"beta": -0.77, "p_hat": -0.124, "r_hat": 0.37, "dr": 0.116},
    "CZ": {"1": -0.055, "alpha": -5.58, "q_hat": -6.0, "de": -0.4},
    "Cl": {"beta": -0.062, "p_hat": -0.5, "r_hat": 0.17, "da": -0.1, "dr": 0.007},
    "Cm": {"1": 0.03, "alpha": -0.9, "q_hat": -31.0, "de": -1.92},
    "Cn": {"beta": 0.06, "p_hat": -0.06, "r_hat": -0.11, "da": -0.004, "dr": -0.083},
}
AIRCRAFT = Aircraft(
    name="small aeroplane", mass=2288.0, S=23.23, b=14.63, cbar=1.5875,
    inertia={"Ix": 5368.0, "Iy": 6929.0, "Iz": 11159.0, "Ixz": 118.0},
    thrust={"offset": (1.8, 0.0, 0.0)}, sensors={"vane": {"position": (2.0, 0.0, 0.0)}},
)  # fmt: skip
CHANNELS = (
    *("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "vn", "ve", "vd"),
    *("ax", "ay", "az", "de", "da", "dr", "thrust"),
)
DT, SECONDS = 0.02, 24.0
_PULSES = (
    ("de", 1.0, 0.05, (3, -2, 1, -1)), ("dr", 6.0, 0.12, (2, -2, 1, -1)), ("da", 10.0, 0.08, (1, -2, 1)),
    ("de", 14.0, -0.07, (1, -1, 2, -2)), ("dr", 18.0, -0.08, (1, -2, 1)), ("da", 20.0, -0.06, (1, -2, 1)),
)  # fmt: skip


def aerodynamics(more: Mapping[str, Mapping[str, float]] | None = None) -> AeroModel:
    """The model, with further terms."""
    terms = {r: {**t, **((more or {}).get(r, {}))} for r, t in TERMS.items()}
    return AeroModel({r: ResponseModel(tuple(t), np.array(list(t.values()))) for r, t in terms.items()}, "small")


@cache
def trimmed(k: int) -> Trim:
    return trim(aerodynamics(), AIRCRAFT, 50.0 + 8.0 * k, 1000.0)


def inputs(k: int, size: float = 1.0) -> dict[str, np.ndarray]:
    """Pulses on elevator, rudder and ailerons, and throttle steps, about a trim."""
    t = np.arange(0.0, SECONDS, DT)
    more = {c: np.zeros_like(t) for c in ("de", "da", "dr", "thrust")}
    unit = (0.35, 0.5)[k]
    for control, at, amplitude, steps in _PULSES:
        for step in steps:
            end = at + abs(step) * unit
            more[control][(t >= at) & (t < end)] += size * amplitude * np.sign(step) * (1.0, -0.8)[k]
            at = end
    for when, force in ((3.0, 1500.0), (9.0, -2000.0), (13.0, 1000.0), (17.0, -500.0)):
        more["thrust"][t >= when] += force * (1.0, 0.7)[k]
    # Corners of a pilot's hand: no derivative of the motion jumps between samples.
    rounding = np.hanning(15) / np.hanning(15).sum()
    more = {c: np.convolve(np.pad(x, 7, mode="edge"), rounding, mode="valid") for c, x in more.items()}
    return trimmed(k).inputs(t, **more)


def fly(
    truth: AeroModel | None = None,
    aircraft: Aircraft = AIRCRAFT,
    *,
    instruments: Instruments | None = None,
    true_inputs: Mapping[str, Any] | None = None,
    size: float = 1.0,
    **more: Any,
) -> list[Recording]:
    """Two manoeuvres.

    Parameters
    ----------
    truth : AeroModel
        What flies.
    instruments : Instruments
        Faults of what is recorded; by default none, and no noise.
    true_inputs : mapping of channel to callable
        True time history of an input, from the recorded one.
    """
    made = []
    for k in range(2):
        recorded = inputs(k, size)
        true = {c: (true_inputs or {}).get(c, lambda x: x)(x) for c, x in recorded.items()}
        flight = simulate(
            truth or aerodynamics(), aircraft, true, start=trimmed(k), instruments=instruments or Instruments(), **more
        )
        channels = {c: flight[c] for c in CHANNELS}
        channels |= {c: np.broadcast_to(recorded[c], flight.t.shape) for c in true_inputs or {}}
        made.append(Recording(f"m{k}", flight.t, channels))
    return made


def _as_they_are(channels: Sequence[np.ndarray], t: np.ndarray, *, order: int) -> list[SimpleNamespace]:
    return [SimpleNamespace(values=x) for x in channels]


def compare(recordings: Sequence[Recording], aircraft: Aircraft = AIRCRAFT) -> list[Flight]:
    """Recordings compared with the model, which is evaluated at the recorded channels.

    Parameters
    ----------
    recordings : sequence of Recording
    aircraft : Aircraft
        As the simulation assumes it.
    """
    simulation = open_simulation(aerodynamics(), recordings, aircraft)
    assert simulation.evaluate is not None
    simulated = [simulation.evaluate(r) for r in recordings]
    # Exact recordings have nothing to smooth, and the smoother would take most of the time.
    with patch("structsel.comparison.inertial_air_data.smooth_splines", _as_they_are):
        flights = [prepare_flight(r, aircraft, s) for r, s in zip(recordings, simulated)]
    stand_in = identify(flights, [f.simulated for f in flights], COEFFICIENTS)
    return [replace(f, surrogate=stand_in) for f in flights]
