"""Modified stepwise regression, compiled; letters of `search_model`."""

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
    MAX_TERMS,
    MOVE_LIMIT,
    NO_DOF,
    NO_F,
    NO_GAIN,
    NONE,
    NONE_LEFT,
    PERFECT,
    ROUNDING,
    ZERO,
    estimates,
    initial_model,
    record_entry,
    record_exit,
    record_swap,
    search_result,
)


class StepwiseRules(NamedTuple):
    """Rules for the entry, exit and exchange of terms."""

    F_in: Array  # (p,) partial F that the first, second, ... term needs to enter
    F_out: float  # partial F a term needs to stay; with k terms in, never more than F_in[k-1]
    max_terms: int
    min_gain: float  # fraction of the total sum of squares that a term must explain to enter, times its weight
    weights: Array  # (p,) the candidate with the largest product of weight and reduction of 1 - R^2 enters
    swap: bool  # try exchanges when nothing enters or leaves
    tolerance: float  # smallest d of a term that may enter


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
    """Largest product of weight and reduction of 1 - R^2: the reduction, and the candidate."""
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
    """Component (p+1,) of each column along the direction that only term m spans."""
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
    """Exchange of one kept term for one outside with the least 1 - R^2: its value, the term, the candidate."""
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
def stepwise_search(C, dof, rules, forced, initial, trace):
    """Modified stepwise search; see :func:`structsel.numerics.stepwise.stepwise`.

    Parameters
    ----------
    C : (p+1, p+1) array, C-contiguous float64, writeable
        Centred cross-products of the candidates and, last, the response.
    dof : float
        Samples less those swept out of C (the constant).
    rules : StepwiseRules
    forced, initial : (any,) int64 array
        Terms that are always in the model; terms of the first model.
    trace : (t, 7) array, written
        First t moves: action, index, other, F, partial r, 1 - R^2 after it, terms after it.

    Returns
    -------
    chosen : (k,) int64 array
        In order of entry.
    theta : (k,) array [response per candidate]
    rss : float [response^2]
    refused : (p,) bool array
        Not in the model, and dependent on its terms within tol (or constant).
    why : int
        One of the reasons in `search_model`.
    moves : int
    """
    p = C.shape[0] - 1
    F_in, weights, tol = rules.F_in, rules.weights, rules.tolerance
    limit = max(0, min(p, int(np.ceil(dof)) - 1))
    model, k, step = initial_model(C, dof, forced, initial, limit, tol, trace)
    d = model.d
    theta, loss, c = np.empty(limit), np.empty(limit), np.empty(p + 1)
    why = CONSTANT if model.scale[p] == 0.0 else MOVE_LIMIT
    if why == CONSTANT:
        k = ZERO
    perfect, rounding = False, 0.0
    while why == MOVE_LIMIT and step < 50 * p + 1000:
        # A kept term leaves if it explains too little; after a perfect fit, if it explains nothing.
        floor = estimates(model, k, theta, loss)
        if d[p] <= floor and not perfect:
            perfect, rounding = True, floor
        least, m = _weakest(model, k, loss)
        if m >= 0 and least < (rounding if perfect else min(rules.F_out, F_in[k - 1]) * d[p] / (dof - k)):
            k, step = record_exit(model, m, k, dof, theta, loss, trace, step)
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
        elif k >= rules.max_terms:
            why = MAX_TERMS
        elif not gain * (dof - k - 1) >= F_in[k] * max(d[p] - gain, 0.0):  # inf times 0 is no entry
            why = NO_F
        elif weights[j] * gain < rules.min_gain:
            why = NO_GAIN
        else:
            k, step = record_entry(model, j, k, dof, trace, step, ENTER, NONE)
            continue
        # No term enters or leaves: the search continues if an exchange lowers rss.
        if rules.swap and j >= 0:
            rss, m, j = _best_swap(model, k, tol, c)
            if m >= 0 and rss < d[p] * (1.0 - MARGIN) - ROUNDING:
                k, step = record_swap(model, m, j, k, dof, trace, step)
                why = MOVE_LIMIT
    chosen, theta_kept, rss_kept, refused = search_result(model, k, tol)
    return chosen, theta_kept, rss_kept, refused, why, step
