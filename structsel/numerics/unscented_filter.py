"""Square-root filter over the kinematics of a flight path, compiled: unscented, or linearised.

The attitude is a unit quaternion; its errors, and the deviations of sigma points from it, are rotation vectors in earth
axes (`rotations`). So there is no singularity, and an unknown heading is the third component at every attitude: it is
left out if it is not estimated.

The covariance P = S S' is never formed. S is lower triangular, with the constants first and the m *moving* states last:
motion, gusts, and constants that drift. Pairs of deviations are turned into their odd part O (a linearisation over the
spread of S) and even part E (the curvature). With [E c N] the even parts, the centre and the process noise,

    S = [C 0; B A],     O = [C 0; B' FA],     S- = [C 0; B' A'],     A' = tria [FA E c N]

A constant is the same at all samples, so its rows, and the columns B', need no triangularisation. An update takes one
reading after the other, in units of its noise [C73]: with o its derivatives along the columns of S,

    S+ = S T,    T T' = I - o o' / (1 + o o'),    T lower triangular

Both only add squares: P stays positive definite. This is possible because the weight of the centre point is not
negative (`square_root` has the weights).

The extended filter is the same with O the derivative along S (`kinematic_tangents`), and no E, c. So is the unscented
filter at samples where S is so narrow that E and c do not matter.

References
----------
[M86], [H17]; [VM01] for the square-root form, [C73] for the update, [B71] for rotation vectors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import REORDERED, UNCOUNTED, Array
from structsel.numerics.compiling import njit
from structsel.numerics.kinematic_tangents import noise_columns, reading_columns, step_columns
from structsel.numerics.kinematics import CIRCULAR, GUST, MEASUREMENTS, STATES, TURN, observe_at, step
from structsel.numerics.rotations import angles_of, cosines_of, to_body, to_earth, turn, vector_between
from structsel.numerics.square_root import absorb, copy, triangularise
from structsel.numerics.unscented_smoother import attitude_roots, store_smoother_step

COMPLETE, NOT_FINITE = 0, 1
"""How a run ended."""
PHI, THETA, PSI = (STATES.index(name) for name in ("phi", "theta", "psi"))
_INPUTS = 6  # accelerometers and gyros have noise
_MAX_REJECTED = 25  # of one channel in a row; then the filter may be wrong, not the channel. Chosen, not critical
_LEAST_COSINE = 1e-3  # of the pitch attitude; limits the noise of phi and psi at the vertical


class FlightData(NamedTuple):
    """Recording and settings of a run; the arrays of `structsel.reconstruction.ukf.KinematicsProblem`.

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
    before: Array  # (L, L) the columns of the root before the step
    N: Array  # (L, m) their moving entries after it
    A: Array  # (m, C) [FA E c N]
    root: Array  # (m, C) its triangular factor
    gain: Array  # (L,)
    square: Array  # (m, m)
    smoothing: Array  # (m, C)
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
    g: Array  # (L,)
    h: Array  # (M,)
    euler: Array  # (3, L) rows of the root for the Euler angles


def workspace(F: int, states: NDArray[np.int64], constants: int, drift: Array, linear: bool) -> FilterWorkspace:
    """Scratch for a full vector of F entries; the `constants` first states do not drift."""
    L, M, m = len(states), len(MEASUREMENTS), len(states) - constants
    C = m + _INPUTS + int(np.sum(drift[states] > 0.0)) + (0 if linear else L + 1)
    e = np.empty
    return FilterWorkspace(
        *(e(F), e((L, F)), e((L, F)), e(F), e(F), e((3, 3)), e((3, 3)), e((3, 3)), e(4), e(4), e((6, 6)), e(6)),
        *(e((L, L)), e((L, m)), e((m, C)), e((m, C)), e(L), e((m, m)), e((m, C)), np.zeros(M), np.zeros((L, M))),
        *(np.zeros((L, M)), np.zeros(M, dtype=np.bool_), np.zeros(M, dtype=np.int64), e(M), e(M), np.zeros((L, M))),
        *(e((L, M)), e((M, L + 1)), e((M, M)), e(L), e(L), e(M), e((3, L))),
    )


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
        wide = not points.linear and is_wide(data, estimate)
        if k > 0:
            # Prediction from sample k - 1.
            columns = predict(k, wide, data, points, estimate, work)
            for i in range(work.A.shape[0]):
                for c in range(columns):
                    work.root[i, c] = work.A[i, c]
            triangularise(work.root, work.A.shape[0], columns)
            if len(steps.gain):
                store_smoother_step(k - first, columns, data, estimate, work, steps)
            adopt_prediction(data, estimate, work)
            if not np.isfinite(estimate.full[THETA] + estimate.full[0]) or not np.isfinite(estimate.T[-1, -1]):
                return total, k, NOT_FINITE
        # Update with what was measured at sample k.
        count = predict_readings(k, wide, data, points, estimate, work)
        count = compare(k, count, wide, data, points, estimate, output, work)
        output.used[k] = count
        if count > 0:
            output.nis[k], log_likelihood = update(count, wide, data, estimate, work)
            total += log_likelihood
        write(k, data, estimate, output, work)
    return total, -1, COMPLETE


