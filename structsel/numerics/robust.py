"""Stepwise search whose F-tests believe blocks of samples, not samples.

Whitening is the efficient way to deal with coloured residuals that are noise. Where they are misfit instead (a late
channel, noise in the signals themselves, dynamics that were left out) it weighs what the terms cannot explain. Here
the fit stays ordinary least squares, and only the tests change: the variance of a term's score is taken from its
scatter over blocks, whatever the residual does inside them. With x_j|kept what the kept terms leave of a
candidate, e the residual without it and theta_j what it would be worth::

    F_j = theta_j^2 d_j^2 / sum_b u_bj^2 (B - k - 1) / B,    u_bj = sum_{t in b} x_j|kept (e - theta_j x_j|kept)

with d_j = sum x_j|kept^2, to be compared with F of 1 and B - 1 degrees of freedom.

References
----------
The variance is the cluster-robust one of generalised estimating equations; [C89] and [TP1916] for the search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import linalg, stats

from structsel.numerics.arrays import Array
from structsel.numerics.moments import MomentSet
from structsel.numerics.stepwise import Path, Step

PERFECT = 1e-12  # of the response's sum of squares


class _Blocks:
    """Columns of every block's products, unpacked only when a search asks for them."""

    def __init__(self, moments: MomentSet, weights: Array | None):
        q = moments.scale.size
        self.used = np.flatnonzero(weights > 0) if weights is not None else np.arange(moments.n_blocks)
        self.weights = np.ones(self.used.size) if weights is None else weights[self.used]
        self.packed = moments.packed
        i = np.arange(q)
        self.start = i * q - i * (i - 1) // 2 - i
        self.q = q
        self.columns: dict[int, Array] = {}
        self.squares = self.packed[np.ix_(self.used, self.start + i)] * self.weights[:, None]

    def column(self, j: int) -> Array:
        """(B, q): weighted products of column j with all columns, block by block."""
        if j not in self.columns:
            i = np.arange(self.q)
            at = np.where(i <= j, self.start[i] + j, self.start[j] + i)
            self.columns[j] = self.packed[np.ix_(self.used, at)] * self.weights[:, None]
        return self.columns[j]


class _Model:
    """Ordinary least squares on the kept columns, with every candidate's block scores."""

    def __init__(self, G: Array, blocks: _Blocks, kept: Sequence[int]):
        rows = [0, *(j + 1 for j in kept)]
        last = G.shape[0] - 1
        root = np.sqrt(np.diag(G)[rows])
        factor = linalg.cho_factor(G[np.ix_(rows, rows)] / np.outer(root, root))
        inner = linalg.cho_solve(factor, G[rows] / root[:, None]) / root[:, None]
        theta = inner[:, last]
        self.rss = max(float(G[last, last] - G[rows, last] @ theta), 0.0)
        residual = blocks.column(last) - sum(t * blocks.column(r) for t, r in zip(theta, rows, strict=True))
        scores = (residual - residual[:, rows] @ inner)[:, 1:last]
        count = blocks.used.size
        shrink = max(count - len(kept) - 1, 0) / count
        left = np.diag(G)[1:last] - np.einsum("ij,ij->j", G[rows, 1:last], inner[:, 1:last])
        total = scores.sum(axis=0)
        # Each block's share of what the kept terms leave of every candidate's sum of squares.
        kept_columns = np.stack([blocks.column(r) for r in rows], axis=1)  # (B, k + 1, q)
        projected = np.einsum("bij,jc->bic", kept_columns[:, :, rows], inner) - 2.0 * kept_columns
        own = (blocks.squares + np.einsum("ic,bic->bc", inner, projected))[:, 1:last]
        worth = np.where(left > 0, total / np.where(left > 0, left, 1.0), 0.0)
        spread = ((scores - worth * own) ** 2).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.F = np.where(spread > 0, total**2 / spread * shrink, 0.0)
            self.gain = np.where(left > 0, total**2 / left, 0.0)
            self.share = np.where(np.diag(G)[1:last] > 0, left / np.diag(G)[1:last], 0.0)
        inverse = linalg.cho_solve(factor, np.eye(len(rows))) / np.outer(root, root)
        meat = residual[:, rows].T @ residual[:, rows]
        variance = np.diag(inverse @ meat @ inverse)
        self.theta = theta
        self.F_kept = theta[1:] ** 2 / np.maximum(variance[1:], 1e-300) * shrink
        self.sign = np.sign(total)


def _best_exchange(
    G: Array, blocks: _Blocks, kept: list[int], gone: set[int], force: Sequence[int], enter: float, tol: float
) -> tuple[int, int, _Model] | None:
    """The exchange of a kept term for one outside that leaves the least residual: place, candidate, model."""
    best: tuple[int, int, float] | None = None
    for place, j in enumerate(kept):
        if j in force:
            continue
        others = [*kept[:place], *kept[place + 1 :]]
        model = _Model(G, blocks, others)
        able = (enter <= model.F) & (model.share > tol)
        able[[*kept, *gone]] = False
        if able.any():
            i = int(np.argmax(np.where(able, model.gain, -1.0)))
            rss = model.rss - float(model.gain[i])
            if best is None or rss < best[2]:
                best = (place, i, rss)
    if best is None:
        return None
    place, i, _ = best
    return place, i, _Model(G, blocks, [*kept[:place], i, *kept[place + 1 :]])


def robust_threshold(F: float, dof: float, blocks: int) -> float:
    """The F of 1 and B - 1 degrees of freedom that is as improbable as ``F`` of 1 and ``dof``."""
    return float(stats.f.isf(stats.f.sf(F, 1, dof), 1, max(blocks - 1, 1)))


