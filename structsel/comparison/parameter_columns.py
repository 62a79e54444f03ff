"""What a stated constant of the aircraft that is off adds to measured less simulated."""

from __future__ import annotations

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.sensitivity import misread
from structsel.nomenclature import FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import Three, air_data_at_cg
from structsel.numerics.arrays import Array


def mass_columns(f: Flight) -> dict[str, Array]:
    """A mass assumed too large by one part makes the measured forces too large by one part."""
    return {c: x for c, x in zip(FORCE_COEFFICIENTS, f.forces) if c in f.measured}


def inertia_columns(f: Flight, axis: str) -> dict[str, Array]:
    """A moment of inertia assumed too large by one part."""
    if f.aircraft.inertia is None:
        return {}
    tensor = np.array(f.aircraft.inertia.tensor)
    k = ("Ix", "Iy", "Iz").index(axis)
    only = np.zeros((3, 3))
    only[k, k] = tensor[k, k]
    lengths = (f.aircraft.b, f.aircraft.cbar, f.aircraft.b)
    rates = (f["p"], f["q"], f["r"])
    still = (np.zeros(len(f)),) * 3
    qbar = f["qbar"]
    coupling = rb.moment_coefficients(rates, still, qbar, only, f.aircraft.S, f.aircraft.b, f.aircraft.cbar)
    made = dict(zip(MOMENT_COEFFICIENTS, coupling))
    # Angular acceleration as the simulation would have it: the measured one would bring its noise along.
    moment = [
        (f.predicted(c) if c in f.simulated else 0.0) * qbar * f.aircraft.S * x
        for c, x in zip(MOMENT_COEFFICIENTS, lengths)
    ]
    thrust = rb.thrust_moment(f["thrust"], f.aircraft.thrust.offset, f.aircraft.thrust.inclination)
    turning = rb.angular_acceleration(rates, tuple(m + t for m, t in zip(moment, thrust)), tensor)
    name = MOMENT_COEFFICIENTS[k]
    made[name] = made[name] + tensor[k, k] * turning[k] / (qbar * f.aircraft.S * lengths[k])
    return {c: x for c, x in made.items() if c in f.measured}


def offset_columns(f: Flight, k: int) -> dict[str, Array]:
    """The forces acting one chord further along body axis k than assumed."""
    arm = [0.0, 0.0, 0.0]
    arm[k] = f.aircraft.cbar
    l, m, n = np.cross(np.array(arm), np.stack(f.forces, axis=-1)).T
    made = {"Cl": l / f.aircraft.b, "Cm": m / f.aircraft.cbar, "Cn": n / f.aircraft.b}
    return {c: x for c, x in made.items() if c in f.measured}


def thrust_columns(f: Flight) -> dict[str, Array]:
    """Thrust one part larger than recorded."""
    CT = f["CT"]
    X, _, Z = rb.thrust_force(CT, f.aircraft.thrust.inclination)
    l, m, n = rb.thrust_moment(CT, f.aircraft.thrust.offset, f.aircraft.thrust.inclination)
    made = {"CX": X, "CZ": Z, "Cl": l / f.aircraft.b, "Cm": m / f.aircraft.cbar, "Cn": n / f.aircraft.b}
    return {c: x for c, x in made.items() if c in f.measured and np.any(x)}


def accelerometer_moved(f: Flight, k: int, turning: Three | None = None) -> dict[str, Array]:
    """An accelerometer one metre further along body axis k than assumed; with other angular accelerations if given."""
    place = [0.0, 0.0, 0.0]
    place[k] = -1.0  # carrying back over a negative distance carries forth
    turning = turning or (f["p_dot"], f["q_dot"], f["r_dot"])
    still = np.zeros(len(f))
    rates = (f["p"], f["q"], f["r"])
    moved = rb.acceleration_at_cg(still, still, still, rates, turning, place)
    return misread(f, ax=moved[0], ay=moved[1], az=moved[2])


def vane_moved(f: Flight, k: int) -> dict[str, Array]:
    """Vanes and pitot one metre further along body axis k than assumed."""
    place = [0.0, 0.0, 0.0]
    place[k] = -1.0
    V, alpha, beta = air_data_at_cg(f["V"], f["alpha"], f["beta"], f["p"], f["q"], f["r"], place)
    return misread(f, V=V - f["V"], alpha=alpha - f["alpha"], beta=beta - f["beta"])
