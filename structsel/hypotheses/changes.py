"""Where in time a difference jumps: candidates for events that no channel tells of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.hypotheses.base import Flights
from structsel.hypotheses.signals import CHANNELS_OF, held, moves
from structsel.mismatch.flight import Flight
from structsel.numerics.smoothing.result import Array

_BLOCK = 0.2  # s, over which differences are averaged
_EDGE = 1.5  # s, at both ends of a manoeuvre, in which no change is sought
_MEMORY = 1.0  # s between samples that count as independent
_OWN = 0.05  # of a change's variance, that channels must leave for it to be told from them
_APART = 3.0  # s between two changes of one manoeuvre


@dataclass(frozen=True, eq=False)
class Change:
    """A step or ramp in the differences of one manoeuvre.

    Attributes
    ----------
    flight : str
    start, duration : float [s]
    gain : float
        In log likelihood, roughly.
    size : (r,) array
        By response, in units of its residual.
    """

    flight: str
    start: float
    duration: float
    gain: float
    size: Array

    def along(self, flight: Flight) -> Array:
        """From zero to one as it happens; zero in other manoeuvres."""
        if flight.name != self.flight:
            return np.zeros(len(flight))
        return ramp(flight.t, self.start, self.duration)


def ramp(t: Array, start: float, duration: float) -> Array:
    """Zero to one from `start` within `duration`; at once where that is zero."""
    if duration <= 0.0:
        return (t >= start).astype(float)
    return np.clip((t - start) / duration, 0.0, 1.0)


def find_changes(
    flights: Flights, responses: Sequence[str], durations: Sequence[float] = (0.0,), each: int = 2
) -> list[Change]:
    """Likeliest changes of every manoeuvre, at most `each` per duration, best first.

    What the simulation's linear terms could explain in the same manoeuvre is allowed for, so that wrong values of
    those are not taken for events.
    """
    wanted = held(flights, responses)
    channels = [c for c in dict.fromkeys(c for r in wanted for c in CHANNELS_OF[r]) if moves(flights, c)]
    found = []
    for f in flights:
        if not wanted or any(r not in f.measured for r in wanted):
            continue
        step = max(1, round(_BLOCK / f.dt))
        n = len(f) // step * step
        t = _averaged(f.t[:n], step)
        y = _centred(_averaged(np.column_stack([f.difference[r][:n] for r in wanted]), step))
        basis = _basis(_centred(_averaged(np.column_stack([f[c][:n] for c in channels] or [np.zeros(n)]), step)))
        left = y - basis @ (basis.T @ y)
        for duration in durations:
            found += _best(f.name, t, left, basis, duration, each)
    return sorted(found, key=lambda change: -change.gain)


def _basis(x: Array) -> Array:
    """Orthonormal columns that span those of x; directions that are but rounding are left out."""
    scaled = x / np.maximum(np.sqrt((x**2).sum(axis=0)), 1e-30)
    U, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return U[:, s > 1e-3]


def _averaged(x: Array, step: int) -> Array:
    return x.reshape(-1, step, *x.shape[1:]).mean(axis=1)


def _centred(x: Array) -> Array:
    return x - x.mean(axis=0)


def _best(name: str, t: Array, y: Array, basis: Array, duration: float, each: int) -> list[Change]:
    starts = t[(t > t[0] + _EDGE) & (t < t[-1] - _EDGE - 0.5 * duration)]
    if not len(starts):
        return []
    S = _centred(np.column_stack([ramp(t, s, duration) for s in starts]))
    whole = (S**2).sum(axis=0)
    S = S - basis @ (basis.T @ S)
    # A change that the channels themselves describe cannot be told from them.
    norm = np.maximum((S**2).sum(axis=0), _OWN * whole)
    size = (S.T @ y) / norm[:, None]
    share = np.clip(size**2 * norm[:, None] / np.maximum((y**2).sum(axis=0), 1e-30), 0.0, 1.0 - 1e-9)
    gains = -0.5 * (t[-1] - t[0]) / _MEMORY * np.log1p(-share).sum(axis=1)
    level = np.maximum(np.sqrt((y**2).mean(axis=0)), 1e-30)
    found: list[Change] = []
    for i in np.argsort(-gains):
        if all(abs(starts[i] - one.start) > _APART for one in found):
            found.append(Change(name, float(starts[i]), duration, float(gains[i]), size[i] / level))
        if len(found) == each:
            break
    return found
