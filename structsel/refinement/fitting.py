"""What `refine` does with a problem: search, descend, tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from structsel.errors import ModelError, RefinementError
from structsel.numerics.global_search import GlobalSearch, search_globally
from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Constraint, OutputErrorProblem
from structsel.refinement.flying import LinearFlight
from structsel.refinement.prediction import PredictionProblem
from structsel.refinement.problem import Problem
from structsel.refinement.result import Estimate, Refinement, find_doubts
from structsel.refinement.settings import RefineOptions, StabilityConstraint

_REACH = 4.0  # times its start, either sign: where the evolution looks for a parameter without bounds


def make_constraint(problem: Problem, constraint: StabilityConstraint | None) -> Constraint | None:
    """Margins of parameter sets, as the kernels take them.

    Raises
    ------
    ModelError
        A constraint that cannot be meant.
    """
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
    return lambda thetas: np.asarray(constraint(dict(zip(problem.names, problem.outer(thetas).T))))


def evolve(
    problem: Problem,
    allowed: Constraint | None,
    R: np.ndarray | None,
    options: RefineOptions,
    progress: Callable[[str, int, float], None] | None,
) -> tuple[GlobalSearch, np.ndarray]:
    """An evolution over what has bounds, and the whole parameter vectors of its last generation, the best first.

    Process noise stays where it starts meanwhile.
    """
    theta, limits = problem.theta0, problem.bounds.copy()
    for i, p in enumerate(problem.parameters):
        if p.kind == "model":
            reach = _REACH * max(abs(p.value), p.scale)
            limits[i] = np.where(np.isfinite(limits[i]), limits[i], (-reach, reach))
    own = np.array([p.kind != "process" for p in problem.parameters])
    searched = np.flatnonzero(np.isfinite(limits).all(axis=1) & own)

    def whole(sets: np.ndarray) -> np.ndarray:
        full = np.tile(theta, (len(sets), 1))
        full[:, searched] = sets
        return full

    reduced = OutputErrorProblem(
        problem.predict(theta, searched), problem.y, R=R, cost=options.cost, full=options.full_noise,
        bounds=limits[searched], constraint=None if allowed is None else lambda sets: allowed(whole(sets)),
    )  # fmt: skip
    found = search_globally(
        reduced, seed=options.seed, population=options.population, generations=options.generations,
        progress=None if progress is None else lambda count, value: progress("evolution", count, value),
    )  # fmt: skip
    return found, whole(found.members) if len(found.members) else theta[None]


def report(
    problem: Problem, fit: OutputErrorFit, evolved: GlobalSearch | None, cost: str, way: Mapping[str, Any]
) -> Refinement:
    """The fit as an engineer reads it; `way` is what the Refinement says of how it was made."""
    slope = problem.slope(fit.theta)
    values, both = problem.outer(fit.theta), np.outer(slope, slope)
    std, white = fit.std * slope, fit.std_white * slope
    began = problem.outer(problem.theta0)
    estimates = tuple(
        Estimate(p.name, p.kind, float(values[i]), float(std[i]), float(white[i]), float(began[i]), p.low, p.high,
                 bool(fit.at_bound[i]))
        for i, p in enumerate(problem.parameters)
    )  # fmt: skip
    fits, modelled, residuals = problem.portray(fit)
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
        refined, estimates, fit.crlb * both, fit.covariance * both, fit.correlation, noise, tuple(fits),
        tuple(modelled), residuals, cost, fit.costs, problem.outer(fit.thetas), fit.converged, fit.message, evolved,
        doubts, **way,
    )  # fmt: skip


def refuse(problem: Problem, fit: OutputErrorFit, found: Refinement) -> None:
    """Raise where there is no estimate worth the name.

    Raises
    ------
    RefinementError
        What cannot be flown, or parameters that the flights leave open; process noise may stay open.
    """
    if not np.isfinite(fit.costs[-1]):
        growth = problem.model.growth(problem.own(fit.theta[None]))[0]
        why = f" Its fastest motion grows by {growth:.3g} per second." if np.isfinite(growth) and growth > 0.0 else ""
        lost = [
            f"'{r.name}'" + (f" from t = {r.t[k]:g} s" if len(z) == len(r) else "")
            for r, z in zip(problem.recordings, fit.outputs)
            for k in [int(np.argmin(np.isfinite(z).all(axis=1)))]
            if not np.isfinite(z).all()
        ]
        open_loop = "" if isinstance(problem, PredictionProblem) else (
            " noise='process', which lets the flight be corrected on its way, bears poorer starts too."
        )  # fmt: skip
        raise RefinementError(
            f"refine cannot fly '{problem.model.name}' with the parameters it starts from: no finite outputs in "
            f"{', '.join(lost)}.{why}\nStart nearer, take shorter recordings, or ask for search='global' with bounds "
            f"and constraint='stable', which finds parameters that fly.{open_loop}",
            found,
        )
    lost = [p.name for p, gone in zip(problem.parameters, fit.undetermined) if gone and p.kind != "process"]
    if lost:
        raise RefinementError(
            f"refine cannot determine {', '.join(lost)} from {', '.join(r.name for r in problem.recordings)}: the "
            "information matrix is rank-deficient, the outputs stay the same whichever values these have, alone or "
            "together.\nHold them (free=...), or fly inputs that move what they multiply. The exception's 'partial' "
            "has the other estimates.",
            found,
        )
