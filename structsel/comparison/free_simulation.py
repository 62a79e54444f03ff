"""Coefficients of a free simulation along the recorded path, identified from its own flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.comparison.checking import check_free_simulations
from structsel.comparison.flight import Flight, prepare_flight
from structsel.comparison.responses import Rate
from structsel.comparison.simulations import OpenedSimulation
from structsel.comparison.surrogate import Surrogate, identify
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION, FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.recording import Recording

_INPUTS = ("de", "da", "dr", *CONFIGURATION, "throttle")
_MOVING = ("alpha", "beta", "p", "q", "r")
_FROM_RECORDING = ("rho", "mass", "thrust", "throttle", *CONFIGURATION, "h_agl", "rpm")
_POOR = 0.9  # R2, below which a simulation's own flights determine a response only in part


def _averaged(increments: Array, dt: float) -> Array:
    """Rate of an integral of which the increment of each step is given."""
    return Rate(dt)(np.concatenate([[0.0], np.cumsum(increments)]))


_BETWEEN: Mapping[str, Callable[[Array, float], Array]] = {
    "as read": lambda x, dt: x,
    "straight": lambda x, dt: Rate(dt)(scipy.integrate.cumulative_trapezoid(x, dx=dt, initial=0.0)),
    "held after": lambda x, dt: _averaged(dt * x[:-1], dt),
    "held before": lambda x, dt: _averaged(dt * x[1:], dt),
}
"""What an input did between two samples, averaged as a derivative is of what acted, but for "as read".

Angular rates are differentiated: their derivative is an average over the neighbouring samples. Forces are read.

An integrator that writes its state before a step holds a sample's input after it; one that writes it afterwards,
before it.
"""


def along_recordings(
    flights: Sequence[Flight], simulation: OpenedSimulation, aircraft: Aircraft, recordings: Sequence[Recording]
) -> tuple[list[Flight], list[str]]:
    """Flights with the coefficients of a free simulation at the recorded states, and remarks.

    Parameters
    ----------
    flights : sequence of Flight
        As recorded.
    simulation : OpenedSimulation
        With its own flights.
    aircraft : Aircraft
    recordings : sequence of Recording

    Raises
    ------
    DataError
        Simulated flights that do not match the recordings.
    """
    check_free_simulations(simulation.flights, recordings, simulation.name)
    own = [_own_flight(f, simulation.flights[f.name], aircraft) for f in flights]
    responses = [c for c in flights[0].simulated if all(c in o.measured for o in own)]
    known = _identified(own, responses)
    poor = [f"{c} ({known[c].r2[c]:.0%})" for c in responses if known[c].r2[c] < _POOR]
    remarks = []
    if poor:
        remarks.append(
            f"the simulation's own flights determine its {', '.join(poor)} only in part: they move too little there"
        )
    errors = {c: float(np.sqrt(max(0.0, 1.0 - known[c].r2[c]))) for c in responses}
    made = []
    for f, simulated in zip(flights, _evaluated(flights, known)):
        measured: Mapping[str, Array] = {c: x for c, x in f.measured.items() if c in simulated or c not in COEFFICIENTS}
        made.append(replace(f, simulated=simulated, measured=measured, form_error=errors))
    return made, remarks


def _own_flight(flight: Flight, simulated: Recording, aircraft: Aircraft) -> Flight:
    """A simulated flight, with what it does not state taken from the recording."""
    filled = {c: np.asarray(simulated[c]) for c in simulated.names}
    if len(simulated) == len(flight):
        filled |= {c: flight.channels[c] for c in _FROM_RECORDING if c not in filled and c in flight.channels}
    nothing = {c: np.zeros(len(simulated)) for c in flight.simulated}
    return prepare_flight(Recording(flight.name, simulated.t, filled), aircraft, nothing)


def _identified(own: Sequence[Flight], responses: Sequence[str]) -> dict[str, Surrogate]:
    """Model of each response, inputs between the samples taken as it fits best: a simulation has no noise."""
    measured = [o.measured for o in own]
    exact = [{c: o.raw[c] for c in _MOVING if c in o.raw} for o in own]
    tried = [
        identify([_averaged_channels(o, way, x) for o, x in zip(own, exact)], measured, responses) for way in _BETWEEN
    ]
    return {c: max(tried, key=lambda s: s.r2[c]) for c in responses}


def _averaged_channels(flight: Flight, way: str, air: Mapping[str, Array]) -> Flight:
    """A flight with `air` in place of its smooth channels, and its inputs taken one way, both averaged alike."""
    # Inputs are not smoothed here: what jumps would be rounded, and their noise is small compared with their motion.
    inputs = {c: _BETWEEN[way](flight.raw[c], flight.dt) for c in _INPUTS if c in flight.raw}
    made = {**flight.channels, **air}
    if way != "as read":
        made |= {c: _BETWEEN["straight"](made[c], flight.dt) for c in _MOVING}
    return replace(flight, channels={**made, **inputs})


def _evaluated(flights: Sequence[Flight], known: Mapping[str, Surrogate]) -> list[dict[str, Array]]:
    """Responses of a model along flights, inputs between the samples taken as they fit best.

    All moments of a flight have the same inputs, and all forces: were they taken differently, one surface would seem to
    be late. A step acts from its sample on, a sweep moves on between samples.
    """
    made: list[dict[str, Array]] = []
    for f in flights:
        moved = {way: _averaged_channels(f, way, f.air) for way in _BETWEEN}
        answers = {way: {c: model.evaluate(g, c) for c, model in known.items()} for way, g in moved.items()}
        chosen: dict[str, Array] = {}
        for group in (FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS):
            mine = [c for c in known if c in group]
            best = min(answers, key=lambda way: sum(_misfit(f, c, answers[way][c]) for c in mine))
            chosen |= {c: answers[best][c] for c in mine}
        made.append(chosen)
    return made


def _misfit(flight: Flight, response: str, answer: Array) -> float:
    """Logarithm of the residual variance of a response."""
    return float(np.log(max(float(np.var(flight.measured[response] - answer)), 1e-300)))
