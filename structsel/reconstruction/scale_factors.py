"""Scale errors of attitude, gyros and accelerometers: which ones a recording determines and supports.

A scale error is estimated if the data determine it, and if it predicts the readings better. The log-likelihood of the
innovations is the sum of the log-densities with which each reading is predicted from the readings before it. If a
constant K with the prior N(0, s_0^2) is a state, this sum is the marginal likelihood, and its gain over K = 0 is [KR95]

    log B = m^2 / (2 s^2) - log(s_0 / s)

with the estimate m +- s from all readings. The last term is the penalty for the additional constant. Of n scale errors
that the data determine, one is expected: prior odds of 1 / n for each. A scale error is kept if its odds exceed one.

The search starts with all that are determined: the noise that is estimated without a scale error can conceal it. The
filter is the extended one, as in the search for noise levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from structsel.numerics import kinematics as fp
from structsel.reconstruction.data_compatibility import check_data_compatibility
from structsel.reconstruction.innovations import check_innovations, widened_noise
from structsel.reconstruction.input_noise import input_noise_variance
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.noise_levels import most_active_interval, refit_noise_levels
from structsel.reconstruction.observability import FIX_FIRST, reconstructibility
from structsel.reconstruction.problem import ReconstructionProblem
from structsel.reconstruction.settings import PRIOR, SCALES, ReconstructOptions
from structsel.reconstruction.turbulence_level import with_gusts
from structsel.reconstruction.ukf import negative_log_likelihood, ukf_filter, ukf_smoother

_DETERMINED = 1.0 / 3.0  # posterior over prior standard deviation, as of a state that is not "weak"
_CHANNEL = {name: name.removeprefix("K") for name in SCALES}


def add_scale_errors(
    problem_setup: ReconstructionProblem, with_noise: ReconstructionProblem, options: ReconstructOptions
) -> ReconstructionProblem:
    """Problem with the scale errors that these data determine and support; `with_noise` if there is none.

    Parameters
    ----------
    problem_setup : ReconstructionProblem
        With the noise of each channel's own spectrum.
    with_noise : ReconstructionProblem
        The same with the estimated noise and turbulence. Output error has neither.
    options : ReconstructOptions
    """
    candidates = _determined(problem_setup, options)
    count = len(candidates)
    while candidates:
        tried = _with_constants(problem_setup, candidates, options)
        if options.method != "output-error":
            tried = _with_noise(tried, with_noise)
        kept = _supported(tried, candidates, count, options)
        if kept == candidates:
            return tried if _predicts_better(tried, with_noise, len(kept) * np.log(count), options) else with_noise
        candidates = kept
    return with_noise


def _with_noise(tried: ReconstructionProblem, found: ReconstructionProblem) -> ReconstructionProblem:
    """The more likely of two noises: estimated with these states, or that of the model without scale errors."""
    p, q = tried.problem, found.problem
    same = replace(p, input_std=q.input_std, measurement_std=q.measurement_std)
    same = with_gusts(same, found.gust, tried.lateral)
    fitted = refit_noise_levels(tried, found)
    kept = replace(tried, problem=same, noise=found.noise, gust=found.gust)
    return max(fitted, kept, key=_log_likelihood)


def _log_likelihood(problem_setup: ReconstructionProblem) -> float:
    """Of the part with the largest rates."""
    return -negative_log_likelihood(most_active_interval(problem_setup.problem))


def _predicts_better(
    tried: ReconstructionProblem, without: ReconstructionProblem, penalty: float, options: ReconstructOptions
) -> bool:
    """Whether all scale errors together predict the readings better, each model with its own noise."""
    # Output error estimates the noise from its residuals.
    return options.method == "output-error" or _log_likelihood(tried) - _log_likelihood(without) > penalty


def _determined(problem_setup: ReconstructionProblem, options: ReconstructOptions) -> tuple[str, ...]:
    """Scale errors that the part with the largest rates determines, next to the states that are estimated already."""
    possible = [name for name in SCALES if name not in problem_setup.names and _CHANNEL[name] in problem_setup.noise]
    part = most_active_interval(problem_setup.problem)
    if not possible or options.scales != "auto" or options.estimate is not None:
        return ()
    verdict = reconstructibility(_with_constants(replace(problem_setup, problem=part), possible, options).problem)
    return tuple(name for name in possible if verdict.active_over_prior.get(name, 1.0) < _DETERMINED)


def _with_constants(
    problem_setup: ReconstructionProblem, names: Sequence[str], options: ReconstructOptions
) -> ReconstructionProblem:
    """Problem with further constants."""
    p, prior = problem_setup.problem, options.prior or {}
    active = np.concatenate([p.active, [fp.STATES.index(name) for name in names]]).astype(p.active.dtype)
    std = np.concatenate([p.start_std, [prior.get(name, PRIOR[name]) for name in names]])
    order = np.argsort(active)
    return replace(problem_setup, problem=replace(p, active=active[order], start_std=std[order]))


def _supported(
    problem_setup: ReconstructionProblem, candidates: tuple[str, ...], count: int, options: ReconstructOptions
) -> tuple[str, ...]:
    """Scale errors that are determined, and whose odds exceed one, when the others are estimated.

    They are removed singly: first those that this noise does not determine, in the order of `FIX_FIRST`, then the least
    probable.
    """
    part, kept = most_active_interval(problem_setup.problem), list(candidates)
    while kept:
        found = _posterior(replace(problem_setup, problem=part), options)
        if found is None:
            return ()
        odds, undetermined = {}, []
        for name in kept:
            (at,) = np.flatnonzero(part.active == fp.STATES.index(name))
            value, std, prior = found[0][at], found[1][at], part.start_std[at]
            odds[name] = _log_bayes_factor(value, std, prior) - np.log(count)
            if std > _DETERMINED * prior:
                undetermined.append(name)
        worst = min(undetermined, key=FIX_FIRST.index) if undetermined else min(kept, key=lambda name: odds[name])
        if not undetermined and odds[worst] > 0.0:
            break
        kept.remove(worst)
        part = part.with_states(part.active != fp.STATES.index(worst))
    return tuple(kept)


def _log_bayes_factor(value: float, std: float, prior: float) -> float:
    """Of a constant with a normal prior about zero over the value zero, from its posterior [KR95]."""
    return float(0.5 * (value / std) ** 2 - np.log(prior / std))


def _posterior(
    problem_setup: ReconstructionProblem, options: ReconstructOptions
) -> tuple[np.ndarray, np.ndarray] | None:
    """Estimates of the active states after all readings and their standard deviations, residuals coloured."""
    problem = problem_setup.problem
    if options.method == "output-error":
        return _posterior_of_output_error(problem.with_states(problem.active < fp.GUST))
    run, smooth = ukf_smoother(problem, spread=0.0, gate=options.gate)
    if smooth is None:
        return None
    residuals = problem.residuals(problem.predict(problem.path(smooth.x)))
    dt = float(np.median(np.diff(problem.t)))
    consistency = check_innovations(run, residuals, problem_setup.measured, dt, problem_setup.given)
    std = widened_noise(problem.measurement_std, consistency)
    if std is not None:
        run = ukf_filter(replace(problem, measurement_std=std), spread=0.0, gate=options.gate)
    return None if run.failed >= 0 else (run.x[-1], run.std[-1])


def _posterior_of_output_error(problem: KinematicsProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """The same by output error, with the effect of the noise of the inertial readings."""
    fit = check_data_compatibility(problem)
    if not fit.converged:
        return None
    noise = input_noise_variance(problem, fit.values, fit.crlb, fit.measurement_std)
    return fit.values, np.sqrt(fit.std**2 + noise)
