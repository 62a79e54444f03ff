"""Square-root filter and smoother over the kinematics of a flight path, compiled: unscented, or linearised.

The covariance P = S S' is never formed: every update is an orthogonal triangularisation of an array of
deviations. Each array only *adds* columns; no column is subtracted, so P stays positive definite. This is
possible because the weight of the centre point is not negative (`square_root` has the weights).

The columns [E c N] are zero for constants without drift. For the others, the m moving states, they are compressed to m
columns by a triangularisation of their own.

Pairs of deviations are turned into their odd part O (a linearisation over the spread of S) and even part E
(the curvature). With [E c N] the even parts, the centre and the process noise,

    prediction   S- = tria [O E c N]
    update       tria [R_e O_y; 0 S-] = [S_y 0; K S_y  S+],   R_e = tria [R E_y c_y],   K the gain
    smoothing    G = S O' (S- S-')^-1,        S_s = tria [S - G O,  G [E c N],  G S_s+]

The extended filter is the same with O the derivative along S, taken by central differences, and no E, c.

References
----------
[M86], [H17]; [VM01] for the square-root form, [AH09] and [S08] for updates and smoothing by triangularisation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.kinematics import (
    CIRCULAR,
    GUST,
    INERTIAL_SCALE,
    MEASUREMENTS,
    MOTION,
    STATES,
    attitude,
    attitude_near,
    noise_gain,
    observe_at,
    step,
)
from structsel.numerics.square_root import absorb, copy, lower_triangle, row_lengths, triangularise
from structsel.numerics.unscented_smoother import store_smoother_step

STEEPEST = 1.55
"""Pitch attitude [rad] beyond which the Euler angles, and with them the filter, break down."""
COMPLETE, STEEP, NOT_FINITE = 0, 1, 2
"""How a run ended."""
THETA, X, Y, H = (STATES.index(name) for name in ("theta", "x", "y", "h"))
WIND_NORTH, WIND_EAST, WIND_DOWN = (STATES.index(name) for name in ("wn", "we", "wd"))
_INPUTS = 6  # accelerometers and gyros have noise
_MAX_REJECTED = 25  # of one channel in a row; then the filter may be wrong, not the channel. Chosen, not critical


class FlightData(NamedTuple):
    """Recording and settings of a run; the arrays of `structsel.reconstruction.ukf.KinematicsProblem`."""

    t: Array
    inputs: Array
    input_std: Array
    measurements: Array
    measurement_std: Array
    active: NDArray[np.int64]
    drift: Array
    place: Array
    flank: bool
    g: float
    gust_time: float
    located: bool
    gate: float


class FilterState(NamedTuple):
    """Estimate that a run updates in place: full vector (F,), root S (L, L) of its covariance, rejections in a row."""

    full: Array
    S: Array
    waiting: NDArray[np.int64]


class FilterOutput(NamedTuple):
    """Results of a run by sample; see `structsel.reconstruction.ukf.FilterResult`."""

    x: Array
    std: Array
    innovations: Array
    innovation_std: Array
    nis: Array
    used: NDArray[np.int64]
    rejected: NDArray[np.bool_]


class FilterWorkspace(NamedTuple):
    """Scratch of a run: F entries of the full vector, L active states, M measurements, C columns of deviations."""

    point: Array  # (F,) one sigma point
    runge_kutta: Array  # (7, F)
    angles: Array  # (2, 6) sines and cosines of the attitude of the centre and of the point
    up: Array  # (L, F) the points one step later
    down: Array  # (L, F)
    middle: Array  # (F,)
    noise: Array  # (F, 6) effect of the inputs' noise
    mean: Array  # (L,)
    moving: NDArray[np.int64]  # (m,) the states but constants without drift
    spread: Array  # (m, C) their [E c N]
    deviations: Array  # (L, L + e) [O tria [E c N]]
    root: Array  # (L, L + e) its triangular factor
    gain: Array  # (m, L)
    smoothing: Array  # (m, L + e)
    y_middle: Array  # (M,) readings at the points
    y_up: Array  # (L, M)
    y_down: Array  # (L, M)
    wanted: NDArray[np.bool_]  # (M,) whether the channel was sampled
    kept: NDArray[np.int64]  # (M,) channels used
    nu: Array  # (M,) their innovations
    O_y: Array  # (M, L)
    E_y: Array  # (M, L + 1) [E_y c_y]
    S_y: Array  # (M, M)
    K_S: Array  # (L, M) the gain times S_y


def workspace(F: int, active: NDArray[np.int64], drift: Array, linear: bool) -> FilterWorkspace:
    """Scratch for a full vector of F entries; `active` are estimated, and those with `drift` above zero drift."""
    L, M = len(active), len(MEASUREMENTS)
    moving = moving_states(active, drift)
    C = (0 if linear else L + 1) + _INPUTS + int(np.sum(drift[active] > 0.0))
    m, e = len(moving), min(len(moving), C)
    return FilterWorkspace(
        *(
            np.empty(F),
            np.empty((7, F)),
            np.empty((2, 6)),
            np.empty((L, F)),
            np.empty((L, F)),
            np.empty(F),
            np.empty((F, _INPUTS)),
        ),
        *(np.empty(L), moving, np.empty((m, C)), np.zeros((L, L + e)), np.empty((L, L + e))),
        *(np.empty((m, L)), np.empty((m, L + e)), np.zeros(M)),
        y_up=np.zeros((L, M)),
        y_down=np.zeros((L, M)),
        wanted=np.zeros(M, dtype=np.bool_),
        kept=np.zeros(M, dtype=np.int64),
        nu=np.empty(M),
        O_y=np.empty((M, L)),
        E_y=np.empty((M, L + 1)),
        S_y=np.empty((M, M)),
        K_S=np.empty((L, M)),
    )


def moving_states(active: NDArray[np.int64], drift: Array) -> NDArray[np.int64]:
    """Positions among the active states of those that change: motion, gusts, and constants that drift."""
    return np.flatnonzero((active < MOTION) | (active >= GUST) | (drift[active] > 0.0))


@njit(cache=True)
def filter_samples(first, last, data, points, estimate, output, steps, work):  # type: ignore[no-untyped-def]
    """Filter samples first to last - 1, from the estimate of the sample before, which is updated.

    Returns
    -------
    float, int, int
        Log-likelihood of the innovations, the sample that failed or -1, and how the run ended.
    """
    total = 0.0
    for k in range(first, last):
        if k > 0:
            # Prediction from sample k - 1.
            propagate(k, data, points, estimate, work)
            fill_deviations(k, data, points, estimate, work)
            work.root[:] = work.deviations
            triangularise(work.root, *work.root.shape)
            if len(steps.gain):
                scratch = (work.mean, work.gain, work.smoothing)
                store_smoother_step(k - first, estimate.S, work.deviations, work.root, *scratch, steps)
            adopt_prediction(data.active, estimate, work)
            if not np.isfinite(estimate.full[THETA]) or not np.isfinite(estimate.S[-1, -1]):
                return total, k, NOT_FINITE
            if abs(estimate.full[THETA]) > STEEPEST:
                return total, k, STEEP
        # Update with what was measured at sample k.
        count = predict_readings(k, data, points, estimate, work)
        count = compare(k, count, data, points, estimate, output, work)
        output.used[k] = count
        if count > 0:
            output.nis[k], log_likelihood = update(count, data, points, estimate, work)
            total += log_likelihood
        for j, state in enumerate(data.active):
            output.x[k, j] = estimate.full[state]
        row_lengths(estimate.S, output.std[k])
    return total, -1, COMPLETE


@njit(**UNCOUNTED)
def propagate(k, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Sigma points from sample k - 1 to k: `middle`, `up`, `down` of the workspace."""
    full, S, active, middle = estimate.full, estimate.S, data.active, work.middle
    L, dt, before, now = len(active), data.t[k] - data.t[k - 1], data.inputs[k - 1], data.inputs[k]
    here, there = work.angles[0], work.angles[1]
    attitude(full, here)
    step(full, before, now, dt, data.place, data.g, data.located, here, work.runge_kutta, middle)
    fade = np.exp(-dt / data.gust_time)
    for j in range(GUST, len(middle)):
        middle[j] *= fade
    # The last column with a state that changes the motion: the roots of the states before it include that state.
    moving = WIND_NORTH
    for i in range(L):
        if INERTIAL_SCALE <= active[i] < GUST:
            moving = active[i] + 1
    for i in range(L):
        for side in range(2):
            point, reach = work.point, points.reach if side == 0 else -points.reach
            target = work.up[i] if side == 0 else work.down[i]
            copy(full, point)
            for j in range(i, L):
                point[active[j]] += reach * S[j, i]
            if active[i] < moving:
                attitude_near(point, full, here, there)
                step(point, before, now, dt, data.place, data.g, data.located, there, work.runge_kutta, target)
                continue
            # Wind and instrument errors change no motion but the position, and that linearly.
            for j in range(len(full)):
                target[j] = middle[j] if j < MOTION else point[j]
            target[H] -= dt * (point[WIND_DOWN] - full[WIND_DOWN])
            if data.located:
                target[X] += dt * (point[WIND_NORTH] - full[WIND_NORTH])
                target[Y] += dt * (point[WIND_EAST] - full[WIND_EAST])