def inflation(moments: MomentSet, weights: Array | None, kept: Sequence[int], dof: float) -> float:
    """How many samples are worth one: the median ratio of a kept term's plain partial F to its block-robust one."""
    if not kept:
        return 1.0
    G = moments.total(weights)
    model = _Model(G, _Blocks(moments, weights), kept)
    if model.rss <= PERFECT * G[-1, -1]:
        return 1.0
    rows = [0, *(j + 1 for j in kept)]
    root = np.sqrt(np.diag(G)[rows])
    variance = np.diag(np.linalg.pinv(G[np.ix_(rows, rows)] / np.outer(root, root))) / root**2
    plain = model.theta**2 / (variance * model.rss / max(dof - len(kept), 1.0))
    return float(max(np.median(plain[1:] / np.maximum(model.F_kept, 1e-300)), 1.0))


def robust_stepwise(
    moments: MomentSet,
    weights: Array | None,
    dof: float,
    *,
    F_in: float = 4.0,
    F_out: float = 4.0,
    force: Sequence[int] = (),
    start: Sequence[int] = (),
    max_terms: int | None = None,
    tol: float = 1e-9,
) -> Path:
    """Modified stepwise regression with partial F from the scatter over blocks.

    Of the candidates whose block-robust F reaches F_in, the one that explains most enters; kept terms below F_out
    leave; when nothing enters, exchanges that lower the residual are tried. A term that has left, or was exchanged,
    does not come back, so the search ends.

    Parameters
    ----------
    moments : MomentSet
        Of one response, not whitened.
    weights : (B,) array, optional
        Of the blocks; zero leaves one out.
    dof : float
        Samples less one.
    F_in, F_out : float
        As for `stepwise`; turned into equally improbable values for the number of blocks.
    force, start : sequence of int
    max_terms : int, optional
    tol : float
        Least share of a candidate's own sum of squares the kept terms must leave.

    Returns
    -------
    Path
        F of each step is the block-robust one.
    """
    G = moments.total(weights)
    blocks = _Blocks(moments, weights)
    count = blocks.used.size
    enter, stay = (robust_threshold(F, dof, count) for F in (F_in, F_out))
    tss = float(G[-1, -1] - G[0, -1] ** 2 / G[0, 0])
    most = min(max_terms if max_terms is not None else G.shape[0] - 2, count - 2, int(dof) - 1)
    kept: list[int] = []
    steps: list[Step] = []
    gone: set[int] = set()
    stopped = "no term outside reaches F_in"

    def note(action: str, j: int, F: float, sign: float, before: float, model: _Model) -> None:
        r2 = max(1.0 - min(before, model.rss) / max(before, model.rss, 1e-300), 0.0)
        steps.append(Step(action, j, -1, F, float(sign * np.sqrt(r2)), model.rss, len(kept)))

    model = _Model(G, blocks, kept)
    for j in dict.fromkeys([*force, *start]):
        if model.share[j] <= tol:
            steps.append(Step("refuse", j, -1, np.nan, np.nan, model.rss, len(kept)))
            continue
        F, sign, before = float(model.F[j]), float(model.sign[j]), model.rss
        kept.append(j)
        model = _Model(G, blocks, kept)
        note("enter", j, F, sign, before, model)
    while True:
        loose = [i for i, j in enumerate(kept) if j not in force]
        if model.rss <= PERFECT * tss:
            # Nothing but rounding is left, and F means nothing; what can go without loss goes.
            idle = next((i for i in loose if _Model(G, blocks, kept[:i] + kept[i + 1 :]).rss <= PERFECT * tss), None)
            if idle is None:
                stopped = "perfect fit"
                break
            before, j = model.rss, kept.pop(idle)
            model = _Model(G, blocks, kept)
            note("leave", j, 0.0, 0.0, before, model)
            continue
        weakest = min(loose, key=lambda i: model.F_kept[i], default=None)
        if weakest is not None and model.F_kept[weakest] < stay:
            F, sign, before = float(model.F_kept[weakest]), float(np.sign(model.theta[1 + weakest])), model.rss
            j = kept.pop(weakest)
            gone.add(j)
            model = _Model(G, blocks, kept)
            note("leave", j, F, sign, before, model)
            continue
        if len(kept) >= most:
            stopped = "as many terms as blocks can test" if max_terms is None else "max_terms reached"
            break
        able = (enter <= model.F) & (model.share > tol)
        able[[*kept, *gone]] = False
        if not able.any():
            swap = _best_exchange(G, blocks, kept, gone, force, enter, tol)
            if swap is None or swap[2].rss >= model.rss * (1.0 - 1e-10):
                break
            place, j, after = swap
            old, before = kept[place], model.rss
            kept[place], model = j, after
            gone.add(old)
            r2 = max(1.0 - after.rss / before, 0.0)
            F, sign = float(after.F_kept[place]), float(np.sign(after.theta[1 + place]))
            steps.append(Step("swap", j, old, F, float(sign * np.sqrt(r2)), after.rss, len(kept)))
            continue
        j = int(np.argmax(np.where(able, model.gain, -1.0)))
        F, sign, before = float(model.F[j]), float(model.sign[j]), model.rss
        kept.append(j)
        model = _Model(G, blocks, kept)
        note("enter", j, F, sign, before, model)
    return Path(tuple(kept), model.theta[1:], model.rss, tuple(steps), (), stopped, tss, dof)