@njit(**UNCOUNTED)
def is_wide(data, estimate):  # type: ignore[no-untyped-def]
    """Whether the curvature over the spread of attitude or velocity matters."""
    x, T = estimate.full, estimate.T
    speed = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for i in range(data.constants, len(data.states)):
        state = data.states[i]
        if state <= PSI or state >= GUST:
            total = 0.0
            for j in range(i + 1):
                total += T[j, i] * T[j, i]
            size = 1.0 if PHI <= state <= PSI else speed
            if not total < (data.narrow * size) ** 2:
                return True
    return False


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
    for a in range(m):
        for j in range(f, L):
            work.A[a, j - f] = work.N[j, a]
    # Process noise.
    for j in range(_INPUTS):
        work.level[j] = dt * np.sqrt(0.5 * (data.input_std[k - 1, j] ** 2 + data.input_std[k, j] ** 2))
    noise_columns(full, work.C1, work.level, work.noise)
    for a in range(m):
        for j in range(_INPUTS):
            work.A[a, columns + j] = work.noise[states[f + a], j] if states[f + a] <= PSI else 0.0
    columns += _INPUTS
    for a in range(m):
        if data.drift[states[f + a]] > 0.0:
            for b in range(m):
                work.A[b, columns] = data.drift[states[f + a]] * np.sqrt(dt) if a == b else 0.0
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
            work.A[a, m + j] = points.odd * ((work.up[j, state] - moved) + (work.down[j, state] - moved))
        work.A[a, m + L] = -points.centre * moved
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
            estimate.T[j, i] = work.root[i - f, j - f]


@njit(**UNCOUNTED)
def set_angles(estimate, work):  # type: ignore[no-untyped-def]
    """Euler angles of the quaternion, and its direction cosines in C1."""
    cosines_of(estimate.quaternion, work.C1)
    phi, theta, psi = angles_of(work.C1)
    estimate.full[PHI], estimate.full[THETA], estimate.full[PSI] = phi, theta, psi


@njit(**UNCOUNTED)
def predict_readings(k, wide, data, points, estimate, work):  # type: ignore[no-untyped-def]
    """Readings of the instruments sampled at k at the centre, and their changes over S; returns their number."""
    full, T, states, inputs, wanted = estimate.full, estimate.T, data.states, data.inputs[k], work.wanted
    count = 0
    for c in range(len(wanted)):
        wanted[c] = np.isfinite(data.measurements[k, c])
        if wanted[c]:
            work.kept[count] = c
            count += 1
    if count == 0:
        return count
    if k == 0:
        set_angles(estimate, work)
    observe_at(full, work.C1, inputs, data.place, data.flank, wanted, work.y_middle)
    if not wide:
        reading_columns(T, states, full, work.C1, inputs, data.place, data.flank, wanted, work.column, work.dy)
        return count
    point = work.point
    for j in range(len(states)):
        for side in range(2):
            reach = points.reach if side == 0 else -points.reach
            target = work.y_up[j] if side == 0 else work.y_down[j]
            copy(full, point)
            point[PHI], point[THETA], point[PSI] = 0.0, 0.0, 0.0
            for i in range(j, len(states)):
                point[states[i]] += reach * T[j, i]
            d0, d1, d2 = to_body(work.C1, point[PHI], point[THETA], point[PSI])
            turn(estimate.quaternion, d0, d1, d2, work.q2)
            cosines_of(work.q2, work.C2)
            point[PHI], point[THETA], point[PSI] = angles_of(work.C2)
            observe_at(point, work.C2, inputs, data.place, data.flank, wanted, target)
            for b in range(count):
                c = work.kept[b]
                target[c] -= work.y_middle[c]
                if CIRCULAR[c]:
                    target[c] -= TURN * np.round(target[c] / TURN)
    return count


@njit(**UNCOUNTED)
def compare(k, count, wide, data, points, estimate, output, work):  # type: ignore[no-untyped-def]
    """Innovations of the readings inside the gate, with O and [E_y c_y]; returns their number."""
    L, y_up, y_down, kept = len(data.states), work.y_up, work.y_down, work.kept
    cosine = max(_LEAST_COSINE, np.cos(estimate.full[THETA]))
    used = 0
    for b in range(count):
        c = kept[b]
        sigma = data.measurement_std[c]
        if CIRCULAR[c]:
            # An instrument that errs by one angle about each body axis reads phi and psi with 1 / cos(theta) of it.
            sigma /= cosine
        # Its mean, and its variance from the deviations.
        mean, variance = 0.0, sigma * sigma
        if wide:
            for j in range(L):
                mean += y_up[j, c] + y_down[j, c]
            mean *= points.mean_weight
        for j in range(L):
            change = points.odd * (y_up[j, c] - y_down[j, c]) if wide else work.dy[j, c]
            work.O[j, used] = change
            variance += change * change
            if wide:
                work.E[used, j] = points.odd * ((y_up[j, c] - mean) + (y_down[j, c] - mean))
                variance += work.E[used, j] ** 2
        if wide:
            work.E[used, L] = -points.centre * mean
            variance += work.E[used, L] ** 2
        innovation = data.measurements[k, c] - (work.y_middle[c] + mean)
        if CIRCULAR[c]:
            innovation -= TURN * np.round(innovation / TURN)
        output.innovations[k, c] = innovation
        output.innovation_std[k, c] = np.sqrt(variance)
        # Gate.
        outside = data.gate > 0.0 and abs(innovation) > data.gate * np.sqrt(variance)
        if outside and estimate.waiting[c] < _MAX_REJECTED:
            output.rejected[k, c] = True
            estimate.waiting[c] += 1
            continue
        estimate.waiting[c] = 0
        work.nu[used] = innovation
        work.sigma[used] = sigma
        used += 1
    return used


