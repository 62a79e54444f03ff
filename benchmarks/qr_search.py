"""Stepwise search by QR: the reference for searches on cross-products."""

from __future__ import annotations

import numpy as np

from structsel.numerics.arrays import Array


def qr_stepwise(X: Array, y: Array, threshold: float, tolerance: float = 1e-9) -> tuple[set[int], set[int]]:
    """Forward selection with backward elimination on orthogonalised columns; no cross-products are formed.

    Parameters
    ----------
    X : (n, p) array
        Candidates, without the constant.
    y : (n,) array
    threshold : float
        Partial F to enter, and to stay.
    tolerance : float
        Candidates with a smaller fraction of their squared length outside the selected ones are refused.

    Returns
    -------
    kept, refused : set of int
    """
    Z = np.column_stack([X, y])
    Z = np.linalg.qr(Z - Z.mean(axis=0), mode="r")
    Z /= np.linalg.norm(Z, axis=0)
    A, b = Z[:, :-1], Z[:, -1]
    dof = len(y) - 1
    kept: list[int] = []
    while True:
        Q, R = np.linalg.qr(A[:, kept])
        left, rest = A, b
        for _ in range(2):  # twice is enough
            left, rest = left - Q @ (Q.T @ left), rest - Q @ (Q.T @ rest)
        if kept:
            loss = np.linalg.solve(R, Q.T @ b) ** 2 / np.sum(np.linalg.inv(R) ** 2, axis=1)
            if loss.min() * (dof - len(kept)) < threshold * (rest @ rest):
                del kept[int(np.argmin(loss))]
                continue
        free = np.sum(left**2, axis=0)
        usable = free > tolerance
        usable[kept] = False
        gain = np.where(usable, (left.T @ rest) ** 2 / np.where(usable, free, 1.0), 0.0)
        best = int(np.argmax(gain))
        if gain[best] * (dof - len(kept) - 1) < threshold * (rest @ rest - gain[best]):
            return set(kept), {int(j) for j in np.flatnonzero(free <= tolerance)} - set(kept)
        kept.append(best)
