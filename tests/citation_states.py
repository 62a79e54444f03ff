"""The Citation with states in its model, and its simulations."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from structsel.candidates import Term
from structsel.model import AeroModel, Quantity, ResponseModel, State
from structsel.simulation import published_aircraft, simulate

CITATION = published_aircraft("citation")
OWN, AIRCRAFT = CITATION.model, CITATION.aircraft
TRIM = CITATION.trim()
T = np.arange(0.0, 6.0, 0.02)


def state(kind, of, **values):
    return State(kind, of, {name: Quantity(value) for name, value in values.items()})


LAGGED = state("lag", "de", tau=0.15)
SEPARATED = state("separation", "alpha", tau1=0.3, tau2=0.15, a1=20.0, alpha_star=0.08)


def with_term(term, value, **states):
    """The Citation with one more term in Cm."""
    held = OWN["Cm"]
    made = ResponseModel((*held.terms, Term(term)), np.append(held.values, value), states=states)
    return AeroModel({**OWN.responses, "Cm": made})


def following(model, channel, name, one):
    """The model with a state in a channel's place."""
    made = {}
    for response, held in model.responses.items():
        terms = tuple(Term(str(t).replace(channel, name)) for t in held.terms)
        made[response] = ResponseModel(terms, held.values, states={name: one})
    return AeroModel(made)


def inputs(seed=0, size=0.02, t=T):
    rng = np.random.default_rng(seed)
    made = {"t": t}
    for c, value in TRIM.controls.items():
        steps = np.repeat(rng.choice([-1.0, 0.0, 1.0], size=len(t) // 40 + 1), 40)[: len(t)]
        made[c] = value + (size * gaussian_filter1d(steps, 4) if c in ("de", "da", "dr") else 0.0 * t)
    return made


def fly(model, given=None, start=TRIM, **options):
    return simulate(model, AIRCRAFT, given or inputs(), start=start, air=CITATION.air, outside="ignore", **options)