@njit(**UNCOUNTED)
def update(count, wide, data, estimate, work):  # type: ignore[no-untyped-def]
    """Correct the estimate by `count` innovations; returns the normalised innovation squared and log-likelihood."""
    L, nu, T, move = len(data.states), work.nu, estimate.T, work.move
    log_determinant = whiten(count, L, wide, work)
    square = 0.0
    for i in range(L):
        move[i] = 0.0
    for b in range(count):
        variance = absorb_reading(b, count, T, work.O, work.g, work.h)
        value = nu[b] / variance
        square += nu[b] * value
        log_determinant += 0.5 * np.log(variance)
        for i in range(L):
            move[i] += work.g[i] * value
        for c in range(b + 1, count):
            nu[c] -= work.h[c] * value
    copy(estimate.full, work.point)
    work.point[PHI], work.point[THETA], work.point[PSI] = 0.0, 0.0, 0.0
    for i in range(L):
        work.point[data.states[i]] += move[i]
    d0, d1, d2 = to_body(work.C1, work.point[PHI], work.point[THETA], work.point[PSI])
    turn(estimate.quaternion, d0, d1, d2, estimate.quaternion)
    copy(work.point, estimate.full)
    set_angles(estimate, work)
    return square, -log_determinant - 0.5 * (square + count * np.log(TURN))


@njit(**UNCOUNTED)
def whiten(count, L, wide, work):  # type: ignore[no-untyped-def]
    """Divide innovations and O by the root of their noise [R E_y c_y]; returns the logarithm of its determinant."""
    nu, O, U = work.nu, work.O, work.U
    total = 0.0
    if not wide:
        for b in range(count):
            scale = 1.0 / work.sigma[b]
            nu[b] *= scale
            for j in range(L):
                O[j, b] *= scale
            total += np.log(work.sigma[b])
        return total
    for b in range(count):
        for c in range(count):
            U[b, c] = work.sigma[b] if b == c else 0.0
    absorb(U, work.E, work.E[:0], work.E[:0], count, L + 1)
    for b in range(count):
        for c in range(b):
            nu[b] -= U[b, c] * nu[c]
        nu[b] /= U[b, b]
        total += np.log(abs(U[b, b]))
        for j in range(L):
            for c in range(b):
                O[j, b] -= U[b, c] * O[j, c]
            O[j, b] /= U[b, b]
    return total


@njit(**REORDERED)
def absorb_reading(b, count, T, O, g, h):  # type: ignore[no-untyped-def]
    """Update T, and the columns of O after b, with the reading b of unit noise; returns its variance.

    g (L,) and h (count,) are its covariances with the states and with the readings after it.
    """
    L = len(T)
    for i in range(L):
        g[i] = 0.0
    for c in range(b + 1, count):
        h[c] = 0.0
    variance = 1.0
    for j in range(L - 1, -1, -1):
        o = O[j, b]
        if o == 0.0:
            continue
        more = variance + o * o
        root = 1.0 / np.sqrt(variance * more)
        scale, turned = variance * root, o * root
        for i in range(j, L):
            old = T[j, i]
            T[j, i] = scale * old - turned * g[i]
            g[i] += o * old
        for c in range(b + 1, count):
            old = O[j, c]
            O[j, c] = scale * old - turned * h[c]
            h[c] += o * old
        variance = more
    return variance


@njit(**UNCOUNTED)
def write(k, data, estimate, output, work):  # type: ignore[no-untyped-def]
    """Write the estimate of sample k and its standard deviations."""
    states, T = data.states, estimate.T
    set_angles(estimate, work)
    copy(estimate.quaternion, output.quaternion[k])
    attitude_roots(T, states, estimate.full, work.C1, work.euler)
    for i in range(len(states)):
        state = states[i]
        total = 0.0
        if PHI <= state <= PSI:
            for j in range(len(states)):
                total += work.euler[state - PHI, j] ** 2
        else:
            for j in range(i + 1):
                total += T[j, i] * T[j, i]
        output.x[k, i] = estimate.full[state]
        output.std[k, i] = np.sqrt(total)
