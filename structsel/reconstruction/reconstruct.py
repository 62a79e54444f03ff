"""`reconstruct`: a flight path that is consistent with all instruments, and the errors of the instruments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ReconstructionError
from structsel.nomenclature import unit_of
from structsel.numerics import kinematics as fp
from structsel.options import takes_options
from structsel.reconstruction.data_compatibility import check_data_compatibility
from structsel.reconstruction.delays import LONGEST_DELAY, Delay, find_delays
from structsel.reconstruction.filter_fit import PathFit, fit_by_filter
from structsel.reconstruction.method_comparison import compare_methods
from structsel.reconstruction.noise_levels import drop_confounded_scales, estimate_noise_levels
from structsel.reconstruction.observability import Reconstructibility, reconstructibility
from structsel.reconstruction.output import output_recording
from structsel.reconstruction.problem import ReconstructionProblem, build_problem
from structsel.reconstruction.quality_checks import check_quality, noise_above_limit, unconfirmed
from structsel.reconstruction.result import CONSTANTS, Constant, NoiseLevel, Reconstruction
from structsel.reconstruction.scale_factors import add_scale_errors
from structsel.reconstruction.settings import INERTIAL, ReconstructOptions
from structsel.reconstruction.sign_and_unit_checks import reject_wrong_sign_or_unit
from structsel.reconstruction.ukf import FilterResult, SmootherResult
from structsel.recording import Recording
from structsel.recording.arguments import as_one_recording, require_kind

if TYPE_CHECKING:
    import pandas as pd

_ALIGNMENTS = 6  # rounds of estimating and removing delays; chosen, not critical
_ALIGNED = 0.002  # s of delay left at which they end; chosen, not critical
_HEADING_SECONDS = 60.0  # of flight from which the first heading is estimated

Progress = Callable[[str, int, int], None]


@takes_options(ReconstructOptions)
def reconstruct(
    recording: Recording | pd.DataFrame,
    aircraft: Aircraft,
    *,
    options: ReconstructOptions,
    progress: Progress | None = None,
) -> Reconstruction:
    """Flight path, sensor biases, upwash and wind of one manoeuvre.

    Accelerometers and gyros, minus constant (or slowly drifting) biases, are the inputs of the kinematics of velocity,
    attitude and position. The recorded air data, attitude, altitude, position and ground velocity are its measurements.
    States that these data cannot determine are found first, and fixed.

    Parameters
    ----------
    recording : Recording or DataFrame
        ``V``, ``ax``, ``az``, ``q`` and, for the lateral motion, ``ay``, ``p``, ``r``; any of ``alpha beta phi
        theta psi h x y vn ve vd``. Measurements may be missing or have a lower rate (NaN, or repeated values).
        For a DataFrame see `Recording.from_frame`.
    aircraft : Aircraft
        Positions and noise of the instruments.
    options : ReconstructOptions, optional
        Each field can also be given as a keyword: ``reconstruct(..., method="extended", gusts=0.0)``.
    progress : callable, optional
        Called with the name of the stage, the steps done and all steps.

    Returns
    -------
    Reconstruction

    Raises
    ------
    ArgumentError
        The recording or the aircraft is an object of another type.
    ChannelError
        A necessary channel is missing.
    DataError
        A gap in time; an inertial channel missing or stuck for too long; a wrong sign or unit.
    DomainError
        An option out of range.
    ReconstructionError
        The filter fails (readings that contradict one another); the exception has the partial result.

    References
    ----------
    [M86] and [H17] for the problem and the filter; [K79] for the check by output error; [KM16] ch. 10.
    """
    call = "reconstruct(recording, aircraft)"
    recording = as_one_recording(recording, call, "reconstruct_all(recordings, aircraft)")
    require_kind(aircraft, Aircraft, call)
    applied = {} if isinstance(options.delays, str) else {name: float(value) for name, value in options.delays.items()}
    if options.delays != "estimate":
        return _reconstruct_aligned(recording, aircraft, options, applied, progress)
    for i in range(_ALIGNMENTS):
        if progress is not None:
            progress("aligning", i, _ALIGNMENTS)
        found = _reconstruct_aligned(recording, aircraft, options, applied, None)
        more = {d.channel: d.delay for d in found.delays if d.significant or d.channel in applied}
        if all(abs(value) < _ALIGNED for value in more.values()):
            break
        applied = {
            name: float(np.clip(applied.get(name, 0.0) + more.get(name, 0.0), -LONGEST_DELAY, LONGEST_DELAY))
            for name in {**applied, **more}
        }
    if progress is not None:
        progress("aligning", _ALIGNMENTS, _ALIGNMENTS)
    return found


def _reconstruct_aligned(
    recording: Recording,
    aircraft: Aircraft,
    options: ReconstructOptions,
    delays: Mapping[str, float],
    progress: Progress | None,
) -> Reconstruction:
    """Reconstruction of a recording whose channels are first advanced by these delays."""
    from threadpoolctl import threadpool_limits

    aligned = recording.align(delays) if delays else recording
    # The matrices are small: more threads would be slower.
    with threadpool_limits(1, user_api="blas"):
        return _reconstruct(aligned, aircraft, options, progress)


def _reconstruct(
    recording: Recording, aircraft: Aircraft, options: ReconstructOptions, progress: Progress | None
) -> Reconstruction:
    problem_setup = build_problem(recording, aircraft, options)
    reject_wrong_sign_or_unit(recording, problem_setup.problem, problem_setup.lateral)
    problem_setup, verdict, fixed = _with_determined_states(problem_setup)
    turbulent: frozenset[str] = frozenset()
    if options.method == "output-error":
        problem_setup = add_scale_errors(problem_setup, problem_setup, options)
        problem_setup, fit, std = _by_output_error(problem_setup, recording)
        best, consistency = fit, fit.consistency(problem_setup, recording.dt)
    else:
        problem_setup, headless = _with_initial_heading(problem_setup)
        lowest = problem_setup.problem.measurement_std
        with_noise = estimate_noise_levels(problem_setup, options.gusts, progress)
        problem_setup, confused, turbulent = drop_confounded_scales(
            add_scale_errors(problem_setup, with_noise, options)
        )
        fixed |= headless | confused
        fit, best, std, consistency = fit_by_filter(problem_setup, lowest, recording, options)
    run, smooth, std_white = fit.run, best.smooth, fit.smooth.std
    delays = _delays(problem_setup, best, turbulent)
    constants = tuple(
        Constant(name, float(smooth.x[-1, j]), float(std[-1, j]), float(std_white[-1, j]), CONSTANTS[name][1])
        for j, name in enumerate(problem_setup.names)
        if name in CONSTANTS
    )
    made, stds = output_recording(recording, problem_setup, best.path, smooth, std, options.method, constants)
    warnings, distrust = check_quality(
        problem_setup, best.path, consistency, constants, verdict, delays, stds, std_white, std
    )
    above = noise_above_limit(problem_setup)
    unknown, contradictions = compare_methods(best.problem, options.method, best.run, constants, turbulent)
    return Reconstruction(
        name=recording.name,
        method=options.method,
        recording=made,
        states=problem_setup.names,
        constants=constants,
        std=stds,
        estimates=smooth.x,
        filtered=best.run.x,
        filtered_std=best.run.std,
        covariance=smooth.covariance,
        covariance_at=smooth.at,
        innovations=_by_channel(run.innovations, problem_setup.measured),
        innovation_std=_by_channel(run.innovation_std, problem_setup.measured),
        residuals=_by_channel(best.residuals, problem_setup.measured),
        readings=_by_channel(best.predicted, problem_setup.measured),
        noise=tuple(
            NoiseLevel(name, level, unit_of(name), "given" if name in problem_setup.given else "estimated")
            for name, level in problem_setup.noise.items()
        ),
        turning_std=dict(zip(INERTIAL[3:], map(float, problem_setup.turning_std))),
        gust=tuple(problem_setup.gust.std.tolist()),
        gust_time=problem_setup.gust.time,
        consistency=consistency,
        reconstructibility=verdict,
        fixed=fixed,
        delays=delays,
        log_likelihood=run.log_likelihood,
        findings=problem_setup.findings,
        doubts=(*warnings, *unknown),
        distrust=(*distrust, *contradictions, *unconfirmed(consistency), *above),
    )


def _with_determined_states(
    problem_setup: ReconstructionProblem,
) -> tuple[ReconstructionProblem, Reconstructibility, dict[str, str]]:
    """Problem of the states that the data determine, the analysis, and the reasons why others are fixed."""
    verdict, wind = reconstructibility(problem_setup.problem), {}
    without = problem_setup.without_ground_track(psi=True)
    if {"wn", "we"} & set(verdict.fixed) and without is not problem_setup:
        # Without the wind, a ground velocity is no measurement of the motion through the air.
        wind = {name: why for name, why in verdict.fixed.items() if name in ("wn", "we")}
        problem_setup, verdict = without, reconstructibility(without.problem)
    return problem_setup.with_verdict(verdict), verdict, wind | dict(verdict.fixed)


def _with_initial_heading(problem_setup: ReconstructionProblem) -> tuple[ReconstructionProblem, dict[str, str]]:
    """Problem that starts with the heading and wind of a batch fit, where no instrument gives the heading.

    With a ground track only, the uncertainty of the heading due to wind is too large for the linearisation of a filter.
    If the fit does not converge either, the ground track is not used, and the reasons are returned.
    """
    if "psi" in problem_setup.measured or not {"psi", "wn", "we"} <= set(problem_setup.names):
        return problem_setup, {}
    problem = problem_setup.problem
    early = int(np.searchsorted(problem.t, problem.t[0] + _HEADING_SECONDS)) + 1
    fit = check_data_compatibility(problem.rows(0, early))
    if not fit.converged:
        reason = "no heading was measured, and the ground track does not determine it here; record psi, or turn"
        return problem_setup.without_ground_track(), dict.fromkeys(("psi", "x", "y", "wn", "we"), reason)
    start, std = problem.start.copy(), problem.start_std.copy()
    for name, spread in (("psi", 0.1), ("wn", 2.0), ("we", 2.0)):
        j = problem_setup.names.index(name)
        start[problem.active[j]] = fit.values[j]
        # The fit uses the same readings as the filter: its standard deviations are too small for a prior.
        std[j] = max(spread, 3.0 * float(fit.std[j]))
    return replace(problem_setup, problem=replace(problem, start=start, start_std=std)), {}


def _by_output_error(
    problem_setup: ReconstructionProblem, recording: Recording
) -> tuple[ReconstructionProblem, PathFit, np.ndarray]:
    """Batch estimate in the form of a filter run, its residuals as innovations; and the std for coloured residuals."""
    problem = problem_setup.problem
    fit = check_data_compatibility(problem)
    if not fit.converged:
        raise ReconstructionError(
            f"reconstruct by output error did not converge on '{recording.name}': {fit.message}.",
            fit,
            remedy="The exception has the last estimate in .partial; method='unscented' includes input noise.",
            cli_remedy="--method unscented includes input noise.",
        )
    n, x = len(problem.t), np.ascontiguousarray(fit.path[:, problem.active])
    seen = np.isfinite(fit.residuals)
    std = np.where(seen, fit.measurement_std, np.nan)
    nis = np.where(seen.any(axis=1), np.nansum((fit.residuals / std) ** 2, axis=1), np.nan)
    white, wide = (np.tile(np.sqrt(np.diag(P)), (n, 1)) for P in (fit.crlb, fit.covariance))
    none = np.zeros(seen.shape, dtype=bool)
    run = FilterResult(x, white, fit.residuals, std, nis, seen.sum(axis=1), none, -float(fit.costs[-1]), -1, "")
    level = problem_setup.noise | {
        name: float(fit.measurement_std[fp.MEASUREMENTS.index(name)]) for name in problem_setup.measured
    }
    # The inertial readings are assumed exact, and the noise of the others is always estimated.
    level = {name: std for name, std in level.items() if name in problem_setup.measured}
    found = replace(problem_setup, noise=level, given=frozenset())
    # The covariance is that of the motion at the first sample and of the constants; it is used for all samples.
    smooth = SmootherResult(x, white, fit.covariance[None], np.array([0]))
    return found, PathFit.of(problem, run, smooth), wide


def _delays(problem_setup: ReconstructionProblem, fit: PathFit, turbulent: frozenset[str]) -> tuple[Delay, ...]:
    """Delays of the channels against the path without gusts, which would conceal them."""
    problem, predicted, residuals = problem_setup.problem, fit.predicted, fit.residuals
    channels = tuple(name for name in problem_setup.measured if name not in turbulent)
    if np.any(problem_setup.gust.std):
        calm = fit.path.copy()
        calm[:, fp.GUST :] = 0.0
        predicted = problem.predict(calm)
        residuals = problem.residuals(predicted)
    return find_delays(problem, predicted, residuals, channels)


def _by_channel(values: np.ndarray, measured: tuple[str, ...]) -> dict[str, np.ndarray]:
    return {name: values[:, fp.MEASUREMENTS.index(name)].copy() for name in measured}
