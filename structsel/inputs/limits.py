"""Limits on an input and on the motion it causes: amplitude, rate, excursion."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from structsel.errors import ModelError
from structsel.inputs.settings import DesignOptions
from structsel.numerics.linear_systems import simulate_linear
from structsel.simulation.linear import LinearModel

_BY_SPEED = {"alpha": "w", "beta": "v"}


@dataclass(frozen=True)
class LimitUse:
    """One limit and the largest value reached.

    Attributes
    ----------
    what : str
        A channel, or ``rate of`` one.
    allowed, reached : float
    """

    what: str
    allowed: float
    reached: float

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        return asdict(self)


def limit_rows(model: LinearModel, u: np.ndarray, options: DesignOptions) -> np.ndarray:
    """Every limited quantity over its limit for each of b inputs (b, n, inputs), (samples of all quantities, b).

    Raises
    ------
    ModelError
        A limit on a quantity that the model does not have, or that is not above zero.
    """
    traces = [t / allowed for _, allowed, t in _traces(model, u, options)]
    return np.concatenate([t.T for t in traces]) if traces else np.zeros((0, len(u)))


def reached(model: LinearModel, u: np.ndarray, options: DesignOptions) -> tuple[LimitUse, ...]:
    """Largest value of each limited quantity for an input (n, inputs)."""
    found = _traces(model, u[None], options)
    return tuple(LimitUse(what, allowed, float(np.abs(t).max())) for what, allowed, t in found)


def _traces(model: LinearModel, u: np.ndarray, options: DesignOptions) -> list[tuple[str, float, np.ndarray]]:
    dt, limits, rate_limits = options.dt, options.limits or {}, options.rate_limits or {}
    for name, value in [*limits.items(), *rate_limits.items()]:
        if not value > 0.0:
            raise ModelError(f"the limit on '{name}' must be above zero; found {value}.")
    s = model.system
    # Without bias and reference: the change of the motion due to the input.
    y, x = simulate_linear(s.A, s.B, s.C, s.D, u, dt, delay=s.delay, hold=options.hold, return_states=True)
    made: dict[str, np.ndarray] = {name: x[:, :, i] for i, name in enumerate(s.states)}
    made |= {name: y[:, :, i] for i, name in enumerate(s.outputs)}
    made |= {name: u[:, :, i] for i, name in enumerate(s.inputs)}
    if "V" not in made and "u" in s.states:
        made["V"] = made["u"]
    for angle, velocity in _BY_SPEED.items():
        if angle not in made and velocity in s.states and "V" in model.condition:
            made[angle] = x[:, :, s.states.index(velocity)] / model.condition["V"]
    found = []
    for name, value in limits.items():
        if name not in made:
            raise ModelError(f"'{model.name}' has no '{name}' to limit; it has {', '.join(made)}.")
        found.append((name, value, made[name]))
    for name, value in rate_limits.items():
        if name not in s.inputs:
            raise ModelError(f"'{model.name}' has no input '{name}' whose rate to limit; it has {', '.join(s.inputs)}.")
        found.append((f"rate of {name}", value, np.diff(made[name], axis=1) / dt))
    return found
