"""Dynamics in a model: states that follow a channel with a lag, a delay, limits, or as a separation point.

The kinds, each starting at rest on the first sample::

    lag          tau y' + y = x
    delay        y(t) = x(t - tau)
    rate limit   y' = x', no faster than `rate`
    backlash     y stays until x has moved half of `width` beyond it
    stops        y = x between `low` and `high`
    separation   tau1 y' + y = (1 - tanh(a1 (x - tau2 x' - alpha_star))) / 2

x is the input. A lag or a delay may be given as the `distance` [m] that the air travels, instead of `tau` [s]. With a
`fraction` other than 1 the state is x + fraction (y - x). The separation point, 1 attached to 0 stalled, is that of
[GK94].
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from structsel.candidates.formula import Node, evaluate, get_channel
from structsel.candidates.parse import parse_formula
from structsel.deprecation import renamed_value
from structsel.errors import ChannelError, ModelError
from structsel.formatting import finite_or_none
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import actuate, delayed, steady_formula
from structsel.results import Copied

_PARAMETERS: dict[str, tuple[frozenset[str], ...]] = {
    "lag": (frozenset({"tau"}), frozenset({"distance"})),
    "delay": (frozenset({"tau"}), frozenset({"distance"})),
    "rate limit": (frozenset({"rate"}),),
    "backlash": (frozenset({"width"}),),
    "stops": (frozenset({"low"}), frozenset({"high"}), frozenset({"low", "high"})),
    "separation": (frozenset({"tau1", "tau2", "a1", "alpha_star"}),),
}
KINDS = tuple(_PARAMETERS)
"""Kinds of states."""
_OLD_PARAMETERS = {"way": "distance", "share": "fraction", "sharpness": "a1", "onset": "alpha_star"}
_ABOVE_ZERO = ("tau", "distance", "rate", "width", "tau1", "a1")
_LINEAR = ("lag", "delay", "separation")


@dataclass(frozen=True)
class Quantity:
    """One parameter of a state.

    Attributes
    ----------
    value : float
    std : float
        Standard deviation; nan where it is not known.
    unit : str
    """

    value: float
    std: float = math.nan
    unit: str = ""


@dataclass(frozen=True, eq=False)
class State(Copied):
    """One state: what it follows, and how.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    input : str
        Channel that it follows.
    parameters : mapping of name to Quantity

    Raises
    ------
    ModelError
        A kind that there is not, parameters that are not the kind's, or a value that cannot be.
    """

    kind: str
    input: str
    parameters: Mapping[str, Quantity] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in _PARAMETERS:
            raise ModelError(f"There is no state of kind '{self.kind}'; there are {', '.join(KINDS)}.")
        held = {name: q if isinstance(q, Quantity) else Quantity(**q) for name, q in self.parameters.items()}
        held = {renamed_value("parameter", name, _OLD_PARAMETERS): q for name, q in held.items()}
        given = set(held) - ({"fraction"} if self.kind != "separation" else set())
        if given not in _PARAMETERS[self.kind]:
            allowed = " or ".join(", ".join(sorted(names)) for names in _PARAMETERS[self.kind])
            raise ModelError(f"A {self.kind} has the parameters {allowed}; it was given {', '.join(held) or 'none'}.")
        for name, q in held.items():
            if not math.isfinite(q.value) or (name in _ABOVE_ZERO and not q.value > 0.0):
                need = "above zero" if name in _ABOVE_ZERO else "finite"
                raise ModelError(f"{name} of a {self.kind} is {q.value:g} {q.unit}; it must be {need}.")
        if {"low", "high"} <= held.keys() and not held["low"].value < held["high"].value:
            raise ModelError(f"Stops at {held['low'].value:g} and {held['high'].value:g} leave nothing between them.")
        object.__setattr__(self, "parameters", MappingProxyType(held))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy does not pickle
        return State, (self.kind, self.input, dict(self.parameters))

    def __eq__(self, other: object) -> bool:
        return self.to_dict() == other.to_dict() if isinstance(other, State) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __getitem__(self, name: str) -> float:
        return self.parameters[name].value

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels it is worked out from, the input first."""
        rate = (f"{self.input}_dot",) if self.kind == "separation" else ()
        return (self.input, *rate, *(("V",) if self.by_distance else ()))

    @property
    def is_linear(self) -> bool:
        """Whether it is a lag or a delay of a formula, which `simulate` can integrate with the motion."""
        return self.kind in _LINEAR

    def along(self, t: Array, held: Mapping[str, Array], *, hold: bool = False) -> Array:
        """State along a flight.

        Parameters
        ----------
        t : (n,) array [s]
        held : mapping of channel to (n,) array
            Those of `channels`.
        hold : bool
            Input held from sample to sample; otherwise linear between them.

        Returns
        -------
        (n,) array
        """
        clock, x = self.clock(t, held), np.asarray(evaluate(self.input_formula, held, self.kind), dtype=float)
        if self.kind == "delay":
            y = delayed(x, clock, self.time_constant, hold=hold)
        else:
            y = actuate(clock, x, hold=hold, **self._actuator)
        return x + self.fraction * (y - x) if "fraction" in self.parameters else y

    def clock(self, t: Array, held: Mapping[str, Array]) -> Array:
        """What its time constant or delay is counted in: time [s], or the distance travelled through the air [m]."""
        return np.asarray(scipy.integrate.cumulative_trapezoid(held["V"], t, initial=0.0)) if self.by_distance else t

    @property
    def input_formula(self) -> Node:
        """Formula of what the state follows."""
        if self.kind != "separation":
            return Node("channel", name=self.input)
        return parse_formula(self._flow(f"{self.input} - {self['tau2']!r}*{self.input}_dot"))

    def quasi_steady(self) -> Node:
        """Formula of the state where nothing changes."""
        x = self.input
        if self.kind == "separation":
            return parse_formula(self._flow(x))
        if self.kind != "stops":
            return parse_formula(x)
        low, high = (f"({self[name]!r})" if name in self.parameters else "" for name in ("low", "high"))
        within = f"{low} + ({x} - {low})+" if low else x
        within += f" - ({x} - {high})+" if high else ""
        return parse_formula(
            f"{x} + ({self['fraction']!r})*({within} - {x})" if "fraction" in self.parameters else within
        )

    @property
    def fraction(self) -> float:
        """Fraction f of the state in its value x + f (y - x)."""
        return self["fraction"] if "fraction" in self.parameters else 1.0

    @property
    def by_distance(self) -> bool:
        """Whether its time constant or delay is a distance travelled through the air [m]."""
        return "distance" in self.parameters

    @property
    def time_constant(self) -> float:
        """Time constant or delay [s], or distance [m]."""
        return next(self[name] for name in ("tau", "distance", "tau1") if name in self.parameters)

    @property
    def _actuator(self) -> dict[str, float]:
        names = {"rate": "rate", "width": "backlash", "low": "low", "high": "high"}
        made = {names[n]: q.value for n, q in self.parameters.items() if n in names}
        return made or {"lag": self.time_constant}

    def _flow(self, angle: str) -> str:
        return steady_formula(angle, self["a1"], self["alpha_star"])

    def to_dict(self) -> dict[str, Any]:
        """For model.json."""
        return {
            "kind": self.kind,
            "input": self.input,
            "parameters": {
                name: {"value": q.value, "std": finite_or_none(q.std), "unit": q.unit}
                for name, q in self.parameters.items()
            },
        }

    def __str__(self) -> str:
        parts = [
            f"{name} {q.value:.4g}" + (f" +- {q.std:.1g}" if math.isfinite(q.std) else "") + f" {q.unit}".rstrip(" -")
            for name, q in self.parameters.items()
        ]
        return f"{self.kind} of {self.input}, {', '.join(parts)}"


