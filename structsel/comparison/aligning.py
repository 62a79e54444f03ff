"""Flow angles without their delay, where the simulation agrees better with these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.flow_angle_delays import FlowAngleDelay, find_flow_angle_delays
from structsel.comparison.prediction_filter import Filter
from structsel.comparison.simulations import OpenedSimulation
from structsel.formatting import format_estimate, join_names
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import delayed
from structsel.recording import Recording

_NAMED = 0.5  # probability of a delay from which it may be removed
_ORDER = 12  # samples of its past from which a difference is predicted
_PLAIN = {"alpha": "the angle of attack", "beta": "the angle of sideslip"}

Flown = tuple[list[Flight], list[str]]
"""Flights with the simulation along them, and remarks."""
Compare = Callable[[Sequence[Recording], OpenedSimulation], Flown]


@dataclass(frozen=True, eq=False)
class Alignment:
    """Flights after delays of the flow angles were removed.

    Attributes
    ----------
    flights : sequence of Flight
    delays : tuple of FlowAngleDelay
        Those that were removed.
    before : sequence of Flight
        As recorded; empty if nothing was removed.
    remarks : tuple of str
    """

    flights: Sequence[Flight]
    delays: tuple[FlowAngleDelay, ...] = ()
    before: Sequence[Flight] = ()
    remarks: tuple[str, ...] = ()


def align(found: Flown, recordings: Sequence[Recording], simulation: OpenedSimulation, compare: Compare) -> Alignment:
    """Remove probable delays of the flow angles if the simulation then agrees better with the recordings.

    A simulation may have been evaluated at delayed readings, or identified from such. If it agrees better with the
    readings as they are, both sides have the delay: it is no difference between them. What was computed before is
    referred to the earlier angles, or stays as it is if it looks like a function of these rather than of those read.

    Parameters
    ----------
    found : flights and remarks
        With the recordings as they are.
    recordings : sequence of Recording
        Of the flights.
    simulation : OpenedSimulation
    compare : callable
        Recordings and a simulation to flights and remarks.
    """
    flights, remarks = found
    probable = tuple(d for d in find_flow_angle_delays(flights) if d.probability >= _NAMED)
    if not probable:
        return Alignment(flights, remarks=tuple(remarks))
    earlier = [without_delays(r, f, probable) for r, f in zip(recordings, flights)]
    stays, (made, noticed) = agreement(flights), compare(earlier, simulation)
    agreed = agreement(made)
    better = agreed > stays
    if simulation.along:
        moved = compare(earlier, _evaluated_earlier(simulation, made, flights, probable))
        if (moved_agreed := agreement(moved[0])) > agreed:
            (made, noticed), better = moved, moved_agreed > stays
        else:  # nothing but the states has changed
            better = _misfit(made) < _misfit(flights)
    says = join_names([f"{_PLAIN[d.channel]} by {format_estimate(d.delay, d.std, 's')}" for d in probable])
    late = f"accelerometers and gyros show a delay of {says}"
    if not better:
        return Alignment(flights, remarks=(*remarks, f"{late}, which the simulation has too: it stays"))
    return Alignment(made, probable, flights, (*noticed, f"{late}: it was removed before the comparison"))


def without_delays(recording: Recording, flight: Flight, delays: Sequence[FlowAngleDelay]) -> Recording:
    """The recording with earlier flow angles; those after the last reading are from accelerometers and gyros."""
    t, made = recording.t, dict(recording.channels)
    for one in delays:
        read, predicted = np.asarray(recording[one.channel], dtype=float), flight.integrated[one.channel]
        offset = read - delayed(predicted, t, one.delay)
        made[one.channel] = predicted + delayed(offset, t, -one.delay)
    return replace(recording, channels=made, findings=())


def _evaluated_earlier(
    simulation: OpenedSimulation, earlier: Sequence[Flight], late: Sequence[Flight], delays: Sequence[FlowAngleDelay]
) -> OpenedSimulation:
    """What a simulation evaluated at the delayed angles would have been at the others, by its stand-in."""
    stand_in = late[0].surrogate
    if stand_in is None:
        return simulation
    along: dict[str, Mapping[str, Array]] = {}
    for f in earlier:
        asked = {d.channel: delayed(f[d.channel], f.dt, d.delay) for d in delays}
        at_readings = replace(f, channels={**f.channels, **asked})
        along[f.name] = {
            c: x + stand_in.evaluate(f, c) - stand_in.evaluate(at_readings, c) if c in stand_in.terms else x
            for c, x in simulation.along[f.name].items()
        }
    return replace(simulation, along=along)


def _misfit(flights: Sequence[Flight]) -> float:
    """What a function of the states, the stand-in, leaves of the simulation."""
    stand_in = flights[0].surrogate
    return 0.0 if stand_in is None else stand_in.misfit


def agreement(flights: Sequence[Flight]) -> float:
    """Log likelihood of what is left of the differences by constants, an error of scale and their own past."""
    total = 0.0
    for c in (c for c in flights[0].simulated if c in COEFFICIENTS):
        simulated = [f.simulated[c] - f.simulated[c].mean() for f in flights]
        left = [f.difference[c] - f.difference[c].mean() for f in flights]
        power = sum(float(x @ x) for x in simulated)
        scale = sum(float(x @ y) for x, y in zip(simulated, left)) / power if power > 0.0 else 0.0
        one = Filter.of([y - scale * x for x, y in zip(simulated, left)], _ORDER)
        total -= 0.5 * sum((len(f) - _ORDER) * float(np.log(v)) for f, v in zip(flights, one.variance))
    return total
