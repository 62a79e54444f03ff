"""Time histories for the plots: measured, simulated, refitted and explained, in the compared band."""

from __future__ import annotations

import numpy as np
import scipy

from structsel.comparison.noise import bins_of
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.residuals import contributions, moved_by_tolerances
from structsel.diagnosis.result import Trace
from structsel.numerics.arrays import Array


def in_band(x: Array, bins: int) -> Array:
    """Signal without frequencies above the compared band."""
    made = scipy.fft.dct(np.asarray(x, dtype=float), norm="ortho")
    made[bins + 1 :] = 0.0
    return scipy.fft.idct(made, norm="ortho")


def traces_of(ranking: Ranking) -> dict[str, Trace]:
    """Traces of every recording."""
    plain = moved_by_tolerances(ranking.start)
    full = moved_by_tolerances(ranking.problem)
    effects = contributions(ranking.problem, range(len(ranking.problem.accepted)))
    made = {}
    for i, f in enumerate(ranking.problem.flights):
        bins = bins_of(f)
        responses = [c for c in f.simulated if c in f.measured]
        measured = {c: in_band(f.measured[c], bins) for c in responses}
        simulated = {c: in_band(f.simulated[c], bins) for c in responses}
        refitted = {c: _levelled(simulated[c] + in_band(plain[i][c], bins), measured[c]) for c in responses}
        extra = {c: full[i][c] + effects[i].get(c, 0.0) for c in responses}
        explained = {c: _levelled(simulated[c] + in_band(extra[c], bins), measured[c]) for c in responses}
        channels = {c: f[c] for c in sorted(f.recorded)}
        made[f.name] = Trace(f.t, measured, simulated, refitted, explained, channels)
    return made


def _levelled(x: Array, goal: Array) -> Array:
    """Signal with the mean of another: biases differ between recordings."""
    return x + (goal - x).mean()
