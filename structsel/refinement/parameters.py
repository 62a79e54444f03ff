"""Names of what can be estimated, and their order in the parameter vector.

============================  ================================================================================
``CL:alpha``                  term of a response of an AeroModel; a linear structure names its own
``start:m01:alpha``           state at the first sample of recording m01
``drift:m01:w``               constant added to a state equation in m01, unit of the state per second
``bias:m01:az``               constant added to an output in m01
``reference:az``              constant added to an output in all recordings
``scale:alpha``               scale factor of an output in all recordings
``delay``                     time delay of the inputs [s]
``process:w``                 process noise of a state, standard deviation per root of a second
``jump:m01:w``                state at the start of m01 less that at its end; in the frequency domain
============================  ================================================================================
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from structsel.errors import DataError, ModelError
from structsel.nomenclature import suggest
from structsel.recording import Recording, require_recordings
from structsel.refinement.protocols import RefinableModel
from structsel.refinement.settings import Names, RefineOptions

_UNEVEN = 1e-3  # of the sampling interval
_FIRST = 5  # samples whose median is the start value of an output's reference
_LONGEST_DELAY = 0.25  # of the shortest recording: upper bound where none is given
_PROCESS = (1e-4, 0.3, 10.0)
"""Process noise of a state: lower bound, start value and upper bound, per root of a second, relative to the standard
deviation of the state. The lower bound has no effect on the prediction, the upper one takes the state from the
measurements."""


Kind: TypeAlias = Literal["model", "start", "drift", "bias", "reference", "scale", "delay", "process", "jump"]


@dataclass(frozen=True)
class Parameter:
    """One parameter that can be estimated.

    Attributes
    ----------
    name : str
    kind : {"model", "start", "drift", "bias", "reference", "scale", "delay", "process", "jump"}
    value : float
        Start of the search.
    low, high : float
        Bounds, infinite where there is none.
    scale : float
        Typical size, above zero.
    recording : str
        Its recording; empty where it holds for all.
    """

    name: str
    kind: Kind
    value: float
    low: float = -np.inf
    high: float = np.inf
    scale: float = 1.0
    recording: str = ""


def bound(parameters: Sequence[Parameter], bounds: Mapping[str, tuple[float, float]]) -> list[Parameter]:
    """Parameters with these bounds, each start brought inside.

    A name that ends in a colon means all that begin so: ``"start:m01:"``.

    Raises
    ------
    ModelError
        A name that is not estimated, or bounds that cross.
    """
    found = {p.name: p for p in parameters}
    for key, (low, high) in bounds.items():
        which = [name for name in found if name == key or (key.endswith(":") and name.startswith(key))]
        if not which:
            raise ModelError(
                f"refine was given bounds of '{key}', which is not estimated.{suggest(key, found)} "
                f"Estimated are: {', '.join(found)}."
            )
        if not low < high:
            raise ModelError(f"refine was given bounds of '{key}' from {low:g} to {high:g}. Write the lower first.")
        for name in which:
            p = found[name]
            start = float(np.clip(p.value, low, high))
            found[name] = Parameter(p.name, p.kind, start, float(low), float(high), p.scale, p.recording)
    return list(found.values())


def require_even_clock(recording: Recording) -> None:
    """Refuse a clock whose steps differ.

    Raises
    ------
    DataError
        The recording, and where.
    """
    steps = np.diff(recording.t)
    off = np.abs(steps - recording.dt)
    if off.max() > _UNEVEN * recording.dt:
        i = int(np.argmax(off))
        raise DataError(
            f"refine needs recordings with an even clock; '{recording.name}' has one of {steps[i]:g} s after "
            f"t = {recording.t[i]:g} s among steps of {recording.dt:g} s. Split it at gaps with recording.split(), "
            "or interpolate it onto an even clock."
        )


def check_recordings(recordings: Sequence[Recording]) -> None:
    """Refuse no recordings, two of one name, and uneven clocks.

    Raises
    ------
    DataError
    """
    require_recordings(recordings, by="refine")
    for recording in recordings:
        require_even_clock(recording)


def choose_outputs(flight: RefinableModel, recordings: Sequence[Recording], outputs: Iterable[str] | None) -> list[str]:
    """Outputs to fit.

    Raises
    ------
    ModelError, ChannelError
        The model, or a recording, has none of that name.
    DataError
        No output of the model is in all recordings.
    """
    if outputs is None:
        default_outputs = [name for name in flight.default_outputs if all(name in r for r in recordings)]
        if not default_outputs:
            raise DataError(f"no output of the model ({', '.join(flight.default_outputs)}) is in all recordings.")
    else:
        default_outputs = list(outputs)
        for name in default_outputs:
            if name not in flight.outputs:
                raise ModelError(f"'{flight.name}' has no output '{name}'. It has: {', '.join(flight.outputs)}.")
        for recording in recordings:
            recording.require(*default_outputs, by="refine")
    for name in default_outputs:
        if not any(np.isfinite(r[name]).any() for r in recordings):
            raise DataError(f"refine was given output '{name}', but no recording has a sample of it. Leave it out.")
    return default_outputs


def _chosen(names: Names, among: Sequence[str], what: str, flight: RefinableModel) -> list[str]:
    chosen = list(among) if isinstance(names, str) and names == "all" else list(names)
    for name in chosen:
        if name not in among:
            raise ModelError(
                f"refine was given {what} '{name}'; '{flight.name}' has: {', '.join(among)}.{suggest(name, among)}"
            )
    return chosen


def build_parameters(
    flight: RefinableModel, recordings: Sequence[Recording], outputs: Sequence[str], options: RefineOptions
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
        longest = _LONGEST_DELAY * min(r.duration for r in recordings)
        dt = max(r.dt for r in recordings)
        made.append(Parameter("delay", "delay", min(max(flight.delay, dt), longest), 0.0, longest, dt))
    for r in recordings:
        made += [Parameter(f"jump:{r.name}:{s}", "jump", 0.0, scale=spread.get(s, 1.0), recording=r.name)
                 for s in _chosen(jumps, flight.states, "the jump of state", flight)]  # fmt: skip
    among = flight.states if process != "all" else flight.states_with_noise(outputs)
    for s in _chosen(process, among, "the process noise of state", flight):
        size = _spread_of(s, recordings)
        low, value, high = (fraction * size for fraction in _PROCESS)
        made.append(Parameter(f"process:{s}", "process", value, low, high, size))
    known = [p.name for p in made]
    for name in guess:
        if name not in known:
            raise ModelError(f"refine was given a guess of '{name}', which is not estimated.{suggest(name, known)}")
    return [
        Parameter(p.name, p.kind, float(guess.get(p.name, p.value)), p.low, p.high, p.scale, p.recording) for p in made
    ]


def _spread_of(state: str, recordings: Sequence[Recording]) -> float:
    """Standard deviation of a state in the recordings; 1 where it is not recorded."""
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


def check_delay(parameters: Sequence[Parameter], flight: RefinableModel, recordings: Sequence[Recording]) -> None:
    """Refuse a delay longer than a recording."""
    longest = max([flight.delay, *(p.high for p in parameters if p.kind == "delay")])
    for p in parameters:
        if p.kind == "delay" and p.low < 0.0:
            raise ModelError(f"refine was given a delay from {p.low:g} s; inputs cannot act before they occur.")
    for r in recordings:
        if longest >= r.duration:
            raise DataError(
                f"refine would delay the inputs by up to {longest:g} s; '{r.name}' lasts {r.duration:g} s, so they "
                "would never act.",
                remedy="Bound the delay with bounds={'delay': (0, ...)}, or leave the recording out.",
                cli_remedy="Bound the delay with --bounds delay=0,..., or leave the recording out.",
            )
