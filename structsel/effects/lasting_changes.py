"""Changes that last over the recordings of one flight, until they are undone.

A flight that was cut into recordings goes on in the next one, and so does what changed in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Flights
from structsel.effects.changes import LEAST_DISTANCE, Sought, SoughtChange
from structsel.effects.signals import CHANNELS_OF, Column, held, moves
from structsel.numerics.arrays import Array

_BLOCK = 0.5  # s, over which differences are averaged
_MOST_BLOCKS = 1000  # of all recordings of a flight; longer flights have longer blocks


def lasting_changes(
    flights: Flights,
    responses: Sequence[str],
    durations: Sequence[float] = (0.0,),
    *,
    factor: Column | None = None,
) -> list[SoughtChange]:
    """Clearest change of each flight of several recordings that stays, and the clearest that is undone.

    Parameters
    ----------
    flights : sequence of Flight
    responses : sequence of str
        In which changes are sought; those that the flights have.
    durations : sequence of float [s]
        Of the change.
    factor : callable, optional
        What a change is multiplied by.
    """
    wanted = held(flights, responses)
    if not wanted:
        return []
    channels = [c for c in dict.fromkeys(c for r in wanted for c in CHANNELS_OF[r]) if moves(flights, c)]
    made = []
    for sequence in dict.fromkeys(f.sequence for f in flights if f.sequence):
        chain = sorted((f for f in flights if f.sequence == sequence), key=lambda f: float(f.t[0]))
        if any(r not in f.measured for r in wanted for f in chain):
            continue
        dt = chain[0].dt
        step = max(1, round(_BLOCK / dt), -(-sum(map(len, chain)) // _MOST_BLOCKS))
        sought = Sought.of(chain, wanted, channels, step, factor)
        for duration in durations:
            starts = sought.starts(duration)
            if len(starts):
                found = [sought.best(starts, duration), *_there_and_back(sought, starts, duration)]
                made += [_placed(one, chain) for one in found]
    return made


def _placed(change: SoughtChange, chain: Sequence[Flight]) -> SoughtChange:
    """A change on the clock of a flight, by the recordings in which its times are."""
    end = np.inf if change.until is None else change.until[1] + change.duration
    first = next(k for k, f in enumerate(chain) if change.start <= f.t[-1])
    later = tuple(f.name for f in chain[first + 1 :] if f.t[0] <= end)
    placed = replace(change, flight=chain[first].name, later=later)
    if change.until is None:
        return placed
    last = next((f for f in chain if change.until[1] <= f.t[-1]), chain[-1])
    return replace(placed, until=(last.name, change.until[1]))


def _there_and_back(sought: Sought, starts: Array, duration: float) -> list[SoughtChange]:
    """Clearest change that is undone."""
    first, last = np.nonzero(max(LEAST_DISTANCE, duration) < np.subtract.outer(starts, starts).T)
    if not len(first):
        return []
    size, norm = sought.fitted_pairs(starts, duration, first, last)
    gain = sought.gains(size**2 * norm[:, None])
    k = int(np.argmax(gain))
    until = ("", float(starts[last[k]]))
    return [SoughtChange(sought.name, float(starts[first[k]]), duration, until=until)]
