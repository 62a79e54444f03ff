"""Arrays of the unscented filter: the flight, the estimate, what is written, and the scratch of a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.kinematics import MEASUREMENTS, STATES
from structsel.numerics.rotations import angles_of, cosines_of
from structsel.numerics.square_root import aligned_zeros, padded

PHI, THETA, PSI = (STATES.index(name) for name in ("phi", "theta", "psi"))
"""Places of the Euler angles in the full vector."""
INPUTS = 6
"""Inputs with noise: accelerometers and gyros."""


class FlightData(NamedTuple):
    """Recording and settings of a run; the arrays of `structsel.reconstruction.kinematics_problem.KinematicsProblem`.

    `states` (L,) are indices of the full vector, the first `constants` of them without drift; those of phi, theta
    and psi are the rotations about north, east and down. `narrow` [rad] is the standard deviation of attitude and
    flow angles below which the unscented filter is linearised.
    """

    t: Array
    inputs: Array
    input_std: Array
    measurements: Array
    measurement_std: Array
    states: NDArray[np.int64]
    constants: int
    drift: Array
    place: Array
    flank: bool
    g: float
    gust_time: float
    located: bool
    gate: float
    narrow: float


class FilterState(NamedTuple):
    """Estimate that a run updates in place.

    full (F,) with its Euler angles, quaternion (4,), columns (L, L) of the root: row j is column j of S; and the
    rejections in a row.
    """

    full: Array
    quaternion: Array
    T: Array
    waiting: NDArray[np.int64]


class FilterOutput(NamedTuple):
    """Results of a run by sample; see `structsel.reconstruction.ukf.FilterResult`. States are in the internal order."""

    x: Array
    std: Array
    innovations: Array
    innovation_std: Array
    nis: Array
    used: NDArray[np.int64]
    rejected: NDArray[np.bool_]
    quaternion: Array


class FilterWorkspace(NamedTuple):
    """Scratch of a run: F entries of the full vector, L states, m of them moving, M measurements, C columns."""

    point: Array  # (F,) one sigma point
    up: Array  # (L, F) the points one step later
    down: Array  # (L, F)
    middle: Array  # (F,)
    column: Array  # (F,)
    C0: Array  # (3, 3) attitude before
    C1: Array  # (3, 3) and after a step
    C2: Array  # (3, 3) of a point
    q1: Array  # (4,)
    q2: Array  # (4,)
    noise: Array  # (6, 6)
    level: Array  # (6,)
    N: Array  # (L, m) the moving entries of the columns of the root, one step later
    A: Array  # (C, 2 P) columns of [FA E c N; A 0], each part padded; then of its triangular factor
    gain: Array  # (L, P) of the smoother, transposed and padded
    total: Array  # (2 P,)
    y_middle: Array  # (M,) readings at the points
    y_up: Array  # (L, M)
    y_down: Array  # (L, M)
    wanted: NDArray[np.bool_]  # (M,) whether the channel was sampled
    kept: NDArray[np.int64]  # (M,) channels used
    nu: Array  # (M,) their innovations
    sigma: Array  # (M,) their noise
    dy: Array  # (L, M) derivatives of all channels
    O: Array  # (L, M) of those used
    E: Array  # (M, L + 1) [E_y c_y]
    U: Array  # (M, M)
    move: Array  # (L,)
    rows: Array  # (L + 1, W) [T O], padded, and the scratch of `unscented_update.absorb_reading`
    euler: Array  # (3, L) rows of the root for the Euler angles


def workspace(F: int, states: NDArray[np.int64], constants: int, drift: Array, linear: bool) -> FilterWorkspace:
    """Scratch for a full vector of F entries; the `constants` first states do not drift."""
    L, M, m = len(states), len(MEASUREMENTS), len(states) - constants
    C = m + INPUTS + int(np.sum(drift[states] > 0.0)) + (0 if linear else L + 1)
    e, P = np.empty, padded(m)
    return FilterWorkspace(
        *(e(F), e((L, F)), e((L, F)), e(F), e(F), e((3, 3)), e((3, 3)), e((3, 3)), e(4), e(4), e((6, 6)), e(6)),
        *(e((L, m)), aligned_zeros(C, 2 * P), aligned_zeros(L, P), aligned_zeros(1, 2 * P)[0]),
        *(np.zeros(M), np.zeros((L, M)), np.zeros((L, M))),
        np.zeros(M, dtype=np.bool_),
        np.zeros(M, dtype=np.int64),
        *(e(M), e(M), np.zeros((L, M))),
        *(e((L, M)), e((M, L + 1)), e((M, M)), e(L), aligned_zeros(L + 1, padded(L + M)), e((3, L))),
    )


@njit(**UNCOUNTED)
def set_angles(estimate, work):  # type: ignore[no-untyped-def]
    """Euler angles of the quaternion, and its direction cosines in C1."""
    cosines_of(estimate.quaternion, work.C1)
    phi, theta, psi = angles_of(work.C1)
    estimate.full[PHI], estimate.full[THETA], estimate.full[PSI] = phi, theta, psi
