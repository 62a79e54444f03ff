"""Compiled kernels of the structure search: rows of a triangular factor of the correlation matrix.

For the kept columns A, in order of entry, with R_AA = U'U, the state of a search is

* ``W`` = U'^-1 R[A, :], one row per kept term, its last column belonging to the response;
* ``T`` = U^-1, so that theta = T W[:, -1] and (R_AA)^-1 = T T';
* ``d`` = 1 - column sums of W^2: what of every column the kept ones do not explain (the Schur
  complement relative to the column's own centred variance; the response's is 1 - R^2);
* ``b`` = what is left of every candidate's correlation with the response.

A term enters in O(p k) operations, leaves by Givens rotations in O(p k), and all k p exchanges of
one term for another are weighed in O(p k^2). Nothing here forms a p x p matrix except the pair moves of
:func:`climb`. Everything releases the interpreter lock, so resamples may run in threads.

The kernels share one file because numba's cache does not notice changes in kernels imported from another.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

import numpy as np
from numba import njit

# int64, not plain integers: numba would compile every kernel again for each literal value.
ZERO, NONE = np.int64(0), np.int64(-1)
ENTER, LEAVE, SWAP, REFUSE = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
NO_F, PERFECT, MAX_TERMS, NO_DOF, MOVES, CONSTANT, NO_GAIN, NONE_LEFT, OPTIMUM = range(9)
ROUNDING = 1e-14  # largest error assumed in an entry of the correlation matrix
SLACK = np.float32(4e-6)  # of single precision, relative to the largest sum it is asked about
MARGIN = 1e-10  # relative fall of rss an exchange must bring, so that rounding cannot make it cycle


@njit(nogil=True, cache=True, error_model="numpy")
def _begin(C, limit):
    p = C.shape[0] - 1
    scale = np.zeros(p + 1)
    d = np.zeros(p + 1)
    b = np.zeros(p)
    for j in range(p + 1):
        if C[j, j] > 0.0:
            scale[j] = 1.0 / np.sqrt(C[j, j])
            d[j] = 1.0
    for j in range(p):
        b[j] = C[j, p] * scale[j] * scale[p]
    W = np.empty((limit, p + 1))
    T = np.empty((limit, limit))
    chosen = np.empty(limit, np.int64)
    inside = np.zeros(p, np.bool_)
    return scale, d, b, W, T, chosen, inside


@njit(nogil=True, cache=True, error_model="numpy")
def _enter(C, scale, j, k, W, T, d, b, chosen, inside):
    p = b.size
    row = W[k]
    for c in range(p + 1):
        row[c] = C[j, c] * scale[j] * scale[c]
    for i in range(k):
        f = W[i, j]
        other = W[i]
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
    chosen[k] = j
    inside[j] = True
    if d[p] < 0.0:
        d[p] = 0.0
    return k + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _leave(m, k, W, T, d, b, chosen, inside):
    p = b.size
    for i in range(m, k - 1):
        upper = W[i]
        lower = W[i + 1]
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
    inside[chosen[m]] = False
    for i in range(m, k - 1):
        chosen[i] = chosen[i + 1]
        for c in range(k - 1):
            T[i, c] = T[i + 1, c]
    return k - 1


@njit(nogil=True, cache=True, error_model="numpy")
def _estimates(k, W, T, theta, loss):
    """Standardised theta, and what dropping each term would add to 1 - R^2; returns the rounding floor."""
    p = W.shape[1] - 1
    size = 1.0
    for i in range(k):
        value = 0.0
        norm = 0.0
        for m in range(i, k):
            value += T[i, m] * W[m, p]
            norm += T[i, m] * T[i, m]
        theta[i] = value
        loss[i] = value * value / norm
        size += abs(value)
    return ROUNDING * size * size


@njit(nogil=True, cache=True, error_model="numpy")
def _released(m, k, W, T, c):
    """Fill c with the direction given up when term m leaves: then d += c^2, b += c c_y."""
    norm = 0.0
    for i in range(m, k):
        norm += T[m, i] * T[m, i]
    norm = 1.0 / np.sqrt(norm)
    c[:] = 0.0
    for i in range(m, k):
        f = T[m, i] * norm
        row = W[i]
        for j in range(c.size):
            c[j] += f * row[j]


@njit(nogil=True, cache=True, error_model="numpy")
def _best_entry(d, b, inside, tol):
    best, at = -1.0, -1
    for j in range(b.size):
        if not inside[j] and d[j] > tol:
            gain = b[j] * b[j] / d[j]
            if gain > best:
                best, at = gain, j
    return best, at


@njit(nogil=True, cache=True, error_model="numpy")
def _best_swap(k, W, T, d, b, chosen, inside, forced, tol, c):
    """The exchange of one kept term for one outside that leaves the least 1 - R^2."""
    p = b.size
    best, out, new = np.inf, -1, -1
    for m in range(k):
        if forced[chosen[m]]:
            continue
        _released(m, k, W, T, c)
        e = c[p]
        base = d[p] + e * e
        for j in range(p):
            if not inside[j]:
                free = d[j] + c[j] * c[j]
                if free > tol:
                    value = b[j] + c[j] * e
                    rss = base - value * value / free
                    if rss < best:
                        best, out, new = rss, m, j
    return best, out, new


@njit(nogil=True, cache=True, error_model="numpy")
def _record(trace, step, action, index, other, F, r, rss, k):
    if step < trace.shape[0]:
        trace[step, 0] = action
        trace[step, 1] = index
        trace[step, 2] = other
        trace[step, 3] = F
        trace[step, 4] = r
        trace[step, 5] = rss
        trace[step, 6] = k
    return step + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _f_and_r(loss, rss, freedom):
    if rss <= 0.0:
        return (np.inf, 1.0) if loss > 0.0 else (0.0, 0.0)
    return loss / (rss / freedom), np.sqrt(loss / (loss + rss))


@njit(nogil=True, cache=True, error_model="numpy")
def _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, action, other):
    p = b.size
    sign = np.sign(b[j])
    gain = b[j] * b[j] / d[j]
    F, r = _f_and_r(gain, d[p] - gain, dof - k - 1)
    k = _enter(C, scale, j, k, W, T, d, b, chosen, inside)
    return k, _record(trace, step, action, j, other, F, sign * r, d[p], k)


@njit(nogil=True, cache=True, error_model="numpy")
def _drop(m, k, W, T, d, b, chosen, inside, dof, theta, loss, trace, step):
    p = b.size
    j = chosen[m]
    F, r = _f_and_r(loss[m], d[p], dof - k)
    r *= np.sign(theta[m])
    k = _leave(m, k, W, T, d, b, chosen, inside)
    return k, _record(trace, step, LEAVE, j, NONE, F, r, d[p], k)


@njit(nogil=True, cache=True, error_model="numpy")
def _take(C, dof, forced, start, limit, tol, trace):
    """Begin, then let the forced and the starting terms in; a dependent one is refused."""
    p = C.shape[0] - 1
    scale, d, b, W, T, chosen, inside = _begin(C, limit)
    must = np.zeros(p, np.bool_)
    k, step = ZERO, ZERO
    for part in range(2):
        wanted = forced if part == 0 else start
        for j in wanted:
            if inside[j] or k >= limit:
                continue
            if d[j] > tol:
                k, step = _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, ENTER, NONE)
                must[j] = part == 0
            else:
                step = _record(trace, step, REFUSE, j, NONE, np.nan, np.nan, d[p], k)
    return scale, d, b, W, T, chosen, inside, must, k, step


@njit(nogil=True, cache=True, error_model="numpy")
def _finish(C, scale, k, W, T, d, b, chosen, inside, tol):
    """Rebuild in the order of entry, which sheds the rounding of the moves; physical units."""
    p = b.size
    for j in range(p):
        b[j] = C[j, p] * scale[j] * scale[p]
        d[j] = 1.0 if scale[j] > 0.0 else 0.0
    d[p] = 1.0 if scale[p] > 0.0 else 0.0
    for i in range(k):
        _enter(C, scale, chosen[i], i, W, T, d, b, chosen, inside)
    theta = np.empty(k)
    _estimates(k, W, T, theta, np.empty(k))
    for i in range(k):
        theta[i] *= scale[chosen[i]] / scale[p]
    refused = np.zeros(p, np.bool_)
    for j in range(p):
        refused[j] = not inside[j] and d[j] <= tol
    return chosen[:k].copy(), theta, d[p] * C[p, p], refused


@njit(nogil=True, cache=True, error_model="numpy")
def search(C, dof, F_in, F_out, forced, start, max_terms, min_gain, swap, tol, trace):
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
    forced, start : (any,) int64 array
        Terms always in; terms in at the start.
    max_terms : int
    min_gain : float
        Share of the total sum of squares a term must explain to enter (the R^2 and PSE stops).
    swap : bool
        Try exchanges when nothing enters or leaves.
    tol : float
        Smallest Schur complement of a term that may enter.
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
    scale, d, b, W, T, chosen, inside, must, k, step = _take(C, dof, forced, start, limit, tol, trace)
    theta = np.empty(limit)
    loss = np.empty(limit)
    c = np.empty(p + 1)
    why = MOVES
    cleaning = False
    least = 0.0
    if scale[p] == 0.0:
        chosen_, theta_, rss_, refused_ = _finish(C, scale, ZERO, W, T, d, b, chosen, inside, tol)
        return chosen_, theta_, rss_, refused_, CONSTANT, step
    most = 50 * p + 1000
    while step < most:
        floor = _estimates(k, W, T, theta, loss)
        if d[p] <= floor and not cleaning:
            cleaning, least = True, floor
        worst, at = np.inf, NONE
        for m in range(k):
            if not must[chosen[m]] and loss[m] < worst:
                worst, at = loss[m], m
        if at >= 0:
            bar = least if cleaning else min(F_out, F_in[k - 1]) * d[p] / (dof - k)
            if worst < bar:
                k, step = _drop(at, k, W, T, d, b, chosen, inside, dof, theta, loss, trace, step)
                continue
        if cleaning:  # nothing is left to explain; what carries nothing has gone
            why = PERFECT
            break
        gain, j = _best_entry(d, b, inside, tol)
        if j < 0:
            why = NONE_LEFT
        elif k >= limit:
            why = NO_DOF
        elif k >= max_terms:
            why = MAX_TERMS
        elif not gain * (dof - k - 1) >= F_in[k] * max(d[p] - gain, 0.0):  # inf times 0 is no entry
            why = NO_F
        elif gain < min_gain:
            why = NO_GAIN
        else:
            k, step = _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, ENTER, NONE)
            continue
        if swap and j >= 0:
            rss, m, j = _best_swap(k, W, T, d, b, chosen, inside, must, tol, c)
            if m >= 0 and rss < d[p] * (1.0 - MARGIN) - ROUNDING:
                old = chosen[m]
                k = _leave(m, k, W, T, d, b, chosen, inside)
                k, step = _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, SWAP, old)
                why = MOVES
                continue
        break
    chosen_, theta_, rss_, refused_ = _finish(C, scale, k, W, T, d, b, chosen, inside, tol)
    return chosen_, theta_, rss_, refused_, why, step


@njit(nogil=True, cache=True, error_model="numpy")
def _remainder(C, scale, outside, packed, S, rough):
    """Write what the kept terms leave of the correlations among the candidates outside, above the diagonal."""
    q = outside.size - 1
    for a in range(q):
        row, places = S[a, a + 1 : q], outside[a + 1 : q]
        for c in range(row.size):
            row[c] = C[outside[a], places[c]] * scale[outside[a]] * scale[places[c]]
        for i in range(packed.shape[0]):
            f, other = packed[i, a], packed[i, a + 1 : q]
            for c in range(row.size):
                row[c] -= f * other[c]
        rough[a, a + 1 : q] = row


@njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})
def _count_above(limit, row, u, f, first, g, second, G, twice, z):
    """In how many places r (G r - twice z) + z^2 is above a limit, r = u row + f first + g second; single precision."""
    count = 0
    for j in range(row.size):
        r = u[j] * row[j] + f * first[j] + g * second[j]
        count += r * (G * r - twice * z[j]) + z[j] * z[j] > limit
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def _best_pair(S, rough, D, B, c1, c2, tol, needed):
    """The two that together explain most, if more than needed.

    That is (B_i^2 D_j - 2 B_i B_j s + B_j^2 D_i) / (D_i D_j - s^2). With r = s / sqrt(D_i D_j) and z = B / sqrt(D) it
    is above G where G r^2 - 2 z_i z_j r + z_i^2 + z_j^2 > G, which single precision rules out for most: it takes
    sixteen at once, and half the memory, where the correlations of hundreds just fill the second-level cache.
    """
    q = D.size
    u, most = np.zeros(q, np.float32), np.float32(0.0)
    for a in range(q):
        if D[a] > tol:
            u[a] = 1.0 / np.sqrt(D[a])
            most = max(most, np.float32(B[a] * B[a] / D[a]))
    z, f1, f2 = u * B.astype(np.float32), c1.astype(np.float32), c2.astype(np.float32)
    first, second = u * f1[:q], u * f2[:q]
    best, one, other = needed, -1, -1
    for i in range(q - 1):
        if D[i] <= tol:
            continue
        # Views that begin at zero: the compiler takes several at once only where no index can be negative.
        G = np.float32(best)
        if not _count_above(
            G - z[i] * z[i] - SLACK * (abs(G) + most), rough[i, i + 1 : q], u[i + 1 :], f1[i], first[i + 1 :],
            f2[i], second[i + 1 :], G * u[i] * u[i], np.float32(2.0) * z[i] * u[i], z[i + 1 :],
        ):  # fmt: skip
            continue
        for j in range(i + 1, q):
            s = S[i, j] + c1[i] * c1[j] + c2[i] * c2[j]
            det = D[i] * D[j] - s * s
            gain = (B[i] * B[i] * D[j] - 2.0 * B[i] * B[j] * s + B[j] * B[j] * D[i]) / det
            if gain > best and det > tol * max(D[i], D[j]):
                best, one, other = gain, i, j
    return best, one, other


@njit(nogil=True, cache=True, error_model="numpy")
def _best_single(D, B, tol, needed):
    """The one that explains most, B^2 / D, if more than needed."""
    count = 0
    for a in range(D.size):
        count += B[a] * B[a] > needed * D[a]
    best, one = needed, -1
    if count:
        for a in range(D.size):
            if D[a] > tol and B[a] * B[a] > best * D[a]:
                best, one = B[a] * B[a] / D[a], a
    return best, one


@njit(nogil=True, cache=True, error_model="numpy")
def _give_up(m, k, T, V, before, g, c_before, c):
    """Direction g that term m alone holds (orthogonal to ``before``), and c, what each column has of it."""
    if m < 0:
        g[:] = 0.0
        c[:] = 0.0
        return
    common = norm = 0.0
    for i in range(k):
        g[i] = T[m, i] if m <= i else 0.0
        common += g[i] * before[i]
    for i in range(k):
        g[i] -= common * before[i]
        norm += g[i] * g[i]
    size = np.sqrt(norm)
    for i in range(k):
        g[i] /= size
    mine = V[m]
    for a in range(c.size):
        c[a] = (mine[a] - common * c_before[a]) / size


@njit(nogil=True, cache=True, error_model="numpy")
def _with(d, b, c, D, B):
    """Write d and b with what they have of a direction c given up; the last entry of c is the response's."""
    own = c[D.size]
    for a in range(D.size):
        D[a] = d[a] + c[a] * c[a]
        B[a] = b[a] + c[a] * own


