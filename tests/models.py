"""Models written as response to term to value, and the demonstration's."""

import numpy as np

from structsel.candidates import Term
from structsel.demo import TRUTH
from structsel.model import AeroModel, ResponseModel


def model_of(truth, **more):
    """Model of a mapping of response to term to value; `more` are further fields of every response."""
    return AeroModel(
        {
            name: ResponseModel(tuple(map(Term, terms)), np.array(list(terms.values())), **more)
            for name, terms in truth.items()
        }
    )


DEMO = model_of(TRUTH)
