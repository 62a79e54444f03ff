"""Prediction of the unscented filter: the centre, the columns of the root and the process noise, one sample later.

`unscented_filter` has the equations and the notation.
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.kinematic_tangents import noise_columns, step_columns
from structsel.numerics.kinematics import GUST, step
from structsel.numerics.rotations import cosines_of, to_body, to_earth, turn, vector_between
from structsel.numerics.square_root import copy
from structsel.numerics.unscented_arrays import INPUTS, PHI, PSI, THETA, set_angles


@njit(**UNCOUNTED)
def predict(k, wide, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Centre one sample later (`middle`, q1), columns N of the root, and the array A; returns its columns."""
    full, T, states, f = estimate.full, estimate.T, data.states, data.constants
    L, dt, a0, a1 = len(states), data.t[k] - data.t[k - 1], data.inputs[k - 1], data.inputs[k]
    m, fade = L - f, np.exp(-dt / data.gust_time)
    cosines_of(estimate.quaternion, work.C0)
    copy(full, work.point)
    work.point[PHI], work.point[THETA], work.point[PSI] = 0.0, 0.0, 0.0
    step(work.point, work.C0, a0, a1, dt, data.place, data.g, data.located, work.middle)
    turn(estimate.quaternion, work.middle[PHI], work.middle[THETA], work.middle[PSI], work.q1)
    for j in range(GUST, len(full)):
        work.middle[j] *= fade
    cosines_of(work.q1, work.C1)
    columns = m
    if wide:
        columns = predict_points(k, fade, data, points, estimate, work)
    else:
        step_columns(
            *(T, states, f, full, work.middle, work.C0, work.C1, a0, a1, dt, data.place, data.g, fade),
            *(work.column, work.N),
        )
    for j in range(f, L):
        for a in range(m):
            work.A[j - f, a] = work.N[j, a]
    # Process noise.
    for j in range(INPUTS):
        work.level[j] = dt * np.sqrt(0.5 * (data.input_std[k - 1, j] ** 2 + data.input_std[k, j] ** 2))
    noise_columns(full, work.C1, work.level, work.noise)
    for a in range(m):
        for j in range(INPUTS):
            work.A[columns + j, a] = work.noise[states[f + a], j] if states[f + a] <= PSI else 0.0
    columns += INPUTS
    for a in range(m):
        if data.drift[states[f + a]] > 0.0:
            for b in range(m):
                work.A[columns, b] = data.drift[states[f + a]] * np.sqrt(dt) if a == b else 0.0
            columns += 1
    return columns


@njit(**UNCOUNTED)
def predict_points(k, fade, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """The same by sigma points: N, the even parts in A, and the mean in `middle`; returns the columns of A in use."""
    full, T, states, f, middle = estimate.full, estimate.T, data.states, data.constants, work.middle
    L, dt, a0, a1 = len(states), data.t[k] - data.t[k - 1], data.inputs[k - 1], data.inputs[k]
    m = L - f
    for j in range(L):
        for side in range(2):
            reach = points.reach if side == 0 else -points.reach
            target = work.up[j] if side == 0 else work.down[j]
            copy(full, work.point)
            work.point[PHI], work.point[THETA], work.point[PSI] = 0.0, 0.0, 0.0
            for i in range(j, L):
                work.point[states[i]] += reach * T[j, i]
            turned = to_body(work.C0, work.point[PHI], work.point[THETA], work.point[PSI])
            work.point[PHI], work.point[THETA], work.point[PSI] = turned
            step(work.point, work.C0, a0, a1, dt, data.place, data.g, data.located, target)
            for i in range(GUST, len(full)):
                target[i] *= fade
            # Deviations from the centre; of the attitude the rotation vector from it.
            turn(estimate.quaternion, target[PHI], target[THETA], target[PSI], work.q2)
            d0, d1, d2 = vector_between(work.q1, work.q2)
            for i in range(f, L):
                target[states[i]] -= middle[states[i]]
            target[PHI], target[THETA], target[PSI] = to_earth(work.C1, d0, d1, d2)
    copy(middle, work.point)
    work.point[PHI], work.point[THETA], work.point[PSI] = 0.0, 0.0, 0.0
    for a in range(m):
        state = states[f + a]
        moved = 0.0
        for j in range(L):
            moved += work.up[j, state] + work.down[j, state]
        moved *= points.mean_weight
        for j in range(L):
            work.N[j, a] = points.odd * (work.up[j, state] - work.down[j, state])
            work.A[m + j, a] = points.odd * ((work.up[j, state] - moved) + (work.down[j, state] - moved))
        work.A[m + L, a] = -points.centre * moved
        work.point[state] += moved
    d0, d1, d2 = to_body(work.C1, work.point[PHI], work.point[THETA], work.point[PSI])
    turn(work.q1, d0, d1, d2, work.q1)
    copy(work.point, middle)
    return m + L + 1


@njit(**UNCOUNTED)
def adopt_prediction(data, estimate, work):  # type: ignore[no-untyped-def]
    """Replace the estimate by the prediction; inactive states are those of the centre point."""
    f, L = data.constants, len(data.states)
    copy(work.middle, estimate.full)
    copy(work.q1, estimate.quaternion)
    set_angles(estimate, work)
    for j in range(f):
        for i in range(f, L):
            estimate.T[j, i] = work.N[j, i - f]
    for j in range(f, L):
        for i in range(j, L):
            estimate.T[j, i] = work.A[j - f, i - f]
