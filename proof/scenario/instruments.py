"""Instruments of both plants: their errors, their places, the readings, and the coefficients computed from them.

The errors are those of the truth, and independent of structsel's hypotheses about them; white noise, constant bias,
scale and delay are read by `structsel.Instruments`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from proof.scenario.errors import RECONSTRUCTION
from structsel.aircraft import Aircraft
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data, air_data_at_cg, cross
from structsel.simulation import Instruments

Channels = dict[str, np.ndarray]
_CUTOFF = 4.0  # Hz; of the rates before they are differentiated
_SLOW, _SETTLING = 0.97, 200


@dataclass(frozen=True)
class InstrumentErrors:
    """What is wrong with the instruments of all manoeuvres.

    Attributes
    ----------
    scale, delay : mapping of channel to value
    bias : mapping of channel to float or list of (n,) arrays
        A constant, or the course in each manoeuvre.
    place : mapping of {"accelerometer", "vane"} to (3,) [m]
        True less stated place.
    mix : tuple of (channel, other, angle)
        The channel takes angle times the other, which loses as much of the channel.
    vanes_blind : bool
        The vanes do not feel gusts.
    without_gusts : bool
        The simulation is given the motion without gusts, though the vanes feel them.
    """

    scale: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    bias: Mapping[str, float | list[np.ndarray]] = field(default_factory=dict)
    place: Mapping[str, Sequence[float]] = field(default_factory=dict)
    mix: tuple[tuple[str, str, float], ...] = ()
    vanes_blind: bool = False
    without_gusts: bool = False

    def joined(self, other: InstrumentErrors) -> InstrumentErrors:
        """Both at once; of the same channel the other's."""
        return InstrumentErrors(
            {**self.scale, **other.scale}, {**self.delay, **other.delay}, {**self.bias, **other.bias},
            {**self.place, **other.place}, (*self.mix, *other.mix), self.vanes_blind or other.vanes_blind,
            self.without_gusts or other.without_gusts,
        )  # fmt: skip

    def applied(self, t: np.ndarray, channels: Channels, number: int = 0) -> Channels:
        """Channels with the errors of manoeuvre `number`; places are for who computes the channels."""
        made = dict(channels)
        for one, other, angle in self.mix:
            made[one], made[other] = made[one] + angle * made[other], made[other] - angle * made[one]
        constant: dict[str, float] = {}
        for name, bias in self.bias.items():
            if isinstance(bias, list):
                made[name] = made[name] + bias[number]
            elif name in made:
                constant[name] = bias
        scale, delay = ({c: v for c, v in held.items() if c in made} for held in (self.scale, self.delay))
        return Instruments(scale=scale, bias=constant, delay=delay).read(t, made)

    def at_sensors(
        self,
        aircraft: Aircraft,
        velocity: Sequence[np.ndarray],
        rates: Sequence[np.ndarray],
        rate_derivatives: Sequence[np.ndarray],
        force: Sequence[np.ndarray],
    ) -> Channels:
        """V, alpha, beta where the vane is, and ax, ay, az where the accelerometer is.

        Parameters
        ----------
        aircraft : Aircraft
            With the stated places.
        velocity : three (n,) arrays [m/s]
            Relative to the air that the vane feels, at the centre of gravity.
        rates, rate_derivatives : three (n,) arrays [rad/s, rad/s^2]
        force : three (n,) arrays [m/s^2]
            Specific force at the centre of gravity.
        """
        boom, seat = (
            aircraft.position(sensor) + np.asarray(self.place.get(sensor, (0.0, 0.0, 0.0)))
            for sensor in ("vane", "accelerometer")
        )
        V, alpha, beta = air_data(*(u + d for u, d in zip(velocity, cross(rates, boom))))
        tangential, centripetal = cross(rate_derivatives, seat), cross(rates, cross(rates, seat))
        felt = [f + a + c for f, a, c in zip(force, tangential, centripetal)]
        return {"V": V, "alpha": alpha, "beta": beta, **dict(zip(("ax", "ay", "az"), felt))}


SOUND = InstrumentErrors()
"""Instruments without errors."""


def derived(readings: Channels) -> Channels:
    """Readings with the dynamic pressure, and no height below the ground."""
    qbar = 0.5 * readings["rho"] * readings["V"] ** 2
    return {**readings, "qbar": qbar, "h_agl": np.maximum(readings["h_agl"], 0.0)}


def at_cg(readings: Channels, aircraft: Aircraft) -> Channels:
    """V, alpha, beta as read, carried from the vane to the centre of gravity."""
    V, alpha, beta, p, q, r = (readings[n] for n in ("V", "alpha", "beta", "p", "q", "r"))
    moved = air_data_at_cg(V, alpha, beta, p, q, r, tuple(aircraft.position("vane")))
    return dict(zip(("V", "alpha", "beta"), moved))


def reconstruction_errors(n: int, rng: np.random.Generator) -> Channels:
    """Slow errors of V, alpha and beta (n,), as a flight-path reconstruction leaves them."""
    return {name: size * first_order_noise(n, rng, _SLOW) for name, size in RECONSTRUCTION.items()}


def first_order_noise(n: int, rng: np.random.Generator, keeps: float) -> np.ndarray:
    """(n,) first-order autoregressive noise of unit variance, with the coefficient `keeps`."""
    made = lfilter([1.0], [1.0, -keeps], rng.standard_normal(n + _SETTLING))[_SETTLING:]
    return np.asarray(made * np.sqrt(1.0 - keeps**2))


def coefficients_of(
    t: np.ndarray,
    readings: Mapping[str, np.ndarray],
    aircraft: Aircraft,
    *,
    mass: np.ndarray | float | None = None,
    inertia: np.ndarray | None = None,
    thrust: np.ndarray | None = None,
) -> np.ndarray:
    """(n, 6) coefficients from readings; rates are smoothed (zero phase, 4 Hz) before they are differentiated.

    Mass, inertia tensor and thrust are those stated and recorded unless they are given.
    """
    mass = float(aircraft.mass or 0.0) if mass is None else mass
    inertia = aircraft.require_inertia("the proof").tensor if inertia is None else inertia
    thrust = readings["thrust"] if thrust is None else thrust
    sos = butter(4, _CUTOFF, fs=1.0 / float(t[1] - t[0]), output="sos")
    smooth = [sosfiltfilt(sos, readings[n]) for n in "pqr"]
    dots = [np.gradient(x, t, edge_order=2) for x in smooth]
    seat = tuple(aircraft.position("accelerometer"))
    force = rb.acceleration_at_cg(readings["ax"], readings["ay"], readings["az"], smooth, dots, seat)
    qbar, line = readings["qbar"], aircraft.thrust
    forces = rb.force_coefficients(*force, qbar, mass, aircraft.S, thrust, line.inclination)
    moments = rb.moment_coefficients(
        smooth, dots, qbar, inertia, aircraft.S, aircraft.b, aircraft.cbar, thrust, line.offset, line.inclination,
        aircraft.engine.angular_momentum,
    )  # fmt: skip
    return np.stack([*forces, *moments], axis=1)
