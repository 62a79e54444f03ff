"""Which test a manoeuvre is taken for, from the controls that move and the free motion that follows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from structsel.formatting import join_names
from structsel.numerics.atmosphere import G0
from structsel.numerics.oscillations import fit_oscillation
from structsel.qualification.tolerances import DEG
from structsel.recording import Recording

MOVED = {"de": DEG, "da": DEG, "dr": DEG, "df": DEG, "gear": 0.1, "thrust": 0.05, "throttle": 0.05}
"""Movement of a control that counts: 1 deg, the tolerance of an elevator in entry 2.c.5; of gear and throttle a
fraction of full travel; of thrust a fraction of its trim value, the tolerance of 2.c.5."""
MINOR = 0.25
"""Fraction of the largest deflection below which another surface only assists; chosen, not critical."""
_SURFACES = ("de", "da", "dr")
_PAUSE = 0.6  # s; movements of a control with shorter pauses are one input: the reversal of a doublet
_BRIEF = 0.3  # s; a shorter movement only touches the limit; chosen, not critical
_LEAD = 0.5  # s of motion before an input that belong to it; chosen, not critical
_SHORTEST = 1.0  # s of a part; chosen, not critical
MEASURED = 0.8
"""R2 from which an oscillation counts as measured; chosen, not critical."""
_CYCLES = 1.0  # of free motion from which an oscillation can be measured


@dataclass(frozen=True)
class Movement:
    """An input: controls that move together, and when [s]."""

    controls: tuple[str, ...]
    start: float
    end: float


@dataclass(frozen=True)
class ManoeuvreKind:
    """Test that a manoeuvre is taken for, empty for none, the reason, and the start of the free motion [s]."""

    kind: str
    why: str
    free: float


def find_movements(recording: Recording) -> list[Movement]:
    """Inputs of a recording in order of time; controls that move at the same time are one input."""
    masks = _moving(recording)
    gap = max(1, round(_PAUSE / recording.dt))
    found: list[Movement] = []
    for name, mask in masks.items():
        closed = mask.copy()
        edges = np.flatnonzero(mask)
        for a, b in pairwise(edges):
            if b - a <= gap:
                closed[a:b] = True
        for (rows,) in scipy.ndimage.find_objects(scipy.ndimage.label(closed)[0]):
            if (rows.stop - rows.start) * recording.dt < _BRIEF:
                continue
            found.append(Movement((name,), float(recording.t[rows.start]), float(recording.t[rows.stop - 1])))
    merged: list[Movement] = []
    for one in sorted(found, key=lambda m: m.start):
        if merged and one.start <= merged[-1].end:
            last = merged[-1]
            names = tuple(dict.fromkeys((*last.controls, *one.controls)))
            merged[-1] = Movement(names, last.start, max(last.end, one.end))
        else:
            merged.append(one)
    return merged


def _moving(recording: Recording) -> dict[str, np.ndarray]:
    """Samples at which each control is away from its trim position, that is its median."""
    away = {}
    for name in MOVED:
        if name in recording and np.isfinite(recording[name]).all():
            trim = float(np.median(recording[name]))
            size = abs(trim) if name == "thrust" else 1.0
            away[name] = np.abs(recording[name] - trim) / size if size > 0.0 else np.zeros(len(recording))
    largest = max((float(away[name].max()) for name in _SURFACES if name in away), default=0.0)
    masks = {}
    for name, distance in away.items():
        limit = max(MOVED[name], MINOR * largest) if name in _SURFACES else MOVED[name]
        if (distance > limit).any():
            masks[name] = distance > limit
    return masks


def split_by_input(recording: Recording) -> list[tuple[Recording, Movement | None]]:
    """Parts of a recording with one input each; the recording itself where there is one input, or none.

    A part begins shortly before its input and ends where that of the next begins, so that each is simulated from the
    recorded state.
    """
    movements = find_movements(recording)
    if len(movements) <= 1:
        return [(recording, movements[0] if movements else None)]
    parts: list[tuple[Recording, Movement | None]] = []
    starts = [max(float(recording.t[0]), one.start - _LEAD) for one in movements]
    starts[0] = float(recording.t[0])
    for j, (movement, start) in enumerate(zip(movements, starts)):
        end = starts[j + 1] - 0.5 * recording.dt if j + 1 < len(starts) else float(recording.t[-1])
        if end - start < _SHORTEST:
            continue
        part = recording.between(start, end)
        parts.append((replace(part, name=f"{recording.name} {chr(ord('a') + j) if j < 26 else j + 1}"), movement))
    return parts


def classify(recording: Recording, movement: Movement | None) -> ManoeuvreKind:
    """Test for which a manoeuvre with one input, or none, is taken."""
    end = float(recording.t[-1])
    if movement is None:
        return ManoeuvreKind("trim", "no control moves", end)
    free = min(movement.end + recording.dt, end)
    rest = end - free
    names = movement.controls
    verb = "moves" if len(names) == 1 else "move"
    moved = f"{join_names(names)} {verb} from {movement.start:.1f} to {movement.end:.1f} s"
    if len(names) > 1:
        return ManoeuvreKind("", f"{moved} together: table A2A has no test of several controls", free)
    (name,) = names
    simple = {"da": "roll-response", "df": "flap-change", "gear": "gear-change", "thrust": "power-change"}
    if name in (simple | {"throttle": ""}):
        return ManoeuvreKind(simple.get(name, "power-change"), moved, free)
    if name == "de":
        period = float(np.pi * np.sqrt(2.0) * np.median(recording["V"]) / G0)  # Lanchester's phugoid
        if rest >= _CYCLES * period:
            return ManoeuvreKind("phugoid", f"{moved}, then {rest:.0f} s are free, a phugoid of {period:.0f} s", free)
        return ManoeuvreKind("short-period", f"{moved}, then {rest:.1f} s are free", free)
    period_seen = yaw_period(recording, free)
    if rest >= _CYCLES * period_seen:
        seen = f"the yaw rate oscillates with a period of {period_seen:.1f} s"
        return ManoeuvreKind("dutch-roll", f"{moved}, then {rest:.1f} s are free, in which {seen}", free)
    return ManoeuvreKind("rudder-response", f"{moved}, then {rest:.1f} s are free, less than a cycle of yaw rate", free)


def yaw_period(recording: Recording, free: float) -> float:
    """Period of the yaw rate after the input [s]; infinite where it does not oscillate, or is not recorded."""
    rows = recording.t >= free
    if "r" not in recording or not rows.any():
        return float("inf")
    fit = fit_oscillation(recording.t[rows], recording["r"][rows, None])
    return fit.period if fit is not None and fit.r2 >= MEASURED else float("inf")
