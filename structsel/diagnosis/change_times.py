"""Changes of the differences that no channel tells of: an event in a flight; a step or another gain of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.comparison.causal_rows import CausalRows, Null
from structsel.comparison.flight import Flight
from structsel.diagnosis.event import Event
from structsel.effects.changes import Sought
from structsel.numerics.arrays import Array

_SIZES = np.geomspace(0.02, 2.0, 5)  # of an event, relative to the rms variation of the simulated response
_SHAPES = ("step", "pulse", "pulse", "ramp")
_EVERY = 1.0  # s, between the times at which events are sought
_BLOCK = 0.2  # of a plant's own time, over which differences are averaged
_UNITS = 80.0  # of a plant's own time, that a recording lasts


def shapes(t: Array, every: float = _EVERY) -> tuple[Array, list[str], Array]:
    """Steps, pulses and ramps on a grid of times: columns (n, k), their shapes and times."""
    at = np.arange(1.5, t[-1] - 1.5, every)
    off = t[:, None] - at
    columns = [(off >= 0.0).astype(float)]
    columns += [np.where(np.abs(off) < w / 2.0, 0.5 * (1.0 + np.cos(2.0 * np.pi * off / w)), 0.0) for w in (1.0, 4.0)]
    columns.append(np.clip(off / 5.0, 0.0, 1.0))
    return np.hstack(columns), [s for s in _SHAPES for _ in at], np.tile(at, len(_SHAPES))


def find_event(rows: CausalRows, null: Null, i: int) -> tuple[float, Event]:
    """Log Bayes factor of an event in one flight, and the most probable one."""
    f = rows.flights[i]
    S, shape, at = shapes(f.t - f.t[0])
    if not len(at):  # too short for an event
        return 0.0, Event(f.name, float(f.t[0]), 0.0, _SHAPES[0])
    total = np.zeros(len(at))
    for c in rows.responses:
        each = rows.single(null, c, {i: rows.inside(S)}, _SIZES * rows.size[c])
        one = scipy.special.logsumexp(each, axis=1) - np.log(len(_SIZES))
        total += np.logaddexp(0.0, one) - np.log(2.0)
    best = shape[int(np.argmax(total))]
    same = np.array([s == best for s in shape])
    weight = scipy.special.softmax(total[same])
    t = float(weight @ at[same])
    std = float(np.sqrt(weight @ (at[same] - t) ** 2 + _EVERY**2 / 12.0))  # the grid adds its own
    log_bayes = float(scipy.special.logsumexp(total) - np.log(len(total)))
    return log_bayes, Event(f.name, float(f.t[0]) + t, std, best)


@dataclass(frozen=True, eq=False)
class _SoughtStep:
    """The likeliest step of one response in one recording.

    Attributes
    ----------
    of : str
        "level" or "gain".
    column : (n,) array
        What it adds at size one: the response's rms, or its simulated values.
    t, std : float [s]
        Since the first sample.
    times : int
        Number of times at which it was sought.
    """

    of: str
    column: Array
    t: float
    std: float
    times: int


def gain_columns(flights: Sequence[Flight], response: str) -> list[Array]:
    """(n, flights + 1) columns of each flight: gain of that flight alone, and gain that grows along every flight."""
    made = []
    for i, f in enumerate(flights):
        x = f.simulated[response]
        own = np.zeros((len(f), len(flights)))
        own[:, i] = x
        made.append(np.column_stack([own, x * np.linspace(-0.5, 0.5, len(f))]))
    return made


def _likeliest_steps(flight: Flight, response: str, size: float) -> list[_SoughtStep]:
    """The likeliest step of the level and of the gain; empty where the recording is too short."""
    own = replace(flight, t=np.linspace(0.0, _UNITS, len(flight)), dt=_UNITS / (len(flight) - 1))
    made = []
    for of, course in (("level", np.full(len(flight), size)), ("gain", flight.simulated[response])):
        coarse, fine = (
            Sought.of([own], [response], [], step, lambda f, x=course: x)  # type: ignore[misc]
            for step in (max(1, round(_BLOCK / own.dt)), 1)
        )
        starts = coarse.starts(0.0)
        if not len(starts):
            continue
        sizes, norm = coarse.fitted(starts, 0.0)
        weight = scipy.special.softmax(coarse.gains(sizes**2 * norm[:, None]))
        nearby = fine.t[np.abs(fine.t - starts[np.argmax(weight)]) <= _BLOCK]
        unit, change = flight.dt / own.dt, fine.best(nearby, 0.0)
        std = max(unit * float(np.sqrt(weight @ (starts - change.start) ** 2)), flight.dt)
        made.append(_SoughtStep(of, course * change.along(own), unit * change.start, std, len(starts)))
    return made


def find_steps(rows: CausalRows, null: Null) -> list[tuple[float, Event]]:
    """Log Bayes factor of a step of the level or of the gain in each recording of a plant, and the most probable one.

    The noise is found anew with it: one that was estimated without it takes a step for slow noise.
    """
    nothing = [np.zeros((len(f) - 2 * rows.edge, 1)) for f in rows.flights]
    # Noise that is found anew may be a little more probable without any step.
    anew = {c: max(rows.remainder(null, c, nothing, _SIZES[:1]).log_bayes, 0.0) for c in rows.responses}
    made = []
    for i, f in enumerate(rows.flights):
        logs, events = [], []
        for c in rows.responses:
            for one in _likeliest_steps(f, c, rows.size[c]):
                columns = list(nothing)
                columns[i] = rows.inside(one.column[:, None])
                found = rows.remainder(null, c, columns, _SIZES)
                logs.append(found.log_bayes - anew[c] - np.log(one.times))
                by = float(found.coefficients[0])
                size = f"{100.0 * by:+.0f} %" if one.of == "gain" else f"{by * rows.size[c]:+.3g}"
                events.append(Event(f.name, float(f.t[0]) + one.t, one.std, "step", f"the {one.of} of {c} by {size}"))
        if logs:
            log_bayes = float(scipy.special.logsumexp(logs) - np.log(len(logs)))
            made.append((log_bayes, events[int(np.argmax(logs))]))
        else:
            made.append((0.0, Event(f.name, float(f.t[0]), 0.0, "step")))
    return made
