"""Comparison of the methods: constants that another method estimates otherwise, by more than the errors of both.

The extended filter has the same noise and another linearisation. Output error has no noise of the inertial readings and
no turbulence; its standard deviations get the effect of that noise here. Where the assumptions matter beyond that, the
constants differ, and no method's standard deviation is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from structsel.numerics import kinematics as fp
from structsel.reconstruction.data_compatibility import check_data_compatibility, fit_attitude_scales, simulate_outputs
from structsel.reconstruction.input_noise import input_noise_variance
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.noise_levels import most_active_interval
from structsel.reconstruction.result import Constant
from structsel.reconstruction.ukf import FilterResult, ukf_filter

_FALSE_ALARMS = 0.05  # fraction of recordings without a contradiction in which one of the constants is named
_SCALE_FALSE_ALARMS = 0.01  # the same for the angles: small errors of the standard deviations are more frequent there


@dataclass(frozen=True)
class _Estimate:
    """Constant of another method."""

    method: str
    name: str
    value: float
    std: float


def compare_methods(
    problem: KinematicsProblem,
    method: str,
    run: FilterResult,
    constants: Iterable[Constant],
    turbulent: frozenset[str] = frozenset(),
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
    turbulent : frozenset of str
        Channels that measure mostly turbulence.
    """
    # A constant that drifts has no single value.
    mine = {c.name: c for c in constants if not problem.drift[fp.STATES.index(c.name)]}
    if method == "output-error" or not mine:
        return (), ()
    used = replace(problem, measurements=np.where(run.rejected, np.nan, problem.measurements))
    others = _by_filter(used, "extended" if method == "unscented" else "unscented", mine)
    why = _why_without_output_error(problem)
    fitted, scales = ([], ()) if why else _by_output_error(used, mine)
    if turbulent and not why:  # the angles are compared with the rates, whatever the air does
        fitted, why = [], f"has no turbulence, which is most of the variance of {', '.join(sorted(turbulent))}"
    why = why or "did not converge"
    warnings = () if fitted else (f"output error {why}, so its constants are not compared with these",)
    return warnings, (*_contradictions(method, mine, [*others, *fitted]), *scales)


def _why_without_output_error(problem: KinematicsProblem) -> str:
    """What the recording has and output error has not; empty if there is nothing."""
    if np.any(problem.input_std != problem.input_std[0]):
        return "has no error of interpolated readings"
    instruments = [i for i in problem.active if i < fp.GUST and fp.STATES[i] not in ("wn", "we", "wd")]
    if np.any(problem.drift[instruments] > 0.0):
        return "has no drift of the instruments"
    return ""


def _by_filter(problem: KinematicsProblem, method: str, mine: Mapping[str, Constant]) -> list[_Estimate]:
    """Constants of the other filter on the part with the largest rates, their errors coloured as those of the first."""
    part = most_active_interval(problem)
    run = ukf_filter(part, spread=0.0 if method == "extended" else 1.0)
    if run.failed >= 0:
        return []
    found, std = part.path(run.x[-1:])[0], dict(zip((fp.STATES[i] for i in part.active), run.std[-1]))
    return [_Estimate(method, name, float(found[fp.STATES.index(name)]), float(std[name])) for name in mine]


def _by_output_error(
    problem: KinematicsProblem, mine: Mapping[str, Constant]
) -> tuple[list[_Estimate], tuple[str, ...]]:
    """Constants of output error on the part with the largest rates, none if it does not converge; and scale errors."""
    part = most_active_interval(problem.with_states(problem.active < fp.GUST))
    near = part.start.copy()
    for name, constant in mine.items():
        near[fp.STATES.index(name)] = constant.value
    fit = check_data_compatibility(part, near=near[part.active])
    if not fit.converged:
        return [], ()
    names = [fp.STATES[i] for i in part.active]
    std = np.sqrt(fit.std**2 + input_noise_variance(part, fit.values, fit.crlb, fit.measurement_std))
    estimates = [
        _Estimate("output error", name, float(value), float(one))
        for name, value, one in zip(names, fit.values, std)
        if name in mine
    ]
    return estimates, _attitude_scales(part, fit.values)


def _attitude_scales(problem: KinematicsProblem, values: np.ndarray) -> tuple[str, ...]:
    """One sentence for each attitude angle with a scale error beyond its standard deviation; no filter has these."""
    found = fit_attitude_scales(problem, values)
    if found is None or not found[0].converged:
        return ()
    fit, angles = found
    L, std = len(values), problem.measurement_std.copy()
    std[np.isfinite(problem.measurements).any(axis=0)] = np.sqrt(np.diag(fit.R))
    variance = input_noise_variance(problem, fit.theta, fit.crlb, std, angles)
    errors = np.sqrt(np.diag(fit.covariance) + variance)[L:]
    angle = simulate_outputs(problem, fit.theta[:L])[:, angles]
    spread = np.sqrt(np.mean((angle - angle[0]) ** 2, axis=0))
    limit = scipy.stats.norm.isf(_SCALE_FALSE_ALARMS / (2 * len(angles)))
    return tuple(
        f"{fp.MEASUREMENTS[c]} has a scale error of {scale:+.1%} +- {one:.1%} by output error, which is not in the "
        "model: it changes the biases, so correct the channel"
        for c, scale, one, size in zip(angles, fit.theta[L:], errors, spread)
        # A scale error whose effect is below the noise of the angle changes no constant.
        if abs(scale) > limit * one and abs(scale) * size > std[c]
    )


def _contradictions(method: str, mine: Mapping[str, Constant], others: list[_Estimate]) -> tuple[str, ...]:
    """One sentence for each method with a constant that differs by more than the standard deviations of both allow."""
    limit = scipy.stats.norm.isf(_FALSE_ALARMS / (2 * max(len(others), 1)))
    found: dict[str, list[str]] = {}
    for other in others:
        own = mine[other.name]
        if abs(other.value - own.value) > limit * np.hypot(other.std, own.std):
            text = f"{other.name} = {other.value:+.3g} +- {other.std:.2g} ({own.value:+.3g} +- {own.std:.2g})"
            found.setdefault(other.method, []).append(text)
    return tuple(f"{name} contradicts {method}: {', '.join(texts)}" for name, texts in found.items())