@njit(nogil=True, cache=True, error_model="numpy")
def _weigh(C, scale, k, W, T, d, b, chosen, inside, must, dof, penalty, floor, max_terms, tol, level, S, rough):
    """Best move of at most level + 1 terms, at most two of them out and two in.

    The rows of T of the terms taken out span the directions given up, so that after orthogonalising
    them (c1, c2) every candidate has d + c1^2 + c2^2 and b + c1 c1_y + c2 c2_y.
    """
    p = b.size
    most = min(level, 2)
    outside = np.empty(p + 1, np.int64)  # candidates that may enter and, last, the response
    q = 0
    for a in range(p):
        if not inside[a] and scale[a] > 0.0:
            outside[q] = a
            q += 1
    outside[q] = p
    outside = outside[: q + 1]
    packed, V = np.empty((k, q + 1)), np.zeros((k, q + 1))
    for i in range(k):
        for a in range(q + 1):
            packed[i, a] = W[i, outside[a]]
    for m in range(k):
        mine = V[m]
        for i in range(m, k):
            f, other = T[m, i], packed[i]
            for a in range(q + 1):
                mine[a] += f * other[a]
    if most > 1:
        _remainder(C, scale, outside, packed, S, rough)
    d0, b0 = d[outside[:q]], b[outside[:q]]
    D1, B1, D, B = np.empty(q), np.empty(q), np.empty(q), np.empty(q)
    g0, g1, g2 = np.zeros(k), np.zeros(k), np.zeros(k)
    c0, c1, c2 = np.zeros(q + 1), np.zeros(q + 1), np.zeros(q + 1)
    best = dof * np.log(max(d[p], floor)) + penalty * k - MARGIN * dof
    move = np.full(4, -1, np.int64)
    for m1 in range(-1, k):
        if m1 >= 0 and must[chosen[m1]]:
            continue
        _give_up(m1, k, T, V, g0, g1, c0, c1)
        _with(d0, b0, c1, D1, B1)
        for m2 in range(-1, max(m1, 0) if most > 1 else 0):
            if m2 >= 0 and must[chosen[m2]]:
                continue
            gone = (m1 >= 0) + (m2 >= 0)
            _give_up(m2, k, T, V, g1, g2, c1, c2)
            _with(D1, B1, c2, D, B)
            base = d[p] + c1[q] * c1[q] + c2[q] * c2[q]
            for new in range(most + 1):
                left = k - gone + new
                if left > max_terms or gone + new == 0 or gone + new > level + 1:
                    continue
                # What must be left at most, to be better than the best so far.
                least = np.exp((best - penalty * left) / dof)
                if new > 0 and least <= floor:
                    continue
                gain, i, j = 0.0, -1, -1
                if new == 1:
                    gain, i = _best_single(D, B, tol, base - least)
                elif new == 2:
                    gain, i, j = _best_pair(S, rough, D, B, c1, c2, tol, base - least)
                if new > 0 and i < 0:
                    continue
                value = dof * np.log(max(base - gain, floor)) + penalty * left
                if value < best:
                    best = value
                    move[0], move[1] = m1, m2
                    move[2] = outside[i] if i >= 0 else -1
                    move[3] = outside[j] if j >= 0 else -1
    return move


