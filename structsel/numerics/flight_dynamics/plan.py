"""What flies, and what one manoeuvre does to it, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.errors import DataError, ModelError
from structsel.numerics.atmosphere import G0
from structsel.numerics.expressions import Program
from structsel.numerics.flight_dynamics.layout import STATES, SURROUNDINGS, VANES


class Kernel(NamedTuple):
    """A `FlightPlan` as the compiled loops take it."""

    operation: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    value: NDArray[np.float64]
    inputs: int
    term_slot: NDArray[np.int64]
    term_response: NDArray[np.int64]
    term_rate: NDArray[np.int64]
    thrust_slot: int
    wind_axes: bool
    implicit: bool
    S: float
    b: float
    cbar: float
    direction: NDArray[np.float64]
    arm: NDArray[np.float64]
    rotor: float


@dataclass(frozen=True, eq=False)
class FlightPlan:
    """An aircraft and its aerodynamic terms.

    Attributes
    ----------
    program : Program
        Its inputs are `CHANNELS`, then the controls.
    term_names : tuple of str
        ``"Cm:alpha"``, one for each term of each response.
    term_slot : (T,) int array
        Where the program leaves each term.
    term_response : (T,) int array
        Row of `AXES` it adds to.
    term_rate : (T,) int array
        0, or 1 for a term with alpha_dot_hat, 2 for one with beta_dot_hat.
    values : (T,) array
        Nominal coefficients.
    controls : tuple of str
        Channels given sample by sample, in the order of the program's inputs.
    thrust_slot : int
        Slot of the thrust [N]; -1 where there is none.
    wind_axes : bool
        Whether the first and third response are CD and CL.
    S, b, cbar : float [m^2, m, m]
    direction, arm : (3,) array [-, m]
        Of the thrust: unit vector, and moment about the centre of gravity per newton.
    rotor : float [kg m^2/s]
    """

    program: Program
    term_names: tuple[str, ...]
    term_slot: NDArray[np.int64]
    term_response: NDArray[np.int64]
    term_rate: NDArray[np.int64]
    values: NDArray[np.float64]
    controls: tuple[str, ...]
    S: float
    b: float
    cbar: float
    thrust_slot: int = -1
    wind_axes: bool = False
    direction: NDArray[np.float64] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    arm: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    rotor: float = 0.0

    @property
    def kernel(self) -> Kernel:
        """The arrays, as the compiled loops take them."""
        code = self.program
        return Kernel(
            operation=code.operation,
            left=code.left,
            right=code.right,
            value=code.value,
            inputs=code.inputs,
            term_slot=self.term_slot,
            term_response=self.term_response,
            term_rate=self.term_rate,
            thrust_slot=self.thrust_slot,
            wind_axes=self.wind_axes,
            implicit=bool(self.term_rate.any()),
            S=self.S,
            b=self.b,
            cbar=self.cbar,
            direction=self.direction,
            arm=self.arm,
            rotor=self.rotor,
        )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the full parameter vector."""
        moving = (f"{kind}:{name}" for kind in ("start", "drift") for name in STATES)
        return (*self.term_names, *moving, *(f"bias:{name}" for name in self.controls), "delay", *VANES)

    def parameters(self, flight: Flight) -> NDArray[np.float64]:
        """(P,) full parameter vector of a flight, at its nominal values."""
        return np.concatenate(
            [self.values, flight.start, np.zeros(len(STATES)), flight.biases, [flight.delay], flight.vanes]
        )

    def parameter_index(self, names: Sequence[str]) -> NDArray[np.int64]:
        """(k,) places of parameters in the full vector.

        Raises
        ------
        ModelError
            For a name that is none of `parameter_names`.
        """
        known = {name: i for i, name in enumerate(self.parameter_names)}
        if unknown := [name for name in names if name not in known]:
            raise ModelError(f"There is no parameter {unknown[0]!r}.\nThere are: {', '.join(known)}.")
        return np.array([known[name] for name in names], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Flight:
    """One manoeuvre: its clock, controls, surroundings and start.

    Attributes
    ----------
    t : (n,) array [s]
    controls : (n, c) array
        Columns as `FlightPlan.controls`.
    surroundings : (n, 14) array
        Columns as `SURROUNDINGS`.
    start : (12,) array
        As `STATES`; u, v, w relative to the wind at the start's altitude.
    hold : bool
        Controls held from sample to sample; otherwise linear between them.
    delayed : (c,) bool array
        Controls the delay holds for; all by default.
    delay : float [s]
        The aircraft meets at t what was commanded at t - delay; before the first sample, the first.
    biases : (c,) array
        Added to the controls.
    vanes : (5,) array
        As `VANES`.
    heights : (w,) array [m]
        Where the wind is known, ascending; linear between, constant beyond.
    wind : (w, 3) array [m/s]
        Of the air, north, east, down.
    warmer : float [K]
        Than the standard atmosphere.
    gravity : float [m/s^2]
    places : (6, 3) array [m]
        Of the instruments, rows as `numerics.flight_path.PLACES`.
    flank : bool
        Whether the sideslip vane reads atan(v/u).

    Raises
    ------
    DataError
        Sizes that do not fit, or values that are not finite.
    """

    t: NDArray[np.float64]
    controls: NDArray[np.float64]
    surroundings: NDArray[np.float64]
    start: NDArray[np.float64]
    hold: bool = False
    delayed: NDArray[np.bool_] | None = None
    delay: float = 0.0
    biases: NDArray[np.float64] | None = None
    vanes: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(VANES)))
    heights: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    wind: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    warmer: float = 0.0
    gravity: float = G0
    places: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 3)))
    flank: bool = False

    def __post_init__(self) -> None:
        n, c = len(self.t), self.controls.shape[1]
        if self.biases is None:
            object.__setattr__(self, "biases", np.zeros(c))
        if self.delayed is None:
            object.__setattr__(self, "delayed", np.ones(c, dtype=bool))
        shapes = {
            "controls": (n, c),
            "surroundings": (n, len(SURROUNDINGS)),
            "start": (len(STATES),),
            "biases": (c,),
            "wind": (len(self.heights), 3),
        }
        for name, shape in shapes.items():
            array = np.ascontiguousarray(getattr(self, name), dtype=float)
            if array.shape != shape:
                raise DataError(f"A flight's {name} has shape {array.shape}; it needs {shape}.")
            # An unknown density is the standard atmosphere's.
            finite = np.isfinite(array[:, :-1] if name == "surroundings" else array)
            if not finite.all():
                at = tuple(int(i) for i in np.argwhere(~finite)[0])
                raise DataError(f"A flight's {name} is not finite at {at}. Mend it, or cut the stretch out.")
            object.__setattr__(self, name, array)
