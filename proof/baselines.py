"""Three simple methods to name a cause, as baselines: each uses the same signatures and the same differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.diagnosis import EffectComparison
from structsel.numerics.stepwise import stepwise

Array = NDArray[np.float64]
LARGEST_FIT, STEPWISE_BIC, LARGEST_CORRELATION = "largest single fit", "stepwise and BIC", "largest correlation"
_MAX_TERMS = 12
"""Terms that stepwise regression may keep."""


@dataclass(frozen=True, eq=False)
class _Sums:
    """Products of all signatures' columns and the differences, each response by its own rms.

    Attributes
    ----------
    C : (p + 1, p + 1) array
        Over all responses, the differences last.
    correlation : (p,) array
        Largest, over the responses, that a column has with the differences, each manoeuvre about its mean.
    rows : int
    owner : (p,) array of int
        Signature that a column is of.
    """

    C: Array
    correlation: Array
    rows: int
    owner: NDArray[np.intp]


def name_simply(compared: EffectComparison) -> dict[str, list[str]]:
    """Effects that each simple method names, likeliest first.

    - *largest single fit*: the hypothesis whose best form has the largest R^2 by least squares;
    - *stepwise and BIC*: stepwise regression over all columns of all forms, a term entering and staying where BIC
      falls; effects by the increase of the residual sum of squares without them;
    - *largest correlation*: the hypothesis with the column most correlated with the differences in some response.

    None of them knows tolerances, the autocorrelation of the noise, or other manoeuvres than those it fits.

    Parameters
    ----------
    compared : EffectComparison

    Returns
    -------
    mapping of method to list of effects
    """
    signatures = compared.signatures
    sums = _add_up(compared) if signatures else None
    if sums is None or not sums.rows:  # nothing to try, or nothing differs
        return {LARGEST_FIT: [], STEPWISE_BIC: [], LARGEST_CORRELATION: []}
    effects = [s.effect for s in signatures]
    return {
        LARGEST_FIT: _in_order(effects, [_fit(sums, k) for k in range(len(signatures))]),
        STEPWISE_BIC: _by_steps(sums, effects),
        LARGEST_CORRELATION: _in_order([effects[k] for k in sums.owner], sums.correlation),
    }


def _add_up(compared: EffectComparison) -> _Sums:
    signatures = compared.signatures
    widths = [len(s.parameters) for s in signatures]
    owner = np.repeat(np.arange(len(signatures)), widths)
    first = np.cumsum([0, *widths])
    p = int(first[-1])
    C = np.zeros((p + 1, p + 1))
    correlation, rows = np.zeros(p), 0
    for response in compared.responses:
        differences = [part[response] for part in compared.transformed]
        scale = np.sqrt(sum(float(y @ y) for y in differences) / sum(len(y) for y in differences))
        if scale == 0.0:
            continue
        xx, xy, yy = np.zeros(p), np.zeros(p), 0.0
        for i, y in enumerate(differences):
            here = [k for k, s in enumerate(signatures) if response in s.columns[i]]
            at = np.concatenate([*(np.arange(first[k], first[k + 1]) for k in here), [p]])
            Z = np.column_stack([*(signatures[k].columns[i][response] for k in here), y]) / scale
            C[np.ix_(at, at)] += Z.T @ Z
            rows += len(y)
            about = Z[1:]  # without the level
            xx[at[:-1]] += np.einsum("ij,ij->j", about[:, :-1], about[:, :-1])
            xy[at[:-1]] += about[:, :-1].T @ about[:, -1]
            yy += float(about[:, -1] @ about[:, -1])
        size = np.sqrt(xx * yy)
        correlation = np.maximum(correlation, np.divide(np.abs(xy), size, out=np.zeros(p), where=size > 0.0))
    return _Sums(C, correlation, rows, owner)


def _fit(sums: _Sums, k: int) -> float:
    """R^2 of one form alone."""
    columns = np.flatnonzero(sums.owner == k)
    A, b = sums.C[np.ix_(columns, columns)], sums.C[columns, -1]
    return float(b @ np.linalg.lstsq(A, b, rcond=1e-10)[0]) / float(sums.C[-1, -1])


def _by_steps(sums: _Sums, effects: Sequence[str]) -> list[str]:
    worth = float(np.log(sums.rows))  # of one term, in F, where BIC neither falls nor rises
    path = stepwise(sums.C, float(sums.rows), F_in=worth, F_out=worth, max_terms=_MAX_TERMS, swap=False)
    kept = np.array(path.selected, dtype=int)
    if not len(kept):
        return []
    spread = np.linalg.pinv(sums.C[np.ix_(kept, kept)], rcond=1e-12)
    names = np.array([effects[sums.owner[j]] for j in kept])
    lost = []
    for name in (found := list(dict.fromkeys(names))):
        mine = np.flatnonzero(names == name)
        lost.append(float(path.theta[mine] @ np.linalg.solve(spread[np.ix_(mine, mine)], path.theta[mine])))
    return _in_order([str(n) for n in found], lost)


def _in_order(effects: Sequence[str], scores: Sequence[float] | Array) -> list[str]:
    """Effects by their best score, each once."""
    order = np.argsort(-np.asarray(scores), kind="stable")
    return list(dict.fromkeys(effects[k] for k in order))
