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

import numpy as np

from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.kinematics import GUST
from structsel.numerics.square_root import copy, triangularise
from structsel.numerics.unscented_arrays import PHI, PSI, THETA, set_angles
from structsel.numerics.unscented_prediction import adopt_prediction, predict
from structsel.numerics.unscented_smoother import attitude_roots, store_smoother_step, triangularise_with_root
from structsel.numerics.unscented_update import compare, predict_readings, update

COMPLETE, NOT_FINITE = 0, 1
"""How a run ended."""


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
            if len(steps.gain):
                triangularise_with_root(columns, data, estimate, work)
                store_smoother_step(k - first, columns, data, estimate, work, steps)
            else:
                triangularise(work.A, 0, work.N.shape[1], columns, work.gain.shape[1], work.total)
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
