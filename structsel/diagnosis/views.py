"""What figures and reports show of a diagnosis: differences over a channel, and where they come from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from structsel.comparison.responses import KINEMATIC, KINEMATIC_UNIT
from structsel.diagnosis.held_out_result import STAGES
from structsel.diagnosis.result import Diagnosis, EffectFinding, Trace
from structsel.nomenclature import unit_of
from structsel.numerics.arrays import Array

_BINS = 18
_INSIDE = 8  # bins within the region where an effect acts, which may hold few of the samples
_LEAST = 5  # samples in a bin that is shown
_SURE = 1.96
_PART = 0.5  # fraction of the recorded range, below which the range of an effect is shown enlarged
_ABOUT = 3.0  # widths of a region that are shown on each side of it


@dataclass(frozen=True, eq=False)
class Binned:
    """Means of the residuals over bins of a channel.

    Attributes
    ----------
    at : (k,) array
        Mean of the channel in each bin.
    means : mapping of stage to (k,) array
        Of measured less simulated.
    half : mapping of stage to (k,) array
        Half of a 95 % interval, from the spread between recordings; nan where a bin holds only one.
    counts : (k,) array
        Samples.
    """

    at: Array
    means: Mapping[str, Array]
    half: Mapping[str, Array]
    counts: Array


def simulated(trace: Trace, stage: str) -> Mapping[str, Array]:
    """Simulated responses at a stage."""
    return {"delivered": trace.simulated, "refitted": trace.refitted, "physics": trace.explained}[stage]


def residuals(trace: Trace, response: str) -> dict[str, Array]:
    """Measured less simulated, by stage."""
    return {stage: np.asarray(trace.measured[response] - simulated(trace, stage)[response]) for stage in STAGES}


def unit_shown(name: str) -> str:
    """Unit of a channel or a response, kinematic ones among them."""
    return KINEMATIC_UNIT.get(name, "rad/s") if name in KINEMATIC else unit_of(name)


def moving_channels(diagnosis: Diagnosis) -> list[str]:
    """Channels that every trace holds and that move in some."""
    traces = list(diagnosis.traces.values())
    if not traces:
        return []
    shared = [c for c in traces[0].channels if all(c in one.channels for one in traces)]
    return [c for c in shared if any(np.ptp(one.channels[c]) > 0.0 for one in traces)]


def shown_responses(diagnosis: Diagnosis) -> list[str]:
    """Responses that every trace holds, those of the findings first."""
    traces = list(diagnosis.traces.values())
    if not traces:
        return []
    first = [c for finding in diagnosis.findings for c in finding.axes]
    every = list(dict.fromkeys([*first, *diagnosis.responses, *traces[0].measured]))
    return [c for c in every if all(c in one.measured for one in traces)]


def shown_stages(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Stages of the simulation that differ: the last one only if a finding was added to the simulation."""
    return STAGES if any(f.is_fitted for f in diagnosis.findings) else STAGES[:-1]


def main_recording(diagnosis: Diagnosis, finding: EffectFinding) -> str:
    """Recording in which a finding acts longest, or that of its first event.

    Returns
    -------
    str
        Empty if it acts all the time.
    """
    acts = {n: sum(b - a for a, b in each) for n, each in finding.intervals.items() if n in diagnosis.traces}
    if any(acts.values()):
        return max(acts, key=lambda name: acts[name])
    return next((e.recording for e in finding.events if e.recording in diagnosis.traces), "")


def driving_channel(diagnosis: Diagnosis, finding: EffectFinding) -> str:
    """Channel that an effect follows: what bounds it, what its terms hold, or what its differences vary most with.

    Returns
    -------
    str
        Empty where the traces hold no channel that moves.
    """
    moving = moving_channels(diagnosis)
    words = re.findall(r"[A-Za-z_]\w*", " ".join(t for p in finding.physics[:1] for t in p.terms))
    for name in (*finding.region, *words):
        if name in moving:
            return name
    seen = [c for c in finding.axes if c in shown_responses(diagnosis)]
    if not moving or not seen:
        return ""
    return max(moving, key=lambda c: _explained_by(bin_residuals(diagnosis, seen[0], c)))


