"""Compiled search by moves of up to two terms in and two out that lower a criterion; letters of `search_model`."""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.search_model import (
    CONSTANT,
    ENTER,
    MARGIN,
    MOVE_LIMIT,
    NONE,
    OPTIMUM,
    ROUNDING,
    estimates,
    initial_model,
    record_entry,
    record_exit,
    record_swap,
    search_result,
)


class Outside(NamedTuple):
    """Candidates that may enter and, last, the response; q + 1 columns."""

    columns: Array  # (q+1,) int64
    V: Array  # (k, q+1) T W of these columns: row m is the component that only term m explains
    S: Array  # (q, q) remaining correlations among them, above the diagonal; for pairs only
    d: Array  # (q,)
    b: Array  # (q,)


@njit(nogil=True, cache=True, error_model="numpy")
def _columns_outside(model, k, pairs, S):
    """Columns that are not in the model; S is workspace, filled if pairs are tried."""
    C, scale, W, T = model.C, model.scale, model.W, model.T
    p = model.b.size
    index = np.empty(p + 1, np.int64)
    q = 0
    for a in range(p):
        if not model.inside[a] and scale[a] > 0.0:
            index[q] = a
            q += 1
    index[q] = p
    index = index[: q + 1]
    packed, V = np.zeros((-(-k // 4) * 4, q + 1)), np.zeros((k, q + 1))
    for i in range(k):
        for a in range(q + 1):
            packed[i, a] = W[i, index[a]]
    for m in range(k):
        for i in range(m, k):
            f, row, other = T[m, i], V[m], packed[i]
            for a in range(q + 1):
                row[a] += f * other[a]
    if pairs:
        size = scale[index]
        for a in range(q):
            row, products, places = S[a, a + 1 : q], C[index[a]], index[a + 1 : q]
            unit, sizes = size[a], size[a + 1 : q]
            for c in range(row.size):
                row[c] = products[places[c]] * unit * sizes[c]
            for i in range(0, k, 4):  # four at once, so that the row is read and written less often
                f0, f1, f2, f3 = packed[i : i + 4, a]
                w0, w1, w2, w3 = packed[i], packed[i + 1], packed[i + 2], packed[i + 3]
                w0, w1, w2, w3 = w0[a + 1 : q], w1[a + 1 : q], w2[a + 1 : q], w3[a + 1 : q]
                for c in range(row.size):
                    row[c] -= f0 * w0[c] + f1 * w1[c] + f2 * w2[c] + f3 * w3[c]
    return Outside(index, V, S, model.d[index[:q]], model.b[index[:q]])


@njit(nogil=True, cache=True, error_model="numpy")
def _direction_beyond(model, outside, m, k, g_before, c_before, g, c):
    """Direction g (k,) that only term m spans, orthogonal to g_before, and the component c (q+1,) of each column."""
    if m < 0:
        g[:] = 0.0
        c[:] = 0.0
        return
    T = model.T
    common = norm = 0.0
    for i in range(k):
        g[i] = T[m, i] if m <= i else 0.0
        common += g[i] * g_before[i]
    for i in range(k):
        g[i] -= common * g_before[i]
        norm += g[i] * g[i]
    size = np.sqrt(norm)
    for i in range(k):
        g[i] /= size
    row = outside.V[m]
    for a in range(c.size):
        c[a] = (row[a] - common * c_before[a]) / size


@njit(nogil=True, cache=True, error_model="numpy")
def _after_exit(d, b, c, D, B):
    """D = d + c^2 and B = b + c c_y; the last entry of c is the response's."""
    c_y = c[D.size]
    for a in range(D.size):
        D[a] = d[a] + c[a] * c[a]
        B[a] = b[a] + c[a] * c_y


@njit(nogil=True, cache=True, error_model="numpy")
def _best_single(D, B, tol, needed):
    """Candidate with the largest B^2 / D above `needed`, or -1."""
    count = 0  # usually there is none, which a loop without branches detects fastest
    for a in range(D.size):
        count += B[a] * B[a] > needed * D[a]
    best, one = needed, -1
    if count:
        for a in range(D.size):
            if D[a] > tol and B[a] * B[a] > best * D[a]:
                best, one = B[a] * B[a] / D[a], a
    return best, one


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _mark_pairs(outside, rss, needed, marked):
    """Mark each candidate that, with a later one, may reduce 1 - R^2 by more than `needed` if no term leaves.

    Of the reduction less `needed`, times the determinant, the error is that of an entry times 2 B.
    """
    S, D, B = outside.S, outside.d, outside.b
    q, margin = D.size, -8.0 * ROUNDING * np.sqrt(rss)
    for i in range(q):
        D_i, B_i = D[i], B[i]
        row, D_j, B_j = S[i, i + 1 : q], D[i + 1 :], B[i + 1 :]
        count, rest = 0, B_i * B_i - needed * D_i
        for j in range(row.size):
            s = row[j]
            count += rest * D_j[j] + D_i * B_j[j] * B_j[j] + s * (needed * s - 2.0 * B_i * B_j[j]) > margin
        marked[i] = count > 0


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _best_pair(S, D, B, c1, c2, tol, needed, marked):
    """Pair, the first of it marked, with the largest reduction of 1 - R^2 above `needed`, or -1.

    With s = S_ij + c1_i c1_j + c2_i c2_j the reduction is::

        (B_i^2 D_j - 2 B_i B_j s + B_j^2 D_i) / (D_i D_j - s^2)
    """
    q = D.size
    best, one, other = needed, -1, -1
    for i in range(q - 1):
        D_i, B_i, f1, f2 = D[i], B[i], c1[i], c2[i]
        if D_i <= tol or not marked[i]:
            continue
        # Usually there is no such pair, which a loop without branches and divisions detects fastest: the reduction less
        # the best, times the determinant. Its views begin at zero, because the compiler vectorises only if no index can
        # be negative.
        row, D_j, B_j, g1, g2 = S[i, i + 1 : q], D[i + 1 :], B[i + 1 :], c1[i + 1 :], c2[i + 1 :]
        count, rest = 0, B_i * B_i - best * D_i
        for j in range(row.size):
            s = row[j] + f1 * g1[j] + f2 * g2[j]
            count += rest * D_j[j] + D_i * B_j[j] * B_j[j] + s * (best * s - 2.0 * B_i * B_j[j]) > 0.0
        if not count:
            continue
        for j in range(row.size):
            s = row[j] + f1 * g1[j] + f2 * g2[j]
            det = D_i * D_j[j] - s * s
            gain = (B_i * B_i * D_j[j] - 2.0 * B_i * B_j[j] * s + B_j[j] * B_j[j] * D_i) / det
            if gain > best and det > tol * max(D_i, D_j[j]):
                best, one, other = gain, i, i + 1 + j
    return best, one, other


@njit(nogil=True, cache=True, error_model="numpy")
def _best_move(model, k, dof, penalty, floor, max_terms, tol, level, S):
    """Best move of at most level + 1 terms, at most two of them out and two in: (out, out, in, in), -1 for none.

    Without two terms every candidate has d + c1^2 + c2^2 and b + c1 c1_y + c2 c2_y, with the components c1 and,
    orthogonal to it, c2.
    """
    n_max = min(level, 2)
    outside = _columns_outside(model, k, n_max > 1, S)
    q = outside.d.size
    D1, B1, D, B = np.empty(q), np.empty(q), np.empty(q), np.empty(q)
    g0, g1, g2 = np.zeros(k), np.zeros(k), np.zeros(k)
    c0, c1, c2 = np.zeros(q + 1), np.zeros(q + 1), np.zeros(q + 1)
    best = dof * np.log(max(model.d[-1], floor)) + penalty * k - MARGIN * dof
    move = np.full(4, NONE)
    # With a term left out a pair leaves no less unexplained than with it: after one exit only those pairs can lower the
    # criterion that, without any, reduce 1 - R^2 by the price of one term. After two exits every pair can.
    marked, every = np.ones(q, np.bool_), np.ones(q, np.bool_)
    if n_max > 1:
        price = model.d[-1] - np.exp((best - penalty * (k + 1)) / dof)
        _mark_pairs(outside, model.d[-1], price, marked)
    for out1 in range(-1, k):
        if out1 >= 0 and model.forced[model.chosen[out1]]:
            continue
        _direction_beyond(model, outside, out1, k, g0, c0, g1, c1)
        _after_exit(outside.d, outside.b, c1, D1, B1)
        for out2 in range(-1, max(out1, 0) if n_max > 1 else 0):
            if out2 >= 0 and model.forced[model.chosen[out2]]:
                continue
            _direction_beyond(model, outside, out2, k, g1, c1, g2, c2)
            _after_exit(D1, B1, c2, D, B)
            n_out = (out1 >= 0) + (out2 >= 0)
            base = model.d[-1] + c1[q] * c1[q] + c2[q] * c2[q]
            for n_in in range(n_max + 1):
                left = k - n_out + n_in
                if left > max_terms or n_out + n_in == 0 or n_out + n_in > level + 1:
                    continue
                # The 1 - R^2 below which this move is better than the best so far.
                bound = np.exp((best - penalty * left) / dof)
                gain, one, other = 0.0, -1, -1
                if n_in > 0 and bound <= floor:
                    continue
                if n_in == 1:
                    gain, one = _best_single(D, B, tol, base - bound)
                elif n_in == 2:
                    which = marked if n_out < 2 else every
                    gain, one, other = _best_pair(outside.S, D, B, c1, c2, tol, base - bound, which)
                if n_in > 0 and one < 0:
                    continue
                value = dof * np.log(max(base - gain, floor)) + penalty * left
                if value < best:
                    best = value
                    move[0], move[1] = out1, out2
                    move[2] = outside.columns[one] if one >= 0 else NONE
                    move[3] = outside.columns[other] if other >= 0 else NONE
    return move


@njit(nogil=True, cache=True, error_model="numpy")
def penalised_search(C, dof, penalty, forced, initial, max_terms, depth, tol, trace):
    """Add, drop and exchange terms while dof log(rss) + penalty k decreases; the best move first.

    Parameters
    ----------
    C, dof, forced, initial, max_terms, tol, trace
        As in :func:`stepwise_search`.
    penalty : float
        Of one term: log(N) for BIC, 2 for AIC.
    depth : int
        1: one in, one out, one for one. 2: also two in, two out, two for one and one for two.
        3: also two for two.

    Returns
    -------
    chosen, theta, rss, refused, why, moves
        As in :func:`stepwise_search`.
    """
    p = C.shape[0] - 1
    limit = max(0, min(p, int(np.ceil(dof)) - 1))
    model, k, step = initial_model(C, dof, forced, initial, limit, tol, trace)
    theta, loss = np.empty(limit), np.empty(limit)
    max_size = min(limit, max_terms)
    pairs = p if depth > 1 else 0
    S = np.empty((pairs, pairs))
    floor = 0.0
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        floor = max(floor, estimates(model, k, theta, loss))
        move = np.full(4, NONE)
        for level in range(1, depth + 1):  # the cheap moves first
            move = _best_move(model, k, dof, penalty, floor, max_size, tol, level, S)
            if move.max() >= 0:
                break
        if move.max() < 0:
            why = OPTIMUM
        elif move[0] >= 0 and move[1] < 0 and move[2] >= 0 and move[3] < 0:
            k, step = record_swap(model, move[0], move[2], k, dof, trace, step)
        else:
            for m in move[:2]:  # the later one first, so that the other keeps its place
                if m >= 0:
                    estimates(model, k, theta, loss)
                    k, step = record_exit(model, m, k, dof, theta, loss, trace, step)
            for j in move[2:]:
                if j >= 0:
                    k, step = record_entry(model, j, k, dof, trace, step, ENTER, NONE)
    chosen, theta_kept, rss_kept, refused = search_result(model, k, tol)
    return chosen, theta_kept, rss_kept, refused, why, step
