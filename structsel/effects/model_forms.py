"""Building blocks of effects in an aerodynamic model: states after controls, derivatives of terms.

The aircraft file of JSBSim with the effect follows from the same form: terms become functions of the aerodynamics, a
state between a control and its terms becomes a flight control channel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from structsel.candidates import Term
from structsel.effects.base import ModelCase, ModelForm, Weights
from structsel.model import Quantity, State
from structsel.numerics.arrays import Array

MakeModel = Callable[[ModelCase], ModelForm | None]


def state_after(
    controls: Sequence[str], kind: str, suffix: str, parameters: Callable[[ModelCase], Mapping[str, Quantity]]
) -> MakeModel:
    """Model of surfaces that do not follow their input: a state of `kind` in the place of each control.

    Parameters
    ----------
    controls : sequence of str
        Those that the simulation's terms lack are left out; with none, the effect has no such model.
    kind : str
        Of the state; see `structsel.model.State`.
    suffix : str
        Of the states' names.
    parameters : callable
        Of the state. A parameter "fraction" of the effect is added.
    """

    def model(case: ModelCase) -> ModelForm | None:
        names = {control: f"{control}_{suffix}" for control in controls if control in case.used_channels}
        if not names:
            return None
        given = dict(parameters(case))
        if "fraction" in case.estimates:
            given["fraction"] = case.quantity("fraction")
        states = {name: State(kind, control, given) for control, name in names.items()}
        return ModelForm(states=states, replaced=dict.fromkeys(case.base, names))

    return model


def derivative(term: Term, channel: str) -> list[tuple[Term, float]] | None:
    """Derivative of a term by a channel, as terms with factors; None where the channel is inside a formula."""
    made = []
    for factor, power in term.factors:
        if channel not in factor.channels:
            continue
        if factor.kind not in ("channel", "offset"):
            return None
        powers = dict(term.factors)
        powers[factor] = power - 1
        made.append((Term(powers), float(power)))
    return made


def one_hot(j: int, k: int) -> Array:
    """(k,) array with a one at place j."""
    return np.eye(k)[j]


def add_term(terms: Weights, response: str, term: Term, weights: Array) -> None:
    """Add (k,) weights to those of a term."""
    held = terms.setdefault(response, {})
    held[term] = held.get(term, np.zeros_like(weights)) + weights
