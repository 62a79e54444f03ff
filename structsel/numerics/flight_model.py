"""The rigid aircraft and one manoeuvre as arrays, in the order of the compiled flight simulation.

`CompiledAircraft` holds the aircraft: its aerodynamic terms as a `TermProgram`, mass and thrust data, and the states of
the model that have a memory. `ManoeuvreInputs` holds a manoeuvre: time, controls, mass, inertia, gusts, initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.errors import ChannelError, DataError, ModelError
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics import kinematics
from structsel.numerics.atmosphere import G0
from structsel.numerics.expressions import TermProgram
from structsel.numerics.rigid_body import STATES

CHANNELS = (
    *("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h"),
    *("V", "alpha", "beta", "rho", "qbar", "mach", "alpha_dot_hat", "beta_dot_hat"),
)
"""First slots of the program: velocity and rates relative to the air (gusts included), attitude, position, air data.
The controls follow. While the terms are evaluated the last two slots hold 1, so that a term's value is its derivative
with respect to the rate."""
CONDITIONS = (
    *("mass", "Ix", "Iy", "Iz", "Ixz", "Ixy", "Iyz"),
    *("u_gust", "v_gust", "w_gust", "p_gust", "q_gust", "r_gust"),
    "rho",
)
"""Known at each sample and not a control: mass and inertia, velocity and rates of the air in body axes [m/s, rad/s],
density (NaN: that of the standard atmosphere). Always linear between samples."""
VANES = ("Cup", "Calpha0", "Csi", "Cbeta0", "KV")
"""Upwash scale and offset, sidewash scale and offset, scale error of the airspeed; see `numerics.kinematics`."""
_AT_CG = (
    *("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h"),
    *("V", "alpha", "beta", "ax", "ay", "az", "p_dot", "q_dot", "r_dot", "alpha_dot", "beta_dot", "V_dot"),
    *("vn", "ve", "vd", "rho", "qbar", "mach", "thrust", "mass", *COEFFICIENTS),
)
READINGS = (*kinematics.MEASUREMENTS, "ax", "ay", "az")
"""Readings of the instruments at their positions, without noise: air data at the vanes, specific force at the
accelerometer, height at the static port, ground position and velocity at the antenna."""
OUTPUTS = (*_AT_CG, *(f"{name} at instrument" for name in READINGS))
"""Columns that `simulate_batch` can return: at the centre of gravity (u, v, w relative to the air), then at the
instruments."""
FIRST_READING = len(_AT_CG)
REASONS = (
    "the simulation reached its end",
    "a state is no longer finite",
    "the airspeed fell to zero",
    "the pitch attitude reached 90 degrees",
    "the altitude left the standard atmosphere (-5 to 32 km)",
)
"""Reason why a simulation stopped, by number."""

# Indices in STATES, CHANNELS, CONDITIONS and OUTPUTS for the compiled functions.
P, Q, R, PHI, THETA, PSI, HEIGHT = (STATES.index(name) for name in ("p", "q", "r", "phi", "theta", "psi", "h"))
AIRSPEED = CHANNELS.index("V")
ALPHA_DOT_HAT, BETA_DOT_HAT = CHANNELS.index("alpha_dot_hat"), CHANNELS.index("beta_dot_hat")
FIRST_CONTROL = len(CHANNELS)
MASS, INERTIA, GUST, DENSITY = (CONDITIONS.index(name) for name in ("mass", "Ix", "u_gust", "rho"))
OUT_V, OUT_AX, OUT_P_DOT, OUT_ALPHA_DOT, OUT_VN, OUT_RHO, OUT_CX = (
    OUTPUTS.index(name) for name in ("V", "ax", "p_dot", "alpha_dot", "vn", "rho", "CX")
)
OUT_WIND = len(OUTPUTS)  # after the outputs: velocity of the air, gust included, north, east, down
DERIVED = OUT_WIND + 3


def outputs_index(names: Sequence[str], *, instruments: bool = False) -> np.ndarray:
    """(c,) int array: columns of `OUTPUTS` of these channels.

    Parameters
    ----------
    names : sequence of str
    instruments : bool
        Readings at the positions of the instruments, for channels in `READINGS`; the others are true values.

    Raises
    ------
    ChannelError
        For a channel that is not an output of a simulation.
    """
    found = []
    for name in names:
        if name not in _AT_CG:
            raise ChannelError(f"A simulation has no output {name!r}.\nIt has: {', '.join(_AT_CG)}.")
        found.append(FIRST_READING + READINGS.index(name) if instruments and name in READINGS else _AT_CG.index(name))
    return np.array(found, dtype=np.int64)


class Memory(NamedTuple):
    """States of the model with a memory: M first-order lags and delays of what a program computes.

    Attributes
    ----------
    program : TermProgram
        Its inputs are those of the terms' program, with the rates alpha_dot_hat and beta_dot_hat themselves.
    slot : (M,) int array
        Slot of the program with the input x of each state.
    control : (M,) int array
        Control that holds the value of each state.
    is_delay : (M,) bool array
        A delay, y(t) = x(t - constant); otherwise a lag, constant y' + y = x.
    constant : (M,) array
        Time constant or delay [s], or a distance [m] that the aircraft travels through the air.
    by_distance : (M,) bool array
    fraction : (M,) array
        f in the state's value x + f (y - x).
    implicit : bool
        Whether a value depends on a rate, or on another state's value, at the same instant.
    """

    program: TermProgram
    slot: NDArray[np.int64]
    control: NDArray[np.int64]
    is_delay: NDArray[np.bool_]
    constant: NDArray[np.float64]
    by_distance: NDArray[np.bool_]
    fraction: NDArray[np.float64]
    implicit: bool


def no_memory(inputs: int) -> Memory:
    """Memory of a model without such states; `inputs` is the number of inputs of its program."""
    nothing, none, never = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    return Memory(TermProgram(inputs, none, none, none, nothing), none, none, never, nothing, never, nothing, False)


class AircraftArrays(NamedTuple):
    """An aircraft and its aerodynamic terms, as the compiled functions take them.

    Attributes
    ----------
    program : TermProgram
        Its inputs are `CHANNELS`, then the controls.
    term_slot : (T,) int array
        Slot of the program with each term.
    term_response : (T,) int array
        Row of `COEFFICIENTS` it adds to.
    term_rate : (T,) int array
        0, or 1 for a term with alpha_dot_hat, 2 for one with beta_dot_hat.
    implicit : bool
        Whether there is a term with a rate.
    thrust_slot : int
        Slot of the thrust [N]; -1 without thrust.
    wind_axes : bool
        Whether the first and third response are CD and CL.
    S, b, cbar : float [m^2, m, m]
    thrust_direction, thrust_arm : (3,) array [-, m]
        Unit vector, and moment about the centre of gravity per newton.
    rotor_momentum : float [kg m^2/s]
    memory : Memory
    """

    program: TermProgram
    term_slot: NDArray[np.int64]
    term_response: NDArray[np.int64]
    term_rate: NDArray[np.int64]
    implicit: bool
    thrust_slot: int
    wind_axes: bool
    S: float
    b: float
    cbar: float
    thrust_direction: NDArray[np.float64]
    thrust_arm: NDArray[np.float64]
    rotor_momentum: float
    memory: Memory


@dataclass(frozen=True, eq=False)
class CompiledAircraft:
    """An aircraft and its aerodynamic model, ready for the compiled simulation.

    Attributes
    ----------
    arrays : AircraftArrays
    term_names : tuple of str
        ``"Cm:alpha"``, one for each term of each response.
    values : (T,) array
        Nominal coefficients.
    controls : tuple of str
        Channels given at each sample, in the order of the program's inputs.
    """

    arrays: AircraftArrays
    term_names: tuple[str, ...]
    values: NDArray[np.float64]
    controls: tuple[str, ...]

    @property
    def has_thrust(self) -> bool:
        """Whether a thrust is given or defined."""
        return self.arrays.thrust_slot >= 0

    @property
    def memory_names(self) -> tuple[str, ...]:
        """Names of the model's states that the simulation integrates."""
        return tuple(self.controls[i] for i in self.arrays.memory.control)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the full parameter vector."""
        moving = (f"{kind}:{name}" for kind in ("start", "drift") for name in STATES)
        return (*self.term_names, *moving, *(f"bias:{name}" for name in self.controls), "delay", *VANES)

    def parameters(self, manoeuvre: ManoeuvreInputs) -> NDArray[np.float64]:
        """(P,) full parameter vector of a manoeuvre, at its nominal values."""
        m = manoeuvre
        return np.concatenate([self.values, m.start, np.zeros(len(STATES)), m.biases, [m.delay], m.vanes])

    def parameter_index(self, names: Sequence[str]) -> NDArray[np.int64]:
        """(k,) indices of parameters in the full vector.

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
class ManoeuvreInputs:
    """One manoeuvre: time, controls, conditions and initial state.

    Attributes
    ----------
    t : (n,) array [s]
    controls : (n, c) array
        Columns as `CompiledAircraft.controls`.
    conditions : (n, 14) array
        Columns as `CONDITIONS`.
    start : (12,) array
        As `STATES`; u, v, w relative to the wind at the initial altitude.
    hold : bool
        Controls held from sample to sample; otherwise linear between them.
    delayed : (c,) bool array
        Controls that the delay applies to; all by default.
    delay : float [s]
        The aircraft receives at t what was commanded at t - delay; before the first sample, the first.
    biases : (c,) array
        Added to the controls.
    vanes : (5,) array
        As `VANES`.
    heights : (w,) array [m]
        Altitudes of the rows of `wind`, ascending; linear between, constant beyond.
    wind : (w, 3) array [m/s]
        Velocity of the air, north, east, down.
    isa_offset : float [K]
        Temperature above that of the standard atmosphere.
    gravity : float [m/s^2]
    sensor_positions : (6, 3) array [m]
        Rows as `numerics.kinematics.PLACES`.
    flank_angle_vane : bool
        Whether the sideslip vane reads atan(v/u).

    Raises
    ------
    DataError
        Sizes that do not fit, or values that are not finite.
    """

    t: NDArray[np.float64]
    controls: NDArray[np.float64]
    conditions: NDArray[np.float64]
    start: NDArray[np.float64]
    hold: bool = False
    delayed: NDArray[np.bool_] | None = None
    delay: float = 0.0
    biases: NDArray[np.float64] | None = None
    vanes: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(VANES)))
    heights: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    wind: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    isa_offset: float = 0.0
    gravity: float = G0
    sensor_positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 3)))
    flank_angle_vane: bool = False

    def __post_init__(self) -> None:
        n, c = len(self.t), self.controls.shape[1]
        if self.biases is None:
            object.__setattr__(self, "biases", np.zeros(c))
        if self.delayed is None:
            object.__setattr__(self, "delayed", np.ones(c, dtype=bool))
        shapes = {
            "controls": (n, c),
            "conditions": (n, len(CONDITIONS)),
            "start": (len(STATES),),
            "biases": (c,),
            "wind": (len(self.heights), 3),
        }
        for name, shape in shapes.items():
            array = np.ascontiguousarray(getattr(self, name), dtype=float)
            if array.shape != shape:
                raise DataError(f"A manoeuvre's {name} has shape {array.shape}; it needs {shape}.")
            # An unknown density is the standard atmosphere's.
            finite = np.isfinite(array[:, :DENSITY] if name == "conditions" else array)
            if not finite.all():
                at = tuple(int(i) for i in np.argwhere(~finite)[0])
                raise DataError(f"A manoeuvre's {name} is not finite at {at}. Interpolate it, or cut that part out.")
            object.__setattr__(self, name, array)
