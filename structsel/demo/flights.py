"""Flying the demonstration: equations of motion, augmentation and instruments, all flights at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.demo.aircraft import TRUTH, aerodynamics, demo_aircraft
from structsel.demo.commands import FLIGHTS, RATE, Plan, commands_of, turbulence_states
from structsel.errors import DomainError
from structsel.nomenclature import AIR_DATA, ANGULAR_ACCELERATIONS, BODY_RATES, CONTROL_SURFACES, SPECIFIC_FORCES
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data, air_data_at_sensor, body_to_earth, body_velocity
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.numerics.dynamic_elements import rk4
from structsel.recording import Recording

_DT = 1.0 / RATE
_ALTITUDE = 1000.0
_ACTUATOR = 20.0  # rad/s
# Standard deviations of the instruments at noise = 1, in each channel's unit.
NOISE = {
    "V": 0.05,
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), 5e-4),
    **dict.fromkeys((*BODY_RATES, *CONTROL_SURFACES), 2e-4),
    **dict.fromkeys(SPECIFIC_FORCES, 0.01),
    "h": 0.3,
    "thrust": 5.0,
}


def demo_flight(
    which: str | int = 0,
    seed: int = 1,
    *,
    duration: float = 30.0,
    noise: float = 1.0,
    turbulence: float = 1.0,
    exact_derivatives: bool = False,
) -> Recording:
    """One demonstration flight; see `demo_flights`.

    Parameters
    ----------
    which : str or int
        A name of `FLIGHTS`, or a number; from six on they repeat with other airspeeds and sizes.
    """
    return _fly([number_of(which)], seed, duration, noise, turbulence, exact_derivatives)[0]


def demo_flights(
    n: int = 6,
    seed: int = 1,
    *,
    duration: float = 30.0,
    noise: float = 1.0,
    turbulence: float = 1.0,
    exact_derivatives: bool = False,
    augmentation: float = 1.0,
) -> tuple[list[Recording], Aircraft, dict[str, dict[str, float]]]:
    """Return manoeuvres simulated in turbulence at 50 Hz, their aircraft, and the truth.

    Parameters
    ----------
    n : int
        Number of manoeuvres.
    seed : int
        Of turbulence and instrument noise. Flight k of one seed is the same whatever `n`.
    duration : float [s]
    noise : float
        Instrument noise; 1 is 0.05 m/s on V, 5e-4 rad on angles, 2e-4 rad/s on rates, 0.01 m/s^2 on
        accelerations, 2e-4 rad on surfaces.
    turbulence : float
        1 is a gust of 0.8 m/s standard deviation, with rolling, pitching and yawing gusts in proportion.
    exact_derivatives : bool
        Record p_dot, q_dot, r_dot, without noise.
    augmentation : float
        Factor of the gains with which the surfaces answer rates, attitude and sideslip; 0 is open loop.

    Returns
    -------
    recordings : list of Recording
        t, V, alpha, beta (at the vanes), ax, ay, az (at the accelerometer), p, q, r, phi, theta, psi, h,
        rho, thrust, de, da, dr.
    aircraft : Aircraft
    truth : dict
        Response -> term -> value, the constant as "1".
    """
    recordings = _fly(range(n), seed, duration, noise, turbulence, exact_derivatives, augmentation)
    return recordings, demo_aircraft(), {response: dict(terms) for response, terms in TRUTH.items()}


def number_of(which: str | int) -> int:
    """Number of a demonstration flight given by name or by number.

    Raises
    ------
    DomainError
        When there is none of that name.
    """
    if not isinstance(which, str):
        return which
    if which not in FLIGHTS:
        raise DomainError(f"there is no demonstration flight {which!r}; there are {', '.join(FLIGHTS)}.")
    return FLIGHTS.index(which)


def _fly(
    which: Sequence[int],
    seed: int,
    duration: float,
    noise: float,
    turbulence: float,
    exact: bool,
    augmentation: float = 1.0,
) -> list[Recording]:
    aircraft = demo_aircraft()
    flights = integrate(which, seed, duration, turbulence, aircraft, augmentation=augmentation)
    return [_record(one, seed, noise, exact, aircraft) for one in flights]


@dataclass(frozen=True)
class SimulatedFlight:
    """One flight as it was, sample by sample, before any instrument.

    Attributes
    ----------
    number : int
    plan : Plan
    t : (n,) array [s]
    states : (n, 15) array
        Rigid body as `rigid_body.STATES`, then the surfaces.
    outputs : dict of str to (n,) array
        V, alpha, beta, ax, ay, az (at the centre of gravity), p_dot, q_dot, r_dot, rho.
    thrust : float [N]
    """

    number: int
    plan: Plan
    t: np.ndarray
    states: np.ndarray
    outputs: Mapping[str, np.ndarray]
    thrust: float


def integrate(
    which: Sequence[int],
    seed: int,
    duration: float,
    turbulence: float,
    aircraft: Aircraft,
    *,
    wind: np.ndarray | None = None,
    steps_at: str = "within_sample",
    augmentation: float = 1.0,
) -> list[SimulatedFlight]:
    """Integrate several flights at once, by Runge-Kutta steps of fourth order.

    Parameters
    ----------
    which : sequence of int
    seed : int
        Of the turbulence.
    duration : float [s]
    turbulence : float
    aircraft : Aircraft
    wind : (3, m) array [m/s], optional
        North, east, down. It carries the position along.
    steps_at : {"within_sample", "sample"}
        When a step of a command acts: within the integration step that ends at its sample, or from that sample on.
        Only the latter makes the states smooth between samples.
    augmentation : float
        As for `demo_flights`.

    Raises
    ------
    DomainError
        When the duration is below 1 s.
    """
    if not duration >= 1.0:
        raise DomainError(f"a demonstration flight lasts 1 s or more, not {duration:g} s.")
    samples = round(duration * RATE) + 1
    plans, commands, gusts = [], [], []
    for k in which:
        rng = np.random.default_rng([seed, k, 5])
        plan, command = commands_of(k, 2 * samples - 1)
        plans.append(plan)
        commands.append(command)
        gusts.append(turbulence * turbulence_states(2 * samples - 1, plan.V, rng))
    command, gust = np.stack(commands, axis=-1), np.stack(gusts, axis=-1)
    trims = [_trim(aircraft, plan.V) for plan in plans]
    state = np.stack([x for x, _ in trims], axis=-1)
    thrust = np.array([T for _, T in trims])
    held = state.copy()  # the attitude and surfaces that the augmentation holds
    states = np.empty((samples, *state.shape))
    states[0] = state
    drift = np.zeros((3, len(plans))) if wind is None else np.broadcast_to(wind, (3, len(plans)))
    last = {"within_sample": 2, "sample": 1}[steps_at]  # half step whose command acts at the end of a step

    for i in range(samples - 1):

        def slope(t: float, x: np.ndarray, i: int = i) -> np.ndarray:
            half = round(2.0 * t / _DT)
            acting = 2 * i + last if half == 2 * i + 2 else half
            return _derivative(x, command[acting], gust[half], thrust, held, aircraft, drift, augmentation)[0]

        states[i + 1] = rk4(slope, states[i], i * _DT, _DT)
    # All samples of all flights in one row, for what is to be recorded.
    all_states = states.transpose(1, 0, 2).reshape(len(state), -1)
    commanded, blown = (x[::2].transpose(1, 0, 2).reshape(x.shape[1], -1) for x in (command, gust))
    thrusts, holds, drifts = (np.tile(x, samples) for x in (thrust, held, drift))
    _, row = _derivative(all_states, commanded, blown, thrusts, holds, aircraft, drifts, augmentation)
    outputs = row.reshape(len(_OUTPUTS), samples, len(plans))
    t = np.arange(samples) * _DT
    return [
        SimulatedFlight(k, plan, t, states[:, :, j], dict(zip(_OUTPUTS, outputs[:, :, j])), float(thrust[j]))
        for j, (k, plan) in enumerate(zip(which, plans))
    ]


_OUTPUTS = ("V", "alpha", "beta", "ax", "ay", "az", "p_dot", "q_dot", "r_dot", "rho")


def _derivative(
    x: np.ndarray,
    command: np.ndarray,
    gust: np.ndarray,
    thrust: np.ndarray,
    held: np.ndarray,
    aircraft: Aircraft,
    wind: np.ndarray,
    augmentation: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Slope of the state (rigid body, then surfaces) and what is to be recorded, for m flights at once.

    The velocity of the state is that in a steady wind; within it the air moves with the gust.
    """
    velocity, rates, (phi, theta, psi) = x[0:3], x[3:6], x[6:9]
    V, alpha, beta = air_data(*(velocity - gust[:3]))
    rho = standard_atmosphere(x[11])[2]
    CX, CY, CZ, Cl, Cm, Cn = aerodynamics(V, alpha, beta, rates + gust[3:], x[12:], aircraft)
    qbar = 0.5 * rho * V * V
    line = aircraft.thrust
    assert aircraft.mass is not None
    assert aircraft.inertia is not None
    force = rb.specific_force(CX, CY, CZ, qbar, aircraft.mass, aircraft.S, thrust, line.inclination)
    qS = qbar * aircraft.S
    aero = (qS * aircraft.b * Cl, qS * aircraft.cbar * Cm, qS * aircraft.b * Cn)
    engine = rb.thrust_moment(thrust, line.offset, line.inclination)
    turning = rb.angular_acceleration(rates, [a + e for a, e in zip(aero, engine)], aircraft.inertia.tensor)
    out = np.empty_like(x)
    out[0:3] = rb.velocity_derivative(velocity, rates, force, phi, theta)
    out[3:6] = turning
    out[6:9] = rb.euler_rates(rates[0], rates[1], rates[2], phi, theta)
    path = np.einsum("mij,jm->im", body_to_earth(phi, theta, psi), velocity)
    path = path + wind
    out[9:11], out[11] = path[:2], -path[2]
    # Positive control makes a negative moment, so that these gains damp and hold.
    wanted = held[12:] + command
    wanted[0] += augmentation * (0.10 * rates[1] + 0.10 * (theta - held[7]))
    wanted[1] += augmentation * (0.05 * rates[0] + 0.12 * (phi - held[6]))
    wanted[2] += augmentation * (0.20 * rates[2] - 0.30 * beta)
    out[12:] = _ACTUATOR * (wanted - x[12:])
    return out, np.array([V, alpha, beta, *force, *turning, rho])


