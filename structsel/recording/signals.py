"""Operations on the signals of a recording: derivatives, spikes, wraps and delays. The provenance records each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from structsel.errors import DataError
from structsel.formatting import count_of
from structsel.nomenclature import is_known
from structsel.numerics import differentiation
from structsel.numerics.dynamic_elements import shift
from structsel.numerics.signal_quality import find_spikes
from structsel.recording.checks import GAP, RECOMPUTED_KINDS, find_gaps
from structsel.recording.finding import Finding

if TYPE_CHECKING:
    from structsel.recording.recording import Recording

_UNIFORM = 0.02  # time steps: times in files are rounded, and smaller deviations count as uniform sampling


def differentiate(recording: Recording, names: Sequence[str], method: str, order: int) -> Recording:
    """See `Recording.differentiate`."""
    recording.require(*names, finite=method != "spline", by="differentiate")
    t, dt = recording.t, recording.dt
    gaps = find_gaps(t, GAP * dt)
    if gaps.size:
        i = int(gaps[0])
        raise DataError(
            f"differentiate needs time without gaps; '{recording.name}' has no samples between {t[i]:g} and "
            f"{t[i + 1]:g} s.\nUse recording.split() first and differentiate each part."
        )
    rate = recording.duration / (len(t) - 1)
    uniform = bool(np.abs(t - (t[0] + np.arange(len(t)) * rate)).max() <= _UNIFORM * dt)
    sampling = "uniform sampling" if uniform else "non-uniform sampling"
    made = {}
    for name in names:
        x = recording[name]
        if method == "spline":
            made[f"{name}_dot"] = differentiation.smooth_derivative(x, t)
        elif uniform:
            made[f"{name}_dot"] = differentiation.differentiate(x, rate, method, order)
        elif method == "fourier":
            raise DataError(
                f"differentiate by fourier needs uniform sampling; '{recording.name}' has none.\n"
                'Use method="spline", which works with any sampling.'
            )
        else:
            per_sample = differentiation.differentiate(t, 1.0, method, order)
            made[f"{name}_dot"] = differentiation.differentiate(x, 1.0, method, order) / per_sample
    label = f"method {method}" if method in differentiation.SMOOTHERS else f"method {method}, order {order}"
    if not uniform and method != "spline":
        sampling += ", chain rule"
    missing = {name: int((~np.isfinite(recording[name])).sum()) for name in names}
    filled = "".join(f", {count} missing samples of {name} interpolated" for name, count in missing.items() if count)
    units = {
        f"{name}_dot": f"{recording.unit(name)}/s"
        for name in names
        if recording.unit(name) != "?" and not is_known(f"{name}_dot")
    }
    note = f"{', '.join(made)}: differentiated, {label}, {sampling}{filled}"
    return recording.with_channels(note=note, units=units, **made)


def remove_spikes(recording: Recording, names: Sequence[str], threshold: float) -> Recording:
    """See `Recording.remove_spikes`."""
    recording.require(*names, by="remove_spikes")
    for name in dict.fromkeys(names):
        old = recording[name]
        samples, values = find_spikes(old, threshold=threshold)
        if not samples.size:
            continue
        corrected = old.copy()
        corrected[samples] = values
        each = ", ".join(f"{i} (t = {recording.t[i]:g} s, was {old[i]:.6g}, is {corrected[i]:.6g})" for i in samples)
        count = count_of(samples.size, "spike sample")
        note = f"{name}: {count} above {threshold:g} sigma replaced: {each}"
        message = f"{count} replaced by a local fit, first"
        remedy = "the provenance lists every sample and its old value"
        found = Finding.of_samples("spike", name, message, "note", remedy, recording.t, samples)
        recording = _replace_channels(recording, note, {name: corrected}, found)
    return recording


def unwrap(recording: Recording, names: Sequence[str], turn: float) -> Recording:
    """See `Recording.unwrap`."""
    recording.require(*names, by="unwrap")
    for name in dict.fromkeys(names):
        angle = recording[name].copy()
        finite = np.flatnonzero(np.isfinite(angle))
        jumps = np.diff(angle[finite]) / turn
        turns = np.round(jumps)
        turns[np.abs(jumps - turns) > 0.25] = 0.0
        angle[finite[1:]] -= turn * np.cumsum(turns)
        wraps = np.flatnonzero(turns)
        if wraps.size:
            at = ", ".join(str(int(finite[i + 1])) for i in wraps)
            note = f"{name}: {count_of(wraps.size, 'wrap')} of {turn:.6g} rad removed, at samples {at}"
            recording = _replace_channels(recording, note, {name: angle})
    return recording


def align(recording: Recording, delays: Mapping[str, float]) -> Recording:
    """See `Recording.align`."""
    recording.require(*delays, by="align")
    aligned = {name: shift(recording[name], recording.t, delay) for name, delay in delays.items()}
    lost = {name: int(np.isnan(x).sum() - np.isnan(recording[name]).sum()) for name, x in aligned.items()}
    each = ", ".join(f"{name} by {delay:g} s ({lost[name]} samples lost)" for name, delay in delays.items())
    return _replace_channels(recording, f"advanced in time: {each}", aligned)


def _replace_channels(
    recording: Recording, note: str, channels: Mapping[str, np.ndarray], *found: Finding
) -> Recording:
    """Recording with modified channels, which keep their findings that are not computed from the samples."""
    kept = tuple(f for f in recording.findings if f.channel in channels and f.kind not in RECOMPUTED_KINDS)
    modified = recording.with_channels(note=note, units=None, **channels)
    return replace(modified, findings=modified.findings + kept + found)
