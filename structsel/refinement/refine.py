"""refine(): output error and filter error over complete recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ArgumentError, ModelError, RefinementError
from structsel.model import AeroModel
from structsel.numerics.global_search import GlobalSearch, search_globally
from structsel.numerics.output_error import OutputErrorFit, fit_output_error
from structsel.numerics.output_error_problem import Constraint, OutputErrorProblem
from structsel.numerics.score_covariance import score_covariance, spectral_score_covariance
from structsel.options import takes_options
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings, require_kind
from structsel.refinement.estimate_checks import check_estimates
from structsel.refinement.filter_error import FilterErrorProblem, iterate_noise
from structsel.refinement.frequency import FrequencyProblem, check_frequency
from structsel.refinement.held_out import HeldOutComparison, check_held_out, compare_on_held_out
from structsel.refinement.linear_flight import LinearFlight
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.nonlinear_flight import NonlinearFlight
from structsel.refinement.parameters import bound, build_parameters, check_delay, check_recordings, choose_outputs
from structsel.refinement.problem import EstimationProblem
from structsel.refinement.protocols import RefinableModel
from structsel.refinement.result import Estimate, Refinement, state_verdict
from structsel.refinement.settings import RefineOptions, StabilityConstraint
from structsel.simulation.linear import LinearModel

_SEARCH_RANGE = 4.0  # times its start, either sign: of a parameter without bounds in the global search
_CONSTANTS = {"drift": "drifts", "bias": "biases", "reference": "references"}


@takes_options(RefineOptions)
def refine(
    model: LinearStructure | LinearModel | AeroModel,
    aircraft: Aircraft | None,
    recordings: Recording | Sequence[Recording],
    *,
    options: RefineOptions,
    held_out: Sequence[Recording] = (),
    progress: Callable[[str, int, float], None] | None = None,
) -> Refinement:
    """Estimate a model's parameters so that the simulated outputs come nearest the recorded ones.

    A search that converged has found the best fit to these recordings, which may predict others worse. Recordings that
    are held out decide: the refined and the original model are simulated on them, and the verdict is "better", "no
    better" or "worse". Where it is worse, the result's `model` is the original one.

    Parameters
    ----------
    model : LinearStructure, LinearModel or AeroModel
        Its values are the start of the search.
    aircraft : Aircraft or None
        None with a linear model.
    recordings : Recording or sequence of Recording
        Even clocks, inputs finite throughout; outputs may have gaps of NaN. Names must differ.
    options : RefineOptions, optional
        Every field may be given as a keyword of its own instead: ``refine(..., free=["Cm:alpha"], starts="all")``.
    held_out : sequence of Recording
        Recordings that are not used for the estimates.
    progress : callable, optional
        Called with "evolution" or "descent", the count and the cost.

    Returns
    -------
    Refinement
        Where the search did not converge, `converged` is False, and what it holds is the best found.

    Raises
    ------
    ArgumentError
        The model, the aircraft or the recordings are objects of another type.
    ModelError
        A name that is not the model's, bounds that cross.
    DataError
        Recordings that cannot be simulated: uneven clock, inputs missing, shorter than the delay. A held-out recording
        that is also refined with, or has none of the outputs.
    RefinementError
        The simulation diverges with the start values, or the recordings do not determine a parameter; ``partial`` has
        the Refinement.

    References
    ----------
    [KM16], [A10], [J15].
    """
    flights = as_recordings(recordings, "refine(model, aircraft, recordings)")
    if options.domain == "frequency" and options.noise == "process":
        raise ModelError("refine predicts sample by sample with noise='process', which needs domain='time'.")
    flight = _make_flight(model, aircraft, options)
    check_recordings(flights)
    if held_out:
        check_held_out(held_out, flights)
    outputs = choose_outputs(flight, flights, options.outputs)
    parameters = bound(build_parameters(flight, flights, outputs, options), options.bounds or {})
    if not parameters:
        raise ModelError("refine has nothing to estimate: free is empty and so is all else.")
    check_delay(parameters, flight, flights)
    held = {r.name: flight.first_state(r) for r in flights}
    in_time, band = options.domain == "time", None
    if not in_time:
        constants = {name: [p.name for p in parameters if p.kind == kind] for kind, name in _CONSTANTS.items()}
        band = check_frequency(flight, options.band, constants)
        problem: EstimationProblem = FrequencyProblem(flight, flights, outputs, parameters, held, band)
    else:
        kind = FilterErrorProblem if options.noise == "process" else EstimationProblem
        problem = kind(flight, flights, outputs, parameters, held)
    allowed = make_constraint(problem, options.constraint)
    R = _covariance(outputs, options)

    def search_locally(theta: np.ndarray) -> OutputErrorFit:
        return fit_output_error(
            problem.output_error(R, options, allowed), theta, scale=problem.scale, method=options.method,
            iterations=options.iterations, tolerance=options.tolerance,
            score=score_covariance if in_time else spectral_score_covariance,
            progress=None if progress is None else lambda step, value: progress("descent", step, value),
        )  # fmt: skip

    evolved, members = None, problem.theta0[None]
    if options.search is not None:
        evolved, members = search_between_bounds(problem, allowed, R, options, progress)
    fit = min(
        (search_locally(theta) for theta in members[: max(options.polish, 1)]), key=lambda one: float(one.costs[-1])
    )
    if isinstance(problem, FilterErrorProblem):
        fit = iterate_noise(problem, fit, search_locally)
    settings = {"noise": options.noise, "domain": options.domain, "band": band}
    found = with_verdict(report(problem, fit, evolved, options.cost, settings), model, None, options.keep_worse)
    refuse_failed_fit(problem, fit, found)
    if not held_out:
        return found
    return with_verdict(found, model, _compare(problem, fit.theta, held_out), options.keep_worse)


def _compare(problem: EstimationProblem, theta: np.ndarray, held_out: Sequence[Recording]) -> HeldOutComparison:
    """Original and refined model on recordings that were held out."""
    flight = problem.model
    delays = [problem.from_search(theta)[i] for i, p in enumerate(problem.parameters) if p.kind == "delay"]
    original = np.array(list(flight.parameters.values())), flight.delay
    refined = problem.model_parameters(theta[None])[0], float(delays[0]) if delays else flight.delay
    return compare_on_held_out(flight, list(held_out), problem.outputs, original, refined)


def with_verdict(
    found: Refinement, original: Any, comparison: HeldOutComparison | None, keep_worse: bool
) -> Refinement:
    """Refinement with its comparison on held-out recordings, and the model that this leaves to use."""
    statement, refined = state_verdict(comparison), found.refined
    if isinstance(refined, AeroModel):
        refined = replace(refined, refinement=statement)
    keep_original = comparison is not None and comparison.verdict == "worse" and not keep_worse
    if keep_original and isinstance(original, AeroModel):
        kept = replace(original, refinement=f"{statement}; this is the original model")
    else:
        kept = original if keep_original else refined
    return replace(found, model=kept, refined=refined, original=original, comparison=comparison)


def _covariance(outputs: Sequence[str], options: RefineOptions) -> np.ndarray | None:
    """(c,) variances that weigh the residuals, where they are given."""
    if options.cost != "weighted" or options.weights is None:
        return None
    if missing := [name for name in outputs if name not in options.weights]:
        raise ModelError(f"refine was given weights, but none for output {', '.join(missing)}.")
    return np.array([options.weights[name] ** 2 for name in outputs])


def _make_flight(model: Any, aircraft: Aircraft | None, options: RefineOptions) -> RefinableModel:
    delayed = None if isinstance(options.delay, bool) else options.delay
    if isinstance(model, LinearStructure | LinearModel):
        return LinearFlight(model, delayed)
    if isinstance(model, AeroModel):
        if aircraft is None:
            raise ModelError("refine needs the aircraft to simulate an AeroModel; it was given None.")
        require_kind(aircraft, Aircraft, "refine(model, aircraft, recordings)")
        return NonlinearFlight(
            model,
            aircraft,
            air=options.air,
            definitions=options.definitions,
            substeps=options.substeps,
            delayed=delayed,
        )
    raise ArgumentError(
        f"refine takes a LinearModel, a LinearStructure or an AeroModel; its model is of type {type(model).__name__}.\n"
        "Name the parameters of a linear system with LinearStructure.from_entries()."
    )


def make_constraint(problem: EstimationProblem, constraint: StabilityConstraint | None) -> Constraint | None:
    """Margins of parameter sets, as the kernels take them.

    Raises
    ------
    ModelError
        A constraint that is not possible for this model.
    """
    if constraint is None:
        return None
    if constraint == "stable":
        if not isinstance(problem.model, LinearFlight):
            raise ModelError(
                "constraint='stable' needs the eigenvalues of a linear model. For an AeroModel bound its "
                "terms, such as bounds={'Cm:alpha': (-3, 0)}."
            )
        return lambda thetas: -problem.model.growth(problem.model_parameters(thetas))
    if not callable(constraint):
        raise ModelError(f"constraint={constraint!r} is neither 'stable' nor a function of the parameters.")
    return lambda thetas: np.asarray(constraint(dict(zip(problem.names, problem.from_search(thetas).T))))


def search_between_bounds(
    problem: EstimationProblem,
    allowed: Constraint | None,
    R: np.ndarray | None,
    options: RefineOptions,
    progress: Callable[[str, int, float], None] | None,
) -> tuple[GlobalSearch, np.ndarray]:
    """Global search over the parameters with bounds, and the parameter vectors of its last generation, the best first.

    Process noise is held at its start value.
    """
    theta, bounds = problem.theta0, problem.bounds.copy()
    for i, p in enumerate(problem.parameters):
        if p.kind == "model":
            limit = _SEARCH_RANGE * max(abs(p.value), p.scale)
            bounds[i] = np.where(np.isfinite(bounds[i]), bounds[i], (-limit, limit))
    searchable = np.array([p.kind != "process" for p in problem.parameters])
    searched = np.flatnonzero(np.isfinite(bounds).all(axis=1) & searchable)

    def complete(sets: np.ndarray) -> np.ndarray:
        full = np.tile(theta, (len(sets), 1))
        full[:, searched] = sets
        return full

    reduced = OutputErrorProblem(
        problem.predict(theta, searched), problem.y, R=R, cost=options.cost, full=options.full_noise,
        bounds=bounds[searched], constraint=None if allowed is None else lambda sets: allowed(complete(sets)),
    )  # fmt: skip
    found = search_globally(
        reduced, seed=options.seed, population=options.population, generations=options.generations,
        progress=None if progress is None else lambda count, value: progress("evolution", count, value),
    )  # fmt: skip
    return found, complete(found.members) if len(found.members) else theta[None]


def report(
    problem: EstimationProblem,
    fit: OutputErrorFit,
    evolved: GlobalSearch | None,
    cost: str,
    settings: Mapping[str, Any],
) -> Refinement:
    """Refinement of a fit; `settings` are its fields noise, domain and band."""
    slope = problem.search_slope(fit.theta)
    values, both = problem.from_search(fit.theta), np.outer(slope, slope)
    std, white = fit.std * slope, fit.std_white * slope
    start = problem.from_search(problem.theta0)
    estimates = tuple(
        Estimate(p.name, p.kind, float(values[i]), float(std[i]), float(white[i]), float(start[i]), p.low, p.high,
                 bool(fit.at_bound[i]))
        for i, p in enumerate(problem.parameters)
    )  # fmt: skip
    fits, modelled, residuals = problem.fits_and_residuals(fit)
    rows = [i for i, e in enumerate(estimates) if e.kind == "model"]
    delay = [e.value for e in estimates if e.kind == "delay"]
    refined = problem.model.refined(
        {estimates[i].name: estimates[i].value for i in rows}, (fit.covariance * both)[np.ix_(rows, rows)],
        delay[0] if delay else problem.model.delay,
        "filter error" if settings["noise"] == "process" else "output error", [r.name for r in problem.recordings],
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        noise = dict(zip(problem.outputs, np.sqrt(np.diag(fit.R)).tolist()))
    doubts = (*problem.model.doubts, *check_estimates(estimates, fit.correlation, fit.converged, fit.message))
    return Refinement(
        refined, estimates, fit.crlb * both, fit.covariance * both, fit.correlation, noise, tuple(fits),
        tuple(modelled), residuals, cost, fit.costs, problem.from_search(fit.thetas), fit.converged, fit.message,
        evolved, doubts, **settings, refined=refined,
        held=_held_parameters(problem, {estimates[i].name for i in rows}),
    )  # fmt: skip


def _held_parameters(problem: EstimationProblem, estimated: set[str]) -> tuple[Estimate, ...]:
    """Parameters of the model that were not estimated."""
    values = {name: value for name, value in problem.model.parameters.items() if name not in estimated}
    errors = problem.model.held_errors(list(values)).tolist()
    return tuple(
        Estimate(name, "held", value, error, np.nan, value, -np.inf, np.inf, at_bound=False)
        for (name, value), error in zip(values.items(), errors)
    )


def refuse_failed_fit(problem: EstimationProblem, fit: OutputErrorFit, found: Refinement) -> None:
    """Raise where there is no usable estimate.

    Raises
    ------
    RefinementError
        A simulation that diverges, or parameters that the recordings do not determine; process noise may be one.
    """
    if not np.isfinite(fit.costs[-1]):
        growth = problem.model.growth(problem.model_parameters(fit.theta[None]))[0]
        why = f" Its fastest motion grows by {growth:.3g} per second." if np.isfinite(growth) and growth > 0.0 else ""
        diverged = [
            f"'{r.name}'" + (f" from t = {r.t[k]:g} s" if len(z) == len(r) else "")
            for r, z in zip(problem.recordings, fit.outputs)
            for k in [int(np.argmin(np.isfinite(z).all(axis=1)))]
            if not np.isfinite(z).all()
        ]
        process = "noise='process'"
        open_loop = "" if isinstance(problem, FilterErrorProblem) else (
            f" {process}, which corrects the simulation at each sample, converges from poorer starts."
        )  # fmt: skip
        raise RefinementError(
            f"refine cannot simulate '{problem.model.name}' with its start values: no finite outputs in "
            f"{', '.join(diverged)}.{why}",
            found,
            remedy="Start nearer, take shorter recordings, or ask for search='global' with bounds and "
            f"constraint='stable', which finds parameters for which it does not diverge.{open_loop}",
            cli_remedy="Start nearer, take shorter recordings, or ask for --search global with --bounds and --stable, "
            f"which finds parameters for which it does not diverge.{open_loop.replace(process, '--noise process')}",
        )
    lost = [p.name for p, gone in zip(problem.parameters, fit.undetermined) if gone and p.kind != "process"]
    if lost:
        raise RefinementError(
            f"refine cannot determine {', '.join(lost)} from {', '.join(r.name for r in problem.recordings)}: the "
            "information matrix is rank-deficient, the outputs do not depend on these, alone or in some "
            "combination.",
            found,
            remedy="Hold them (free=...), or record inputs that excite what they multiply. The exception's 'partial' "
            "has the other estimates.",
            cli_remedy="Hold them (--free), or record inputs that excite what they multiply. The other estimates are "
            "printed, and written with --out.",
        )
