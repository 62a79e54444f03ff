"""What is compared: coefficients, and how well the instruments agree with each other.

A recording says twice what the aircraft did: its forces and moments, to be set against a simulation's, and the rates
of its states, which kinematics ties to other channels whatever the air does. The second kind, named ``k_V``,
``k_alpha``, ... shows what is wrong with an instrument, or with the air, and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from structsel.aircraft import Aircraft
from structsel.nomenclature import COEFFICIENTS, FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import Three, air_data, body_velocity, cross, flow_angle_rates
from structsel.numerics.arrays import Array
from structsel.numerics.differentiation import difference_weights

KINEMATIC = {
    "k_V": ("V", "ax", "theta"),
    "k_alpha": ("V", "alpha", "q", "az", "theta"),
    "k_beta": ("V", "beta", "p", "r", "ay", "phi"),
    "k_phi": ("phi", "theta", "p", "q", "r"),
    "k_theta": ("theta", "phi", "q"),
    "k_psi": ("psi", "phi", "theta", "q", "r"),
    "k_h": ("h", "V", "alpha", "theta"),
    "k_vn": ("vn", "V", "alpha", "theta", "psi"),
    "k_ve": ("ve", "V", "alpha", "theta", "psi"),
    "k_vd": ("vd", "V", "alpha", "theta"),
}
"""Kinematic responses, and the channels that each cannot do without."""

KINEMATIC_UNIT = {
    "k_V": "m/s^2", "k_h": "m/s", "k_vn": "m/s", "k_ve": "m/s", "k_vd": "m/s",
}  # fmt: skip
"""Those not in rad/s."""


_STENCIL = difference_weights(tuple(range(-3, 4)))
_AT_START = np.array([difference_weights(tuple(range(-i, 5 - i))) for i in range(3)])


class Rate:
    """Time derivative of arrays on one even clock, of sixth order: within 1 % up to a sixth of the sampling rate.

    Of fourth order at the three samples next to either end.
    """

    def __init__(self, dt: float):
        self.dt = dt

    def __call__(self, x: Array) -> Array:
        """Derivative of (n,) or (n, k) samples [unit of x / s]."""
        made = np.empty_like(x, dtype=float)
        made[:3] = _AT_START @ x[:5]
        made[-3:] = -(_AT_START @ x[:-6:-1])[::-1]
        for column, rate in [(x, made)] if x.ndim == 1 else zip(x.T, made.T):
            rate[3:-3] = np.correlate(column, _STENCIL, "valid")
        made /= self.dt
        return made


def respond(ch: Mapping[str, Array], aircraft: Aircraft, dt: float, wanted: tuple[str, ...]) -> dict[str, Array]:
    """Coefficients and kinematic residuals of channels taken at their word.

    Parameters
    ----------
    ch : mapping of channel to (n,) or (n, k) array [SI]
        ``V alpha beta p q r phi theta psi ax ay az`` (zero where the recording has none), ``p_dot q_dot r_dot``,
        ``qbar_ratio`` (qbar over 0.5 rho V^2), ``rho``, ``thrust``, ``mass``, and ``h vn ve vd`` as far as wanted.
    aircraft : Aircraft
    dt : float [s]
    wanted : tuple of str
        Names among `COEFFICIENTS` and `KINEMATIC`.
    """
    d = Rate(dt)
    made: dict[str, Array] = {}
    rates = (ch["p"], ch["q"], ch["r"])
    turning = (ch["p_dot"], ch["q_dot"], ch["r_dot"])
    at_vane = body_velocity(ch["V"], ch["alpha"], ch["beta"])
    u, v, w = (x - turned for x, turned in zip(at_vane, cross(rates, aircraft.position("vane"))))
    V, alpha, beta = air_data(u, v, w)
    force = rb.acceleration_at_cg(ch["ax"], ch["ay"], ch["az"], rates, turning, aircraft.position("accelerometer"))
    qbar = ch["qbar_ratio"] * 0.5 * ch["rho"] * V**2
    if any(name in wanted for name in COEFFICIENTS[:3]):
        made |= zip(
            FORCE_COEFFICIENTS,
            rb.force_coefficients(*force, qbar, ch["mass"], aircraft.S, ch["thrust"], aircraft.thrust.inclination),
        )
    if aircraft.inertia is not None and any(name in wanted for name in COEFFICIENTS[3:]):
        made |= zip(
            MOMENT_COEFFICIENTS,
            rb.moment_coefficients(
                rates, turning, qbar, aircraft.inertia.tensor, aircraft.S, aircraft.b, aircraft.cbar, ch["thrust"],
                aircraft.thrust.offset, aircraft.thrust.inclination, aircraft.engine.angular_momentum,
            ),
        )  # fmt: skip
    if any(name in wanted for name in KINEMATIC):
        made |= _kinematics(ch, d, (u, v, w), {"V": V, "alpha": alpha, "beta": beta}, force)
    return {name: made[name] for name in wanted}


def predicted_rates(ch: Mapping[str, Array], velocity: Three, force: Three) -> dict[str, Array]:
    """Rates of V, alpha, beta and of the Euler angles predicted from specific force and body rates.

    Parameters
    ----------
    ch : mapping of channel to (n,) array
    velocity : u, v, w at the centre of gravity
    force : specific force there
    """
    rates = (ch["p"], ch["q"], ch["r"])
    turning = rb.velocity_derivative(velocity, rates, force, ch["phi"], ch["theta"])
    alpha_dot, beta_dot, V_dot = flow_angle_rates(*velocity, *turning)
    turned = rb.euler_rates(*rates, ch["phi"], ch["theta"])
    return {
        "V": V_dot,
        "alpha": alpha_dot,
        "beta": beta_dot,
    } | dict(zip(("phi", "theta", "psi"), turned))


def _kinematics(
    ch: Mapping[str, Array], d: Rate, velocity: Three, air: Mapping[str, Array], force: Three
) -> dict[str, Array]:
    phi, theta, psi = ch["phi"], ch["theta"], ch["psi"]
    predicted = predicted_rates(ch, velocity, force)
    read = {**air, "phi": phi, "theta": theta, "psi": psi}
    made = {f"k_{name}": d(x) - predicted[name] for name, x in read.items()}
    u, v, w = velocity
    right, below = np.cos(phi) * v - np.sin(phi) * w, np.sin(phi) * v + np.cos(phi) * w
    ahead, down = np.cos(theta) * u + np.sin(theta) * below, np.cos(theta) * below - np.sin(theta) * u
    if "h" in ch:
        made["k_h"] = d(ch["h"]) + down
    if "vn" in ch:
        made["k_vn"] = ch["vn"] - (np.cos(psi) * ahead - np.sin(psi) * right)
    if "ve" in ch:
        made["k_ve"] = ch["ve"] - (np.sin(psi) * ahead + np.cos(psi) * right)
    if "vd" in ch:
        made["k_vd"] = ch["vd"] - down
    return made
