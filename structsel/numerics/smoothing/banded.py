"""Compiled kernels of the smoothing spline: one sweep of a sequential QR forward, one back.

With the state s = (x, x', ..., x^(m-1)) the spline is the least-squares problem of the rows

* x_k - y_k, one per sample that is there, in units of the noise;
* C^-1 (s_{k+1} - F s_k), m per step, with C C' the covariance that white noise in x^(m) gives in a step.

Rows enter one sample at a time and are triangularised by Householder reflections, so a state is eliminated as
soon as nothing more refers to it, in O(n). Working on the rows, not on their products, keeps twice the digits, and a
state about which nothing is known yet is a triangle of zeros: no large starting variance is needed.

The kernels share one file because numba's cache does not notice changes in kernels imported from another.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def eliminate(step, y, drive, L, LF, store, keep):
    """Forward sweep.

    Parameters
    ----------
    step : (n - 1,) array [s]
    y : (n,) array
        NaN where a sample is missing.
    drive : float
        Square root of the intensity of the white noise in x^(m), over the measurement noise.
    L, LF : (m, m) arrays
        Inverse Cholesky factor of the step's covariance, and it times the transition, for a step of one second.
    store : (n, m, 2 m + 1) array
        Receives the triangular rows [U, V, c] of each state, U s_k + V s_{k+1} = c, where `keep`.

    Returns
    -------
    rss : float
        Residual sum of squares, noise units squared times the noise variance.
    logdet : float
        log |det| of the whole triangle less that of the step rows' own factors.
    """
    m = L.shape[0]
    n = y.size
    width = 2 * m + 1
    rows = np.zeros((width, width))
    carried = np.zeros((m, m + 1))
    rss, logdet = 0.0, 0.0
    for k in range(n):
        last = k == n - 1
        rows[:] = 0.0
        rows[:m, :m] = carried[:, :m]
        rows[:m, 2 * m] = carried[:, m]
        if not np.isnan(y[k]):
            rows[m, 0] = 1.0
            rows[m, 2 * m] = y[k]
        if not last:
            for j in range(m):
                # The covariance of a step h scales with h^(2m - 1 - i - j), so one factor serves all steps.
                scale = 1.0 / (drive * step[k] ** (m - 0.5 - j))
                for i in range(m):
                    rows[m + 1 + i, j] = -LF[i, j] * scale
                    rows[m + 1 + i, m + j] = L[i, j] * scale
                logdet -= np.log(abs(L[j, j]) * scale)
        for j in range(m if last else 2 * m):
            _reflect(rows, j)
        for i in range(m):
            logdet += np.log(abs(rows[i, i]))
        if keep:
            store[k] = rows[:m]
        if last:
            for i in range(m, width):
                rss += rows[i, 2 * m] ** 2
        else:
            rss += rows[2 * m, 2 * m] ** 2
            carried[:, :m] = rows[m : 2 * m, m : 2 * m]
            carried[:, m] = rows[m : 2 * m, 2 * m]
    return rss, logdet


@njit(nogil=True, cache=True, error_model="numpy")
def _reflect(rows, j):
    """Householder reflection that leaves zeros below the diagonal of column j."""
    width = rows.shape[0]
    norm = 0.0
    for i in range(j, width):
        norm += rows[i, j] ** 2
    norm = np.sqrt(norm)
    if norm == 0.0:
        return
    pivot = -norm if rows[j, j] > 0.0 else norm
    head = rows[j, j] - pivot
    for c in range(j + 1, width):
        dot = head * rows[j, c]
        for i in range(j + 1, width):
            dot += rows[i, j] * rows[i, c]
        dot /= -pivot * head
        rows[j, c] -= dot * head
        for i in range(j + 1, width):
            rows[i, c] -= dot * rows[i, j]
    rows[j, j] = pivot
    for i in range(j + 1, width):
        rows[i, j] = 0.0


@njit(nogil=True, cache=True, error_model="numpy")
def solve_back(store, states, variances):
    """Backward sweep: states (n, m) and the diagonal of their covariance (n, m), over the noise variance."""
    n, m = states.shape
    cov = np.zeros((m, m))
    new = np.zeros((m, m))
    wide = np.zeros((m, 2 * m + 1))  # U^-1 [I, V, c]
    for k in range(n - 1, -1, -1):
        wide[:] = 0.0
        for i in range(m - 1, -1, -1):
            wide[i, i] = 1.0
            wide[i, m:] = store[k, i, m:]
            for j in range(i + 1, m):
                wide[i] -= store[k, i, j] * wide[j]
            wide[i] /= store[k, i, i]
        for i in range(m):
            states[k, i] = wide[i, 2 * m]
            if k < n - 1:
                for j in range(m):
                    states[k, i] -= wide[i, m + j] * states[k + 1, j]
            for j in range(m):
                total = 0.0
                for a in range(m):
                    total += wide[i, a] * wide[j, a]
                    if k < n - 1:
                        for b in range(m):
                            total += wide[i, m + a] * cov[a, b] * wide[j, m + b]
                new[i, j] = total
        cov[:] = new
        for i in range(m):
            variances[k, i] = cov[i, i]