def _trim(aircraft: Aircraft, V: float) -> tuple[np.ndarray, float]:
    """Straight and level state (15,) at an airspeed, without sideslip, and its thrust [N]."""
    still = np.zeros((6, 1))

    def assemble(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        alpha, theta, phi, de, da, dr, T = z
        u, v, w = body_velocity(V, alpha, 0.0)
        x = np.array([u, v, w, 0.0, 0.0, 0.0, phi, theta, 0.0, 0.0, 0.0, _ALTITUDE, de, da, dr])[:, None]
        return x, np.array([1000.0 * T])

    def unbalance(z: np.ndarray) -> np.ndarray:
        x, thrust = assemble(z)
        slope, _ = _derivative(x, still[:3], still, thrust, x, aircraft, still[:3])
        return np.concatenate([slope[0:6, 0], slope[11]])

    found = scipy.optimize.root(unbalance, np.array([0.08, 0.08, 0.0, 0.0, 0.0, 0.0, 2.0]), tol=1e-12)
    x, thrust = assemble(found.x)
    return x[:, 0], float(thrust[0])


def at_instruments(flight: SimulatedFlight, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """V, alpha, beta at the vanes and ax, ay, az at the accelerometer."""
    got = flight.outputs
    rates = flight.states[:, 3:6].T
    turning = [got[name] for name in ANGULAR_ACCELERATIONS]
    V, alpha, beta, ax, ay, az = (got[name] for name in (*AIR_DATA, *SPECIFIC_FORCES))
    air = air_data_at_sensor(V, alpha, beta, rates[0], rates[1], rates[2], aircraft.position("vane"))
    force = rb.acceleration_at_sensor(ax, ay, az, rates, turning, aircraft.position("accelerometer"))
    return dict(zip((*AIR_DATA, *SPECIFIC_FORCES), (*air, *force)))


def _record(flight: SimulatedFlight, seed: int, noise: float, exact: bool, aircraft: Aircraft) -> Recording:
    """Readings of the instruments at their positions."""
    plan, states = flight.plan, flight.states
    channels = at_instruments(flight, aircraft)
    channels |= dict(zip(rb.STATES[3:9], states[:, 3:9].T))
    channels |= {"h": states[:, 11], "rho": flight.outputs["rho"], "thrust": np.full(len(states), flight.thrust)}
    channels |= dict(zip(CONTROL_SURFACES, states[:, 12:].T))
    rng = np.random.default_rng([seed, flight.number, 6])
    for name, std in NOISE.items():
        channels[name] = channels[name] + noise * std * rng.standard_normal(len(states))
    if exact:
        channels |= {name: flight.outputs[name] for name in ANGULAR_ACCELERATIONS}
    note = f"simulated: {plan.name} at {plan.V:.1f} m/s, seed {seed}, noise {noise:g}"
    return Recording(plan.name, flight.t, channels, provenance=(note,))
