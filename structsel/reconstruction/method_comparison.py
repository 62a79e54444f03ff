"""Comparison of the methods: constants that another method estimates otherwise, by more than the errors of both.

The extended filter has the same noise and another linearisation. Output error has no noise of the inertial readings and
no turbulence. Where these assumptions matter, the constants differ, and no method's standard deviation is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from structsel.numerics import kinematics as fp
from structsel.reconstruction.data_compatibility import check_data_compatibility
from structsel.reconstruction.noise_levels import most_active_interval
from structsel.reconstruction.result import Constant
from structsel.reconstruction.ukf import FilterResult, KinematicsProblem, ukf_smoother

_FALSE_ALARMS = 0.05  # fraction of recordings without a contradiction in which one of the constants is named


@dataclass(frozen=True)
class _Estimate:
    """Constant of another method."""

    method: str
    name: str
    value: float
    std: float


def compare_methods(
    problem: KinematicsProblem, method: str, run: FilterResult, constants: Iterable[Constant]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Warnings, and contradictions between the methods; each is a sentence.

    Parameters
    ----------
    problem : KinematicsProblem
        With its noise.
    method : {"unscented", "extended", "output-error"}
        That of the constants. Output error does not estimate the noise that a filter needs, so nothing is compared.
    run : FilterResult
        Readings that it rejected are not used.
    constants : iterable of Constant
    """
    # A constant that drifts has no single value.
    mine = {c.name: c for c in constants if not problem.drift[fp.STATES.index(c.name)]}
    if method == "output-error" or not mine:
        return (), ()
    used = replace(problem, measurements=np.where(run.rejected, np.nan, problem.measurements))
    others = _by_filter(used, "extended" if method == "unscented" else "unscented", mine)
    interpolated = bool(np.any(problem.input_std != problem.input_std[0]))
    fitted = [] if interpolated else _by_output_error(used, mine)
    why = "has no error of interpolated readings" if interpolated else "did not converge"
    warnings = () if fitted else (f"output error {why}, so its constants are not compared with these",)
    return warnings, _contradictions(method, mine, [*others, *fitted])


def _by_filter(problem: KinematicsProblem, method: str, mine: Mapping[str, Constant]) -> list[_Estimate]:
    """Constants of the other filter; the noise is the same, and so are the standard deviations."""
    _, smooth = ukf_smoother(problem, spread=0.0 if method == "extended" else 1.0)
    if smooth is None:
        return []
    found = problem.path(smooth.x[-1:])[0]
    return [_Estimate(method, name, float(found[fp.STATES.index(name)]), c.std) for name, c in mine.items()]


def _by_output_error(problem: KinematicsProblem, mine: Mapping[str, Constant]) -> list[_Estimate]:
    """Constants of output error on the part of the recording with the largest rates; none if it does not converge."""
    part = most_active_interval(problem.with_states(problem.active < fp.GUST))
    fit = check_data_compatibility(part)
    if not fit.converged:
        return []
    names = [fp.STATES[i] for i in part.active]
    return [
        _Estimate("output error", name, float(value), float(std))
        for name, value, std in zip(names, fit.values, fit.std)
        if name in mine
    ]


def _contradictions(method: str, mine: Mapping[str, Constant], others: list[_Estimate]) -> tuple[str, ...]:
    """One sentence for each method with a constant that differs by more than the standard deviations of both allow."""
    limit = norm.isf(_FALSE_ALARMS / (2 * max(len(others), 1)))
    found: dict[str, list[str]] = {}
    for other in others:
        own = mine[other.name]
        if abs(other.value - own.value) > limit * np.hypot(other.std, own.std):
            text = f"{other.name} = {other.value:+.3g} +- {other.std:.2g} ({own.value:+.3g} +- {own.std:.2g})"
            found.setdefault(other.method, []).append(text)
    return tuple(f"{name} contradicts {method}: {', '.join(texts)}" for name, texts in found.items())
