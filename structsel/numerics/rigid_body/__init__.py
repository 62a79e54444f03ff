"""Rigid-body relations between sensors, forces and moments over a flat Earth.

Arrays only, SI and radians, body axes x forward, y right, z down. Every function broadcasts over its
arguments, so time may run along any axis the caller likes; stacked results (a state, a matrix) say where
their own axis is.
"""

from structsel.numerics.atmosphere import G0, standard_atmosphere
from structsel.numerics.rigid_body.air import (
    acceleration_at_cg,
    air_data,
    air_data_at_cg,
    body_to_earth,
    body_velocity,
    nondimensional_rates,
)
from structsel.numerics.rigid_body.loads import (
    angular_acceleration,
    force_coefficients,
    inertia_tensor,
    inertial_moment,
    lift_and_drag,
    moment_coefficients,
    specific_force,
    thrust_force,
    thrust_moment,
)
from structsel.numerics.rigid_body.motion import STATES, euler_rates, state_derivative, velocity_derivative
from structsel.numerics.rigid_body.vectors import require_positive

__all__ = [
    "G0",
    "STATES",
    "acceleration_at_cg",
    "air_data",
    "air_data_at_cg",
    "angular_acceleration",
    "body_to_earth",
    "body_velocity",
    "euler_rates",
    "force_coefficients",
    "inertia_tensor",
    "inertial_moment",
    "lift_and_drag",
    "moment_coefficients",
    "nondimensional_rates",
    "require_positive",
    "specific_force",
    "standard_atmosphere",
    "state_derivative",
    "thrust_force",
    "thrust_moment",
    "velocity_derivative",
]
