"""Time histories for the plots: measured, simulated, refitted and explained, in the compared band."""

from __future__ import annotations

import numpy as np
import scipy

from structsel.comparison.noise import bins_of
from structsel.diagnosis.assembling import contributions
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.result import Trace
from structsel.numerics.arrays import Array


def in_band(x: Array, bins: int) -> Array:
    """A signal without what is faster than the compared band."""
    made = scipy.fft.dct(np.asarray(x, dtype=float), norm="ortho")
    made[bins + 1 :] = 0.0
    return scipy.fft.idct(made, norm="ortho")


def traces_of(ranking: Ranking) -> dict[str, Trace]:
    """Traces of every recording."""
    plain = _moved(ranking.start)
    full = _moved(ranking.bench)
    effects = contributions(ranking.bench, range(len(ranking.bench.accepted)))
    made = {}
    for i, f in enumerate(ranking.bench.flights):
        bins = bins_of(f)
        told = [c for c in f.simulated if c in f.measured]
        measured = {c: in_band(f.measured[c], bins) for c in told}
        simulated = {c: in_band(f.simulated[c], bins) for c in told}
        refitted = {c: _levelled(simulated[c] + in_band(plain[i][c], bins), measured[c]) for c in told}
        extra = {c: full[i][c] + effects[i].get(c, 0.0) for c in told}
        explained = {c: _levelled(simulated[c] + in_band(extra[c], bins), measured[c]) for c in told}
        channels = {c: f[c] for c in sorted(f.recorded)}
        made[f.name] = Trace(f.t, measured, simulated, refitted, explained, channels)
    return made


def residuals(bench: Bench) -> list[dict[str, Array]]:
    """What neither tolerances nor the effects taken in explain, per flight and response, at all frequencies."""
    moved = _moved(bench)
    effects = contributions(bench, range(len(bench.accepted)))
    return [
        {c: x - m.get(c, 0.0) - e.get(c, 0.0) for c, x in f.difference.items()}
        for f, m, e in zip(bench.flights, moved, effects)
    ]


def _moved(bench: Bench) -> list[dict[str, Array]]:
    """What the tolerances, pulled as they are, add to the differences."""
    pulled, _ = bench.pulled
    made = []
    for i, f in enumerate(bench.flights):
        total = {c: np.zeros(len(f)) for c in f.difference}
        for n, x in zip(bench.nuisances, pulled):
            for c, column in n.columns[i].items():
                if c in total:
                    total[c] = total[c] + x * n.sd * column
        made.append(total)
    return made


def _levelled(x: Array, goal: Array) -> Array:
    """Moved to the level of another: constant biases differ in each recording."""
    return x + (goal - x).mean()
