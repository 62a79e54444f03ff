"""Compiled kernels of the structure search: rows of a triangular factor of the correlation matrix.

R is the correlation matrix of [candidates, response]. For the k kept columns A, in order of entry, with R_AA = U'U,
a search holds

* ``W`` = U'^-1 R[A, :], one row per kept term, its last column belonging to the response;
* ``T`` = U^-1, so that theta = T W[:, -1] and (R_AA)^-1 = T T';
* ``d`` = 1 - column sums of W^2: what of every column the kept ones do not explain (its tolerance, the Schur complement
  relative to the column's own centred variance; the response's is 1 - R^2);
* ``b`` = R[:p, -1] - W[:, :p]' W[:, -1]: what is left of every candidate's correlation with the response.

Candidate j explains b_j^2 / d_j more. A kept term m explains theta_m^2 / (T T')_mm; without it, each column gets back
its part c of the direction that m alone spans::

    c = T[m] W / |T[m]|,    d + c^2,    b + c c_y

A term enters in O(p k) operations, leaves by Givens rotations in O(p k), and all k p exchanges of one term for another
are weighed in O(p k^2). Nothing here forms a p x p matrix except the pair moves of `penalised_search`. Everything
releases the interpreter lock, so resamples may run in threads.

The kernels share one file because numba's cache does not notice changes in kernels imported from another.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from structsel.numerics.arrays import Array

# int64, not plain integers: numba would compile every kernel again for each literal value.
ZERO, NONE = np.int64(0), np.int64(-1)
ENTER, LEAVE, SWAP, REFUSE = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
NO_F, PERFECT, MAX_TERMS, NO_DOF, MOVE_LIMIT, CONSTANT, NO_GAIN, NONE_LEFT, OPTIMUM = range(9)
ACTION, INDEX, OTHER, PARTIAL_F, PARTIAL_R, UNEXPLAINED, TERMS = range(7)  # columns of a trace
ROUNDING = 1e-14  # largest error assumed in an entry of the correlation matrix
MARGIN = 1e-10  # relative fall of rss an exchange must bring, so that rounding cannot make it cycle


class Model(NamedTuple):
    """Kept terms of a search and what they leave, in the letters of this file; k rows of W and T are in use."""

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
    """Rotate term m to the last row and take that off; returns the new k."""
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
def _estimates(model, k, theta, loss):
    """Standardised theta, and what dropping each term would add to 1 - R^2; returns the rounding floor."""
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
def _initial_model(C, dof, forced, initial, limit, tol, trace):
    """Let the forced and then the initial terms in; a dependent one is refused."""
    model = _empty_model(C, limit)
    k, step = ZERO, ZERO
    for part in range(2):
        wanted = forced if part == 0 else initial
        for j in wanted:
            if model.inside[j] or k >= limit:
                continue
            if model.d[j] > tol:
                k, step = _record_entry(model, j, k, dof, trace, step, ENTER, NONE)
                model.forced[j] = part == 0
            else:
                step = _record(trace, step, REFUSE, j, NONE, np.nan, np.nan, model.d[-1], k)
    return model, k, step


@njit(nogil=True, cache=True, error_model="numpy")
def _result(model, k, tol):
    """Rebuild in the order of entry, which sheds the rounding of the moves: chosen, theta, rss, refused."""
    C, scale, d, b = model.C, model.scale, model.d, model.b
    p = b.size
    for j in range(p + 1):
        d[j] = 1.0 if scale[j] > 0.0 else 0.0
    for j in range(p):
        b[j] = C[j, p] * scale[j] * scale[p]
    for i in range(k):
        _enter(model, model.chosen[i], i)
    theta = np.empty(k)
    _estimates(model, k, theta, np.empty(k))
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
def _record_entry(model, j, k, dof, trace, step, action, other):
    d, b = model.d, model.b
    sign = np.sign(b[j])
    gain = b[j] * b[j] / d[j]
    F, r = _partial_f_and_r(gain, d[-1] - gain, dof - k - 1)
    k = _enter(model, j, k)
    return k, _record(trace, step, action, j, other, F, sign * r, d[-1], k)


@njit(nogil=True, cache=True, error_model="numpy")
def _record_exit(model, m, k, dof, theta, loss, trace, step):
    j = model.chosen[m]
    F, r = _partial_f_and_r(loss[m], model.d[-1], dof - k)
    r *= np.sign(theta[m])
    k = _leave(model, m, k)
    return k, _record(trace, step, LEAVE, j, NONE, F, r, model.d[-1], k)


@njit(nogil=True, cache=True, error_model="numpy")
def _record_swap(model, m, j, k, dof, trace, step):
    old = model.chosen[m]
    k = _leave(model, m, k)
    return _record_entry(model, j, k, dof, trace, step, SWAP, old)


# ---------------------------------------------------------------- modified stepwise regression


@njit(nogil=True, cache=True, error_model="numpy")
def _weakest(model, k, loss):
    """The kept term, not forced, whose loss is least."""
    least, at = np.inf, NONE
    for m in range(k):
        if not model.forced[model.chosen[m]] and loss[m] < least:
            least, at = loss[m], m
    return least, at


@njit(nogil=True, cache=True, error_model="numpy")
def _best_entry(model, weights, tol):
    """The candidate outside that explains most, times its weight; what it explains."""
    d, b, inside = model.d, model.b, model.inside
    best, gain, at = -1.0, -1.0, -1
    for j in range(b.size):
        if not inside[j] and d[j] > tol:
            explained = b[j] * b[j] / d[j]
            if weights[j] * explained > best:
                best, gain, at = weights[j] * explained, explained, j
    return gain, at


@njit(nogil=True, cache=True, error_model="numpy")
def _direction_of(model, m, k, c):
    """Write what each column has of the direction that term m alone spans; (p+1,)."""
    W, T = model.W, model.T
    norm = 0.0
    for i in range(m, k):
        norm += T[m, i] * T[m, i]
    norm = 1.0 / np.sqrt(norm)
    c[:] = 0.0
    for i in range(m, k):
        f, row = T[m, i] * norm, W[i]
        for j in range(c.size):
            c[j] += f * row[j]


@njit(nogil=True, cache=True, error_model="numpy")
def _best_swap(model, k, tol, c):
    """The exchange of one kept term for one outside that leaves the least 1 - R^2: that, the term, the candidate."""
    d, b, inside = model.d, model.b, model.inside
    p = b.size
    best, out, new = np.inf, -1, -1
    for m in range(k):
        if model.forced[model.chosen[m]]:
            continue
        _direction_of(model, m, k, c)
        c_y = c[p]
        base = d[p] + c_y * c_y
        for j in range(p):
            if not inside[j]:
                free = d[j] + c[j] * c[j]
                if free > tol:
                    value = b[j] + c[j] * c_y
                    rss = base - value * value / free
                    if rss < best:
                        best, out, new = rss, m, j
    return best, out, new


@njit(nogil=True, cache=True, error_model="numpy")
def stepwise_search(C, dof, F_in, F_out, forced, initial, max_terms, min_gain, weights, swap, tol, trace):
    """Modified stepwise search; the fast form of :func:`structsel.numerics.stepwise.stepwise`.

    Parameters
    ----------
    C : (p+1, p+1) array, C-contiguous float64, writeable
        Centred cross-products of the candidates and, last, the response.
    dof : float
        Samples less what was swept out of C (the constant).
    F_in : (p,) array
        Partial F the (k+1)-th term needs to enter.
    F_out : float
        Partial F a term needs to stay; with k terms in, never more than F_in[k-1].
    forced, initial : (any,) int64 array
        Terms always in; terms in at the start.
    max_terms : int
    min_gain : float
        Fraction of the total sum of squares that a term must explain to enter, times its weight.
    weights : (p,) array
        The candidate to enter is the one whose weight times what it explains is largest.
    swap : bool
        Try exchanges when nothing enters or leaves.
    tol : float
        Smallest d of a term that may enter.
    trace : (t, 7) array, written
        First t moves: action, index, other, F, partial r, 1 - R^2 after it, terms after it.

    Returns
    -------
    chosen : (k,) int64 array
        In order of entry.
    theta : (k,) array [response per candidate]
    rss : float [response^2]
    refused : (p,) bool array
        Outside, and dependent on the kept terms within tol (or constant).
    why : int
        One of the reasons named at the top of this file.
    moves : int
    """
    p = C.shape[0] - 1
    limit = max(0, min(p, int(np.ceil(dof)) - 1))
    model, k, step = _initial_model(C, dof, forced, initial, limit, tol, trace)
    d = model.d
    theta, loss, c = np.empty(limit), np.empty(limit), np.empty(p + 1)
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    if why == CONSTANT:
        k = ZERO
    perfect, rounding = False, 0.0
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        # A kept term leaves that explains too little; once nothing is left to explain, one that explains nothing.
        floor = _estimates(model, k, theta, loss)
        if d[p] <= floor and not perfect:
            perfect, rounding = True, floor
        least, m = _weakest(model, k, loss)
        if m >= 0 and least < (rounding if perfect else min(F_out, F_in[k - 1]) * d[p] / (dof - k)):
            k, step = _record_exit(model, m, k, dof, theta, loss, trace, step)
            continue
        if perfect:
            why = PERFECT
            break
        # The best candidate enters if its partial F and its gain suffice.
        gain, j = _best_entry(model, weights, tol)
        if j < 0:
            why = NONE_LEFT
        elif k >= limit:
            why = NO_DOF
        elif k >= max_terms:
            why = MAX_TERMS
        elif not gain * (dof - k - 1) >= F_in[k] * max(d[p] - gain, 0.0):  # inf times 0 is no entry
            why = NO_F
        elif weights[j] * gain < min_gain:
            why = NO_GAIN
        else:
            k, step = _record_entry(model, j, k, dof, trace, step, ENTER, NONE)
            continue
        # Nothing enters or leaves: an exchange that lowers rss lets the search go on.
        if swap and j >= 0:
            rss, m, j = _best_swap(model, k, tol, c)
            if m >= 0 and rss < d[p] * (1.0 - MARGIN) - ROUNDING:
                k, step = _record_swap(model, m, j, k, dof, trace, step)
                why = MOVE_LIMIT
    chosen, theta_kept, rss_kept, refused = _result(model, k, tol)
    return chosen, theta_kept, rss_kept, refused, why, step


# ---------------------------------------------------------------- moves of up to two terms in and two out


class Outside(NamedTuple):
    """Candidates that may enter and, last, the response; q + 1 columns."""

    columns: Array  # (q+1,) int64
    V: Array  # (k, q+1) T W of these columns: row m spans what term m alone holds of them
    S: Array  # (q, q) what the kept terms leave of the correlations among them, above the diagonal; for pairs only
    d: Array  # (q,)
    b: Array  # (q,)


@njit(nogil=True, cache=True, error_model="numpy")
def _look_outside(model, k, pairs, S):
    """Gather the columns outside; S is workspace, filled where pairs are to be tried."""
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
    packed, V = np.empty((k, q + 1)), np.zeros((k, q + 1))
    for i in range(k):
        for a in range(q + 1):
            packed[i, a] = W[i, index[a]]
    for m in range(k):
        for i in range(m, k):
            f, row, other = T[m, i], V[m], packed[i]
            for a in range(q + 1):
                row[a] += f * other[a]
    if pairs:
        for a in range(q):
            row, places = S[a, a + 1 : q], index[a + 1 : q]
            for c in range(row.size):
                row[c] = C[index[a], places[c]] * scale[index[a]] * scale[places[c]]
            for i in range(k):
                f, other = packed[i, a], packed[i, a + 1 : q]
                for c in range(row.size):
                    row[c] -= f * other[c]
    return Outside(index, V, S, model.d[index[:q]], model.b[index[:q]])


@njit(nogil=True, cache=True, error_model="numpy")
def _direction_beyond(model, outside, m, k, g_before, c_before, g, c):
    """Direction g (k,) that term m alone spans, orthogonal to g_before, and what each column has of it, c (q+1,)."""
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
def _give_back(d, b, c, D, B):
    """D = d + c^2 and B = b + c c_y; the last entry of c is the response's."""
    c_y = c[D.size]
    for a in range(D.size):
        D[a] = d[a] + c[a] * c[a]
        B[a] = b[a] + c[a] * c_y


