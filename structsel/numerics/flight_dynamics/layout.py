"""The order of every vector the compiled flight works on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import ChannelError
from structsel.numerics import flight_path
from structsel.numerics.rigid_body import STATES

AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
"""Rows of the coefficients; with wind axes CD stands in the place of CX and CL in that of CZ."""
CHANNELS = (
    *("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h"),
    *("V", "alpha", "beta", "rho", "qbar", "mach", "alpha_dot_hat", "beta_dot_hat"),
)
"""First slots of the program: velocity and rates relative to the air (gusts included), attitude, position, air data.
The controls follow. The last two hold 1: what multiplies them is the derivative with respect to the rate."""
SURROUNDINGS = (
    *("mass", "Ix", "Iy", "Iz", "Ixz", "Ixy", "Iyz"),
    *("u_gust", "v_gust", "w_gust", "p_gust", "q_gust", "r_gust"),
    "rho",
)
"""What is known sample by sample and no control: mass and inertia, motion of the air in body axes [m/s, rad/s], and
the density, NaN where the standard atmosphere's is meant. Always linear between samples."""
VANES = ("Cup", "Calpha0", "Csi", "Cbeta0", "KV")
"""Upwash scale and offset, sidewash scale and offset, scale error of the airspeed; see `numerics.flight_path`."""
_TRUE = (
    *("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h"),
    *("V", "alpha", "beta", "ax", "ay", "az", "p_dot", "q_dot", "r_dot", "alpha_dot", "beta_dot", "V_dot"),
    *("vn", "ve", "vd", "rho", "qbar", "mach", "thrust", "mass", *AXES),
)
READINGS = (*flight_path.MEASUREMENTS, "ax", "ay", "az")
"""What instruments read at their places, without noise: air data at the vanes, acceleration at the accelerometer,
height at the static port, ground position and velocity at the antenna."""
OUTPUTS = (*_TRUE, *(f"{name} at instrument" for name in READINGS))
"""Columns `fly_batch` can observe: at the centre of gravity (u, v, w relative to the air), then at the instruments."""
FIRST_READING = len(_TRUE)
REASONS = (
    "flew to the end",
    "a state is no longer finite",
    "the airspeed fell to zero",
    "the pitch attitude reached 90 degrees",
    "the altitude left the standard atmosphere (-5 to 32 km)",
)
"""Why a flight stopped, by number."""


def outputs_index(names: Sequence[str], *, instruments: bool = False) -> np.ndarray:
    """(c,) int array: columns of `OUTPUTS` of these channels.

    Parameters
    ----------
    names : sequence of str
    instruments : bool
        As the instruments at their places read them, for those in `READINGS`; the rest are true values.

    Raises
    ------
    ChannelError
        For a channel that no flight gives.
    """
    found = []
    for name in names:
        if name not in _TRUE:
            raise ChannelError(f"A flight gives no output {name!r}.\nIt gives: {', '.join(_TRUE)}.")
        found.append(FIRST_READING + READINGS.index(name) if instruments and name in READINGS else _TRUE.index(name))
    return np.array(found, dtype=np.int64)


__all__ = [
    "AXES",
    "CHANNELS",
    "FIRST_READING",
    "OUTPUTS",
    "READINGS",
    "REASONS",
    "STATES",
    "SURROUNDINGS",
    "VANES",
    "outputs_index",
]
