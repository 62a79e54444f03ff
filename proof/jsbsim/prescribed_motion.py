"""Coefficients of a simulation with given aerodynamic functions along a flight, all samples at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from proof.jsbsim.aircraft import FT, LBF, JSBSimPlant
from proof.jsbsim.flight import TruthFlight
from proof.jsbsim.functions import AXES, CL_SQUARED, H_B, AeroFunction, evaluate

SEEN = ("V", "alpha", "beta", "p", "q", "r", "h", "de", "da", "dr")
"""Channels at which a simulation may be computed with other values than the true ones."""


def functions_with(plant: JSBSimPlant, changed: Sequence[AeroFunction] = ()) -> tuple[AeroFunction, ...]:
    """The aircraft's parts, with some in place of those of the same name."""
    new = {function.name: function for function in changed}
    return tuple(new.get(function.name, function) for function in plant.functions)


def coefficients(
    plant: JSBSimPlant,
    flight: TruthFlight,
    functions: Sequence[AeroFunction],
    off: Mapping[str, np.ndarray] | None = None,
) -> np.ndarray:
    """CX, CY, CZ, Cl, Cm, Cn (n, 6) of everything but gravity and the declared thrust.

    Parameters
    ----------
    plant : JSBSimPlant
    flight : TruthFlight
    functions : sequence of AeroFunction
        All of them; see `functions_with`.
    off : mapping of channel to (n,) array
        Errors of the states, for the channels of `SEEN`: of a reconstruction, of a faulty sensor.
    """
    off = off or {}
    values, qbar, alpha, beta = _values(plant, flight, off)
    made = _axes(functions, values)
    lift = made["LIFT"]
    plain = lift if not off and tuple(functions) == plant.functions else None
    if any(CL_SQUARED in function.reads() for function in functions) and plain is None:
        # JSBSim's is of the step before; the difference that the simulation makes is added to it.
        base, q0, *_ = _values(plant, flight, {})
        area = plant.aircraft.S / FT**2
        before = (_axes(plant.functions, base)["LIFT"] / (q0 / LBF * FT**2 * area)) ** 2
        after = (lift / (qbar / LBF * FT**2 * area)) ** 2
        values[CL_SQUARED] = values[CL_SQUARED] + after - before
        made = _axes(functions, values)
    force, moment = _body(plant, made, alpha, beta)
    rest_force, rest_moment = _rest(plant, flight)
    lengths = np.array([plant.aircraft.b, plant.aircraft.cbar, plant.aircraft.b])
    qS = (qbar * plant.aircraft.S)[:, None]
    q0S = (flight["qbar"] * plant.aircraft.S)[:, None]
    return np.hstack([force / qS + rest_force / q0S, (moment / qS + rest_moment / q0S) / lengths])


def contributions(plant: JSBSimPlant, flight: TruthFlight, functions: Sequence[AeroFunction]) -> dict[str, np.ndarray]:
    """Each part of an axis, as a coefficient of its own axis (n,)."""
    values, qbar, *_ = _values(plant, flight, {})
    scale = qbar * plant.aircraft.S / LBF
    arms = {"ROLL": plant.aircraft.b, "PITCH": plant.aircraft.cbar, "YAW": plant.aircraft.b}
    made = {}
    for function in functions:
        found = evaluate(function.node, values) + np.zeros(len(flight.t))
        if function.axis:
            made[function.name] = found / (scale * arms.get(function.axis, 1.0 * FT) / FT)
        else:
            values[function.name] = found
    return made