@njit(**UNCOUNTED)
def fill_deviations(k, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Mean of the propagated points, and their deviations [O tria [E c N]]."""
    up, down, middle, A, W, mean = work.up, work.down, work.middle, work.deviations, work.spread, work.mean
    active, moving, S, L = data.active, work.moving, estimate.S, len(data.active)
    dt = data.t[k] - data.t[k - 1]
    fade = np.exp(-dt / data.gust_time)
    first_noise = 0 if points.linear else L + 1
    noise_gain(estimate.full, data.inputs[k], work.noise)
    for j in range(L):
        a = active[j]
        mean[j] = middle[a]
        if a >= MOTION:  # constants stay exactly the same, and gusts decay
            for i in range(L):
                A[j, i] = 0.0 if i > j else (S[j, i] if a < GUST else fade * S[j, i])
            continue
        for i in range(L):
            A[j, i] = points.odd * (up[i, a] - down[i, a])
            mean[j] += (
                0.0 if points.linear else points.mean_weight * ((up[i, a] - middle[a]) + (down[i, a] - middle[a]))
            )
    column = first_noise + _INPUTS
    for row in range(len(moving)):
        j = moving[row]
        a = active[j]
        for i in range(W.shape[1]):
            W[row, i] = 0.0
        if a < MOTION:
            if not points.linear:
                for i in range(L):
                    W[row, i] = points.odd * ((up[i, a] - mean[j]) + (down[i, a] - mean[j]))
                W[row, L] = points.centre * (middle[a] - mean[j])
            for i in range(_INPUTS):
                level = dt * np.sqrt(0.5 * (data.input_std[k - 1, i] ** 2 + data.input_std[k, i] ** 2))
                W[row, first_noise + i] = work.noise[a, i] * level
        if data.drift[a] > 0.0:
            W[row, column] = data.drift[a] * np.sqrt(dt)
            column += 1
    triangularise(W, len(moving), W.shape[1])
    for row in range(len(moving)):
        for i in range(A.shape[1] - L):
            A[moving[row], L + i] = W[row, i] if i <= row else 0.0


@njit(cache=True)
def adopt_prediction(active, estimate, work):  # type: ignore[no-untyped-def]
    """Replace the estimate by the prediction; inactive states are those of the centre point."""
    estimate.full[:] = work.middle
    for j in range(len(active)):
        estimate.full[active[j]] = work.mean[j]
    lower_triangle(work.root, estimate.S)


@njit(**UNCOUNTED)
def predict_readings(k, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Readings of the instruments sampled at k, at all sigma points; returns their number."""
    full, S, active, inputs, wanted = estimate.full, estimate.S, data.active, data.inputs[k], work.wanted
    count = 0
    for c in range(len(wanted)):
        wanted[c] = np.isfinite(data.measurements[k, c])
        if wanted[c]:
            work.kept[count] = c
            count += 1
    if count == 0:
        return count
    here, there = work.angles[0], work.angles[1]
    attitude(full, here)
    observe_at(full, inputs, data.place, data.flank, wanted, here, work.y_middle)
    point = work.point
    for i in range(len(active)):
        copy(full, point)
        for j in range(i, len(active)):
            point[active[j]] += points.reach * S[j, i]
        attitude_near(point, full, here, there)
        observe_at(point, inputs, data.place, data.flank, wanted, there, work.y_up[i])
        for j in range(i, len(active)):
            point[active[j]] = full[active[j]] - points.reach * S[j, i]
        attitude_near(point, full, here, there)
        observe_at(point, inputs, data.place, data.flank, wanted, there, work.y_down[i])
    return count


@njit(**UNCOUNTED)
def compare(k, count, data, points, estimate, output, work):  # type: ignore[no-untyped-def]
    """Innovations nu of the readings inside the gate, with the rows O_y and [E_y c_y]; returns their number."""
    L, y0, y_up, y_down = len(data.active), work.y_middle, work.y_up, work.y_down
    O_y, E_y, kept, waiting = work.O_y, work.E_y, work.kept, estimate.waiting
    used = 0
    for b in range(count):
        c = kept[b]
        # Mean of the predicted readings.
        mean = y0[c]
        if not points.linear:
            total = 0.0
            for i in range(L):
                total += (y_up[i, c] - y0[c]) + (y_down[i, c] - y0[c])
            mean = y0[c] + points.mean_weight * total
        innovation = data.measurements[k, c] - mean
        if CIRCULAR[c]:
            innovation -= 2.0 * np.pi * np.round(innovation / (2.0 * np.pi))
        # Its variance from the deviations.
        variance = data.measurement_std[c] ** 2
        for i in range(L):
            O_y[used, i] = points.odd * (y_up[i, c] - y_down[i, c])
            variance += O_y[used, i] ** 2
            E_y[used, i] = 0.0
            if not points.linear:
                E_y[used, i] = points.odd * ((y_up[i, c] - mean) + (y_down[i, c] - mean))
                variance += E_y[used, i] ** 2
        E_y[used, L] = points.centre * (y0[c] - mean)
        variance += E_y[used, L] ** 2
        output.innovations[k, c] = innovation
        output.innovation_std[k, c] = np.sqrt(variance)
        # Gate.
        outside = data.gate > 0.0 and abs(innovation) > data.gate * np.sqrt(variance)
        if outside and waiting[c] < _MAX_REJECTED:
            output.rejected[k, c] = True
            waiting[c] += 1
            continue
        waiting[c] = 0
        work.nu[used] = innovation
        kept[used] = c
        used += 1
    return used


@njit(**UNCOUNTED)
def update(count, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Correct the estimate by `count` innovations; returns the normalised innovation squared and log-likelihood."""
    L, nu, U, Y, S, active = len(data.active), work.nu, work.S_y, work.K_S, estimate.S, data.active
    # R_e = tria [R E_y c_y]
    for b in range(count):
        for c in range(count):
            U[b, c] = data.measurement_std[work.kept[b]] if b == c else 0.0
        for i in range(L):
            Y[i, b] = 0.0
    if not points.linear:
        absorb(U, work.E_y, Y[:0], S[:0], count, L + 1)
    # tria [R_e O_y; 0 S-] = [S_y 0; K S_y  S+]
    absorb(U, work.O_y, Y, S, count, L)
    triangularise(S, L, L)
    # nu = S_y^-1 nu
    square, log_determinant = 0.0, 0.0
    for b in range(count):
        value = nu[b]
        for c in range(b):
            value -= U[b, c] * nu[c]
        nu[b] = value / U[b, b]
        square += nu[b] * nu[b]
        log_determinant += np.log(abs(U[b, b]))
    # x = x- + K S_y nu
    for i in range(L):
        move = 0.0
        for b in range(count):
            move += Y[i, b] * nu[b]
        estimate.full[active[i]] += move
    return square, -log_determinant - 0.5 * (square + count * np.log(2.0 * np.pi))
