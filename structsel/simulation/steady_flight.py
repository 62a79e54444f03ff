"""Trim: a steady flight, as it was found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import scipy

from structsel.errors import ChannelError
from structsel.formatting import format_number
from structsel.nomenclature import is_known, unit_of
from structsel.numerics.air_data import air_data, body_velocity
from structsel.numerics.atmosphere import G0
from structsel.numerics.flight_model import STATES
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

EQUATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot", "climb")
"""Quantities that are zero in a steady flight: accelerations, and the error of the rate of climb."""
_ANGLES = ("alpha", "beta", "phi", "theta", "p", "q", "r")


def _degrees(name: str, value: float) -> str:
    return f"{math.degrees(value):.3f}" if unit_of(name) in ("rad", "rad/s") else ""


@dataclass(frozen=True, eq=False, repr=False)
class Trim(Result):
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
        Residual of each equation: accelerations [m/s^2, rad/s^2] and rate of climb [m/s].
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
        V, alpha, beta = (float(x) for x in air_data(*self.state[:3]))
        states = dict(zip(STATES, self.state.tolist()))
        return {"V": V, "alpha": alpha, "beta": beta, **states, **self.controls, **self.outputs}

    def to_frame(self) -> pd.DataFrame:
        """One row: the content of `to_dict`."""
        import pandas as pd

        return pd.DataFrame([self.to_dict()])

    def summary(self) -> Summary:
        """States and controls of the steady flight, angles in degrees too."""
        values = self.to_dict()
        facts = [("V", f"{format_number(values['V'])} m/s"), ("h", f"{format_number(values['h'])} m")]
        facts += [("climb", f"{math.degrees(self.climb):.4g} deg")] * bool(self.climb)
        facts += [("turn", f"{math.degrees(self.turn_rate):.4g} deg/s")] * bool(self.turn_rate)
        shown = [n for n in _ANGLES if values[n] or n in ("alpha", "theta")]
        rows = [(n, values[n], unit_of(n), _degrees(n, values[n]), "") for n in shown]
        for name, value in self.controls.items():
            unit = unit_of(name) if is_known(name) else ""
            rows.append((name, value, unit, _degrees(name, value), "found" if name in self.free else "given"))
        columns = (text_column("quantity"), Column("value"), text_column("unit"), Column("degrees"), text_column(""))
        worst = max(self.unbalance, key=lambda name: abs(self.unbalance[name]))
        return Summary(
            "Trim",
            "steady flight",
            facts=tuple(facts),
            tables=(Table(columns, tuple(rows)),),
            notes=(f"unbalanced at most {abs(self.unbalance[worst]):.1g} in {worst}",),
        )


class TrimPlant(Protocol):
    """What is trimmed: anything that accelerates at given states and controls."""

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of the controls."""
        ...

    def accelerations(self, state: np.ndarray, controls: Mapping[str, float]) -> np.ndarray:
        """(7,) derivatives of u, v, w, p, q, r, and the rate of climb through the air [m/s]."""
        ...


@dataclass(frozen=True, eq=False)
class TrimProblem:
    """Unknowns and equations of a steady flight.

    Attributes
    ----------
    plant : TrimPlant
    V, h : float [m/s, m]
    unknowns : tuple of str
        Of alpha, beta, theta, phi, turn_rate, climb and the controls.
    fixed : mapping of str to float
        The others.
    rows : (k,) int array
        Which of `EQUATIONS` are to be satisfied.
    scale : (u,) array
        Unknowns are solved for in units of this.
    limits : (u, 2) array
        In these units.
    """

    plant: TrimPlant
    V: float
    h: float
    unknowns: tuple[str, ...]
    fixed: Mapping[str, float]
    rows: np.ndarray
    scale: np.ndarray
    limits: np.ndarray

    def values(self, z: np.ndarray) -> dict[str, float]:
        """Every quantity of the flight by name, for scaled unknowns (u,)."""
        return {**self.fixed, **dict(zip(self.unknowns, (z * self.scale).tolist()))}

    def state(self, z: np.ndarray) -> np.ndarray:
        """(12,) state."""
        held = self.values(z)
        phi, theta, turn = held["phi"], held["theta"], held["turn_rate"]
        velocity = [float(x) for x in body_velocity(self.V, held["alpha"], held["beta"])]
        rates = [
            0.0 - turn * math.sin(theta),
            turn * math.sin(phi) * math.cos(theta),
            turn * math.cos(phi) * math.cos(theta),
        ]
        return np.array([*velocity, *rates, phi, theta, 0.0, 0.0, 0.0, self.h])

    def controls(self, z: np.ndarray) -> dict[str, float]:
        """Controls of the plant."""
        held = self.values(z)
        return {c: held[c] for c in self.plant.controls}

    def imbalance(self, z: np.ndarray) -> np.ndarray:
        """(7,) residuals of `EQUATIONS`: accelerations, and the error of the rate of climb."""
        left = np.array(self.plant.accelerations(self.state(z), self.controls(z)), dtype=float)
        left[6] -= self.V * math.sin(self.values(z)["climb"])
        return left

    def relative(self, left: np.ndarray) -> np.ndarray:
        """(k,) the imbalance of the rows in g, rad/s^2 and V."""
        return (left / np.array([G0, G0, G0, 1.0, 1.0, 1.0, self.V]))[self.rows]

    def residual(self, z: np.ndarray) -> np.ndarray:
        """(k,) as `relative`, large where the plant gives no finite value."""
        left = self.relative(self.imbalance(z))
        return np.where(np.isfinite(left), left, 1e3)

    def nearest(self, first: np.ndarray, *, tolerance: float, evaluations: int, **difference: Any) -> Any:
        """Least squares within the limits; `difference` are options of `scipy.optimize.least_squares`."""
        return scipy.optimize.least_squares(
            self.residual, first, bounds=(self.limits[:, 0], self.limits[:, 1]), x_scale=0.1, xtol=tolerance,
            ftol=tolerance, gtol=tolerance, max_nfev=evaluations, **difference,
        )  # fmt: skip

    def solution(self, z: np.ndarray, outputs: Mapping[str, float]) -> Trim:
        """The steady flight of scaled unknowns."""
        held, controls = self.values(z), self.controls(z)
        free = tuple(c for c in self.unknowns if c in controls)
        left = dict(zip(EQUATIONS, self.imbalance(z).tolist()))
        return Trim(self.state(z), controls, free, held["climb"], held["turn_rate"], left, outputs)