def _rest(plant: JSBSimPlant, flight: TruthFlight) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment of neither aerodynamics nor declared thrust nor extras: what a propeller does besides."""
    line = plant.aircraft.thrust
    qS = (flight["qbar"] * plant.aircraft.S)[:, None]
    lengths = np.array([plant.aircraft.b, plant.aircraft.cbar, plant.aircraft.b])
    thrust = flight["thrust"][:, None]
    force = np.column_stack([flight[f"F{c}"] - flight[f"A{c}"] for c in "xyz"]) - thrust * line.direction
    moment = np.column_stack([flight[f"M{c}"] - flight[f"A{c}"] for c in "lmn"]) - thrust * line.arm
    return force - flight.extra[:, :3] * qS, moment - flight.extra[:, 3:] * qS * lengths


def _axes(functions: Sequence[AeroFunction], values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    made = {axis: np.zeros(len(values["n"])) for axis in AXES}
    for function in functions:
        found = evaluate(function.node, values)
        if function.axis:
            made[function.axis] = made[function.axis] + found
        else:
            values[function.name] = found + np.zeros(len(values["n"]))
    return made


def _body(
    plant: JSBSimPlant, made: Mapping[str, np.ndarray], alpha: np.ndarray, beta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force [N], and moment [N m] about the centre of gravity."""
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    D, Y, L = -made["DRAG"] * LBF, made["SIDE"] * LBF, -made["LIFT"] * LBF
    force = np.column_stack([ca * cb * D - ca * sb * Y - sa * L, sb * D + cb * Y, sa * cb * D - sa * sb * Y + ca * L])
    about = np.column_stack([made[a] for a in ("ROLL", "PITCH", "YAW")]) * LBF * FT
    return force, about + np.cross(plant.reference_points["aerodynamic"], force)


def _values(
    plant: JSBSimPlant, flight: TruthFlight, off: Mapping[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Properties at the states as seen; qbar, alpha, beta there."""
    values = dict(flight.properties)
    values["n"] = flight.t
    V, alpha, beta = (flight[c] + off.get(c, 0.0) for c in ("V", "alpha", "beta"))
    qbar = 0.5 * flight["rho"] * V * V
    if not off:
        return values, qbar, alpha, beta
    faster = V / flight["V"]
    delayed = np.gradient(flight["alpha"] + off["alpha"], flight.t) - np.gradient(flight["alpha"], flight.t) \
        if "alpha" in off else 0.0  # fmt: skip
    more = {
        "aero/alpha-rad": off.get("alpha", 0.0), "aero/alpha-deg": np.degrees(off.get("alpha", 0.0)),
        "aero/alpha-wing-rad": off.get("alpha", 0.0),
        "aero/beta-rad": off.get("beta", 0.0), "aero/beta-deg": np.degrees(off.get("beta", 0.0)),
        "aero/alphadot-rad_sec": delayed, H_B: off.get("h", 0.0) / plant.aircraft.b,
        **{f"velocities/{c}{kind}-rad_sec": off.get(c, 0.0) for c in "pqr" for kind in ("", "-aero")},
        "fcs/left-aileron-pos-rad": plant.machine.senses["da"] * off.get("da", 0.0),
        "fcs/right-aileron-pos-rad": -plant.machine.senses["da"] * off.get("da", 0.0),
        "fcs/elevator-pos-rad": plant.machine.senses["de"] * off.get("de", 0.0),
        "fcs/rudder-pos-rad": plant.machine.senses["dr"] * off.get("dr", 0.0),
    }  # fmt: skip
    for name, change in more.items():
        if name in values:
            values[name] = values[name] + change
    for name, of in (("aero/mag-beta-rad", beta), ("fcs/mag-elevator-pos-rad", flight_surface(flight, off))):
        if name in values:
            values[name] = np.abs(of)
    times = {
        "aero/qbar-psf": faster**2, "aero/qbar-area": faster**2, "aero/bi2vel": 1.0 / faster, "aero/ci2vel": 1 / faster,
        "velocities/mach": faster, "aero/Re": faster, "velocities/u-aero-fps": faster, "velocities/w-aero-fps": faster,
    }  # fmt: skip
    for name, factor in times.items():
        if name in values:
            values[name] = values[name] * factor
    return values, qbar, alpha, beta


def flight_surface(flight: TruthFlight, off: Mapping[str, np.ndarray]) -> np.ndarray:
    """Elevator as seen (n,) [rad]."""
    true = flight.channels.get("real_de", flight["de"])
    return np.asarray(true + off.get("de", 0.0))
