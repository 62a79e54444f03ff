"""resimulate(): simulate a model with the recorded inputs from the recorded state, and compare the outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ChannelError, DomainError, ModelError
from structsel.metrics import Normaliser
from structsel.model import AeroModel
from structsel.nomenclature import (
    BODY_RATES,
    LATERAL_COEFFICIENTS,
    LATERAL_OUTPUTS,
    LONGITUDINAL_OUTPUTS,
    SPECIFIC_FORCES,
    suggest,
)
from structsel.numerics.flight_model import REASONS
from structsel.recording import Recording, require_recordings
from structsel.recording.arguments import as_recordings, require_kind
from structsel.simulation import Atmosphere, prepare
from structsel.simulation.flight_setup import start_from
from structsel.simulation.missing_responses import describe_missing, missing_responses
from structsel.validation.resimulation import Divergence, Resimulation, score_output

BANDS: Mapping[str, float] = {
    "V": 1.543,
    **dict.fromkeys(("alpha", "beta", "theta"), 0.0262),
    **dict.fromkeys(("phi", "psi"), 0.0349),
    **dict.fromkeys(BODY_RATES, 0.0349),
    **dict.fromkeys(SPECIFIC_FORCES, 0.981),
    "h": 30.48,
}
"""Proof-of-match bands: 3 kt, 1.5 deg, 2 deg, 2 deg/s, 0.1 g, 100 ft, either way [FSTD]; where the rules have none, the
value of a similar channel."""

_OUTPUTS = (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, "psi", "h")
_FEWEST = 10  # samples of a recording
_DIVERGED = 1.0  # of the measured range: error beyond which the simulation has left the recording


def resimulate(
    model: AeroModel,
    aircraft: Aircraft,
    recordings: Recording | Sequence[Recording],
    *,
    outputs: Iterable[str] | None = None,
    window: float = 4.0,
    bands: Mapping[str, float] | None = None,
    normaliser: Normaliser = "rms",
    air: Atmosphere | None = None,
    definitions: Mapping[str, str] | None = None,
    substeps: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Resimulation:
    """Simulate a model with the recorded inputs and compare the outputs with the recordings.

    Each recording is simulated twice: over its complete length from its first sample, and in consecutive windows,
    each restarted from the recorded state. Use the windows for an aircraft that is unstable: errors cannot grow over
    the complete recording. Outputs are what the instruments read at their places.

    Parameters
    ----------
    model : AeroModel
    aircraft : Aircraft
        With mass, inertia and the places of the instruments.
    recordings : Recording or sequence of Recording
        With the inputs of the model, and V, alpha, theta and h for the start; reconstructed ones start most accurately.
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
        Called with the recording's name, windows simulated and windows in all.

    Returns
    -------
    Resimulation
        A simulation that diverges is named in it with the time, and scored up to there.

    Raises
    ------
    ModelError
        Outputs that a simulation does not give, or a window that is not above zero.
    ChannelError, DataError
        A recording lacks an input, an output or what a simulation starts from, is too short, or an input is not finite.
    AircraftError
        There is no mass or no inertia.

    References
    ----------
    [M86], [J15], [FSTD].
    """
    call = "resimulate(model, aircraft, recordings)"
    flights = as_recordings(recordings, call)
    require_kind(model, AeroModel, call)
    require_kind(aircraft, Aircraft, call)
    _check(flights, window, normaliser)
    lateral = any(name in model for name in LATERAL_COEFFICIENTS)
    shown = _choose(flights, outputs, lateral)
    held = {**BANDS, **(bands or {})}
    if strange := [name for name in bands or {} if not held[name] > 0.0]:
        raise DomainError(f"resimulate needs bands above zero; that of '{strange[0]}' is {held[strange[0]]:g}.")
    scores, pooled, divergences = [], [], []
    simulated: dict[str, list[Recording]] = {"whole": [], "windows": []}
    for recording in flights:
        options = {"air": air, "definitions": definitions, "substeps": substeps}
        windows = window_rows(recording, window)
        pieces = {"whole": [slice(0, len(recording))], "windows": windows}
        for kind, parts in pieces.items():
            made = np.full((len(recording), len(shown)), np.nan)
            for i, part in enumerate(parts):
                y, reason = _simulate(model, aircraft, _cut(recording, part), shown, options)
                made[part.start : part.start + len(y)] = y
                if reason:
                    at = float(recording.t[min(part.start + len(y), len(recording) - 1)])
                    divergences.append(Divergence(recording.name, kind, float(recording.t[part.start]), at, reason))
                if progress is not None and kind == "windows":
                    progress(recording.name, i + 1, len(parts))
            channels = dict(zip(shown, made.T))
            if kind == "whole":
                divergences += _divergence(recording, channels, held)
            scores += [
                score_output(
                    kind, recording.name, name, [(recording[name], channels[name])], held.get(name), normaliser
                )
                for name in shown
            ]
            note = f"simulated by resimulate, {'whole' if kind == 'whole' else f'in windows of {window:g} s'}"
            simulated[kind].append(recording.with_channels(note=note, **channels))  # type: ignore[arg-type]
    for kind, simulations in simulated.items():
        for name in shown:
            pairs = [(r[name], s[name]) for r, s in zip(flights, simulations)]
            pooled.append(score_output(kind, "all", name, pairs, held.get(name), normaliser))
    missing = describe_missing(model, missing_responses(model, lateral=lateral))
    doubts = [*([missing] if missing else []), *model.warnings_on(flights)]
    return Resimulation(
        model.name, shown, window, normaliser, {name: held[name] for name in shown if name in held}, tuple(scores),
        tuple(pooled), tuple(divergences), tuple(flights), tuple(simulated["whole"]), tuple(simulated["windows"]),
        tuple(doubts),
    )  # fmt: skip


def _check(flights: Sequence[Recording], window: float, normaliser: str) -> None:
    require_recordings(flights, samples=_FEWEST, by="resimulate")
    if not window > 0.0:
        raise ModelError(f"resimulate needs a window above zero; found {window:g} s.")
    if normaliser not in get_args(Normaliser):
        raise DomainError(f"normaliser={normaliser!r} is not one of 'rms', 'std', 'range'.")


def _choose(flights: Sequence[Recording], outputs: Iterable[str] | None, lateral: bool) -> tuple[str, ...]:
    if outputs is None:
        usual = (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS) if lateral else LONGITUDINAL_OUTPUTS
        shown = tuple(name for name in usual if all(name in r for r in flights))
        if not shown:
            raise ChannelError(f"resimulate found none of {', '.join(usual)} in all recordings, so nothing to compare.")
        return shown
    shown = tuple(dict.fromkeys(outputs))
    for name in shown:
        if name not in _OUTPUTS:
            raise ModelError(
                f"resimulate has no output '{name}'; it has {', '.join(_OUTPUTS)}.{suggest(name, _OUTPUTS)}"
            )
    for recording in flights:
        recording.require(*shown, by="resimulate")
    return shown


def window_rows(recording: Recording, window: float) -> list[slice]:
    """Rows of windows of a length [s]; the rest at the end joins the last if shorter than half of that."""
    n, size = len(recording), max(2, round(window / recording.dt))
    count = max(1, round(n / size))
    return [slice(size * i, n if i == count - 1 else size * (i + 1)) for i in range(count)]


def _cut(recording: Recording, rows: slice) -> Recording:
    if rows == slice(0, len(recording)):
        return recording
    parts = {name: recording[name][rows] for name in recording.names}
    return replace(recording, t=recording.t[rows], channels=parts)


def _simulate(
    model: AeroModel,
    aircraft: Aircraft,
    recording: Recording,
    shown: Sequence[str],
    options: Mapping[str, Any],
) -> tuple[np.ndarray, str]:
    """Outputs (samples, outputs) from the recorded start, and why they end before the recording does."""
    state = start_from(model, aircraft, recording, options["air"])
    ready = prepare(model, aircraft, recording, start=state, **options)
    batch = ready.simulate(shown, instruments=not recording.at_cg)
    reason = int(batch.reason[0])
    return batch.outputs[0, : int(batch.samples[0])], REASONS[reason] if reason else ""


def _divergence(
    recording: Recording, channels: Mapping[str, np.ndarray], bands: Mapping[str, float]
) -> Iterator[Divergence]:
    """First time at which the error of an output exceeds its measured range, and its band."""
    first = len(recording)
    of = ""
    for name, simulated in channels.items():
        measured = recording[name]
        seen = np.isfinite(measured) & np.isfinite(simulated)
        if not seen.any() or not (reach := float(np.ptp(measured[seen]))) > 0.0:
            continue
        limit = max(_DIVERGED * reach, bands.get(name, 0.0))
        off = np.flatnonzero(seen & (np.abs(np.where(seen, measured - simulated, 0.0)) > limit))
        if len(off) and off[0] < first:
            first, of = int(off[0]), name
    if of:
        why = f"{of} is off by more than its measured range"
        yield Divergence(recording.name, "whole", float(recording.t[0]), float(recording.t[first]), why)
