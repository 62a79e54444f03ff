"""Trim: a steady flight, as it was found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from structsel.errors import ChannelError
from structsel.nomenclature import unit_of
from structsel.numerics import rigid_body as rb
from structsel.numerics.flight_model import STATES
from structsel.rich_text import opening, to_html


@dataclass(frozen=True, eq=False)
class Trim:
    """A steady flight: constant velocity, rates and controls.

    Attributes
    ----------
    state : (12,) array
        As `structsel.numerics.rigid_body.STATES`.
    controls : mapping of channel to value
        All that the model flies on, those found and those given.
    free : tuple of str
        The controls that were found.
    climb : float [rad]
        Angle of climb.
    turn_rate : float [rad/s]
        Of the heading; positive to the right.
    unbalance : mapping of str to float
        What is left of each equation: accelerations [m/s^2, rad/s^2] and rate of climb [m/s].
    outputs : mapping of channel to value
        What else the flight gives there: ax, az, qbar, CX, ...
    """

    state: np.ndarray
    controls: Mapping[str, float]
    free: tuple[str, ...]
    climb: float
    turn_rate: float
    unbalance: Mapping[str, float]
    outputs: Mapping[str, float]

    def __post_init__(self) -> None:
        state = np.array(self.state, dtype=float)
        state.setflags(write=False)
        object.__setattr__(self, "state", state)
        for name in ("controls", "unbalance", "outputs"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy does not pickle
        parts = (self.state, dict(self.controls), self.free, self.climb, self.turn_rate)
        return Trim, (*parts, dict(self.unbalance), dict(self.outputs))

    def __getitem__(self, name: str) -> float:
        """A state, a control, V, alpha, beta or an output by name.

        Raises
        ------
        ChannelError
            When there is none of that name.
        """
        held = self.to_dict()
        if name not in held:
            raise ChannelError(f"A trim has no '{name}'; it has {', '.join(held)}.")
        return held[name]

    def inputs(self, t: np.ndarray, **departures: Any) -> dict[str, Any]:
        """Inputs for `simulate`: the trimmed controls, and departures from them.

        Parameters
        ----------
        t : (n,) array [s]
        **departures : (n,) array or float
            Added to the trimmed value of the control of that name.

        Raises
        ------
        ChannelError
            A departure of what is no control.
        """
        if unknown := [name for name in departures if name not in self.controls]:
            raise ChannelError(f"The trim has no control '{unknown[0]}'; it has {', '.join(self.controls)}.")
        made = {name: value + np.asarray(departures.get(name, 0.0)) for name, value in self.controls.items()}
        return {"t": t, **made}

    def to_dict(self) -> dict[str, float]:
        """V, alpha, beta, the states, the controls and the outputs."""
        V, alpha, beta = (float(x) for x in rb.air_data(*self.state[:3]))
        states = dict(zip(STATES, self.state.tolist()))
        return {"V": V, "alpha": alpha, "beta": beta, **states, **self.controls, **self.outputs}

    def to_frame(self) -> pd.DataFrame:
        """One row: the content of `to_dict`."""
        return pd.DataFrame([self.to_dict()])

    def __str__(self) -> str:
        held = self.to_dict()
        turn = f", turning {math.degrees(self.turn_rate):.4g} deg/s" if self.turn_rate else ""
        climb = f", climbing {math.degrees(self.climb):.4g} deg" if self.climb else ""
        lines = [f"steady flight at V = {held['V']:.5g} m/s, h = {held['h']:.5g} m{climb}{turn}"]
        for name in ("alpha", "beta", "phi", "theta", "p", "q", "r"):
            unit = unit_of(name)
            lines.append(f"  {name:<6} {held[name]:>12.6g} {unit:<6} {math.degrees(held[name]):>10.4f} deg{unit[3:]}")
        for name, value in self.controls.items():
            found = "found" if name in self.free else "given"
            lines.append(f"  {name:<6} {value:>12.6g} {unit_of(name):<6} {found}")
        worst = max(self.unbalance, key=lambda name: abs(self.unbalance[name]))
        lines.append(f"unbalanced at most {abs(self.unbalance[worst]):.2g} in {worst}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return to_html([{"name": n, "value": x, "unit": unit_of(n)} for n, x in self.to_dict().items()], opening(self))
