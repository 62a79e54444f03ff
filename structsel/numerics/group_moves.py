"""Groups of candidates that enter or leave together, their gains, losses and prices; letters of `search_model`.

`hierarchical_search` has the rules of the moves.
"""

# mypy: disable-error-code="no-untyped-def"
# Compiled kernels: the types of their arguments are those of the arrays passed in.

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.search_model import NONE, ZERO


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


@njit(nogil=True, cache=True, error_model="numpy")
def satisfied(inside, j, needs):
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
def group_price(F, dof, k, g):
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
def best_group(model, k, dof, rules, needs, groups, sizes, max_terms):
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
        if needs.strong or satisfied(inside, j, needs):
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
                    worth = -np.log(max(d[p] - one, 1e-300)) - group_price(rules.F_in, dof, k, g)
                    if worth > value:
                        value, gain, sizes[j] = worth, one, g
                        groups[j, :g] = trial[:g]
        if gain < 0.0:
            sizes[j] = 0
            continue
        g = sizes[j]
        if k + g > max_terms or gain < rules.min_gain * g:
            continue
        value = np.log(d[p]) - np.log(max(d[p] - gain, 1e-300)) - group_price(rules.F_in, dof, k, g)
        if value >= 0.0 and (value / g > best or at < 0):
            best, excess, at = value / g, value, j
    return excess, at


@njit(nogil=True, cache=True, error_model="numpy")
def dependants(model, m, k, needs, out):
    """Mark term m and the kept terms that would lack a parent without it in out (k,); their number."""
    inside = model.inside.copy()
    out[:k] = False
    out[m] = True
    inside[model.chosen[m]] = False
    g, before = 1, 0
    while g > before:
        before = g
        for i in range(k):
            if not out[i] and not model.forced[model.chosen[i]] and not satisfied(inside, model.chosen[i], needs):
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
def weakest_group(model, k, dof, rules, needs, theta, rounding, perfect, out):
    """Marks of the group whose exit pays most; its size, 0 where none pays."""
    p = model.inside.size
    trial, best, size = np.zeros(max(k, 1), np.bool_), 0.0, ZERO
    for m in range(k):
        if model.forced[model.chosen[m]]:
            continue
        g = dependants(model, m, k, needs, trial)
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