class RecordingWithStates:
    """A recording, or a mapping of arrays, with the states of a model as channels.

    Parameters
    ----------
    source : Recording or mapping of name to (n,) array
        With the clock ``t``.
    states : mapping of name to State
    known : dict
        States computed so far, added to.

    Raises
    ------
    ChannelError, DataError
        There is no clock, or a channel is missing or not finite.
    """

    def __init__(self, source: Any, states: Mapping[str, State], known: dict[Any, Array]):
        self._source, self._made = source, {}
        for name, state in states.items():
            if ("state", name) not in known:
                held = {c: get_channel(source, c, name) for c in state.channels}
                known["state", name] = state.along(_clock_of(source, name), held)
            self._made[name] = known["state", name]

    @property
    def name(self) -> Any:
        """Of the source; None where it has none."""
        return getattr(self._source, "name", None)

    @property
    def names(self) -> tuple[str, ...]:
        """Channels, the states last."""
        own = self._source if isinstance(self._source, Mapping) else getattr(self._source, "names", ())
        return (*own, *self._made)

    def __contains__(self, name: object) -> bool:
        return name in self._made or name in self._source

    def __getitem__(self, name: str) -> Array:
        return self._made[name] if name in self._made else self._source[name]

    def __len__(self) -> int:
        return len(next(iter(self._made.values())))


def _clock_of(source: Any, state: str) -> Array:
    t = getattr(source, "t", None)
    if t is None and "t" in source:
        t = source["t"]
    if t is None:
        raise ChannelError(f"The model's state '{state}' needs the clock 't' [s]; the source has none. Add it.")
    return np.asarray(t, dtype=float)
