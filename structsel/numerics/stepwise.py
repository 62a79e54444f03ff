"""Modified stepwise regression on the centred cross-products of candidates and response.

Arrays only. Every search sees C = Z'Z of the centred columns Z = [x_1 ... x_p, y] and ``dof``, the
samples less those swept out for the constant (N - 1), so it costs the same for a minute of flight or
a day. It works on the correlation form, so scaling a candidate changes nothing but its coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.triangular import climb, search

__all__ = ["Path", "Step", "check_products", "climb", "partial_f", "polish", "search", "stepwise"]

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


@dataclass(frozen=True)
class Step:
    """One move of a search.

    Attributes
    ----------
    action : {"enter", "leave", "swap", "refuse"}
        Forced and starting terms enter too. "refuse": a forced or starting term that is constant or
        that the terms already in explain.
    index : int
        Candidate (column of C) that moved; of a swap the one that came in.
    other : int
        Candidate a swap put out, else -1.
    F : float [-]
        Partial F of the candidate beside the other terms; inf if it leaves nothing unexplained.
    partial_r : float [-]
        Its partial correlation with the response, given the other terms.
    rss : float [response^2]
        Residual sum of squares after the move.
    n_terms : int
        Terms in the model after the move, the constant not counted.
    """

    action: str
    index: int
    other: int
    F: float
    partial_r: float
    rss: float
    n_terms: int


@dataclass(frozen=True)
class Path:
    """What a search kept, and how it came to it.

    Attributes
    ----------
    selected : tuple of int
        Candidates kept, in order of entry.
    theta : (k,) array [response per candidate]
        Their least-squares coefficients, in that order.
    rss : float [response^2]
    steps : tuple of Step
    refused : tuple of int
        Candidates outside that are constant or dependent on the kept ones within tol: these data cannot
        tell them apart.
    stopped : str
        Why the search ended, in words.
    tss : float [response^2]
        Sum of squares of the response about its mean.
    dof : float [-]
        Degrees of freedom before any term; dof - k are left.
    """

    selected: tuple[int, ...]
    theta: NDArray[np.float64]
    rss: float
    steps: tuple[Step, ...]
    refused: tuple[int, ...]
    stopped: str
    tss: float
    dof: float

    @property
    def r2(self) -> float:
        """Share of the response's variance explained, R^2 [-]."""
        return 1.0 - self.rss / self.tss


def check_products(C: ArrayLike, dof: float, who: str) -> NDArray[np.float64]:
    """Return C as the kernels need it, or say what is wrong with it.

    Parameters
    ----------
    C : (p+1, p+1) array
        Centred cross-products of the candidates and, last, the response.
    dof : float
    who : str
        Function to name in the message.

    Returns
    -------
    C : (p+1, p+1) array, C-contiguous float64, writeable

    Raises
    ------
    SelectionError
        C is not square or not finite, dof is not above 1, or the response is constant.
    """
    C = np.require(C, np.float64, ["C", "A", "W"])
    if C.ndim != 2 or C.shape[0] != C.shape[1] or C.shape[0] < 2:
        raise SelectionError(
            f"{who} needs square cross-products of at least one candidate and the response; found shape "
            f"{C.shape}. Pass the centred Z'Z of [candidates, response]."
        )
    # One sum sees every NaN and infinity; the exact place is looked for only to report it.
    if not np.isfinite(C.sum()) and not np.isfinite(C).all():
        # A bad column spoils its product with every other, but on the diagonal only its own.
        wrong = ~np.isfinite(np.diag(C))
        bad = int(np.argmax(wrong if wrong.any() else ~np.isfinite(C).all(axis=0)))
        what = "the response" if bad == C.shape[0] - 1 else f"candidate {bad}"
        raise SelectionError(
            f"{who} needs finite cross-products; {what} has NaN or infinite ones. Remove the samples that "
            "are not finite before accumulating."
        )
    if not dof > 1.0:
        raise SelectionError(
            f"{who} needs more than one degree of freedom beside the constant; found {dof:g}. Use a longer recording."
        )
    if not C[-1, -1] > 0.0:
        raise SelectionError(
            f"{who} needs a response that varies; the sum of squares about its mean is {C[-1, -1]:g}. "
            "Choose another response: the constant alone describes this one."
        )
    return C


def _indices(values: Sequence[int], p: int, who: str, what: str) -> NDArray[np.int64]:
    array = np.asarray(list(dict.fromkeys(int(v) for v in values)), dtype=np.int64)
    if array.size and (array.min() < 0 or array.max() >= p):
        bad = [int(v) for v in array if not 0 <= v < p]
        raise SelectionError(
            f"{who} needs {what} to be candidate numbers from 0 to {p - 1}; found {bad}. Number the "
            "candidates as the columns of C."
        )
    return array


