"""Leaps and bounds, compiled; letters and bounds of `best_subset`."""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

import numpy as np

from structsel.numerics.compiling import njit


@njit(nogil=True, cache=True, error_model="numpy")
def _drop_explained(S, active, m, tol):
    """Remove candidates that the kept ones explain; returns the number of the others."""
    left = 0
    for a in range(m + 1):
        if a == m or S[a, a] > tol:
            for c in range(m + 1):
                S[left, c] = S[a, c]
            for c in range(m + 1):
                S[c, left] = S[c, a]
            if a < m:
                active[left] = active[a]
            left += 1
    return left - 1


@njit(nogil=True, cache=True, error_model="numpy")
def _factor(S, m, tol):
    """U with S = U'U, zero rows for candidates that depend on earlier ones, and the smallest pivot."""
    U = np.zeros((m + 1, m + 1))
    smallest = 1.0
    for a in range(m):
        for c in range(a, m + 1):
            value = S[a, c]
            for i in range(a):
                value -= U[i, a] * U[i, c]
            U[a, c] = value
        pivot = U[a, a]
        smallest = min(smallest, pivot)
        root = 1.0 / np.sqrt(pivot) if pivot > tol else 0.0
        for c in range(a, m + 1):
            U[a, c] *= root
    return U, smallest


@njit(nogil=True, cache=True, error_model="numpy")
def _losses(U, m):
    """Increase of rss without each candidate, theta_a^2 / (S^-1)_aa, by row a of T = U^-1."""
    loss, T = np.zeros(m), np.zeros(m)
    for a in range(m):
        theta = norm = 0.0
        for c in range(a, m):
            value = 1.0 if c == a else 0.0
            for i in range(a, c):
                value -= T[i] * U[i, c]
            T[c] = value / U[c, c]
            theta += T[c] * U[c, m]
            norm += T[c] * T[c]
        loss[a] = theta * theta / norm
    return loss


@njit(nogil=True, cache=True, error_model="numpy")
def _prepare(S, active, m, tol, bound):
    """Remove explained candidates, bound each branch, sort by the losses; returns the number of candidates."""
    m = _drop_explained(S, active, m, tol)
    U, smallest = _factor(S, m, tol)
    rss = S[m, m]
    for a in range(m):
        rss -= U[a, m] * U[a, m]
    if smallest > tol:
        loss = _losses(U, m)
        worth = loss
        # The losses carry a rounding error of about eps / smallest pivot; a bound must not be too high.
        trust = max(0.0, 1.0 - 1e-13 / smallest)
    else:  # dependent candidates: the losses are unknown, and each candidate is ranked alone
        loss, worth, trust = np.zeros(m), np.zeros(m), 0.0
        for a in range(m):
            worth[a] = S[a, m] * S[a, m] / S[a, a]
    rank = np.argsort(-worth, kind="mergesort")
    copy, names = S[: m + 1, : m + 1].copy(), active[:m].copy()
    for a in range(m):
        active[a] = names[rank[a]]
        bound[a] = max(rss, 0.0) * (1.0 - 1e-12) + loss[rank[a]] * trust
        S[a, m] = copy[rank[a], m]
        S[m, a] = S[a, m]
        for c in range(m):
            S[a, c] = copy[rank[a], rank[c]]
    return m


@njit(nogil=True, cache=True, error_model="numpy")
def _allowed(inside, a, parents, strong):
    """Whether candidate a has the parents that it needs."""
    some, every, known = False, True, False
    for b in parents[a]:
        if b >= 0:
            known = True
            if inside[b]:
                some = True
            else:
                every = False
    return not known or (every if strong else some)


@njit(nogil=True, cache=True, error_model="numpy")
def _hide_orphans(S, active, m, path, size, possible, parents, strong):
    """Zero undecided candidates that cannot have the parents they need any more; whether a kept one cannot."""
    possible[:] = False
    for i in range(size):
        possible[path[i]] = True
    for a in range(m):
        possible[active[a]] = True
    changed = True
    while changed:
        changed = False
        for a in range(m):
            if possible[active[a]] and not _allowed(possible, active[a], parents, strong):
                possible[active[a]] = False
                S[a, a] = 0.0
                changed = True
    lost = False
    for i in range(size):
        lost |= not _allowed(possible, path[i], parents, strong)
    return lost


@njit(nogil=True, cache=True, error_model="numpy")
def _is_allowed(path, size, inside, parents, strong):
    """Whether the first terms of a path are a hierarchical model."""
    inside[:] = False
    for i in range(size):
        inside[path[i]] = True
    complete = True
    for i in range(size):
        complete &= _allowed(inside, path[i], parents, strong)
    return complete


@njit(nogil=True, cache=True, error_model="numpy")
def leaps(R, max_size, best, sets, tol, parents, strong):
    """Improve best (max_size+1,) and sets (max_size+1, q) until they are exact; returns the number of nodes."""
    q = R.shape[0] - 1
    inside = np.zeros(q, np.bool_)
    work = np.empty((q + 1, q + 1, q + 1))
    active = np.empty((q + 1, q + 1), np.int64)
    bound = np.empty((q + 1, q + 1))
    count = np.zeros(q + 1, np.int64)
    at = np.zeros(q + 1, np.int64)
    kept = np.zeros(q + 1, np.int64)
    path = np.empty(q + 1, np.int64)
    for a in range(q + 1):
        active[0, a] = a
        for c in range(q + 1):
            work[0, a, c] = R[a, c]
    count[0] = _prepare(work[0], active[0], q, tol, bound[0])
    level = 0
    nodes = 1
    while level >= 0:
        i, m = at[level], count[level]
        size = kept[level] + i
        if i >= m or size >= max_size:
            level -= 1
            continue
        at[level] += 1
        S = work[level]
        if i > 0:
            path[size - 1] = active[level, i - 1]
        left = m - i - 1
        branch = left > 0 and bound[level, i] < best[size + 1]
        if branch:  # without active[i]; the later ones stay undecided
            child = work[level + 1]
            for a in range(left + 1):
                for c in range(left + 1):
                    child[a, c] = S[i + 1 + a, i + 1 + c]
            for a in range(left):
                active[level + 1, a] = active[level, i + 1 + a]
        pivot = S[i, i]
        if pivot > tol:  # with active[i]
            for a in range(i + 1, m + 1):
                f = S[i, a] / pivot
                for c in range(i + 1, m + 1):
                    S[a, c] -= f * S[i, c]
            rss = max(S[m, m], 0.0)
            path[size] = active[level, i]
            if rss < best[size + 1] and _is_allowed(path, size + 1, inside, parents, strong):
                best[size + 1] = rss
                for a in range(q):
                    sets[size + 1, a] = False
                for a in range(size + 1):
                    sets[size + 1, path[a]] = True
        else:
            at[level] = m
        if branch and parents.shape[1]:
            branch = not _hide_orphans(child, active[level + 1], left, path, size, inside, parents, strong)
        if branch:
            level += 1
            nodes += 1
            kept[level] = size
            at[level] = 0
            count[level] = _prepare(work[level], active[level], left, tol, bound[level])
    return nodes
