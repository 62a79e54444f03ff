"""Effects that were found, as terms and states that can be added to a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from structsel.candidates import Term
from structsel.diagnosis.matching import LIFT, exact_terms
from structsel.effects.base import Effect, ModelCase, ModelForm, Weights
from structsel.effects.model_forms import add_term
from structsel.numerics.arrays import Array

_ELSEWHERE = {
    "sensor": "is an error of an instrument",
    "inertial": "is an error of mass, inertia or centre of gravity, which the aircraft file states",
    "atmospheric": "is a motion of the air",
    "random": "is a motion of the air",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Addition(ModelForm):
    """Terms and states of one effect in a model; empty if it has none.

    Attributes
    ----------
    effect : str
    theta : (k,) array
        Its linear parameters, in their units.
    covariance : (k, k) array
        Theirs.
    remark : str
        Empty, or why it is not in the model as what it is.
    """

    effect: str
    theta: Array
    covariance: Array
    remark: str = ""

    @property
    def is_known(self) -> bool:
        """Whether it is terms or states."""
        return bool(self.terms or self.fixed or self.replaced)


def addition_of(hypothesis: Effect, case: ModelCase, theta: Array, covariance: Array) -> Addition:
    """An effect as terms or states; with neither, and a remark, where it has none.

    Parameters
    ----------
    hypothesis : Effect
    case : ModelCase
    theta : (k,) array
        Linear parameters, in their units.
    covariance : (k, k) array
    """
    effect = hypothesis.name

    def made(form: ModelForm | None = None, remark: str = "") -> Addition:
        parts = vars(form) if form is not None else {}
        return Addition(effect=effect, theta=theta, covariance=covariance, remark=remark, **parts)

    if hypothesis.kind in _ELSEWHERE:
        return made(remark=f"{effect} {_ELSEWHERE[hypothesis.kind]}: model.json does not contain it")
    if case.variant.model is not None and (form := case.variant.model(case)) is not None:
        return made(form)
    if (terms := exact_terms(case.variant, case.flights)) is not None:
        return made(ModelForm(terms={c: _without_lift(mine, case) for c, mine in terms.items() if mine}))
    if hypothesis.event:
        what = "acts at certain times of these recordings"
        return made(remark=f"{effect} {what}: model.json does not contain it")
    return made()


def _without_lift(terms: Mapping[Term, Array], case: ModelCase) -> dict[Term, Array]:
    """Terms with the simulated lift written in the simulation's own terms."""
    made: Weights = {}
    for term, weights in terms.items():
        powers = {f: p for f, p in term.factors if f.channels != (LIFT,)}
        parts: list[tuple[Term, float]] = [(Term(powers), 1.0)]
        for _ in range(term.degree - sum(powers.values())):
            parts = [(t * more, v * value) for t, v in parts for more, value in case.lift()]
        for t, v in parts:
            add_term(made, "", t, v * weights)
    return made.get("", {})