def _check_room(force: NDArray[np.int64], start: NDArray[np.int64], dof: float, max_terms: int, who: str) -> None:
    wanted = np.union1d(force, start).size
    if wanted >= dof:
        raise SelectionError(
            f"{who} is to start from {wanted} terms but has {dof:g} degrees of freedom. Start from fewer "
            "terms (start=() adds them one by one) or use more samples."
        )
    if force.size > max_terms:
        raise SelectionError(
            f"{who} is to keep {force.size} forced terms but max_terms is {max_terms}. Raise max_terms or force fewer."
        )


def _path(answer: Any, trace: NDArray[np.float64], tss: float, dof: float) -> Path:
    chosen, theta, rss, refused, why, moves = answer
    theta.setflags(write=False)
    steps = tuple(
        Step(ACTIONS[int(a)], int(i), int(o), float(F), float(r), float(left) * tss, int(k))
        for a, i, o, F, r, left, k in trace[:moves]
    )
    kept = tuple(int(j) for j in chosen)
    out = tuple(int(j) for j in np.flatnonzero(refused))
    return Path(kept, theta, float(rss), steps, out, STOPS[why], tss, dof)


def stepwise(
    C: ArrayLike,
    dof: float,
    *,
    F_in: float = 4.0,
    F_out: float = 4.0,
    force: Sequence[int] = (),
    start: Sequence[int] = (),
    max_terms: int | None = None,
    swap: bool = True,
    stop: str = "F",
    r2_change: float = 0.005,
    sigma_max2: float | None = None,
    tol: float = 1e-9,
    entry_thresholds: ArrayLike | None = None,
) -> Path:
    """Choose terms by modified stepwise regression.

    The candidate with the largest partial correlation enters if its partial F reaches F_in; after
    each entry the kept term with the smallest partial F leaves if it is below F_out; when nothing enters
    or leaves, exchanging one kept term for one outside is tried, and the search goes on if that lowers the
    residual sum of squares. With b_j and d_j what the kept terms leave of the candidate's product with
    the response and of its own sum of squares::

        inside   F_j = theta_j^2 / s^2(theta_j),           s^2 = rss / (dof - k)
        outside  F_j = g_j / ((rss - g_j) / (dof - k - 1)),  g_j = b_j^2 / d_j

    Parameters
    ----------
    C : (p+1, p+1) array [products]
        Centred cross-products of the candidates and, last, the response.
    dof : float [-]
        Samples less those swept out for the constant (N - 1), or the effective number.
    F_in, F_out : float [-]
        Partial F to enter and to stay. The sources use 12.
    force : sequence of int
        Candidates that enter first and never leave.
    start : sequence of int
        Candidates in at the start, free to leave: the linear terms [TP1916], or all [C89]. Of
        dependent ones the later is refused.
    max_terms : int, optional
        Most terms kept, the constant not counted.
    swap : bool
    stop : {"F", "R2", "PSE"}
        What, beside F_in, an entry must bring: "R2" a rise of R^2 by r2_change; "PSE" a fall of
        rss / N + sigma_max2 n / N, that is g_j above sigma_max2.
    r2_change : float [-]
    sigma_max2 : float [response^2], optional
        Default: the variance of the response, tss / N with N = dof + 1.
    tol : float [-]
        Refuse a candidate of whose centred variance the kept terms leave no more than this share.
    entry_thresholds : (p,) array [-], optional
        In place of F_in: what the first, second, ... term needs to enter (:func:`fdr_thresholds`). With k
        terms in, F_out is at most the k-th of them.

    Returns
    -------
    Path

    Raises
    ------
    SelectionError
        F_out above F_in; products not finite; a constant response; more starting terms than degrees of
        freedom.

    Notes
    -----
    It ends: log rss + sum_{i<=k} log(1 + F_in / (dof - i)) does not rise on entry and falls when a
    term leaves or is exchanged, so no model returns. What cannot be told from rounding
    (1 - R^2 below about 1e-14 times the squared size of the standardised coefficients) is a perfect fit.

    References
    ----------
    [TP1916], [C89]
    """
    C = check_products(C, dof, "stepwise")
    p = C.shape[0] - 1
    if entry_thresholds is None:
        thresholds = np.full(p, float(F_in))
        if F_out > F_in:
            raise SelectionError(
                f"stepwise needs F_out no larger than F_in; found F_in = {F_in:g}, F_out = {F_out:g}. A term "
                "whose partial F lies between would enter and leave for ever. Lower F_out or raise F_in."
            )
    else:
        thresholds = np.require(entry_thresholds, np.float64, ["C", "A", "W"])
        if thresholds.shape != (p,):
            raise SelectionError(
                f"stepwise needs one entry threshold per candidate ({p}); found shape {thresholds.shape}. "
                "fdr_thresholds(p, dof, q) makes them."
            )
    if np.isnan(thresholds).any() or np.isnan(F_out):
        raise SelectionError("stepwise needs numbers for F_in and F_out; found NaN. The usual values are 4 to 12.")
    tss = float(C[-1, -1])
    if stop == "F":
        min_gain = 0.0
    elif stop == "R2":
        min_gain = float(r2_change)
    elif stop == "PSE":
        min_gain = 1.0 / (dof + 1.0) if sigma_max2 is None else float(sigma_max2) / tss
    else:
        raise SelectionError(f'stepwise stops on "F", "R2" or "PSE"; found {stop!r}. Choose one of the three.')
    forced = _indices(force, p, "stepwise", "force")
    begin = _indices(start, p, "stepwise", "start")
    most = p if max_terms is None else int(max_terms)
    _check_room(forced, begin, dof, most, "stepwise")
    answer, trace = _traced(
        search, C, float(dof), thresholds, float(F_out), forced, begin, most, min_gain, bool(swap), float(tol)
    )
    return _path(answer, trace, tss, float(dof))


