"""replay(): a model flown with recorded inputs from the recorded start, against what was recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ChannelError, DataError, DomainError, ModelError
from structsel.model import AeroModel
from structsel.nomenclature import suggest
from structsel.numerics.flight_dynamics import REASONS, STATES
from structsel.recording import Recording
from structsel.simulation import Air, prepare
from structsel.simulation.preparing import first_state
from structsel.validation.metrics import Normaliser
from structsel.validation.replayed import Departure, Replay, score_output

BANDS: Mapping[str, float] = {
    "V": 1.543,
    **dict.fromkeys(("alpha", "beta", "theta"), 0.0262),
    **dict.fromkeys(("phi", "psi"), 0.0349),
    **dict.fromkeys(("p", "q", "r"), 0.0349),
    **dict.fromkeys(("ax", "ay", "az"), 0.981),
    "h": 30.48,
}
"""Proof-of-match bands: 3 kt, 1.5 deg, 2 deg, 2 deg/s, 0.1 g, 100 ft, either way [FSTD]; where the rules have none, the
like of their neighbours."""

_ALONG, _ACROSS = ("V", "alpha", "q", "theta", "ax", "az"), ("beta", "p", "r", "phi", "ay")
_SHOWN = (*_ALONG, *_ACROSS, "psi", "h")
_LATERAL = ("CY", "Cl", "Cn")
_SIDEWAYS = ("v", "p", "r", "phi")
_FEWEST = 10  # samples of a recording
_PARTED = 1.0  # of the measured range: an error beyond it, and the flights have no more to do with each other


def replay(
    model: AeroModel,
    aircraft: Aircraft,
    recordings: Recording | Sequence[Recording],
    *,
    outputs: Iterable[str] | None = None,
    window: float = 4.0,
    bands: Mapping[str, float] | None = None,
    normaliser: Normaliser = "rms",
    air: Air | None = None,
    definitions: Mapping[str, str] | None = None,
    substeps: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Replay:
    """Fly a model with recorded inputs, and score the outputs it gives against those recorded.

    Each manoeuvre is flown twice: whole, from its first sample on, as a simulator would be judged; and in short
    windows that each start from what was recorded, so that errors cannot pile up and an aircraft that is unstable
    without its pilot can be judged as well. Outputs are what the instruments read at their places.

    Parameters
    ----------
    model : AeroModel
    aircraft : Aircraft
        With mass, inertia and the places of the instruments.
    recordings : Recording or sequence of Recording
        With the inputs the model flies on, and V, alpha, theta and h to start from; reconstructed ones start best.
    outputs : iterable of str, optional
        Channels to score; by default those of V, alpha, q, theta, ax, az, and for a model with lateral coefficients
        beta, p, r, phi, ay, that all recordings have. Samples of NaN are passed over.
    window : float [s]
        Length of the short windows; two periods of the short period or so.
    bands : mapping of channel to float, optional
        Half-widths of the proof-of-match bands; `BANDS` where not named.
    normaliser : {"rms", "std", "range"}
        See `rrmse`.
    air, definitions, substeps
        As `structsel.simulation.simulate` takes them.
    progress : callable, optional
        Called with the recording's name, windows flown and windows in all.

    Returns
    -------
    Replay
        A flight that blows up, or parts from the recorded one, is named in it with the time, and scored up to there.

    Raises
    ------
    ModelError
        Outputs that a flight does not give, or a window that is not above zero.
    ChannelError, DataError
        A recording lacks an input, an output or what a flight starts from, is too short, or an input is not finite.
    AircraftError
        There is no mass or no inertia.

    References
    ----------
    [M86], [J15], [FSTD].
    """
    flown = [recordings] if isinstance(recordings, Recording) else list(recordings)
    _check(flown, window, normaliser)
    lateral = any(name in model for name in _LATERAL)
    shown = _choose(flown, outputs, lateral)
    held = {**BANDS, **(bands or {})}
    if strange := [name for name in bands or {} if not held[name] > 0.0]:
        raise DomainError(f"replay needs bands above zero; that of '{strange[0]}' is {held[strange[0]]:g}.")
    scores, pooled, departures, doubts = [], [], [], []
    simulated: dict[str, list[Recording]] = {"whole": [], "windows": []}
    for recording in flown:
        craft = {"air": air, "definitions": definitions, "substeps": substeps}
        rows = window_rows(recording, window)
        pieces = {"whole": [slice(0, len(recording))], "windows": rows}
        for kind, parts in pieces.items():
            made = np.full((len(recording), len(shown)), np.nan)
            for i, part in enumerate(parts):
                y, reason = _fly(model, aircraft, _cut(recording, part), shown, craft)
                made[part.start : part.start + len(y)] = y
                if reason:
                    at = float(recording.t[min(part.start + len(y), len(recording) - 1)])
                    departures.append(Departure(recording.name, kind, float(recording.t[part.start]), at, reason))
                if progress is not None and kind == "windows":
                    progress(recording.name, i + 1, len(parts))
            channels = dict(zip(shown, made.T))
            if kind == "whole":
                departures += _parting(recording, channels, held)
            scores += [
                score_output(
                    kind, recording.name, name, [(recording[name], channels[name])], held.get(name), normaliser
                )
                for name in shown
            ]
            note = f"flown by replay, {'whole' if kind == 'whole' else f'in windows of {window:g} s'}"
            simulated[kind].append(recording.with_channels(note=note, **channels))  # type: ignore[arg-type]
        if recording.name in model.recordings:
            doubts.append(f"'{recording.name}' was used to identify the model: its scores describe the fit.")
    for kind, flights in simulated.items():
        for name in shown:
            pairs = [(r[name], s[name]) for r, s in zip(flown, flights)]
            pooled.append(score_output(kind, "all", name, pairs, held.get(name), normaliser))
    doubts += _doubt_region(model, flown)
    return Replay(
        model.name, shown, window, normaliser, {name: held[name] for name in shown if name in held}, tuple(scores),
        tuple(pooled), tuple(departures), tuple(flown), tuple(simulated["whole"]), tuple(simulated["windows"]),
        tuple(doubts),
    )  # fmt: skip


def _check(flown: Sequence[Recording], window: float, normaliser: str) -> None:
    if not flown:
        raise DataError("replay needs at least one recording; it was given none.")
    names = [r.name for r in flown]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise DataError(f"replay was given {', '.join(twice)} more than once. Name recordings apart.")
    if short := [r for r in flown if len(r) < _FEWEST]:
        raise DataError(f"replay needs {_FEWEST} samples or more; '{short[0].name}' has {len(short[0])}.")
    if not window > 0.0:
        raise ModelError(f"replay needs a window above zero; found {window:g} s.")
    if normaliser not in get_args(Normaliser):
        raise DomainError(f"normaliser={normaliser!r} is not one of 'rms', 'std', 'range'.")


def _choose(flown: Sequence[Recording], outputs: Iterable[str] | None, lateral: bool) -> tuple[str, ...]:
    if outputs is None:
        usual = (*_ALONG, *_ACROSS) if lateral else _ALONG
        shown = tuple(name for name in usual if all(name in r for r in flown))
        if not shown:
            raise ChannelError(f"replay found none of {', '.join(usual)} in all recordings, so nothing to compare.")
        return shown
    shown = tuple(dict.fromkeys(outputs))
    for name in shown:
        if name not in _SHOWN:
            raise ModelError(f"replay has no output '{name}'; it has {', '.join(_SHOWN)}.{suggest(name, _SHOWN)}")
    for recording in flown:
        recording.require(*shown, by="replay")
    return shown


def window_rows(recording: Recording, window: float) -> list[slice]:
    """Rows of windows of a length [s]; what is left at the end goes with the last if less than half of that."""
    n, size = len(recording), max(2, round(window / recording.dt))
    count = max(1, round(n / size))
    return [slice(size * i, n if i == count - 1 else size * (i + 1)) for i in range(count)]


def _cut(recording: Recording, rows: slice) -> Recording:
    if rows == slice(0, len(recording)):
        return recording
    parts = {name: recording[name][rows] for name in recording.names}
    return replace(recording, t=recording.t[rows], channels=parts)


def _fly(
    model: AeroModel,
    aircraft: Aircraft,
    recording: Recording,
    shown: Sequence[str],
    craft: Mapping[str, Any],
) -> tuple[np.ndarray, str]:
    """Outputs (flown, outputs) from the recorded start, and why they end before the recording does."""
    state = recorded_start(model, aircraft, recording, craft["air"])
    ready = prepare(model, aircraft, recording, start=state, **craft)
    batch = ready.fly(shown, instruments=not recording.at_cg)
    reason = int(batch.reason[0])
    return batch.outputs[0, : int(batch.flown[0])], REASONS[reason] if reason else ""


def recorded_start(
    model: AeroModel, aircraft: Aircraft, recording: Recording, air: Air | None = None
) -> dict[str, float]:
    """State at the first sample, by name, carried to the centre of gravity.

    Without lateral coefficients nothing would end a lateral motion, so none is started. In air of a given density the
    altitude is of no account, and zero where it was not recorded.

    Raises
    ------
    ChannelError, DataError
        The recording lacks what a flight starts from, or that is not finite.
    """
    if air is not None and air.rho is not None and "h" not in recording:
        recording = recording.with_channels(h=0.0)
    state = dict(zip(STATES, first_state(recording, None, aircraft, recording.name).tolist()))
    if not any(name in model for name in _LATERAL):
        state |= dict.fromkeys(_SIDEWAYS, 0.0)
    return state


def _parting(
    recording: Recording, channels: Mapping[str, np.ndarray], bands: Mapping[str, float]
) -> Iterator[Departure]:
    """Where, first, one of the outputs is off by more than all that was measured of it, and beyond its band."""
    first = len(recording)
    of = ""
    for name, flown in channels.items():
        measured = recording[name]
        seen = np.isfinite(measured) & np.isfinite(flown)
        if not seen.any() or not (reach := float(np.ptp(measured[seen]))) > 0.0:
            continue
        most = max(_PARTED * reach, bands.get(name, 0.0))
        off = np.flatnonzero(seen & (np.abs(np.where(seen, measured - flown, 0.0)) > most))
        if len(off) and off[0] < first:
            first, of = int(off[0]), name
    if of:
        why = f"{of} is off by more than its measured range"
        yield Departure(recording.name, "whole", float(recording.t[0]), float(recording.t[first]), why)


def _doubt_region(model: AeroModel, flown: Sequence[Recording]) -> list[str]:
    said = []
    for recording in flown:
        known = [name for name in model.region if name in recording]
        excursions = model.leaves_region({name: recording[name] for name in known})
        said += [f"'{recording.name}' leaves the region the model was identified in: {e}" for e in excursions]
    return said
