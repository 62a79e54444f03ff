"""refine(): output error over whole manoeuvres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError
from structsel.model import AeroModel
from structsel.numerics.noise_models import score_covariance, spectral_score_covariance
from structsel.numerics.output_error import OutputErrorFit, fit_output_error
from structsel.options import takes_options
from structsel.recording import Recording
from structsel.refinement.aero_flight import AeroFlight
from structsel.refinement.fitting import evolve, make_constraint, refuse, report
from structsel.refinement.flying import LinearFlight
from structsel.refinement.frequency import FrequencyProblem, check_frequency
from structsel.refinement.layout import build_parameters, check_delay, check_recordings, choose_outputs
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.parameters import bound
from structsel.refinement.prediction import PredictionProblem, settle
from structsel.refinement.problem import FlightModel, Problem
from structsel.refinement.result import Refinement
from structsel.refinement.settings import RefineOptions
from structsel.simulation.linear import LinearModel

_CONSTANTS = {"drift": "drifts", "bias": "biases", "reference": "references"}


@takes_options(RefineOptions)
def refine(
    model: LinearStructure | LinearModel | AeroModel,
    aircraft: Aircraft | None,
    recordings: Recording | Sequence[Recording],
    *,
    options: RefineOptions,
    progress: Callable[[str, int, float], None] | None = None,
) -> Refinement:
    """Estimate a model's parameters so that the simulated outputs come nearest the recorded ones.

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
    progress : callable, optional
        Called with "evolution" or "descent", the count and the cost.

    Returns
    -------
    Refinement
        Where the search did not settle, `converged` is False, and what it holds is the best found.

    Raises
    ------
    ModelError
        A name that is not the model's, bounds that cross.
    DataError
        Recordings that cannot be flown: uneven clock, inputs missing, shorter than the delay.
    RefinementError
        The start cannot be flown, or the flights do not determine a parameter; ``partial`` has what was found.

    References
    ----------
    [KM16], [A10], [J15].
    """
    flights = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if options.domain == "frequency" and options.noise == "process":
        raise ModelError("refine lets innovations in sample by sample: noise='process' needs domain='time'.")
    flight = _make_flight(model, aircraft, options)
    check_recordings(flights)
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
        problem: Problem = FrequencyProblem(flight, flights, outputs, parameters, held, band)
    else:
        kind = PredictionProblem if options.noise == "process" else Problem
        problem = kind(flight, flights, outputs, parameters, held)
    allowed = make_constraint(problem, options.constraint)
    R = _covariance(outputs, options)

    def search_locally(theta: np.ndarray) -> OutputErrorFit:
        return fit_output_error(
            problem.in_numbers(R, options, allowed), theta, scale=problem.scale, method=options.method,
            iterations=options.iterations, tolerance=options.tolerance,
            score=score_covariance if in_time else spectral_score_covariance,
            progress=None if progress is None else lambda step, value: progress("descent", step, value),
        )  # fmt: skip

    evolved, members = None, problem.theta0[None]
    if options.search is not None:
        evolved, members = evolve(problem, allowed, R, options, progress)
    fit = min(
        (search_locally(theta) for theta in members[: max(options.polish, 1)]), key=lambda one: float(one.costs[-1])
    )
    if isinstance(problem, PredictionProblem):
        fit = settle(problem, fit, search_locally)
    found = report(
        problem, fit, evolved, options.cost, {"noise": options.noise, "domain": options.domain, "band": band}
    )
    refuse(problem, fit, found)
    return found


def _covariance(outputs: Sequence[str], options: RefineOptions) -> np.ndarray | None:
    """(c,) variances that weigh the residuals, where they are given."""
    if options.cost != "weighted" or options.weights is None:
        return None
    if missing := [name for name in outputs if name not in options.weights]:
        raise ModelError(f"refine was given weights, but none for output {', '.join(missing)}.")
    return np.array([options.weights[name] ** 2 for name in outputs])


def _make_flight(model: Any, aircraft: Aircraft | None, options: RefineOptions) -> FlightModel:
    delayed = None if isinstance(options.delay, bool) else options.delay
    if isinstance(model, LinearStructure | LinearModel):
        return LinearFlight(model, delayed)
    if isinstance(model, AeroModel):
        if aircraft is None:
            raise ModelError("refine needs the aircraft to fly an AeroModel; it was given None.")
        return AeroFlight(
            model, aircraft, air=options.air, definitions=options.definitions, substeps=options.substeps, late=delayed
        )
    raise ModelError(
        f"refine flies a LinearModel, a LinearStructure or an AeroModel; it was given a {type(model).__name__}. "
        "Name the parameters of a linear system with LinearStructure.from_entries()."
    )
