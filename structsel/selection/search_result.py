"""What a search found, and changes to it: aliases of lower degree, and correlated terms that are dropped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.collinearity import drop_correlated
from structsel.numerics.search_path import SearchStep
from structsel.numerics.stepwise import partial_f
from structsel.selection.aliases import SAME_FIT, find_aliases
from structsel.selection.methods import SearchProblem


@dataclass(frozen=True)
class SearchResult:
    """Terms selected for one response with one noise model.

    Attributes
    ----------
    selected : tuple of int
        Candidates kept, in order of entry.
    rss, tss : float
        In the (scaled, prewhitened) units of the cross-products.
    steps : tuple of SearchStep
    stop_reason : str
    dof : float
        Samples less one.
    effective_dof : float
        The same, of independent samples; fewer where tests took the scatter between blocks.
    """

    selected: tuple[int, ...]
    rss: float
    tss: float
    steps: tuple[SearchStep, ...]
    stop_reason: str
    dof: float
    effective_dof: float

    def numbered(self, numbers: NDArray[np.int64]) -> SearchResult:
        """The same where candidate i is number ``numbers[i]`` of a larger pool."""
        steps = tuple(
            replace(s, index=int(numbers[s.index]), other=int(numbers[s.other]) if s.other >= 0 else s.other)
            for s in self.steps
        )
        return replace(self, selected=tuple(int(numbers[j]) for j in self.selected), steps=steps)


def prefer_lower_degree(result: SearchResult, problem: SearchProblem) -> SearchResult:
    """Of terms between which these data cannot decide, keep the one of lowest degree.

    Exchanges of one term after another raise the residual sum of squares by less than 4 s^2 together.
    """
    C, constraints = problem.products, problem.constraints
    kept, steps = list(result.selected), list(result.steps)
    rss, lost = result.rss, dict.fromkeys(kept, 0.0)
    for _ in kept:
        higher = [j for j in kept if j not in constraints.include and constraints.degrees[j] > 1]
        lower = constraints.degrees < max((constraints.degrees[j] for j in higher), default=0)
        better = [
            a
            for a in find_aliases(C, kept, result.effective_dof, higher, lower)
            if lost[a.kept] + a.loss < SAME_FIT
            and constraints.degrees[a.other] < constraints.degrees[a.kept]
            and constraints.allow(a.other if j == a.kept else j for j in kept)
        ]
        if not better:
            break
        move = min(better, key=lambda a: (constraints.degrees[a.other], a.loss))
        kept[kept.index(move.kept)] = move.other
        lost[move.other] = lost.pop(move.kept) + max(move.loss, 0.0)
        _, F, rss = partial_f(C, result.dof, kept)
        F_new = float(F[kept.index(move.other)])
        steps.append(SearchStep("simplify", move.other, move.kept, F_new, move.correlation, rss, len(kept)))
    return replace(result, selected=tuple(kept), rss=rss, steps=tuple(steps))


def drop_correlated_terms(result: SearchResult, problem: SearchProblem) -> SearchResult:
    """Apply the rule of [H17]: of two kept terms whose parameters correlate above the limit, the weaker goes."""
    limit, C = problem.options.correlation_limit, problem.products
    if limit is None or len(result.selected) < 2:
        return result
    stay, hierarchy = list(problem.constraints.include), problem.constraints.hierarchy
    if hierarchy is not None:
        stay += hierarchy.needed_by_others(result.selected)
    kept, dropped = drop_correlated(C, result.dof, result.selected, limit, include=stay)
    steps = list(result.steps)
    remaining = list(result.selected)
    for drop in dropped:
        _, F, _ = partial_f(C, result.dof, remaining)
        at = remaining.index(drop.index)
        remaining.pop(at)
        _, _, rss = partial_f(C, result.dof, remaining)
        steps.append(SearchStep("leave", drop.index, -1, float(F[at]), drop.correlation, rss, len(remaining)))
    if not dropped:
        return replace(result, selected=kept)
    reason = f"{result.stop_reason}; {len(dropped)} dropped, parameters correlated above {limit:g}"
    return replace(result, selected=kept, rss=steps[-1].rss, steps=tuple(steps), stop_reason=reason)
