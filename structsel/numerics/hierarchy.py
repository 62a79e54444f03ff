"""Marginality: the terms that a product needs in a model.

Candidates are rows of a table of exponents. The parents of a candidate are the candidates that divide it, with no
other candidate between: of x^2 z these are x z and x^2 where the pool has both, else x and z. A linear term has no
parent; the constant is always in the model. A formula, a spline or an offset channel is one signal: abs(x) is a linear
term without a parent, and the parents of abs(x) x are abs(x) and x.

A model is hierarchical in the strong sense if it has all parents of each of its terms, and so all their parents; in the
weak sense if it has at least one [N77], [BTT13].
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array

NONE = -1


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Parents of the candidates, and how many of them a term needs.

    Attributes
    ----------
    parents : (p, m) int64 array
        Filled with -1; all -1 for a candidate that needs none.
    strong : bool
        All parents; else at least one.
    """

    parents: NDArray[np.int64]
    strong: bool

    def allows(self, model: Iterable[int]) -> bool:
        """Whether a model is hierarchical."""
        inside = {int(j) for j in model}
        return all(self._satisfied(j, inside) for j in inside)

    def needed_by_others(self, model: Sequence[int]) -> list[int]:
        """Terms without which the model would not be hierarchical."""
        return [j for j in model if not self.allows(i for i in model if i != j)]

    def group_of(self, j: int, inside: Sequence[int], preference: Array) -> list[int]:
        """Candidate j after the parents that it lacks; where one suffices, that of the largest preference."""
        have = {int(i) for i in inside}
        if self._satisfied(j, have):
            return [j]
        own = [int(q) for q in self.parents[j] if q >= 0]
        wanted = [q for q in own if q not in have] if self.strong else [max(own, key=lambda q: float(preference[q]))]
        group: list[int] = []
        for q in wanted:
            group += [i for i in self.group_of(q, inside, preference) if i not in group]
        return [*group, j]

    def without(self, exempt: Iterable[int]) -> Hierarchy:
        """The same where some candidates need no parent."""
        parents = self.parents.copy()
        parents[list(exempt)] = NONE
        return replace(self, parents=parents)

    def without_constants(self, C: Array) -> Hierarchy:
        """The same where a candidate that does not vary is no parent; C are centred products."""
        still = np.append(np.diag(C)[: len(self.parents)] <= 0.0, False)
        return replace(self, parents=np.where(still[self.parents], NONE, self.parents)) if still.any() else self

    def of_candidates(self, numbers: NDArray[np.integer]) -> Hierarchy:
        """The same among some of the candidates, in their order."""
        place = np.full(len(self.parents) + 1, NONE, dtype=np.int64)
        place[numbers] = np.arange(numbers.size)
        return replace(self, parents=place[self.parents[numbers]])

    def parents_first(self) -> NDArray[np.int64]:
        """(p,) candidates in an order in which parents come before what needs them."""
        level = np.zeros(len(self.parents), dtype=np.int64)
        for _ in range(len(self.parents)):
            above = np.where(self.parents >= 0, level[self.parents] + 1, 0).max(axis=1, initial=0)
            if (above == level).all():
                break
            level = above
        return np.argsort(level, kind="stable")

    def ancestors(self) -> NDArray[np.bool_]:
        """(p, p) whether the second is a parent of the first, or a parent of a parent, ..."""
        table = np.zeros((len(self.parents), len(self.parents)), dtype=bool)
        for j in self.parents_first().tolist():
            own = self.parents[j][self.parents[j] >= 0]
            table[j, own] = True
            table[j] |= table[own].any(axis=0)
        return table

    def _satisfied(self, j: int, inside: set[int]) -> bool:
        own = [int(q) for q in self.parents[j] if q >= 0]
        return not own or (all if self.strong else any)(q in inside for q in own)


def find_parents(exponents: NDArray[np.integer]) -> NDArray[np.int64]:
    """(p, m) parents of each monomial, as in `Hierarchy`; exponents (p, s)."""
    table = np.asarray(exponents)
    found = []
    for row in table:
        divisors = np.flatnonzero((table <= row).all(axis=1) & (table != row).any(axis=1))
        some = table[divisors]
        below = (some[:, None] <= some[None]).all(axis=2) & (some[:, None] != some[None]).any(axis=2)
        found.append(divisors[~below.any(axis=1)].tolist())
    width = max(map(len, found), default=0)
    return np.array([row + [NONE] * (width - len(row)) for row in found], dtype=np.int64).reshape(len(found), width)
