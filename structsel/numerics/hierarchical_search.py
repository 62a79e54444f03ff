"""Stepwise search among hierarchical models, compiled; letters of `search_model`.

A move takes a group of terms. A candidate enters with the parents that it lacks, and a kept term leaves with the terms
that need it. Let a term that enters as the k-th have the price log(1 + F_in / (dof - k)). A group enters if the fall of
log rss exceeds the sum of its prices; of these the one with the largest excess for each of its terms. For one term
that is partial F above F_in, the rule of `stepwise`. A group leaves if log rss rises by less than the same sum with
F_out.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.hierarchy import Hierarchy
from structsel.numerics.search_model import (
    CONSTANT,
    ENTER,
    MARGIN,
    MAX_TERMS,
    MOVE_LIMIT,
    NO_F,
    NONE,
    NONE_LEFT,
    PERFECT,
    ZERO,
    Model,
    estimates,
    initial_model,
    record_entry,
    record_exit,
    search_result,
)


class Needs(NamedTuple):
    """What each candidate needs."""

    parents: NDArray[np.int64]  # (p, m), filled with -1
    order: NDArray[np.int64]  # (p,) parents come before what needs them
    longest: int  # most terms of a candidate with all its ancestors
    strong: bool  # all parents; else one


class GroupRules(NamedTuple):
    """Rules for the entry, exit and exchange of groups; see `StepwiseRules`."""

    F_in: Array  # (p,)
    F_out: float
    max_terms: int
    min_gain: float
    swap: bool
    tolerance: float


def needs_of(hierarchy: Hierarchy) -> Needs:
    """What the compiled search reads of a hierarchy."""
    longest = 1 + int(hierarchy.ancestors().sum(axis=1).max(initial=0))
    return Needs(np.ascontiguousarray(hierarchy.parents), hierarchy.parents_first(), longest, hierarchy.strong)


@njit(nogil=True, cache=True, error_model="numpy")
def _satisfied(inside, j, needs):
    """Whether candidate j has the parents that it needs."""
    some, every, known = False, True, False
    for q in needs.parents[j]:
        if q >= 0:
            known = True
            if inside[q]:
                some = True
            else:
                every = False
    return not known or (every if needs.strong else some)


@njit(nogil=True, cache=True, error_model="numpy")
def _gain(model, k, group, g, tol, S, v):
    """Reduction of 1 - R^2 by g candidates together; -1 where they depend on the kept ones or one another."""
    C, scale, W = model.C, model.scale, model.W
    total = 0.0
    for a in range(g):
        i = group[a]
        v[a] = model.b[i]
        for c in range(a + 1):
            j = group[c]
            value = C[i, j] * scale[i] * scale[j] if c < a else model.d[i]
            if c < a:
                for m in range(k):
                    value -= W[m, i] * W[m, j]
            for e in range(c):
                value -= S[a, e] * S[c, e]
            if c < a:
                S[a, c] = value / S[c, c]
            else:
                if value <= tol:
                    return -1.0
                S[a, a] = np.sqrt(value)
        for e in range(a):
            v[a] -= S[a, e] * v[e]
        v[a] /= S[a, a]
        total += v[a] * v[a]
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def _price(F, dof, k, g):
    """Of g terms that enter a model of k."""
    total = 0.0
    for i in range(g):
        total += np.log1p(F[k + i] / max(dof - k - i - 1.0, 1e-9))
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def _with_parents(groups, sizes, j, needs, inside):
    """Write the strong group of candidate j; its size, 0 where a parent cannot enter."""
    row, g = groups[j], ZERO
    for q in needs.parents[j]:
        if q < 0 or inside[q]:
            continue
        if sizes[q] == 0:
            return ZERO
        for a in range(sizes[q]):
            new = groups[q, a]
            if not (row[:g] == new).any():
                row[g] = new
                g += 1
    row[g] = j
    return g + 1


@njit(nogil=True, cache=True, error_model="numpy")
def _best_group(model, k, dof, rules, needs, groups, sizes, most):
    """Group with the largest excess over its price for each of its terms: the total excess and the candidate, or -1."""
    inside, d = model.inside, model.d
    p = inside.size
    S, v = np.empty((needs.longest, needs.longest)), np.empty(needs.longest)
    trial = np.empty(needs.longest, np.int64)
    best, excess, at = 0.0, -1.0, NONE
    sizes[:] = 0
    for j in needs.order:
        if inside[j] or d[j] <= rules.tolerance:
            continue
        gain = -1.0
        if needs.strong or _satisfied(inside, j, needs):
            sizes[j] = _with_parents(groups, sizes, j, needs, inside) if needs.strong else 1
            if not needs.strong:
                groups[j, 0] = j
            gain = _gain(model, k, groups[j], sizes[j], rules.tolerance, S, v) if sizes[j] else -1.0
        else:
            value = -np.inf
            for q in needs.parents[j]:
                if q < 0 or sizes[q] == 0:
                    continue
                g = sizes[q] + 1
                trial[: g - 1] = groups[q, : g - 1]
                trial[g - 1] = j
                one = _gain(model, k, trial, g, rules.tolerance, S, v)
                if one >= 0.0 and k + g <= p:
                    worth = -np.log(max(d[p] - one, 1e-300)) - _price(rules.F_in, dof, k, g)
                    if worth > value:
                        value, gain, sizes[j] = worth, one, g
                        groups[j, :g] = trial[:g]
        if gain < 0.0:
            sizes[j] = 0
            continue
        g = sizes[j]
        if k + g > most or gain < rules.min_gain * g:
            continue
        value = np.log(d[p]) - np.log(max(d[p] - gain, 1e-300)) - _price(rules.F_in, dof, k, g)
        if value >= 0.0 and (value / g > best or at < 0):
            best, excess, at = value / g, value, j
    return excess, at


@njit(nogil=True, cache=True, error_model="numpy")
def _dependants(model, m, k, needs, out):
    """Mark term m and the kept terms that would lack a parent without it in out (k,); their number."""
    inside = model.inside.copy()
    out[:k] = False
    out[m] = True
    inside[model.chosen[m]] = False
    g, before = 1, 0
    while g > before:
        before = g
        for i in range(k):
            if not out[i] and not model.forced[model.chosen[i]] and not _satisfied(inside, model.chosen[i], needs):
                out[i] = True
                inside[model.chosen[i]] = False
                g += 1
    return g


@njit(nogil=True, cache=True, error_model="numpy")
def _loss(model, k, out, g, theta):
    """Rise of 1 - R^2 without the marked terms, theta_G' [(T T')_GG]^-1 theta_G."""
    T = model.T
    L, v = np.empty((g, g)), np.empty(g)
    at = np.flatnonzero(out[:k])
    total = 0.0
    for a in range(g):
        for c in range(a + 1):
            value = 0.0
            for i in range(max(at[a], at[c]), k):
                value += T[at[a], i] * T[at[c], i]
            for e in range(c):
                value -= L[a, e] * L[c, e]
            if c < a:
                L[a, c] = value / L[c, c]
            else:
                L[a, a] = np.sqrt(max(value, 1e-300))
        v[a] = theta[at[a]]
        for e in range(a):
            v[a] -= L[a, e] * v[e]
        v[a] /= L[a, a]
        total += v[a] * v[a]
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def _weakest_group(model, k, dof, rules, needs, theta, rounding, perfect, out):
    """Marks of the group whose exit pays most; its size, 0 where none pays."""
    p = model.inside.size
    trial, best, size = np.zeros(max(k, 1), np.bool_), 0.0, ZERO
    for m in range(k):
        if model.forced[model.chosen[m]]:
            continue
        g = _dependants(model, m, k, needs, trial)
        loss = _loss(model, k, trial, g, theta)
        if perfect:
            value = rounding - loss
        else:
            value = -np.log1p(loss / model.d[p])
            for i in range(g):
                value += np.log1p(min(rules.F_out, rules.F_in[k - i - 1]) / (dof - k + i))
        if value > best:
            best, size = value, g
            out[:k] = trial[:k]
    return size


@njit(nogil=True, cache=True, error_model="numpy")
def _remove(model, k, dof, needs, out, theta, loss, trace, step):
    """Let the marked terms leave, those that need others first; the new k and step."""
    p = model.inside.size
    names = np.zeros(p, np.bool_)
    for i in range(k):
        names[model.chosen[i]] = out[i]
    for j in needs.order[::-1]:
        if names[j]:
            estimates(model, k, theta, loss)
            k, step = record_exit(model, np.flatnonzero(model.chosen[:k] == j)[0], k, dof, theta, loss, trace, step)
    return k, step


@njit(nogil=True, cache=True, error_model="numpy")
def _copy(model, into, k):
    """Copy the state of a model."""
    into.W[:k], into.T[:k, :k] = model.W[:k], model.T[:k, :k]
    into.d[:], into.b[:], into.chosen[:k] = model.d, model.b, model.chosen[:k]
    into.inside[:], into.forced[:] = model.inside, model.forced


@njit(nogil=True, cache=True, error_model="numpy")
def _enter_group(model, group, g, k, dof, trace, step):
    """Enter the candidates of a group; the new k and step."""
    for a in range(g):
        k, step = record_entry(model, group[a], k, dof, trace, step, ENTER, NONE)
    return k, step


@njit(nogil=True, cache=True, error_model="numpy")
def _exchange(model, spare, k, dof, rules, needs, groups, sizes, most, theta, loss, trace, step):
    """Make the exchange of a kept group for one outside that lowers the criterion most; the new k and step."""
    p = model.inside.size
    out, none = np.zeros(max(k, 1), np.bool_), np.empty((0, 7))
    now = np.log(model.d[p]) + _price(rules.F_in, dof, 0, k)
    best, at = now - MARGIN, NONE
    for m in range(k):
        if model.forced[model.chosen[m]]:
            continue
        _dependants(model, m, k, needs, out)
        _copy(model, spare, k)
        left, _ = _remove(spare, k, dof, needs, out, theta, loss, none, ZERO)
        excess, j = _best_group(spare, left, dof, rules, needs, groups, sizes, most)
        if j >= 0:
            value = np.log(spare.d[p]) + _price(rules.F_in, dof, 0, left) - excess
            if value < best:
                best, at = value, m
    if at < 0:
        return k, step
    _dependants(model, at, k, needs, out)
    k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
    _, j = _best_group(model, k, dof, rules, needs, groups, sizes, most)
    return _enter_group(model, groups[j], sizes[j], k, dof, trace, step)


@njit(nogil=True, cache=True, error_model="numpy")
def hierarchical_search(C, dof, rules, needs, forced, initial, trace):
    """Stepwise search by moves of groups, by the rules of this file.

    Parameters
    ----------
    C, dof, forced, initial, trace
        As for `stepwise_search`. Initial terms that lack a parent leave first.
    rules : GroupRules
    needs : Needs

    Returns
    -------
    chosen, theta, rss, refused, why, moves
        As for `stepwise_search`.
    """
    p = C.shape[0] - 1
    limit = max(0, min(p, int(np.ceil(dof)) - 1))
    model, k, step = initial_model(C, dof, forced, initial, limit, rules.tolerance, trace)
    d, theta, loss = model.d, np.empty(limit), np.empty(limit)
    spare = Model(
        C, model.scale, np.empty_like(model.W), np.empty_like(model.T), d.copy(), model.b.copy(),
        np.empty_like(model.chosen), model.inside.copy(), model.forced.copy(),
    )  # fmt: skip
    groups, sizes = np.empty((p, needs.longest), np.int64), np.zeros(p, np.int64)
    out = np.zeros(max(limit, 1), np.bool_)
    for i in range(k):
        out[i] = not model.forced[model.chosen[i]] and not _satisfied(model.inside, model.chosen[i], needs)
    while out[:k].any():
        k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
        for i in range(k):
            out[i] = not model.forced[model.chosen[i]] and not _satisfied(model.inside, model.chosen[i], needs)
    most = min(limit, rules.max_terms)
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    perfect, rounding = False, 0.0
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        floor = estimates(model, k, theta, loss)
        if d[p] <= floor and not perfect:
            perfect, rounding = True, floor
        leaves = rules.F_out >= 0.0 or perfect
        if leaves and _weakest_group(model, k, dof, rules, needs, theta, rounding, perfect, out):
            k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
            continue
        if perfect:
            why = PERFECT
            break
        _, j = _best_group(model, k, dof, rules, needs, groups, sizes, most)
        if j >= 0:
            k, step = _enter_group(model, groups[j], sizes[j], k, dof, trace, step)
            continue
        why = MAX_TERMS if k >= most else NO_F if sizes.any() else NONE_LEFT
        if rules.swap:
            before = step
            k, step = _exchange(model, spare, k, dof, rules, needs, groups, sizes, most, theta, loss, trace, step)
            if step > before:
                why = MOVE_LIMIT
    chosen, theta_kept, rss_kept, refused = search_result(model, k, rules.tolerance)
    return chosen, theta_kept, rss_kept, refused, why, step
