"""What is done to a recording's signals: derivatives, spikes, turns and delays, each put on record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import is_known
from structsel.numerics import differentiation
from structsel.numerics.dynamic_elements import shift
from structsel.numerics.signal_quality import find_spikes
from structsel.recording.checks import FROM_SAMPLES, GAP, Finding

if TYPE_CHECKING:
    from structsel.recording.recording import Recording

_EVEN = 0.02  # steps: files give time to a few decimals, and steps that differ by less are one step


def differentiate(recording: Recording, names: Sequence[str], method: str, order: int) -> Recording:
    """See `Recording.differentiate`."""
    recording.require(*names, finite=method != "spline", by="differentiate")
    t, dt = recording.t, recording.dt
    gaps = np.flatnonzero(np.diff(t) > GAP * dt)
    if gaps.size:
        i = int(gaps[0])
        raise DataError(
            f"differentiate needs a clock without gaps; '{recording.name}' has none between {t[i]:g} and "
            f"{t[i + 1]:g} s.\nUse recording.split() first and differentiate each part."
        )
    rate = recording.duration / (len(t) - 1)
    even = bool(np.abs(t - (t[0] + np.arange(len(t)) * rate)).max() <= _EVEN * dt)
    clock = "an even clock" if even else "an uneven clock"
    made = {}
    for name in names:
        x = recording[name]
        if method == "spline":
            made[f"{name}_dot"] = differentiation.smooth_derivative(x, t)
        elif even:
            made[f"{name}_dot"] = differentiation.differentiate(x, rate, method, order)
        elif method == "fourier":
            raise DataError(
                f"differentiate by fourier needs an even clock; that of '{recording.name}' is not.\n"
                'Use method="spline", which takes any clock.'
            )
        else:
            per_sample = differentiation.differentiate(t, 1.0, method, order)
            made[f"{name}_dot"] = differentiation.differentiate(x, 1.0, method, order) / per_sample
    how = f"method {method}" if method in differentiation.SMOOTHERS else f"method {method}, order {order}"
    if not even and method != "spline":
        clock += ", chain rule"
    lost = {name: int((~np.isfinite(recording[name])).sum()) for name in names}
    bridged = "".join(f", {count} missing samples of {name} bridged" for name, count in lost.items() if count)
    units = {
        f"{name}_dot": f"{recording.unit(name)}/s"
        for name in names
        if recording.unit(name) != "?" and not is_known(f"{name}_dot")
    }
    note = f"{', '.join(made)}: differentiated, {how}, {clock}{bridged}"
    return recording.with_channels(note=note, units=units, **made)


def remove_spikes(recording: Recording, names: Sequence[str], threshold: float) -> Recording:
    """See `Recording.remove_spikes`."""
    recording.require(*names, by="remove_spikes")
    for name in dict.fromkeys(names):
        old = recording[name]
        samples, values = find_spikes(old, threshold=threshold)
        if not samples.size:
            continue
        mended = old.copy()
        mended[samples] = values
        each = ", ".join(f"{i} (t = {recording.t[i]:g} s, was {old[i]:.6g}, is {mended[i]:.6g})" for i in samples)
        count, first = int(samples.size), int(samples[0])
        note = f"{name}: {count} spike sample{'s' if count > 1 else ''} above {threshold:g} sigma replaced: {each}"
        what = f"{count} spike sample{'s' if count > 1 else ''} replaced by a local fit, first"
        remedy = "the provenance lists every sample and its old value"
        found = Finding("spike", name, what, "note", remedy, first, float(recording.t[first]), count)
        recording = _treated(recording, note, {name: mended}, found)
    return recording


def unwrap(recording: Recording, names: Sequence[str], turn: float) -> Recording:
    """See `Recording.unwrap`."""
    recording.require(*names, by="unwrap")
    for name in dict.fromkeys(names):
        angle = recording[name].copy()
        there = np.flatnonzero(np.isfinite(angle))
        jumps = np.diff(angle[there]) / turn
        turns = np.round(jumps)
        turns[np.abs(jumps - turns) > 0.25] = 0.0
        angle[there[1:]] -= turn * np.cumsum(turns)
        wraps = np.flatnonzero(turns)
        if wraps.size:
            at = ", ".join(str(int(there[i + 1])) for i in wraps)
            note = (
                f"{name}: {wraps.size} wrap{'s' if wraps.size > 1 else ''} of {turn:.6g} rad removed, at samples {at}"
            )
            recording = _treated(recording, note, {name: angle})
    return recording


def align(recording: Recording, delays: Mapping[str, float]) -> Recording:
    """See `Recording.align`."""
    recording.require(*delays, by="align")
    made = {name: shift(recording[name], recording.t, delay) for name, delay in delays.items()}
    lost = {name: int(np.isnan(x).sum() - np.isnan(recording[name]).sum()) for name, x in made.items()}
    each = ", ".join(f"{name} by {delay:g} s ({lost[name]} samples lost)" for name, delay in delays.items())
    return _treated(recording, f"advanced in time: {each}", made)


def _treated(recording: Recording, note: str, channels: Mapping[str, np.ndarray], *found: Finding) -> Recording:
    """Recording with channels treated, which keep what was said of them, as ones put in their place would not."""
    said = tuple(f for f in recording.findings if f.channel in channels and f.kind not in FROM_SAMPLES)
    made = recording.with_channels(note=note, units=None, **channels)
    return replace(made, findings=made.findings + said + found)
