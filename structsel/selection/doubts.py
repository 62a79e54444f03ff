"""What a selection says against itself: one sentence each, with the remedy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from structsel.candidates import Candidates
from structsel.selection.engine import Outcome
from structsel.selection.identifiability import Alias
from structsel.selection.search import thresholds
from structsel.selection.settings import SelectOptions

FEW_BLOCKS = 12  # tests by blocks have one degree of freedom less than these
SEVERAL = 3  # names spelled out before "and n more"


def listed(names: Sequence[str]) -> str:
    """A few names, and how many more there are."""
    shown = ", ".join(names[:SEVERAL])
    return shown if len(names) <= SEVERAL else f"{shown} and {len(names) - SEVERAL} more"


def find_doubts(
    outcome: Outcome,
    candidates: Candidates,
    options: SelectOptions,
    aliases: Sequence[Alias],
) -> tuple[str, ...]:
    """Everything about a result that should make its reader hesitate."""
    found, p = outcome.found, len(candidates)
    names = candidates.names
    kept = [names[i] for i in found.selected]
    doubts = []

    if outcome.n <= p:
        doubts.append(f"{outcome.n} samples for {p} candidates: many models fit equally well. Record longer.")
    if not outcome.settled:
        doubts.append("Structure and residual colour did not settle in four rounds; the last one is shown.")
    if outcome.whitening_refused is not None:
        a, b = (np.sqrt(v) for v in outcome.whitening_refused)
        doubts.append(
            f"Whitening was given up: held-out error {a / b:.2f} times that of plain weighting. The residual is not "
            "only noise; look for late channels, noise in the signals, or dynamics that were left out."
        )
    if outcome.by_blocks and outcome.n_blocks < FEW_BLOCKS:
        doubts.append(
            f"Only {outcome.n_blocks} blocks of samples stand behind the tests, which finds little and that unsurely. "
            "Record longer, or give more recordings."
        )
    if outcome.colours and max(c.order for c in outcome.colours) >= options.max_ar_order > 0:
        doubts.append(
            f"The residual's colour asks for more than AR order {options.max_ar_order}. Raise max_ar_order, or look "
            "for an oscillation that was left out."
        )
    if (
        options.method == "stepwise"
        and options.criterion_used is None
        and options.stopping_rule == "F"
        and options.F_in != "fdr"
    ):
        F_in = thresholds(options, p, found.dof)[0]
        chance = (p - len(kept)) * stats.f.sf(F_in, 1, max(found.dof - len(kept), 1.0))
        if chance > 0.5 and not outcome.by_blocks:
            doubts.append(
                f"With F_in = {F_in:.3g} and {p} candidates about {chance:.1f} terms enter by chance alone; "
                "F_in='auto' keeps the chance of any near 5 %."
            )
    doubts += _disagreement(outcome, names, options)
    for alias in aliases[:SEVERAL]:
        doubts.append(f"Cannot be told apart here: {alias}.")
    if len(aliases) > SEVERAL:
        doubts.append(f"{len(aliases) - SEVERAL} more pairs cannot be told apart (see .aliases).")
    still = [names[i] for i in outcome.dependent]
    if still:
        doubts.append(
            f"Constant, or exactly dependent on the kept terms, so never tested: {listed(still)}. "
            "Vary their channels by themselves."
        )
    large = [f"{n} ({v:.0f})" for n, v in zip(kept, outcome.vif) if v > 10]
    if large:
        doubts.append(f"Collinear (VIF above 10): {listed(large)}; their values trade against each other.")
    if outcome.fit.condition > 1e6:
        digits = max(0, int(15 - np.log10(outcome.fit.condition)))
        doubts.append(f"Condition number {outcome.fit.condition:.1g}: about {digits} digits of the values are sure.")
    if outcome.bootstrap is not None:
        unsure = [
            f"{names[i]} ({outcome.bootstrap.inclusion[i]:.0%})"
            for i in found.selected
            if outcome.bootstrap.inclusion[i] < 0.5
        ]
        if unsure:
            doubts.append(f"Kept in under half of the resampled selections: {listed(unsure)}.")
    held = outcome.held_out
    if held is None:
        doubts.append("Nothing could be held out; R2 is of the samples fitted.")
    elif held.within:
        doubts.append("One manoeuvre only: held-out parts come from the same flight, which flatters.")
    if held is not None and outcome.r2 - held.r2 > 0.1:
        doubts.append(f"R2 falls from {outcome.r2:.2f} to {held.r2:.2f} on data not used for selecting.")
    return tuple(doubts)


def _disagreement(outcome: Outcome, names: Sequence[str], options: SelectOptions) -> list[str]:
    """Where the white-noise rule and the one in force keep different terms."""
    now, classical = set(outcome.found.selected), set(outcome.classical.selected)
    if options.noise == "white" or now == classical:
        return []
    more = [names[i] for i in outcome.classical.selected if i not in now]
    fewer = [names[i] for i in outcome.found.selected if i not in classical]
    parts = []
    if more:
        parts.append(f"would also keep {listed(more)}")
    if fewer:
        parts.append(f"would not keep {listed(fewer)}")
    return [f"Taking residuals as white, the sources' rule {' and '.join(parts)}."]
