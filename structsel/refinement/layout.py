"""From what is asked for to the list of parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from structsel.errors import DataError, ModelError
from structsel.nomenclature import suggest
from structsel.recording import Recording
from structsel.refinement.parameters import Parameter
from structsel.refinement.problem import FlightModel, require_even_clock
from structsel.refinement.settings import Names, RefineOptions

_FIRST = 5  # samples whose median is an output's first guess at rest
_LATEST = 0.25  # of the shortest recording: the delay's upper bound where none is given
_PROCESS = (1e-4, 0.3, 10.0)
"""Least process noise of a state, where its search starts, and most, per root of a second and by how much the state
moves: the least leaves the flight alone, the most takes the state from the measurements."""


def check_recordings(recordings: Sequence[Recording]) -> None:
    """Refuse no recordings, two of one name, and uneven clocks.

    Raises
    ------
    DataError
    """
    if not recordings:
        raise DataError("refine needs at least one recording; it was given none.")
    names = [r.name for r in recordings]
    if len(set(names)) < len(names):
        raise DataError(f"refine tells recordings apart by name; these are {', '.join(names)}.")
    for recording in recordings:
        require_even_clock(recording)


def choose_outputs(flight: FlightModel, recordings: Sequence[Recording], outputs: Iterable[str] | None) -> list[str]:
    """Outputs to fit.

    Raises
    ------
    ModelError, ChannelError
        The model, or a recording, has none of that name.
    DataError
        No output of the model is in all recordings.
    """
    if outputs is None:
        shown = [name for name in flight.shown if all(name in r for r in recordings)]
        if not shown:
            raise DataError(f"no output of the model ({', '.join(flight.shown)}) is in all recordings.")
    else:
        shown = list(outputs)
        for name in shown:
            if name not in flight.outputs:
                raise ModelError(f"'{flight.name}' has no output '{name}'. It has: {', '.join(flight.outputs)}.")
        for recording in recordings:
            recording.require(*shown, by="refine")
    for name in shown:
        if not any(np.isfinite(r[name]).any() for r in recordings):
            raise DataError(f"refine is to fit output '{name}', of which no recording has a sample. Leave it out.")
    return shown


def _chosen(names: Names, among: Sequence[str], what: str, flight: FlightModel) -> list[str]:
    chosen = list(among) if isinstance(names, str) and names == "all" else list(names)
    for name in chosen:
        if name not in among:
            raise ModelError(
                f"refine was asked for {what} '{name}'; '{flight.name}' has: {', '.join(among)}.{suggest(name, among)}"
            )
    return chosen


def build_parameters(
    flight: FlightModel, recordings: Sequence[Recording], outputs: Sequence[str], options: RefineOptions
) -> list[Parameter]:
    """Every parameter to estimate, in the order of the table in parameters.py."""
    in_time = options.domain == "time"
    starts, jumps = (options.starts, ()) if in_time else ((), options.starts)
    process = options.process if options.noise == "process" else ()
    guess = options.guess or {}
    values = flight.parameters
    made = [
        Parameter(name, "model", values[name], scale=abs(values[name]) or 1.0)
        for name in _chosen(options.free, tuple(values), "the model's parameter", flight)
    ]
    spread = {name: max(float(np.nanstd(r[name])) for r in recordings) or 1.0 for name in outputs}
    states = _chosen(starts, flight.states, "the start of state", flight)
    drifting = _chosen(options.drifts, flight.drifting, "the drift of state", flight)
    biased = _chosen(options.biases, outputs, "the bias of output", flight)
    for r in recordings:
        at = dict(zip(flight.states, flight.first_state(r)))
        made += [Parameter(f"start:{r.name}:{s}", "start", float(at[s]), scale=spread.get(s, 1.0), recording=r.name)
                 for s in states]  # fmt: skip
        made += [Parameter(f"drift:{r.name}:{s}", "drift", 0.0, scale=spread.get(s, 1.0), recording=r.name)
                 for s in drifting]  # fmt: skip
        made += [Parameter(f"bias:{r.name}:{o}", "bias", 0.0, scale=spread[o], recording=r.name) for o in biased]
    for o in _chosen(options.references, outputs, "the reference of output", flight):
        at_rest = float(np.nanmedian(np.concatenate([r[o][:_FIRST] for r in recordings]))) if flight.from_rest else 0.0
        value = at_rest if np.isfinite(at_rest) else 0.0
        made.append(Parameter(f"reference:{o}", "reference", value, scale=spread[o]))
    for o in _chosen(options.scales, outputs, "the scale of output", flight):
        made.append(Parameter(f"scale:{o}", "scale", 1.0))
    if options.delay:
        latest = _LATEST * min(r.duration for r in recordings)
        dt = max(r.dt for r in recordings)
        made.append(Parameter("delay", "delay", min(max(flight.delay, dt), latest), 0.0, latest, dt))
    for r in recordings:
        made += [Parameter(f"jump:{r.name}:{s}", "jump", 0.0, scale=spread.get(s, 1.0), recording=r.name)
                 for s in _chosen(jumps, flight.states, "the jump of state", flight)]  # fmt: skip
    among = flight.states if process != "all" else flight.noisy(outputs)
    for s in _chosen(process, among, "the process noise of state", flight):
        size = _moves(s, recordings)
        low, value, high = (share * size for share in _PROCESS)
        made.append(Parameter(f"process:{s}", "process", value, low, high, size))
    known = [p.name for p in made]
    for name in guess:
        if name not in known:
            raise ModelError(f"refine was given a guess of '{name}', which is not estimated.{suggest(name, known)}")
    return [
        Parameter(p.name, p.kind, float(guess.get(p.name, p.value)), p.low, p.high, p.scale, p.recording) for p in made
    ]


def _moves(state: str, recordings: Sequence[Recording]) -> float:
    """How much a state moves in the recordings; 1 where they do not say."""
    spread = []
    for r in recordings:
        made = {name: r[name] for name in (state, "V", "alpha", "beta") if name in r}
        if "V" in made:
            V = np.nanmean(made["V"])
            made |= {"u": made.get("u", made["V"])}
            made |= {name: made.get(name, V * made[angle]) for name, angle in (("w", "alpha"), ("v", "beta")) if
                     angle in made}  # fmt: skip
        if state in made:
            spread.append(float(np.nanstd(made[state])))
    found = max(spread, default=1.0)
    return found if np.isfinite(found) and found > 0.0 else 1.0


def check_delay(parameters: Sequence[Parameter], flight: FlightModel, recordings: Sequence[Recording]) -> None:
    """Refuse a delay that no recording could show."""
    longest = max([flight.delay, *(p.high for p in parameters if p.kind == "delay")])
    for p in parameters:
        if p.kind == "delay" and p.low < 0.0:
            raise ModelError(f"refine was given a delay from {p.low:g} s; inputs cannot act before they are made.")
    for r in recordings:
        if longest >= r.duration:
            raise DataError(
                f"refine is to delay the inputs by up to {longest:g} s; '{r.name}' lasts {r.duration:g} s, so they "
                "would never act. Bound the delay with bounds={'delay': (0, ...)}, or leave the recording out."
            )
