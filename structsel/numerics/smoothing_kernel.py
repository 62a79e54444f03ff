"""Compiled kernels of the smoothing spline: one sweep of a sequential QR forward, one back.

With the state s = (x, x', ..., x^(m-1)) the spline is the least-squares problem of the rows

* x_k - y_k, one per sample that is there, in units of the noise;
* C^-1 (s_{k+1} - F s_k), m per step, with C C' the covariance that white noise in x^(m) gives in a step.

Rows are added sample by sample and triangularised by Householder reflections. A state is eliminated after the last
row that contains it, so the work is O(n). Where steps are even the triangle converges, and from there on only the
right-hand sides change. Rows, unlike their products, keep all digits. An unknown initial state is a triangle of zeros,
so no large initial variance is needed.

The kernels are in one file because numba's cache does not detect changes in kernels imported from another.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

import numpy as np

from structsel.numerics.compiling import njit

_EVEN = 1e-9  # relative difference of steps that are treated as even; times are rounded
_STILL = 1e-13  # of the diagonal; a smaller change of the triangle is none


@njit(nogil=True, cache=True, error_model="numpy")
def forward_sweep(step, y, drive, L, LF, store, keep):
    """Forward sweep.

    Parameters
    ----------
    step : (n - 1,) array [s]
    y : (n, c) array
        One or several channels; NaN where a sample is missing, of all or of none.
    drive : float
        Square root of the intensity of the white noise in x^(m), over the measurement noise.
    L, LF : (m, m) arrays
        Inverse Cholesky factor of the step's covariance, and it times the transition, for a step of one second.
    store : (n, m, 2 m + 1) array
        Receives the triangular rows [U, V, c] of each state, U s_k + V s_{k+1} = c, where `keep`; of one channel.

    Returns
    -------
    rss : (c,) array
        Residual sums of squares, noise units squared times the noise variance.
    logdet : float
        log |det| of the complete triangle minus that of the factors of the step rows.
    """
    m = L.shape[0]
    n, channels = y.shape
    width = 2 * m + 1
    rows = np.zeros((width, 2 * m + channels))
    with_turn = np.zeros((width, width + m))
    turn = with_turn[:, 2 * m :]
    carried = np.zeros((m, m + channels))
    rss = np.zeros(channels)
    logdet, logs, even = 0.0, 0.0, 0.0
    for k in range(n):
        last = k == n - 1
        there = not np.isnan(y[k, 0])
        if there and not last and abs(step[k] - even) < _EVEN * even:
            # The triangle has converged: only the right-hand sides change.
            for c in range(channels):
                for i in range(0 if keep else m, width):
                    total = turn[i, m] * y[k, c]
                    for j in range(m):
                        total += turn[i, j] * carried[j, m + c]
                    rows[i, 2 * m + c] = total
                rss[c] += rows[2 * m, 2 * m + c] ** 2
                for i in range(m):
                    carried[i, m + c] = rows[m + i, 2 * m + c]
            logdet += logs
            if keep:
                store[k] = rows[:m]
            continue
        logs = _fill(rows, carried, step, k, drive, L, LF)
        rows[:m, 2 * m :] = carried[:, m:]
        if there:
            rows[m, 0] = 1.0
            rows[m, 2 * m :] = y[k]
        for j in range(m if last else 2 * m):
            _reflect(rows, j, m)
        for i in range(m):
            logs += np.log(abs(rows[i, i]))
        even = step[k] if there and not last and _converged(rows[m : 2 * m, m : 2 * m], carried) else 0.0
        if even > 0.0:
            _fill(with_turn, carried, step, k, drive, L, LF)
            with_turn[m, 0] = 1.0
            for i in range(m + 1):
                turn[i, i] = 1.0
            for j in range(2 * m):
                _reflect(with_turn, j, m)
        logdet += logs
        if keep:
            store[k] = rows[:m]
        if last:
            for i in range(m, width):
                for c in range(channels):
                    rss[c] += rows[i, 2 * m + c] ** 2
        else:
            for c in range(channels):
                rss[c] += rows[2 * m, 2 * m + c] ** 2
            for i in range(m):
                for j in range(i, m + channels):
                    carried[i, j] = rows[m + i, m + j]
    return rss, logdet


@njit(nogil=True, cache=True, error_model="numpy")
def _fill(rows, carried, step, k, drive, L, LF):
    """Fill in the carried rows and the step after sample k, if any; minus log |det| of the factors of the step rows."""
    m = L.shape[0]
    rows[:] = 0.0
    rows[:m, :m] = carried[:, :m]
    logs = 0.0
    if k < step.size:
        for j in range(m):
            # The covariance of a step h scales with h^(2m - 1 - i - j), so one factor serves all steps.
            scale = 1.0 / (drive * step[k] ** (m - 0.5 - j))
            for i in range(m):
                rows[m + 1 + i, j] = -LF[i, j] * scale
                rows[m + 1 + i, m + j] = L[i, j] * scale
            logs -= np.log(abs(L[j, j]) * scale)
    return logs


@njit(nogil=True, cache=True, error_model="numpy")
def _converged(triangle, carried):
    """Whether a step did not change the triangle, or covariance; further even steps will not either."""
    for i in range(triangle.shape[0]):
        for j in range(i, triangle.shape[0]):
            if not abs(triangle[i, j] - carried[i, j]) < _STILL * abs(triangle[i, i]):
                return False
    return True


@njit(nogil=True, cache=True, error_model="numpy")
def _reflect(rows, j, m):
    """Householder reflection that leaves zeros below the diagonal of column j; the first m rows are a triangle."""
    width, columns = rows.shape
    first = max(j + 1, m)
    norm = rows[j, j] ** 2
    for i in range(first, width):
        norm += rows[i, j] ** 2
    norm = np.sqrt(norm)
    if norm == 0.0:
        return
    pivot = -norm if rows[j, j] > 0.0 else norm
    head = rows[j, j] - pivot
    for c in range(j + 1, columns):
        dot = head * rows[j, c]
        for i in range(first, width):
            dot += rows[i, j] * rows[i, c]
        dot /= -pivot * head
        rows[j, c] -= dot * head
        for i in range(first, width):
            rows[i, c] -= dot * rows[i, j]
    rows[j, j] = pivot
    for i in range(first, width):
        rows[i, j] = 0.0


@njit(nogil=True, cache=True, error_model="numpy")
def backward_sweep(store, states, variances):
    """Backward sweep: states (n, m) and the diagonal of their covariance (n, m), over the noise variance."""
    n, m = states.shape
    cov = np.zeros((m, m))
    new = np.zeros((m, m))
    wide = np.zeros((m, 2 * m))  # U^-1 [I, V]
    still = False  # whether the covariance has converged, which stays so while the triangle is the same
    for k in range(n - 1, -1, -1):
        if k >= n - 2 or not _same_triangle(store[k], store[k + 1]):
            still = False
            wide[:] = 0.0
            for i in range(m - 1, -1, -1):
                wide[i, i] = 1.0
                wide[i, m:] = store[k, i, m : 2 * m]
                for j in range(i + 1, m):
                    wide[i] -= store[k, i, j] * wide[j]
                wide[i] /= store[k, i, i]
        for i in range(m):
            total = 0.0
            for j in range(i, m):
                total += wide[i, j] * store[k, j, 2 * m]
            if k < n - 1:
                for j in range(m):
                    total -= wide[i, m + j] * states[k + 1, j]
            states[k, i] = total
        if not still:
            for i in range(m):
                for j in range(m):
                    total = 0.0
                    for a in range(m):
                        total += wide[i, a] * wide[j, a]
                        if k < n - 1:
                            for b in range(m):
                                total += wide[i, m + a] * cov[a, b] * wide[j, m + b]
                    new[i, j] = total
            still = k < n - 1 and _converged(new, cov)
            cov[:] = new
        for i in range(m):
            variances[k, i] = cov[i, i]


@njit(nogil=True, cache=True, error_model="numpy")
def _same_triangle(rows, others):
    """Whether the triangular rows of two states differ in the right-hand sides only."""
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1] - 1):
            if rows[i, j] != others[i, j]:
                return False
    return True
