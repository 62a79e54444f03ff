"""The simulation plus what was missing, as a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.candidates import Term
from structsel.diagnosis.assembling import contributions
from structsel.diagnosis.ranking import Ranking
from structsel.mismatch.flight import Flight
from structsel.mismatch.preparing import Prepared
from structsel.mismatch.responses import COEFFICIENTS
from structsel.mismatch.surrogate import Surrogate, identify
from structsel.model import AeroModel, ResponseModel


def corrected_model(prepared: Prepared, ranking: Ranking) -> AeroModel | None:
    """Model of the simulation with the physics found; None where the responses are no coefficients.

    Responses that the physics changes are stood for by few terms of the states; the others of a simulation that is a
    model stay as they are. Physics with a memory enters by what it amounts to along the recordings.
    """
    flights = ranking.bench.flights
    responses = [c for c in flights[0].simulated if c in COEFFICIENTS]
    if not responses:
        return None
    added = contributions(ranking.bench, range(len(ranking.bench.accepted)))
    told = [{c: f.simulated[c] + a.get(c, 0.0) for c in responses} for f, a in zip(flights, added)]
    stand_in = identify(flights, told, responses)
    model = as_model(stand_in, flights, "simulation with the physics it left out")
    own = prepared.simulation.model
    if own is None or not set(responses) <= set(own):
        return model
    # What a model says already stays as it is; the stand-in serves only the responses that the physics changed.
    changed = {c for a in added for c, x in a.items() if np.any(x)}
    kept = {c: (model[c] if c in changed else own[c]) for c in responses}
    return AeroModel(kept, name=f"{own.name or 'model'} with the physics it left out")


def as_model(stand_in: Surrogate, flights: Sequence[Flight], name: str) -> AeroModel:
    """A stand-in as a model anyone can evaluate."""
    made = {}
    for c, terms in stand_in.terms.items():
        texts, values = ["1"], [stand_in.constant[c]]
        for term, value in zip(terms, stand_in.values[c]):
            factors = sorted(set(term))
            text = "*".join(
                _centred(f, stand_in.centre[f]) + (f"^{term.count(f)}" if term.count(f) > 1 else "") for f in factors
            )
            texts.append(text)
            values.append(float(value / np.prod([stand_in.scale[f] for f in term])))
        region = {
            f: (min(float(x[f].min()) for x in flights), max(float(x[f].max()) for x in flights))
            for f in sorted({f for t in terms for f in t})
        }
        made[c] = ResponseModel(
            tuple(Term.parse(t) for t in texts), np.array(values), method="stand-in of a simulation", region=region,
            n=sum(len(f) for f in flights), r2=stand_in.r2[c],
        )  # fmt: skip
    return AeroModel(made, name=name)


def _centred(channel: str, centre: float) -> str:
    return f"({channel} - {centre!r})" if centre >= 0.0 else f"({channel} + {-centre!r})"
