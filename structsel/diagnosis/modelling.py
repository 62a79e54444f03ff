"""Model of the simulation with the missing effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.comparison.preparing import PreparedComparison
from structsel.diagnosis.adding import addition_of
from structsel.diagnosis.assembling import estimates
from structsel.diagnosis.extending import Extended, as_models
from structsel.diagnosis.patching import Patched, patched_aircraft
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.residuals import contributions
from structsel.effects.base import ModelCase
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS


@dataclass(frozen=True, eq=False)
class CorrectedModel(AeroModel):
    """Model of a simulation with the effects that it lacks.

    Attributes
    ----------
    remarks : tuple of str
        Effects that the model does not contain in their own form, and the reasons.
    patched : Patched or None
        The corrected aircraft of JSBSim, if the simulation is one and the effects can be written into it.
    """

    remarks: tuple[str, ...] = ()
    patched: Patched | None = None


def corrected_model(prepared: PreparedComparison, ranking: Ranking) -> CorrectedModel | None:
    """Model of the simulation with the effects found; None if the responses are no coefficients.

    The terms and values of a simulation that is a model are kept. Any other simulation is represented by its surrogate,
    a regression on the states. Each effect is added as terms with the estimated values, as states with their own
    dynamics, or, if it has neither, as a regression on the states along the recordings.
    """
    problem, flights = ranking.problem, ranking.problem.flights
    responses = [c for c in flights[0].simulated if c in COEFFICIENTS]
    own, stand_in = prepared.simulation.model, prepared.flights[0].surrogate
    if not responses or stand_in is None:
        return None
    if own is not None:
        base, name = dict(own.responses), f"{own.name or 'model'} with the missing effects"
    else:
        base = as_models(stand_in, flights)
        name = "simulation with the missing effects"
    made = Extended(base, flights)
    additions, remarks = [], []
    for k, (step, signature) in enumerate(zip(ranking.steps, problem.accepted)):
        estimated = estimates(problem, k, step.score)
        names = [p.name for p in signature.variant.parameters]
        sds = np.array([p.sd for p in signature.variant.parameters])
        part = problem.place(k)
        spread = problem.base.posterior.covariance[part, part]
        # Scaled to the standard errors of the parameters.
        wide = np.array([estimated[n].std for n in names]) / np.sqrt(np.diag(spread))
        one = addition_of(
            signature.hypothesis,
            ModelCase(signature.variant, estimated, flights[0].aircraft, base, flights),
            problem.base.posterior.mean[part] * sds,
            spread * np.outer(wide, wide),
        )
        additions.append(one)
        if one.remark:
            remarks.append(one.remark)
        elif not one.is_known or not made.take(one):
            remarks.append(made.add_regression(one.effect, contributions(problem, [k])))
    patched = None
    if prepared.simulation.form == "jsbsim":
        patched = patched_aircraft(
            prepared.simulation.name.removeprefix("jsbsim:"), additions, flights[0].aircraft, flights
        )
        remarks += patched.remarks
    return CorrectedModel(made.responses(), name, tuple(r.name for r in prepared.flights), tuple(remarks), patched)
