"""A second look where kept terms are nearly dependent: products without rounding, and the search again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from structsel.numerics.arrays import Array
from structsel.selection.search import Found, centred
from structsel.selection.way import Way

NEAR = 1e-6  # Schur complement below which ordinary products leave less than nine digits of a partial F
ROUNDS = 3  # of searches with ever more exact products


def look_again(way: Way, found: Found, exact: Callable[[Sequence[int]], Array]) -> tuple[Way, Found]:
    """Search exact products of the kept terms, if they nearly depend on each other; else what is there already.

    Parameters
    ----------
    way : Way
    found : Found
        By this way.
    exact : callable of candidates
        Their centred products and the response's without rounding; see `structsel.numerics.exact.exact_centred`.
    """
    seen: set[int] = set()
    for _ in range(ROUNDS):
        kept = set(found.selected)
        if kept <= seen or smallest_schur(centred(way.moments.total()), sorted(kept)) > NEAR:
            break
        seen |= kept
        candidates = sorted(seen)
        way = replace(way, exact=(candidates, exact(candidates)))
        found = way.find()
    return way, found


def smallest_schur(C: Array, kept: Sequence[int]) -> float:
    """The least share of a kept term's variance that the other kept ones leave."""
    if len(kept) < 2:
        return 1.0
    A = C[np.ix_(kept, kept)]
    root = np.sqrt(np.diag(A))
    return float(1.0 / np.diag(np.linalg.pinv(A / np.outer(root, root), hermitian=True)).max())
