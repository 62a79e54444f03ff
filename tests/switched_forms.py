"""The form of an effect that is on in parts of some flights, as the diagnosis finds it."""

from structsel.diagnosis.diagnose import set_up
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.switching import refine
from tests.effect_fits import effect_named


def refined(flights, effect):
    """Problem, and the score of an effect."""
    problem, library, _ = set_up(flights, [effect_named(effect)])
    (score,) = refine(problem, score_all(problem, library))
    return problem, score


def sizes(score):
    """Parameters of the form that is judged."""
    return {p.name: x * p.sd for p, x in zip(score.signature.variant.parameters, score.trial.theta)}