@njit(nogil=True, cache=True, error_model="numpy")
def _best_single(D, B, tol, needed):
    """The one that explains most, B^2 / D, if more than needed."""
    count = 0  # most often none does, which a loop without branches finds out fastest
    for a in range(D.size):
        count += B[a] * B[a] > needed * D[a]
    best, one = needed, -1
    if count:
        for a in range(D.size):
            if D[a] > tol and B[a] * B[a] > best * D[a]:
                best, one = B[a] * B[a] / D[a], a
    return best, one


@njit(nogil=True, cache=True, error_model="numpy")
def _best_pair(S, D, B, c1, c2, tol, needed):
    """The two that together explain most, if more than needed.

    With s = S_ij + c1_i c1_j + c2_i c2_j::

        (B_i^2 D_j - 2 B_i B_j s + B_j^2 D_i) / (D_i D_j - s^2)
    """
    q = D.size
    best, one, other = needed, -1, -1
    for i in range(q - 1):
        D_i, B_i, f1, f2 = D[i], B[i], c1[i], c2[i]
        if D_i <= tol:
            continue
        # Most often no pair is good enough, which a loop without branches and divisions finds out fastest. Its views
        # begin at zero: the compiler takes several at once only where no index can be negative.
        row, D_j, B_j, g1, g2 = S[i, i + 1 : q], D[i + 1 :], B[i + 1 :], c1[i + 1 :], c2[i + 1 :]
        count = 0
        for j in range(row.size):
            s = row[j] + f1 * g1[j] + f2 * g2[j]
            det = D_i * D_j[j] - s * s
            count += B_i * B_i * D_j[j] - 2.0 * B_i * B_j[j] * s + B_j[j] * B_j[j] * D_i > best * det
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

    Taking two terms out gives two directions back, c1 and, orthogonal to it, c2: every candidate has
    d + c1^2 + c2^2 and b + c1 c1_y + c2 c2_y.
    """
    most = min(level, 2)
    outside = _look_outside(model, k, most > 1, S)
    q = outside.d.size
    D1, B1, D, B = np.empty(q), np.empty(q), np.empty(q), np.empty(q)
    g0, g1, g2 = np.zeros(k), np.zeros(k), np.zeros(k)
    c0, c1, c2 = np.zeros(q + 1), np.zeros(q + 1), np.zeros(q + 1)
    best = dof * np.log(max(model.d[-1], floor)) + penalty * k - MARGIN * dof
    move = np.full(4, NONE)
    for out1 in range(-1, k):
        if out1 >= 0 and model.forced[model.chosen[out1]]:
            continue
        _direction_beyond(model, outside, out1, k, g0, c0, g1, c1)
        _give_back(outside.d, outside.b, c1, D1, B1)
        for out2 in range(-1, max(out1, 0) if most > 1 else 0):
            if out2 >= 0 and model.forced[model.chosen[out2]]:
                continue
            _direction_beyond(model, outside, out2, k, g1, c1, g2, c2)
            _give_back(D1, B1, c2, D, B)
            n_out = (out1 >= 0) + (out2 >= 0)
            base = model.d[-1] + c1[q] * c1[q] + c2[q] * c2[q]
            for n_in in range(most + 1):
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
                    gain, one, other = _best_pair(outside.S, D, B, c1, c2, tol, base - bound)
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
    """Add, drop and exchange terms while dof log(rss) + penalty k falls; best move first.

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
    model, k, step = _initial_model(C, dof, forced, initial, limit, tol, trace)
    theta, loss = np.empty(limit), np.empty(limit)
    most = min(limit, max_terms)
    pairs = p if depth > 1 else 0
    S = np.empty((pairs, pairs))
    floor = 0.0
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        floor = max(floor, _estimates(model, k, theta, loss))
        move = np.full(4, NONE)
        for level in range(1, depth + 1):  # the cheap moves first
            move = _best_move(model, k, dof, penalty, floor, most, tol, level, S)
            if move.max() >= 0:
                break
        if move.max() < 0:
            why = OPTIMUM
        elif move[0] >= 0 and move[1] < 0 and move[2] >= 0 and move[3] < 0:
            k, step = _record_swap(model, move[0], move[2], k, dof, trace, step)
        else:
            for m in move[:2]:  # the later one first, so that the other keeps its place
                if m >= 0:
                    _estimates(model, k, theta, loss)
                    k, step = _record_exit(model, m, k, dof, theta, loss, trace, step)
            for j in move[2:]:
                if j >= 0:
                    k, step = _record_entry(model, j, k, dof, trace, step, ENTER, NONE)
    chosen, theta_kept, rss_kept, refused = _result(model, k, tol)
    return chosen, theta_kept, rss_kept, refused, why, step
