"""Contributions of effects and tolerances to the differences over time, and the residual of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.locating.turbulence import coloured_fractions
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.effects.base import Variant
from structsel.numerics.arrays import Array


def contribution(flight: Flight, variant: Variant, theta: Array) -> dict[str, Array]:
    """Contribution of a variant to the differences of one flight, parameters in their units."""
    return {c: (x if x.ndim == 2 else x[:, None]) @ theta for c, x in variant.columns(flight).items()}


def contributions(problem: DiagnosisProblem, places: Sequence[int]) -> list[dict[str, Array]]:
    """Contributions of some effects in the model to the differences, per flight."""
    made: list[dict[str, Array]] = []
    for f in problem.flights:
        total: dict[str, Array] = {}
        for k in places:
            variant = problem.accepted[k].variant
            theta = problem.base.posterior.mean[problem.place(k)] * np.array([p.sd for p in variant.parameters])
            for c, x in contribution(f, variant, theta).items():
                total[c] = total.get(c, 0.0) + x
        made.append({c: np.asarray(x) for c, x in total.items() if c in problem.responses})
    return made


def residuals(problem: DiagnosisProblem) -> list[dict[str, Array]]:
    """Residual of tolerances and effects, per flight and response, at all frequencies."""
    moved = moved_by_tolerances(problem)
    effects = contributions(problem, range(len(problem.accepted)))
    return [
        {c: x - m.get(c, 0.0) - e.get(c, 0.0) for c, x in f.difference.items()}
        for f, m, e in zip(problem.flights, moved, effects)
    ]


def white_fraction(problem: DiagnosisProblem) -> float | None:
    """Fraction of white noise in the residual of the forces, the smallest of them; None without forces.

    The white noise of the instruments causes no motion; any other residual may have caused it.
    """
    coloured = coloured_fractions(problem.flights, residuals(problem))
    return 1.0 - max(coloured.values()) if coloured else None


def moved_by_tolerances(problem: DiagnosisProblem) -> list[dict[str, Array]]:
    """Contribution of the estimated deviations from the stated values to the differences."""
    deviations, _ = problem.deviations
    made = []
    for i, f in enumerate(problem.flights):
        total = {c: np.zeros(len(f)) for c in f.difference}
        for n, x in zip(problem.nuisances, deviations):
            for c, column in n.columns[i].items():
                if c in total:
                    total[c] = total[c] + x * n.sd * column
        made.append(total)
    return made