def _traced(kernel: Any, C: NDArray[np.float64], *arguments: Any) -> tuple[Any, NDArray[np.float64]]:
    """Call a kernel with a trace long enough for its moves."""
    rows = 4 * C.shape[0] + 200
    while True:
        trace = np.empty((rows, 7))
        answer = kernel(C, *arguments, trace)
        if answer[-1] <= rows:
            return answer, trace
        rows = answer[-1]


def polish(
    C: ArrayLike,
    dof: float,
    selected: Sequence[int],
    penalty: float,
    *,
    force: Sequence[int] = (),
    max_terms: int | None = None,
    depth: int = 2,
    tol: float = 1e-9,
) -> Path:
    """Improve a selection until no small move lowers dof log(rss) + penalty k.

    Parameters
    ----------
    C, dof, force, tol
        As in :func:`stepwise`.
    selected : sequence of int
        Terms to start from.
    penalty : float [-]
        What one term costs: (dof / N) log(N) gives BIC exactly, 2 about AIC.
    max_terms : int, optional
    depth : {1, 2, 3}
        1: one term in, out or exchanged. 2: also two in, two out, two for one and one for two. 3: also two
        for two.

    Returns
    -------
    Path
        Its steps begin with ``selected`` entering.

    Raises
    ------
    SelectionError
        As :func:`stepwise`, or depth is none of the three.
    """
    C = check_products(C, dof, "polish")
    p = C.shape[0] - 1
    if depth not in (1, 2, 3):
        raise SelectionError(f"polish needs depth 1, 2 or 3; found {depth!r}. 2 is the usual choice.")
    forced = _indices(force, p, "polish", "force")
    begin = _indices(selected, p, "polish", "selected")
    most = p if max_terms is None else int(max_terms)
    _check_room(forced, begin, dof, most, "polish")
    answer, trace = _traced(climb, C, float(dof), float(penalty), forced, begin, most, int(depth), float(tol))
    return _path(answer, trace, float(C[-1, -1]), float(dof))


def partial_f(
    C: ArrayLike, dof: float, selected: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Least squares with the given terms, and each one's partial F beside the others.

    Parameters
    ----------
    C, dof
        As in :func:`stepwise`.
    selected : sequence of int

    Returns
    -------
    theta : (k,) array [response per candidate]
    F : (k,) array [-]
        theta_j^2 / s^2(theta_j): the square of the t statistic.
    rss : float [response^2]

    Raises
    ------
    SelectionError
        As :func:`stepwise`, or the terms depend on one another.
    """
    C = check_products(C, dof, "partial_f")
    p = C.shape[0] - 1
    begin = _indices(selected, p, "partial_f", "selected")
    none = np.empty(0, np.int64)
    _check_room(none, begin, dof, p, "partial_f")
    nothing = np.empty((0, 7))
    # Nothing passes these thresholds: the search only takes the terms in and estimates.
    chosen, theta, rss, *_ = search(
        C, float(dof), np.full(p, np.inf), -1.0, begin, none, begin.size, 0.0, False, 1e-12, nothing
    )
    if chosen.size < begin.size:
        lost = sorted(set(begin.tolist()) - set(chosen.tolist()))
        raise SelectionError(
            f"partial_f needs independent terms; candidates {lost} are constant or depend on the others. "
            "Leave them out."
        )
    inverse = np.linalg.inv(C[np.ix_(chosen, chosen)] / np.outer(_root(C, chosen), _root(C, chosen)))
    loss = (theta * _root(C, chosen)) ** 2 / np.diag(inverse)
    with np.errstate(divide="ignore"):
        F = loss * (dof - chosen.size) / rss
    return theta, F, float(rss)


def _root(C: NDArray[np.float64], chosen: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.sqrt(np.diag(C)[chosen])
