"""Flights in calm air whose truth is known sample by sample, seen by instruments with constant errors.

What flight-path reconstruction is tested with: every bias, scale error and wind is set, so its estimates can be
compared with the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.demo.aircraft import demo_aircraft
from structsel.demo.flights import NOISE, SimulatedFlight, at_instruments, integrate, number_of
from structsel.errors import DomainError
from structsel.nomenclature import BODY_RATES, CONTROL_SURFACES, EULER_ANGLES, SPECIFIC_FORCES, suggest
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import body_to_earth, cross
from structsel.recording import Recording

# Instrument: place from the centre of gravity [m] and standard deviations at noise = 1, in the channel's unit.
# Places that demo_aircraft gives already are its own.
_INSTRUMENTS: dict[str, tuple[tuple[float, float, float] | None, dict[str, float]]] = {
    "accelerometer": (None, dict.fromkeys(SPECIFIC_FORCES, 0.02)),
    "gyro": (None, dict.fromkeys(BODY_RATES, 5e-4)),
    "vane": (None, {"V": 0.2, "alpha": 2e-3, "beta": 2e-3}),
    "attitude": (None, dict.fromkeys(EULER_ANGLES, 2e-3)),
    "static": ((-1.5, 0.0, 0.2), {"h": 0.5}),
    "gps": ((-0.4, 0.0, -1.1), {"x": 1.0, "y": 1.0, "vn": 0.05, "ve": 0.05, "vd": 0.05}),
}
# Standard deviations of the errors that are drawn; the others are zero unless set.
_SPREAD = {
    **dict.fromkeys(("bax", "bay", "baz"), 0.1),
    **dict.fromkeys(("bp", "bq", "br"), 3e-3),
    **dict.fromkeys(("wn", "we"), 6.0),
    "wd": 0.0,
    "Cup": 0.03,
    "Calpha0": 5e-3,
    "Csi": 0.03,
    "Cbeta0": 0.0,
    "KV": 0.0,
}
INSTRUMENT_ERRORS = tuple(_SPREAD)
"""Names of the constant errors: biases of ax ... r, wind, vane scales and offsets, airspeed scale."""


@dataclass(frozen=True, eq=False)
class InstrumentedFlight:
    """A flight as it was, and as its instruments saw it.

    Attributes
    ----------
    measured : Recording
        t, V, alpha, beta (at the vanes), ax, ay, az (at the accelerometer), p, q, r, phi, theta, psi, h (at the
        static port), x, y, vn, ve, vd (at the antenna), rho, thrust, de, da, dr.
    truth : Recording
        The same at the centre of gravity without error or noise, and u, v, w, p_dot, q_dot, r_dot.
    aircraft : Aircraft
        With the places of the instruments and, where there is noise, its standard deviations.
    errors : mapping of str to float
        All of `INSTRUMENT_ERRORS`, in SI units and radians.
    """

    measured: Recording
    truth: Recording
    aircraft: Aircraft
    errors: Mapping[str, float]

    def __str__(self) -> str:
        wrong = ", ".join(f"{name} = {value:.4g}" for name, value in self.errors.items() if value)
        return f"{self.measured.name}: {len(self.truth)} samples, {wrong or 'no instrument errors'}"


def demo_instruments(
    which: str | int = 0,
    seed: int = 1,
    *,
    duration: float = 30.0,
    errors: Mapping[str, float] | None = None,
    noise: float = 1.0,
) -> InstrumentedFlight:
    """One demonstration flight in a constant wind, exact and as read by instruments with constant errors.

    Measured are::

        ax = ax_true + bax, ...    p = p_true + bp, ...    V = (1 + KV) V_true
        alpha = alpha_vane + Cup alpha_cg + Calpha0        beta = beta_vane + Csi beta_cg + Cbeta0

    The wind carries the aeroplane over the ground; u, v and w stay relative to the air.

    Parameters
    ----------
    which : str or int
        A name of `FLIGHTS`, or a number; as `demo_flight` takes it.
    seed : int
        Of the errors drawn and of the noise.
    duration : float [s]
    errors : mapping of str to float, optional
        By the names of `INSTRUMENT_ERRORS`; those not named are zero. Without it biases (standard deviation
        0.1 m/s^2 and 3e-3 rad/s), wn and we (6 m/s), Cup and Csi (0.03) and Calpha0 (5e-3 rad) are drawn,
        and wd, Cbeta0 and KV are zero.
    noise : float
        1 is 0.2 m/s on V, 2e-3 rad on vanes and attitude, 0.02 m/s^2 on accelerations, 5e-4 rad/s on rates,
        0.5 m on h, 1 m on x and y, 0.05 m/s on vn, ve and vd.

    Returns
    -------
    InstrumentedFlight

    Raises
    ------
    DomainError
        For a flight or an error of unknown name, or a duration below 1 s.
    """
    k = number_of(which)
    set_to = _draw_errors(seed, k) if errors is None else _named_errors(errors)
    aircraft = _instrumented_aircraft(noise)
    wind = np.array([set_to["wn"], set_to["we"], set_to["wd"]])
    flight = integrate([k], seed, duration, 0.0, aircraft, wind=wind[:, None], steps_at="sample")[0]
    truth = _truth(flight, wind)
    measured = _measure(flight, truth, aircraft, set_to, np.random.default_rng([seed, k, 8]), noise)
    return InstrumentedFlight(measured, truth, aircraft, MappingProxyType(set_to))


def _draw_errors(seed: int, k: int) -> dict[str, float]:
    drawn = np.random.default_rng([seed, k, 7]).standard_normal(len(_SPREAD))
    return {name: float(std * z) for (name, std), z in zip(_SPREAD.items(), drawn)}


def _named_errors(errors: Mapping[str, float]) -> dict[str, float]:
    for name in errors:
        if name not in _SPREAD:
            raise DomainError(
                f"demo_instruments has no error {name!r}.{suggest(name, _SPREAD)}\n"
                f"There are: {', '.join(INSTRUMENT_ERRORS)}."
            )
    return {name: float(errors.get(name, 0.0)) for name in INSTRUMENT_ERRORS}


def _instrumented_aircraft(noise: float) -> Aircraft:
    content = demo_aircraft().to_dict()
    for name, (place, stds) in _INSTRUMENTS.items():
        sensor: dict[str, Any] = content["sensors"].setdefault(name, {})
        if place is not None:
            sensor["position"] = place
        # No instrument is perfect, so without noise nothing is said of it.
        sensor["noise"] = {channel: noise * std for channel, std in stds.items()} if noise else {}
    return Aircraft.from_dict(content)


def _truth(flight: SimulatedFlight, wind: np.ndarray) -> Recording:
    states = dict(zip(rb.STATES, flight.states.T))
    velocity = flight.states[:, 0:3]
    to_earth = body_to_earth(states["phi"], states["theta"], states["psi"])
    ground = np.einsum("nij,nj->in", to_earth, velocity) + wind[:, None]
    channels = {**states, **flight.outputs, **dict(zip(("vn", "ve", "vd"), ground))}
    channels |= {
        "thrust": np.full(len(flight.t), flight.thrust),
        **dict(zip(CONTROL_SURFACES, flight.states[:, 12:].T)),
    }
    note = f"simulated: {flight.plan.name} at {flight.plan.V:.1f} m/s in calm air, exact, at the centre of gravity"
    return Recording(flight.plan.name, flight.t, channels, provenance=(note,))


def _measure(
    flight: SimulatedFlight,
    truth: Recording,
    aircraft: Aircraft,
    errors: Mapping[str, float],
    rng: np.random.Generator,
    noise: float,
) -> Recording:
    to_earth = body_to_earth(truth["phi"], truth["theta"], truth["psi"])
    # The static port stands above or below the centre of gravity as the attitude has it; z is down.
    port = to_earth @ aircraft.position("static")
    antenna = aircraft.position("gps")
    swing = np.stack(np.broadcast_arrays(*cross([truth[name] for name in BODY_RATES], antenna)), axis=-1)
    ahead, swinging = to_earth @ antenna, np.einsum("nij,nj->ni", to_earth, swing)
    channels = at_instruments(flight, aircraft)
    channels["V"] = (1.0 + errors["KV"]) * channels["V"]
    channels["alpha"] = channels["alpha"] + errors["Cup"] * truth["alpha"] + errors["Calpha0"]
    channels["beta"] = channels["beta"] + errors["Csi"] * truth["beta"] + errors["Cbeta0"]
    channels |= {name: truth[name] for name in (*BODY_RATES, *EULER_ANGLES)}
    for name in (*SPECIFIC_FORCES, *BODY_RATES):
        channels[name] = channels[name] + errors[f"b{name}"]
    channels["h"] = truth["h"] - port[:, 2]
    channels |= {name: truth[name] + ahead[:, j] for j, name in enumerate(("x", "y"))}
    channels |= {name: truth[name] + swinging[:, j] for j, name in enumerate(("vn", "ve", "vd"))}
    channels |= {name: truth[name] for name in ("rho", "thrust", *CONTROL_SURFACES)}
    stds = {name: std for _, of_instrument in _INSTRUMENTS.values() for name, std in of_instrument.items()}
    stds |= {name: NOISE[name] for name in ("thrust", *CONTROL_SURFACES)}
    for name, std in stds.items():
        channels[name] = channels[name] + noise * std * rng.standard_normal(len(truth))
    note = f"simulated: {flight.plan.name} at {flight.plan.V:.1f} m/s in calm air, instrument errors, noise {noise:g}"
    return Recording(flight.plan.name, flight.t, channels, provenance=(note,))
