"""Response of flights to the recorded inputs alone.

In moving air an aircraft goes where gusts push it, and what gusts do to its forces follows its motion: a function of
the motion then explains some of it, whether the simulation lacks that function or not. So it is with the noise of what
the motion was read by. What the inputs make of the motion owes nothing to either. Functions of that, in place of
functions of the motion, are instrumental variables: they explain gusts and noise no better than random signals would.

References
----------
[L99] section 7.6 for instrumental variables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from structsel.comparison.flight import AIRFRAME, Flight
from structsel.nomenclature import COEFFICIENTS, INPUTS
from structsel.numerics.arrays import Array

_PAST = np.array([0.0, 0.1, 0.2, 0.35, 0.55, 0.8, 1.2, 1.8, 2.7, 4.0, 6.0, 9.0])  # s
_RIDGE = 1e-3  # of each column's mean square
_BEFORE = 0.5  # s, that an input is measured from


def input_responses(flights: Sequence[Flight]) -> tuple[Flight, ...]:
    """Flights whose motion is predicted from the past of the inputs, by one linear filter for all of them.

    Parameters
    ----------
    flights : sequence of Flight
        Of one aircraft, with a stand-in of the simulation.

    Returns
    -------
    tuple of Flight
        With the differences that they had; none where no input moves.
    """
    inputs = [c for c in INPUTS if all(c in f.recorded for f in flights) and any(np.ptp(f[c]) > 0.0 for f in flights)]
    if not inputs:
        return ()
    X = [_past(f, inputs) for f in flights]
    size = np.sqrt(np.mean(np.concatenate(X) ** 2, axis=0))
    X = [x[:, size > 0.0] / size[size > 0.0] for x in X]
    motion = [np.column_stack([f[c] - f[c].mean() for c in AIRFRAME]) for f in flights]
    rows = np.concatenate(X)
    held = rows.T @ rows + _RIDGE * len(rows) * np.eye(rows.shape[1])
    filters = scipy.linalg.solve(held, rows.T @ np.concatenate(motion), assume_a="pos")
    return tuple(_moving(f, dict(zip(AIRFRAME, (x @ filters).T))) for f, x in zip(flights, X))


def _past(f: Flight, inputs: Sequence[str]) -> Array:
    """(n, k) inputs seen through hats over their past, and summed up; about their means."""
    at = np.arange(round(_PAST[-1] / f.dt) + 1) * f.dt
    hats = [np.interp(at, _PAST, one) * f.dt for one in np.eye(len(_PAST))[:-1]]
    columns = []
    for c in inputs:
        moved = f[c] - f[c][: max(1, round(_BEFORE / f.dt))].mean()
        columns += [scipy.signal.fftconvolve(moved, hat)[: len(f)] for hat in hats]
        columns.append(np.cumsum(moved) * f.dt)
    X = np.column_stack(columns)
    return np.asarray(X - X.mean(axis=0))


def _moving(f: Flight, moved: dict[str, Array]) -> Flight:
    """A flight that moves so about its means; what the simulation says there, and as much measured beyond that."""
    other = replace(f, channels={**f.channels, **{c: f[c].mean() + x for c, x in moved.items()}})
    simulated = {c: other.predicted(c) if c in COEFFICIENTS else x for c, x in f.simulated.items()}
    measured = {c: x + simulated.get(c, 0.0) - f.simulated.get(c, 0.0) for c, x in f.measured.items()}
    return replace(other, measured=measured, simulated=simulated)
