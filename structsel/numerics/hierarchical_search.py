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

import numpy as np

from structsel.numerics.compiling import njit
from structsel.numerics.group_moves import (
    Needs,
    best_group,
    dependants,
    group_price,
    satisfied,
    weakest_group,
)
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


def needs_of(hierarchy: Hierarchy) -> Needs:
    """What the compiled search reads of a hierarchy."""
    longest = 1 + int(hierarchy.ancestors().sum(axis=1).max(initial=0))
    return Needs(np.ascontiguousarray(hierarchy.parents), hierarchy.parents_first(), longest, hierarchy.strong)


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
def _exchange(model, trial, k, dof, rules, needs, groups, sizes, max_terms, theta, loss, trace, step):
    """Make the exchange of a kept group for one outside that lowers the criterion most; the new k and step."""
    p = model.inside.size
    out, none = np.zeros(max(k, 1), np.bool_), np.empty((0, 7))
    now = np.log(model.d[p]) + group_price(rules.F_in, dof, 0, k)
    best, at = now - MARGIN, NONE
    for m in range(k):
        if model.forced[model.chosen[m]]:
            continue
        dependants(model, m, k, needs, out)
        _copy(model, trial, k)
        left, _ = _remove(trial, k, dof, needs, out, theta, loss, none, ZERO)
        excess, j = best_group(trial, left, dof, rules, needs, groups, sizes, max_terms)
        if j >= 0:
            value = np.log(trial.d[p]) + group_price(rules.F_in, dof, 0, left) - excess
            if value < best:
                best, at = value, m
    if at < 0:
        return k, step
    dependants(model, at, k, needs, out)
    k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
    _, j = best_group(model, k, dof, rules, needs, groups, sizes, max_terms)
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
    trial = Model(
        C, model.scale, np.empty_like(model.W), np.empty_like(model.T), d.copy(), model.b.copy(),
        np.empty_like(model.chosen), model.inside.copy(), model.forced.copy(),
    )  # fmt: skip
    groups, sizes = np.empty((p, needs.longest), np.int64), np.zeros(p, np.int64)
    out = np.zeros(max(limit, 1), np.bool_)
    for i in range(k):
        out[i] = not model.forced[model.chosen[i]] and not satisfied(model.inside, model.chosen[i], needs)
    while out[:k].any():
        k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
        for i in range(k):
            out[i] = not model.forced[model.chosen[i]] and not satisfied(model.inside, model.chosen[i], needs)
    max_terms = min(limit, rules.max_terms)
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    perfect, rounding = False, 0.0
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        floor = estimates(model, k, theta, loss)
        if d[p] <= floor and not perfect:
            perfect, rounding = True, floor
        leaves = rules.F_out >= 0.0 or perfect
        if leaves and weakest_group(model, k, dof, rules, needs, theta, rounding, perfect, out):
            k, step = _remove(model, k, dof, needs, out, theta, loss, trace, step)
            continue
        if perfect:
            why = PERFECT
            break
        _, j = best_group(model, k, dof, rules, needs, groups, sizes, max_terms)
        if j >= 0:
            k, step = _enter_group(model, groups[j], sizes[j], k, dof, trace, step)
            continue
        why = MAX_TERMS if k >= max_terms else NO_F if sizes.any() else NONE_LEFT
        if rules.swap:
            before = step
            k, step = _exchange(model, trial, k, dof, rules, needs, groups, sizes, max_terms, theta, loss, trace, step)
            if step > before:
                why = MOVE_LIMIT
    chosen, theta_kept, rss_kept, refused = search_result(model, k, rules.tolerance)
    return chosen, theta_kept, rss_kept, refused, why, step
