"""refine(): output error over whole manoeuvres."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError, RefinementError
from structsel.model import AeroModel
from structsel.numerics.output_error import GlobalSearch, OutputErrorFit, fit_output_error, search_globally
from structsel.recording import Recording
from structsel.refinement.aero_flight import AeroFlight
from structsel.refinement.flying import LinearFlight
from structsel.refinement.layout import Names, check_delay, check_recordings, choose_outputs, lay_out
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.parameters import bound
from structsel.refinement.problem import FlightModel, Problem
from structsel.refinement.result import Estimate, Refinement, find_doubts, judge_output
from structsel.simulation.air import Air
from structsel.simulation.linear import LinearModel

_REACH = 4.0  # times its start, either sign: where the evolution looks for a parameter without bounds


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
    delay: bool = False,
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
    delay : bool
        Estimate by how much the inputs act late.
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
    flight = _make_flight(model, aircraft, air, definitions, substeps)
    check_recordings(flights)
    shown = choose_outputs(flight, flights, outputs)
    parameters = lay_out(flight, flights, shown, free, starts, drifts, biases, references, scales, delay, guess or {})
    parameters = bound(parameters, bounds or {})
    if not parameters:
        raise ModelError("refine has nothing to estimate: free is empty and so is all else.")
    check_delay(parameters, flight, flights)
    held = {r.name: flight.first_state(r) for r in flights}
    problem = Problem(flight, flights, shown, parameters, held)
    allowed = _make_constraint(problem, constraint)
    R = None
    if cost == "weighted" and weights is not None:
        missing = [name for name in shown if name not in weights]
        if missing:
            raise ModelError(f"refine was given weights, but none for output {', '.join(missing)}.")
        R = np.array([weights[name] ** 2 for name in shown])
    evolved, members = None, problem.theta0[None]
    if search is not None:
        evolved, members = _evolve(problem, allowed, R, cost, full_noise, seed, population, generations, progress)
    fits = [
        fit_output_error(
            problem.predict(), problem.y, theta, bounds=problem.bounds, R=R, cost=cost, full=full_noise,
            method=method, constraint=allowed, affects=problem.affects, scale=problem.scale, iterations=iterations,
            tolerance=tolerance,
            progress=None if progress is None else lambda step, value: progress("descent", step, value),
        )
        for theta in members[: max(polish, 1)]
    ]  # fmt: skip
    fit = min(fits, key=lambda one: one.costs[-1])
    found = _report(problem, fit, evolved, cost)
    _refuse(problem, fit, found)
    return found


def _make_flight(
    model: Any,
    aircraft: Aircraft | None,
    air: Air | None,
    definitions: Mapping[str, str] | None,
    substeps: int | None,
) -> FlightModel:
    if isinstance(model, LinearStructure | LinearModel):
        return LinearFlight(model)
    if isinstance(model, AeroModel):
        if aircraft is None:
            raise ModelError("refine needs the aircraft to fly an AeroModel; it was given None.")
        return AeroFlight(model, aircraft, air=air, definitions=definitions, substeps=substeps)
    raise ModelError(
        f"refine flies a LinearModel, a LinearStructure or an AeroModel; it was given a {type(model).__name__}. "
        "Name the parameters of a linear system with LinearStructure.from_entries()."
    )


def _make_constraint(
    problem: Problem, constraint: Literal["stable"] | Callable[[Mapping[str, np.ndarray]], np.ndarray] | None
) -> Callable[[np.ndarray], np.ndarray] | None:
    if constraint is None:
        return None
    if constraint == "stable":
        if not isinstance(problem.model, LinearFlight):
            raise ModelError(
                "constraint='stable' looks at the eigenvalues of a linear model. For an AeroModel bound the terms that "
                "decide, such as bounds={'Cm:alpha': (-3, 0)}."
            )
        return lambda thetas: -problem.model.growth(problem.own(thetas))
    if not callable(constraint):
        raise ModelError(f"constraint={constraint!r} is neither 'stable' nor a function of the parameters.")
    return lambda thetas: np.asarray(constraint(dict(zip(problem.names, thetas.T))))


def _evolve(
    problem: Problem,
    allowed: Callable[[np.ndarray], np.ndarray] | None,
    R: np.ndarray | None,
    cost: Literal["ml", "weighted"],
    full_noise: bool,
    seed: int,
    population: int,
    generations: int,
    progress: Callable[[str, int, float], None] | None,
) -> tuple[GlobalSearch, np.ndarray]:
    """An evolution over what has bounds, and the whole parameter vectors of its last generation, the best first."""
    theta, limits = problem.theta0, problem.bounds.copy()
    for i, p in enumerate(problem.parameters):
        if p.kind == "model":
            reach = _REACH * max(abs(p.value), p.scale)
            limits[i] = np.where(np.isfinite(limits[i]), limits[i], (-reach, reach))
    searched = np.flatnonzero(np.isfinite(limits).all(axis=1))

    def whole(sets: np.ndarray) -> np.ndarray:
        full = np.tile(theta, (len(sets), 1))
        full[:, searched] = sets
        return full

    found = search_globally(
        problem.predict(theta, searched), problem.y, limits[searched], R=R, cost=cost, full=full_noise, seed=seed,
        constraint=None if allowed is None else lambda sets: allowed(whole(sets)),
        population=population, generations=generations,
        progress=None if progress is None else lambda count, value: progress("evolution", count, value),
    )  # fmt: skip
    return found, whole(found.members) if len(found.members) else theta[None]


def _report(problem: Problem, fit: OutputErrorFit, evolved: GlobalSearch | None, cost: str) -> Refinement:
    std, white = fit.std, fit.std_white
    estimates = tuple(
        Estimate(p.name, p.kind, float(fit.theta[i]), float(std[i]), float(white[i]), p.value, p.low, p.high,
                 bool(fit.at_bound[i]))
        for i, p in enumerate(problem.parameters)
    )  # fmt: skip
    fits, simulated, residuals = [], [], {}
    for r, z, v in zip(problem.recordings, fit.outputs, fit.residuals):
        fits += [judge_output(r.name, name, r[name], z[:, c]) for c, name in enumerate(problem.outputs)]
        flown = {name: np.array(z[:, c]) for c, name in enumerate(problem.outputs)}
        simulated.append(r.with_channels(note="outputs simulated by refine", **flown))  # type: ignore[arg-type]
        residuals[r.name] = {name: np.array(v[:, c]) for c, name in enumerate(problem.outputs)}
    own = {e.name: e for e in estimates if e.kind == "model"}
    late = [e.value for e in estimates if e.kind == "delay"]
    refined = problem.model.refined(
        {name: e.value for name, e in own.items()}, {name: e.std for name, e in own.items()},
        late[0] if late else problem.model.delay,
    )  # fmt: skip
    with np.errstate(invalid="ignore"):
        noise = dict(zip(problem.outputs, np.sqrt(np.diag(fit.R)).tolist()))
    doubts = find_doubts(estimates, fit.correlation, fit.converged, fit.message)
    return Refinement(
        refined, estimates, fit.crlb, fit.covariance, fit.correlation, noise, tuple(fits), tuple(simulated), residuals,
        cost, fit.costs, fit.thetas, fit.converged, fit.message, evolved, doubts,
    )  # fmt: skip


def _refuse(problem: Problem, fit: OutputErrorFit, found: Refinement) -> None:
    """Raise where there is no estimate worth the name."""
    if not np.isfinite(fit.costs[-1]):
        growth = problem.model.growth(problem.own(fit.theta[None]))[0]
        why = f" Its fastest motion grows by {growth:.3g} per second." if np.isfinite(growth) and growth > 0.0 else ""
        lost = [
            f"'{r.name}' from t = {r.t[int(np.argmin(np.isfinite(z).all(axis=1)))]:g} s"
            for r, z in zip(problem.recordings, fit.outputs)
            if not np.isfinite(z).all()
        ]
        raise RefinementError(
            f"refine cannot fly '{problem.model.name}' with the parameters it starts from: no finite outputs in "
            f"{', '.join(lost)}.{why}\nStart nearer, take shorter recordings, or ask for search='global' with bounds "
            "and constraint='stable', which finds parameters that fly.",
            found,
        )
    lost = [p.name for p, gone in zip(problem.parameters, fit.undetermined) if gone]
    if lost:
        raise RefinementError(
            f"refine cannot determine {', '.join(lost)} from {', '.join(r.name for r in problem.recordings)}: the "
            "information matrix is rank-deficient, the outputs stay the same whichever values these have, alone or "
            "together.\nHold them (free=...), or fly inputs that move what they multiply. The exception's 'partial' "
            "has the other estimates.",
            found,
        )