def acting_range(diagnosis: Diagnosis, finding: EffectFinding, channel: str) -> tuple[float, float] | None:
    """Range of a channel in which an effect acts: its region, or the range of the channel in its intervals.

    Returns
    -------
    (low, high) or None
        None if this is most of the recorded range.
    """
    if channel in finding.region:
        return finding.region[channel]
    inside = [
        one.channels[channel][(one.t >= start) & (one.t <= end)]
        for name, one in diagnosis.traces.items()
        for start, end in finding.intervals.get(name, ())
    ]
    if not sum(map(len, inside)):
        return None
    low, high = np.quantile(np.concatenate(inside), (0.02, 0.98))
    recorded = np.concatenate([one.channels[channel] for one in diagnosis.traces.values()])
    return (float(low), float(high)) if high - low < _PART * np.ptp(recorded) else None


def bin_residuals(
    diagnosis: Diagnosis, response: str, channel: str, region: tuple[float, float] | None = None
) -> Binned:
    """Average the differences of one response over bins of a channel, all recordings together.

    Parameters
    ----------
    diagnosis : Diagnosis
    response, channel : str
        Of its traces.
    region : (low, high), optional
        Of the channel, where bins are narrow.
    """
    traces = list(diagnosis.traces.values())
    x = np.concatenate([one.channels[channel] for one in traces])
    owner = np.repeat(np.arange(len(traces)), [len(one.t) for one in traces])
    parts = [residuals(one, response) for one in traces]
    left = {stage: np.concatenate([p[stage] for p in parts]) for stage in STAGES}
    edges = _edges(x, region)
    # Sums over each bin (row) and recording (column): recordings are independent, samples of one are not.
    cell = np.searchsorted(edges, x, side="right") * len(traces) + owner
    shape = (edges.size + 1, len(traces))

    def sums(weights: Array | None = None) -> Array:
        return np.bincount(cell, weights, minlength=shape[0] * shape[1]).reshape(shape).astype(float)

    counts = sums()
    kept = counts.sum(axis=1) >= _LEAST
    counts = counts[kept]
    n = counts.sum(axis=1)
    means, half = {}, {}
    for stage, e in left.items():
        each = sums(e)[kept]
        means[stage] = each.sum(axis=1) / n
        half[stage] = _half_interval(each - counts * means[stage][:, None], counts)
    return Binned(sums(x)[kept].sum(axis=1) / n, means, half, n)


def worth_showing(x: Array, region: tuple[float, float] | None) -> tuple[float, float]:
    """Part of the range of a channel that is shown first: the region of an effect and its surroundings."""
    least, largest = float(x.min()), float(x.max())
    if region is None:
        return least, largest
    low, high = np.clip(region, least, largest)
    wide = _ABOUT * (high - low)
    return (max(least, float(low - wide)), min(largest, float(high + wide))) if wide > 0.0 else (least, largest)


def _edges(x: Array, region: tuple[float, float] | None) -> Array:
    """Edges of bins with equal numbers of samples, and of equal width where an effect acts."""
    inner = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1)[1:-1]))
    if region is None:
        return inner
    low, high = np.clip(region, x.min(), x.max())
    outside = inner[(inner < low) | (inner > high)]
    return np.unique(np.concatenate([outside, np.linspace(low, high, _INSIDE + 1)]))


def _half_interval(off: Array, counts: Array) -> Array:
    """Half of a 95 % interval of the mean of each row, from the scatter between recordings; nan with one recording."""
    m = np.count_nonzero(counts, axis=1)
    spread = np.sqrt(m / np.maximum(m - 1.0, 1.0) * np.sum(off**2, axis=1)) / counts.sum(axis=1)
    return np.where(m > 1, _SURE * spread, np.nan)


def _explained_by(binned: Binned) -> float:
    """Mean square of the retuned differences that the means over the bins explain."""
    return float(binned.counts @ binned.means["refitted"] ** 2 / max(binned.counts.sum(), 1.0))
