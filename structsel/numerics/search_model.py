"""Model of a structure search, compiled: rows of a triangular factor of the correlation matrix.

R is the correlation matrix of [candidates, response]. For the k kept columns A, in order of entry, with R_AA = U'U,
a search holds

* ``W`` = U'^-1 R[A, :], one row per kept term, its last column belonging to the response;
* ``T`` = U^-1, so that theta = T W[:, -1] and (R_AA)^-1 = T T';
* ``d`` = 1 - column sums of W^2: tolerance of every column, the fraction of its centred variance that the kept terms do
  not explain (1 - R^2 for the response);
* ``b`` = R[:p, -1] - W[:, :p]' W[:, -1]: remaining correlation of every candidate with the response.

Candidate j reduces 1 - R^2 by b_j^2 / d_j. A kept term m reduces it by theta_m^2 / (T T')_mm. Without term m, each
column regains its component c along the direction that only m spans::

    c = T[m] W / |T[m]|,    d + c^2,    b + c c_y

A term enters in O(p k) operations, leaves by Givens rotations in O(p k), and all k p exchanges of one term for another
are evaluated in O(p k^2). No p x p matrix is formed except in the pair moves of `penalised_search`. All functions
release the interpreter lock, so resamples may run in threads.

Numba's cache does not detect changes in kernels imported from another file: after an edit here, delete the cache of
`stepwise_kernel` and `penalised_search`.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

# int64, not plain integers: numba would compile every kernel again for each literal value.
ZERO, NONE = np.int64(0), np.int64(-1)
ENTER, LEAVE, SWAP, REFUSE = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
NO_F, PERFECT, MAX_TERMS, NO_DOF, MOVE_LIMIT, CONSTANT, NO_GAIN, NONE_LEFT, OPTIMUM = range(9)
ACTIONS = ("enter", "leave", "swap", "refuse")
STOPS = (
    "no term outside reaches F_in",
    "perfect fit",
    "max_terms reached",
    "no degrees of freedom left",
    "move limit reached",
    "constant response",
    "the best term outside gains too little",
    "no candidate left",
    "no move lowers the criterion",
)
"""Names of the actions ENTER to REFUSE, and of the reasons NO_F to OPTIMUM."""
ACTION, INDEX, OTHER, PARTIAL_F, PARTIAL_R, UNEXPLAINED, TERMS = range(7)  # columns of a trace
ROUNDING = 1e-14  # largest error assumed in an entry of the correlation matrix
MARGIN = 1e-10  # least relative reduction of rss by an exchange, so that rounding cannot cause a cycle


class Model(NamedTuple):
    """Kept terms of a search and the remaining correlations, in the letters of this file; k rows are used."""

    C: Array  # (p+1, p+1) centred cross-products
    scale: Array  # (p+1,) 1 / sqrt(C_jj), 0 for a constant column
    W: Array  # (limit, p+1)
    T: Array  # (limit, limit) upper triangular
    d: Array  # (p+1,)
    b: Array  # (p,)
    chosen: Array  # (limit,) int64: candidates in order of entry
    inside: Array  # (p,) bool
    forced: Array  # (p,) bool: never leaves


# ---------------------------------------------------------------- terms in and out


@njit(nogil=True, cache=True, error_model="numpy")
def _empty_model(C, limit):
    p = C.shape[0] - 1
    scale, d, b = np.zeros(p + 1), np.zeros(p + 1), np.zeros(p)
    for j in range(p + 1):
        if C[j, j] > 0.0:
            scale[j] = 1.0 / np.sqrt(C[j, j])
            d[j] = 1.0
    for j in range(p):
        b[j] = C[j, p] * scale[j] * scale[p]
    W, T, chosen = np.empty((limit, p + 1)), np.empty((limit, limit)), np.empty(limit, np.int64)
    return Model(C, scale, W, T, d, b, chosen, np.zeros(p, np.bool_), np.zeros(p, np.bool_))


@njit(nogil=True, cache=True, error_model="numpy")
def _enter(model, j, k):
    """Append candidate j: a row of W by substitution, a column of T; returns the new k."""
    C, scale, W, T, d, b = model.C, model.scale, model.W, model.T, model.d, model.b
    p = b.size
    row = W[k]
    for c in range(p + 1):
        row[c] = C[j, c] * scale[j] * scale[c]
    for i in range(k):
        f, other = W[i, j], W[i]
        for c in range(p + 1):
            row[c] -= f * other[c]
    inverse = 1.0 / np.sqrt(row[j])
    for c in range(p + 1):
        row[c] *= inverse
        d[c] -= row[c] * row[c]
    for c in range(p):
        b[c] -= row[p] * row[c]
    for i in range(k):
        total = 0.0
        for m in range(i, k):
            total += T[i, m] * W[m, j]
        T[i, k] = -total * inverse
        T[k, i] = 0.0
    T[k, k] = inverse
    model.chosen[k] = j
    model.inside[j] = True
    d[p] = max(d[p], 0.0)
    return k + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _leave(model, m, k):
    """Rotate term m to the last row and remove that row; returns the new k."""
    W, T, d, b, chosen = model.W, model.T, model.d, model.b, model.chosen
    p = b.size
    for i in range(m, k - 1):
        upper, lower = W[i], W[i + 1]
        f, g = upper[chosen[i + 1]], lower[chosen[i + 1]]
        r = np.sqrt(f * f + g * g)
        f, g = f / r, g / r
        for c in range(p + 1):
            a = upper[c]
            upper[c] = f * a + g * lower[c]
            lower[c] = f * lower[c] - g * a
        for c in range(k):
            a = T[c, i]
            T[c, i] = f * a + g * T[c, i + 1]
            T[c, i + 1] = f * T[c, i + 1] - g * a
    row = W[k - 1]
    for c in range(p + 1):
        d[c] += row[c] * row[c]
    for c in range(p):
        b[c] += row[p] * row[c]
    model.inside[chosen[m]] = False
    for i in range(m, k - 1):
        chosen[i] = chosen[i + 1]
        for c in range(k - 1):
            T[i, c] = T[i + 1, c]
    return k - 1


@njit(nogil=True, cache=True, error_model="numpy")
def estimates(model, k, theta, loss):
    """Standardised theta, and the increase of 1 - R^2 without each term; returns the rounding error of 1 - R^2."""
    W, T = model.W, model.T
    p = W.shape[1] - 1
    size = 1.0
    for i in range(k):
        value = norm = 0.0
        for m in range(i, k):
            value += T[i, m] * W[m, p]
            norm += T[i, m] * T[i, m]
        theta[i] = value
        loss[i] = value * value / norm
        size += abs(value)
    return ROUNDING * size * size


@njit(nogil=True, cache=True, error_model="numpy")
def initial_model(C, dof, forced, initial, limit, tol, trace):
    """Enter the forced and then the initial terms; a dependent one is refused."""
    model = _empty_model(C, limit)
    k, step = ZERO, ZERO
    for part in range(2):
        wanted = forced if part == 0 else initial
        for j in wanted:
            if model.inside[j] or k >= limit:
                continue
            if model.d[j] > tol:
                k, step = record_entry(model, j, k, dof, trace, step, ENTER, NONE)
                model.forced[j] = part == 0
            else:
                step = _record(trace, step, REFUSE, j, NONE, np.nan, np.nan, model.d[-1], k)
    return model, k, step


@njit(nogil=True, cache=True, error_model="numpy")
def search_result(model, k, tol):
    """Recompute in the order of entry, without the rounding of the moves: chosen, theta, rss, refused."""
    C, scale, d, b = model.C, model.scale, model.d, model.b
    p = b.size
    for j in range(p + 1):
        d[j] = 1.0 if scale[j] > 0.0 else 0.0
    for j in range(p):
        b[j] = C[j, p] * scale[j] * scale[p]
    for i in range(k):
        _enter(model, model.chosen[i], i)
    theta = np.empty(k)
    estimates(model, k, theta, np.empty(k))
    for i in range(k):
        theta[i] *= scale[model.chosen[i]] / scale[p]
    refused = np.zeros(p, np.bool_)
    for j in range(p):
        refused[j] = not model.inside[j] and d[j] <= tol
    return model.chosen[:k].copy(), theta, d[p] * C[p, p], refused


# ---------------------------------------------------------------- the trace of the moves


@njit(nogil=True, cache=True, error_model="numpy")
def _record(trace, step, action, index, other, F, r, unexplained, k):
    if step < trace.shape[0]:
        trace[step, ACTION] = action
        trace[step, INDEX] = index
        trace[step, OTHER] = other
        trace[step, PARTIAL_F] = F
        trace[step, PARTIAL_R] = r
        trace[step, UNEXPLAINED] = unexplained
        trace[step, TERMS] = k
    return step + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _partial_f_and_r(loss, rss, freedom):
    if rss <= 0.0:
        return (np.inf, 1.0) if loss > 0.0 else (0.0, 0.0)
    return loss / (rss / freedom), np.sqrt(loss / (loss + rss))


@njit(nogil=True, cache=True, error_model="numpy")
def record_entry(model, j, k, dof, trace, step, action, other):
    """Enter candidate j and record it; returns the new k and step."""
    d, b = model.d, model.b
    sign = np.sign(b[j])
    gain = b[j] * b[j] / d[j]
    F, r = _partial_f_and_r(gain, d[-1] - gain, dof - k - 1)
    k = _enter(model, j, k)
    return k, _record(trace, step, action, j, other, F, sign * r, d[-1], k)


@njit(nogil=True, cache=True, error_model="numpy")
def record_exit(model, m, k, dof, theta, loss, trace, step):
    """Remove term m and record it; returns the new k and step."""
    j = model.chosen[m]
    F, r = _partial_f_and_r(loss[m], model.d[-1], dof - k)
    r *= np.sign(theta[m])
    k = _leave(model, m, k)
    return k, _record(trace, step, LEAVE, j, NONE, F, r, model.d[-1], k)


@njit(nogil=True, cache=True, error_model="numpy")
def record_swap(model, m, j, k, dof, trace, step):
    """Exchange term m for candidate j and record it; returns the new k and step."""
    old = model.chosen[m]
    k = _leave(model, m, k)
    return record_entry(model, j, k, dof, trace, step, SWAP, old)
