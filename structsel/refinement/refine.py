"""refine(): output error over whole manoeuvres."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError
from structsel.model import AeroModel
from structsel.numerics.coloured_output import coloured_information, spectral_information
from structsel.numerics.output_error import OutputErrorFit, fit_output_error
from structsel.recording import Recording
from structsel.refinement.aero_flight import AeroFlight
from structsel.refinement.fitting import evolve, make_constraint, refuse, report
from structsel.refinement.flying import LinearFlight
from structsel.refinement.frequency import FrequencyProblem, check_frequency
from structsel.refinement.layout import Names, check_delay, check_recordings, choose_outputs, lay_out
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.parameters import bound
from structsel.refinement.prediction import PredictionProblem, settle
from structsel.refinement.problem import FlightModel, Problem
from structsel.refinement.result import Refinement
from structsel.simulation.air import Air
from structsel.simulation.linear import LinearModel

_CONSTANTS = {"drift": "drifts", "bias": "biases", "reference": "references"}


def refine(
    model: LinearStructure | LinearModel | AeroModel,
    aircraft: Aircraft | None,
    recordings: Recording | Sequence[Recording],
    *,
    free: Names = "all",
    outputs: Iterable[str] | None = None,
    starts: Names = (),
    drifts: Names = (),
    biases: Names = (),
    references: Names = (),
    scales: Names = (),
    delay: bool | Iterable[str] = False,
    noise: Literal["measurement", "process"] = "measurement",
    process: Names = "all",
    domain: Literal["time", "frequency"] = "time",
    band: tuple[float, float] | None = None,
    guess: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    constraint: Literal["stable"] | Callable[[Mapping[str, np.ndarray]], np.ndarray] | None = None,
    cost: Literal["ml", "weighted"] = "ml",
    weights: Mapping[str, float] | None = None,
    full_noise: bool = False,
    method: Literal["levenberg-marquardt", "gauss-newton"] = "levenberg-marquardt",
    search: Literal["global"] | None = None,
    seed: int = 0,
    population: int = 8,
    generations: int = 100,
    polish: int = 6,
    iterations: int = 60,
    tolerance: float = 1e-5,
    air: Air | None = None,
    definitions: Mapping[str, str] | None = None,
    substeps: int | None = None,
    progress: Callable[[str, int, float], None] | None = None,
) -> Refinement:
    """Refine a model's parameters so that its simulated flights come nearest the recorded ones.

    Parameters
    ----------
    model : LinearStructure, LinearModel or AeroModel
        Its values are where the search starts.
    aircraft : Aircraft or None
        None with a linear model.
    recordings : Recording or sequence of Recording
        Even clocks, inputs finite throughout; outputs may have gaps of NaN. Names must differ.
    free : iterable of str or "all"
        The model's parameters to estimate; the others are held. Of an AeroModel they are called "Cm:alpha",
        the constant "Cm:1".
    outputs : iterable of str, optional
        Channels to fit; those of the model that all recordings have.
    starts, drifts : iterable of state's name or "all"
        Per recording: states at the first sample, and constants in the state equations.
    biases : iterable of output's name or "all"
        Per recording: constant added to an output.
    references, scales : iterable of output's name or "all"
        Over all recordings: constant added to an output, and its factor.
    delay : bool or iterable of input's name
        Estimate by how much the inputs act late: all of them, or these. A recorded thrust is never late unless it is
        named.
    noise : {"measurement", "process"}
        ``"measurement"``: output error, for flights in calm air; all that parts model and recording is the
        instruments'. ``"process"``: filter error, for turbulence and a model that leaves something out. Each sample's
        innovations are fed back through the steady gain of a Kalman filter, the process noise is estimated (its
        names are ``"process:w"``, per root of a second), and residuals are innovations.
    process : iterable of state's name or "all"
        States that process noise moves; all that the outputs show.
    domain : {"time", "frequency"}
        ``"frequency"``, for linear models: output error of the transforms over the band. Constants take no part;
        ``starts`` then names the states that may end a record elsewhere than they began it (``"jump:m01:w"``).
    band : (low, high) [Hz]
        With ``domain="frequency"``.
    guess : mapping of parameter's name to float, optional
        Starts of the search, in place of the model's value; 1 for scales, and 0 for constants but the references of
        a linear model, which start from the first readings.
    bounds : mapping of parameter's name to (low, high), optional
        A name that ends in a colon stands for all that begin so. The delay is bounded by zero and a quarter of the
        shortest recording unless given.
    constraint : "stable" or callable, optional
        ``"stable"``: no motion of the model grows. A callable takes parameters by name, (m,) each, and returns
        margins (m,) that must not be negative.
    cost : {"ml", "weighted"}
        Noise estimated, or residuals weighted.
    weights : mapping of output to float, optional
        Standard deviations for the cost "weighted"; those of the measured channels where not given.
    full_noise : bool
        Estimate how the noise of the outputs is correlated too.
    search : "global" or None
        Differential evolution between the bounds before the descent. A parameter of the model without bounds is
        looked for within four times its start, either sign; starts, drifts, biases and references without bounds
        are held meanwhile.
    seed, population, generations : int
        Of the evolution.
    polish : int
        Best members of the last generation that are each taken downhill; the lowest of them is the result.
    method, iterations, tolerance
        Of the descent, as `fit_output_error` takes them.
    air, definitions, substeps
        Of an AeroModel's flights, as `structsel.simulation.simulate` takes them.
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
    if noise not in ("measurement", "process") or domain not in ("time", "frequency"):
        raise ModelError(
            f"refine was given noise={noise!r}, domain={domain!r}; noise is 'measurement' or 'process', domain 'time' "
            "or 'frequency'."
        )
    if domain == "frequency" and noise == "process":
        raise ModelError("refine lets innovations in sample by sample: noise='process' needs domain='time'.")
    flight = _make_flight(model, aircraft, air, definitions, substeps, None if isinstance(delay, bool) else delay)
    check_recordings(flights)
    shown = choose_outputs(flight, flights, outputs)
    in_time = domain == "time"
    parameters = lay_out(
        flight, flights, shown, free, starts if in_time else (), drifts, biases, references, scales, bool(delay),
        guess or {}, process=process if noise == "process" else (), jumps=() if in_time else starts,
    )  # fmt: skip
    parameters = bound(parameters, bounds or {})
    if not parameters:
        raise ModelError("refine has nothing to estimate: free is empty and so is all else.")
    check_delay(parameters, flight, flights)
    held = {r.name: flight.first_state(r) for r in flights}
    if not in_time:
        constants = {option: [p.name for p in parameters if p.kind == kind] for kind, option in _CONSTANTS.items()}
        band = check_frequency(flight, band, constants)
        problem: Problem = FrequencyProblem(flight, flights, shown, parameters, held, band)
    else:
        kind = PredictionProblem if noise == "process" else Problem
        problem = kind(flight, flights, shown, parameters, held)
    allowed = make_constraint(problem, constraint)
    R = None
    if cost == "weighted" and weights is not None:
        missing = [name for name in shown if name not in weights]
        if missing:
            raise ModelError(f"refine was given weights, but none for output {', '.join(missing)}.")
        R = np.array([weights[name] ** 2 for name in shown])

    def descend(theta: np.ndarray) -> OutputErrorFit:
        return fit_output_error(
            problem.predict(), problem.y, theta, bounds=problem.bounds, R=R, cost=cost, full=full_noise,
            method=method, constraint=allowed, affects=problem.affects, scale=problem.scale, iterations=iterations,
            tolerance=tolerance, colour=coloured_information if in_time else spectral_information,
            progress=None if progress is None else lambda step, value: progress("descent", step, value),
        )  # fmt: skip

    evolved, members = None, problem.theta0[None]
    if search is not None:
        evolved, members = evolve(problem, allowed, R, cost, full_noise, seed, population, generations, progress)
    fit = min((descend(theta) for theta in members[: max(polish, 1)]), key=lambda one: float(one.costs[-1]))
    if isinstance(problem, PredictionProblem):
        fit = settle(problem, fit, descend)
    found = report(problem, fit, evolved, cost, {"noise": noise, "domain": domain, "band": None if in_time else band})
    refuse(problem, fit, found)
    return found


def _make_flight(
    model: Any,
    aircraft: Aircraft | None,
    air: Air | None,
    definitions: Mapping[str, str] | None,
    substeps: int | None,
    late: Iterable[str] | None,
) -> FlightModel:
    if isinstance(model, LinearStructure | LinearModel):
        return LinearFlight(model, late)
    if isinstance(model, AeroModel):
        if aircraft is None:
            raise ModelError("refine needs the aircraft to fly an AeroModel; it was given None.")
        return AeroFlight(model, aircraft, air=air, definitions=definitions, substeps=substeps, late=late)
    raise ModelError(
        f"refine flies a LinearModel, a LinearStructure or an AeroModel; it was given a {type(model).__name__}. "
        "Name the parameters of a linear system with LinearStructure.from_entries()."
    )
