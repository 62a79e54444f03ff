"""Update of the unscented filter with the readings of one sample, one reading after the other.

`unscented_filter` has the equations and the notation.
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import REORDERED, UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.kinematic_tangents import reading_columns
from structsel.numerics.kinematics import CIRCULAR, TURN, observe_at
from structsel.numerics.rotations import angles_of, cosines_of, to_body, turn
from structsel.numerics.square_root import absorb, copy
from structsel.numerics.unscented_arrays import PHI, PSI, THETA, set_angles

_MAX_REJECTED = 25  # of one channel in a row; then the filter may be wrong, not the channel. Chosen, not critical
_LEAST_COSINE = 1e-3  # of the pitch attitude; limits the noise of phi and psi at the vertical


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
    rows, g = work.rows[:L], work.rows[L]
    for j in range(L):
        row = rows[L - 1 - j]
        for i in range(L):
            row[i] = T[j, i]
        for c in range(len(nu)):
            row[L + c] = work.O[j, c] if c < count else 0.0
    square = 0.0
    for i in range(L):
        move[i] = 0.0
    for b in range(count):
        variance = absorb_reading(b, rows, g)
        value = nu[b] / variance
        square += nu[b] * value
        log_determinant += 0.5 * np.log(variance)
        for i in range(L):
            move[i] += g[i] * value
        for c in range(b + 1, count):
            nu[c] -= g[L + c] * value
    for j in range(L):
        for i in range(L):
            T[j, i] = rows[L - 1 - j, i]
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
def absorb_reading(b, rows, g):  # type: ignore[no-untyped-def]
    """Update `rows` (L, W) with the reading b of unit noise, whose derivatives are column L + b; returns its variance.

    Row r is [T[j] O[j]] of j = L - 1 - r. g is as long as a row: the covariances with the states and with the readings.
    The columns of O up to b are of no use afterwards.
    """
    L = len(rows)
    for i in range(len(g)):
        g[i] = 0.0
    variance = 1.0
    # Upwards: downwards, the compiler could not exclude that the rows overlap, and would add one product at a time.
    for r in range(L):
        o = rows[r, L + b]
        if o == 0.0:
            continue
        more = variance + o * o
        root = 1.0 / np.sqrt(variance * more)
        scale, turned = variance * root, o * root
        for i in range(len(g)):
            old = rows[r, i]
            rows[r, i] = scale * old - turned * g[i]
            g[i] += o * old
        variance = more
    return variance
