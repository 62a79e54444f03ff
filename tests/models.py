"""Models written as response to term to value, and the demonstration's."""

from structsel.demo import TRUTH
from structsel.model import AeroModel

model_of = AeroModel.from_terms
DEMO = model_of(TRUTH)