@njit(nogil=True, cache=True, error_model="numpy")
def climb(C, dof, penalty, forced, start, max_terms, depth, tol, trace):
    """Add, drop and exchange terms while dof log(rss) + penalty k falls; best move first.

    Parameters
    ----------
    C, dof, forced, start, max_terms, tol, trace
        As in :func:`search`.
    penalty : float
        Of one term: log(N) for BIC, 2 for AIC.
    depth : int
        1: one in, one out, one for one. 2: also two in, two out, two for one and one for two.
        3: also two for two.

    Returns
    -------
    chosen, theta, rss, refused, why, moves
        As in :func:`search`.
    """
    p = C.shape[0] - 1
    limit = max(0, min(p, int(np.ceil(dof)) - 1))
    scale, d, b, W, T, chosen, inside, must, k, step = _take(C, dof, forced, start, limit, tol, trace)
    theta, loss = np.empty(limit), np.empty(limit)
    most = min(limit, max_terms)
    pairs = p if depth > 1 else 0
    S, rough = np.empty((pairs, pairs)), np.empty((pairs, pairs), np.float32)
    floor = 0.0
    why = CONSTANT if scale[p] == 0.0 else MOVES
    while why == MOVES and step < 50 * p + 1000:
        floor = max(floor, _estimates(k, W, T, theta, loss))
        move = np.full(4, -1, np.int64)
        for level in range(1, depth + 1):
            move = _weigh(
                C, scale, k, W, T, d, b, chosen, inside, must, dof, penalty, floor, most, tol, level, S, rough
            )
            if move.max() >= 0:
                break
        if move.max() < 0:
            why = OPTIMUM
        elif move[0] >= 0 and move[1] < 0 and move[2] >= 0 and move[3] < 0:
            j, old = move[2], chosen[move[0]]
            k = _leave(move[0], k, W, T, d, b, chosen, inside)
            k, step = _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, SWAP, old)
        else:
            for m in move[:2]:  # the later one first, so that the other keeps its place
                if m >= 0:
                    _estimates(k, W, T, theta, loss)
                    k, step = _drop(m, k, W, T, d, b, chosen, inside, dof, theta, loss, trace, step)
            for j in move[2:]:
                if j >= 0:
                    k, step = _add(C, scale, j, k, W, T, d, b, chosen, inside, dof, trace, step, ENTER, NONE)
    chosen_, theta_, rss_, refused_ = _finish(C, scale, k, W, T, d, b, chosen, inside, tol)
    return chosen_, theta_, rss_, refused_, why, step
