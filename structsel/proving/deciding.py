"""Whether a case can be decided: what a perfect account of its effects brings beside the stated tolerances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from structsel.comparison.flight import Flight
from structsel.comparison.preparing import prepare
from structsel.comparison.responses import COEFFICIENTS
from structsel.diagnosis.bench import Bench
from structsel.numerics.evidence import Base
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
    accounted = [_without(f, *adds[f.name]) for f in prepared.flights]
    bench = Bench.set_up(accounted, ())
    with_it = [replace(r, flight=f).difference() for r, f in zip(bench.rows, prepared.flights)]
    concealed = Base(with_it, bench.base.given, bench.base.groups, bench.base.scales)
    return float(logsumexp(bench.base.evidence[:, 0]) - logsumexp(concealed.evidence[:, 0]))


def _without(flight: Flight, t: np.ndarray, brought: np.ndarray) -> Flight:
    """A prepared flight less what effects bring to each coefficient, (n, 6) at times t."""
    adds = dict(zip(COEFFICIENTS, brought.T))
    return replace(
        flight,
        measured={c: y - np.interp(flight.t, t, adds[c]) if c in adds else y for c, y in flight.measured.items()},
    )
