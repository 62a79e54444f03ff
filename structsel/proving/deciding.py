"""Whether a case can be decided: what a perfect account of its effects brings beside the stated tolerances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from structsel.diagnosis.bench import Bench
from structsel.mismatch.flight import Flight
from structsel.mismatch.noise import edge_of
from structsel.mismatch.preparing import prepare
from structsel.mismatch.responses import COEFFICIENTS
from structsel.numerics.evidence import Base, spectrum
from structsel.proving.apart import open_case
from structsel.proving.cases import Case


def nats_of(case: Case, folder: Path) -> float | None:
    """Log evidence of a perfect account over none, tolerances being free in both; None where it is not known.

    The noise is what is left once the account is given. What an effect brings is taken to first order as what it adds
    to measured less simulated along the recordings, so that a simulation flown free counts as forced.

    Parameters
    ----------
    case : Case
    folder : Path
        Where it was written.
    """
    if not case.brought:
        return None
    prepared = prepare(*open_case(folder))
    adds = {r.name: (r.t, x) for r, x in zip(case.recordings, case.brought)}
    brought = [_along(f, adds[f.name]) for f in prepared.flights]
    accounted = [
        replace(f, measured={c: y - more.get(c, 0.0) for c, y in f.measured.items()})
        for f, more in zip(prepared.flights, brought)
    ]
    bench = Bench.set_up(accounted, ())
    with_it = [
        y + r.whiten({c: spectrum(x, r.bins, edge_of(r.flight))[:, None] for c, x in more.items()}, 1)[:, 0]
        for y, r, more in zip(bench.base.y, bench.rows, brought)
    ]
    concealed = Base(with_it, bench.base.given, bench.base.groups, bench.base.scales)
    return float(logsumexp(bench.base.evidence[:, 0]) - logsumexp(concealed.evidence[:, 0]))


def _along(flight: Flight, brought: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    """What effects bring to each coefficient along a prepared flight, from times and (n, 6) of its recording."""
    t, told = brought
    return {c: np.interp(flight.t, t, told[:, k]) for k, c in enumerate(COEFFICIENTS) if c in flight.measured}
