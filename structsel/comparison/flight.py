"""One manoeuvre prepared for comparison: smooth channels, responses measured and simulated, and their slopes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.inertial_air_data import inertial_channels, smooth_channels
from structsel.comparison.responses import KINEMATIC, Rate, respond
from structsel.errors import DataError
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data_at_cg
from structsel.numerics.arrays import Array
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.recording import Recording

if TYPE_CHECKING:
    from structsel.comparison.surrogate import Surrogate

AIRFRAME = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
"""Channels that every flight holds; zero where the recording has none."""
OF_COEFFICIENTS = ("V", "alpha", "ax", "az")
"""Channels without which no coefficient can be computed."""
_ANGLES = ("psi", "phi")
_LEAST_SAMPLES = 40


@dataclass(frozen=True, eq=False)
class Flight:
    """A manoeuvre on an even clock.

    Attributes
    ----------
    name : str
    t : (n,) array [s]
    dt : float [s]
    aircraft : Aircraft
    channels : mapping of channel to (n,) array [SI]
        Smoothed, as read; `AIRFRAME` and ``rho``, ``mass``, ``thrust``, ``qbar_ratio`` always there.
    raw : mapping of channel to (n,) array
        As recorded.
    measured, simulated : mapping of response to (n,) array
        Kinematic responses are simulated as zero.
    recorded : frozenset of str
        Channels the recording has.
    surrogate : Surrogate, optional
        The simulation's stand-in.
    inertial : frozenset of str
        Air data and attitude that accelerometers and gyros predict, except for slow drifts: without the noise of their
        own instruments.
    air : mapping of channel to (n,) array
        V, alpha and beta with gusts, as far as these exceed the noise: the states at which a simulation is evaluated.
    apart : bool
        Whether the simulation was evaluated at other states, such as reconstructed ones, which lack the biases of the
        readings.
    form_error : mapping of response to float
        Of a simulation whose coefficients were identified from its own flights, or whose error of form is stated: rms
        that its form leaves there, as a fraction of the response's own.
    fit_error : mapping of response to float
        Of a model that was identified from recordings: the same of its residual there, without white noise. What the
        recordings contain and the model lacks is part of it.
    integrated : mapping of channel to (n,) array
        Changes of alpha and beta at the centre of gravity since the first sample, from accelerometers and gyros.
    sequence : str
        Name of the first recording of the flight, where it was cut into several; else empty.
    """

    name: str
    t: Array
    dt: float
    aircraft: Aircraft
    channels: Mapping[str, Array]
    raw: Mapping[str, Array]
    measured: Mapping[str, Array]
    simulated: Mapping[str, Array]
    recorded: frozenset[str]
    surrogate: Surrogate | None = field(default=None, repr=False)
    inertial: frozenset[str] = frozenset()
    air: Mapping[str, Array] = field(default_factory=dict, repr=False)
    apart: bool = False
    form_error: Mapping[str, float] = field(default_factory=dict)
    fit_error: Mapping[str, float] = field(default_factory=dict)
    integrated: Mapping[str, Array] = field(default_factory=dict, repr=False)
    sequence: str = ""

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, name: str) -> Array:
        """Channel smoothed, or derived from those: ``p_hat``, ``alpha_dot``, ``CT``, ``qbar``, ``mach``, ..."""
        if name in self.channels:
            return self.channels[name]
        if name in self._derived:
            return self._derived[name]
        if name.endswith("_dot") and name[:-4] in self.channels:
            self._derived[name] = self.rate(self.channels[name[:-4]])
            return self._derived[name]
        raise DataError(f"'{self.name}' has no channel '{name}', and none to make it from.")

    def __contains__(self, name: str) -> bool:
        return name in self.recorded or name in self._derived or (name.endswith("_dot") and name[:-4] in self.recorded)

    @property
    def is_identified(self) -> bool:
        """Whether the simulation's coefficients were identified from flights: their form is not exact."""
        return bool(self.form_error) or bool(self.fit_error)

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the responses, coefficients first."""
        return tuple(self.measured)

    @cached_property
    def difference(self) -> dict[str, Array]:
        """Measured less simulated, by response."""
        return {name: self.measured[name] - self.simulated.get(name, 0.0) for name in self.measured}

    @cached_property
    def rate(self) -> Rate:
        """Time derivative on this clock."""
        return Rate(self.dt)

    @cached_property
    def _derived(self) -> dict[str, Array]:
        if not set(AIRFRAME) <= set(self.channels):
            return {}
        ch, aircraft = self.channels, self.aircraft
        V = ch["V"]
        qbar = ch["qbar_ratio"] * 0.5 * ch["rho"] * V**2
        made = {
            "p_hat": ch["p"] * aircraft.b / (2.0 * V),
            "q_hat": ch["q"] * aircraft.cbar / (2.0 * V),
            "r_hat": ch["r"] * aircraft.b / (2.0 * V),
            "alpha_dot_hat": self.rate(ch["alpha"]) * aircraft.cbar / (2.0 * V),
            "beta_dot_hat": self.rate(ch["beta"]) * aircraft.b / (2.0 * V),
            "qbar": qbar,
            "CT": ch["thrust"] / (qbar * aircraft.S),
            "abs(beta)": np.abs(ch["beta"]),
        }
        if "mach" not in ch and "h" in ch:
            made["mach"] = V / standard_atmosphere(ch["h"])[3]
        return made

    @cached_property
    def at_cg(self) -> dict[str, Array]:
        """Alpha and beta carried from the vanes to the centre of gravity."""
        ch = self.channels
        place = tuple(self.aircraft.position("vane"))
        _, alpha, beta = air_data_at_cg(ch["V"], ch["alpha"], ch["beta"], ch["p"], ch["q"], ch["r"], place)
        return {"alpha": alpha, "beta": beta}

    @cached_property
    def expected(self) -> dict[str, Array]:
        """Accelerations by the simulation.

        The effect of a wrong reading on the differences is computed from these: the measured ones, and those of a
        simulation evaluated at noisy states, would bring the noise of the differences into their explanation.
        """
        ch, aircraft = self.channels, self.aircraft
        predicted = {c: self.predicted(c) for c in COEFFICIENTS}
        qS = self["qbar"] * aircraft.S
        rates = (ch["p"], ch["q"], ch["r"])
        made = {f"{c}_dot": self.rate(ch[c]) for c in "pqr"}
        if aircraft.inertia is not None:
            thrust = rb.thrust_moment(ch["thrust"], aircraft.thrust.offset, aircraft.thrust.inclination)
            moment = [
                predicted[c] * qS * x + m
                for c, x, m in zip(COEFFICIENTS[3:], (aircraft.b, aircraft.cbar, aircraft.b), thrust)
            ]
            turning = rb.angular_acceleration(rates, tuple(moment), aircraft.inertia.tensor)
            made |= {f"{c}_dot": x for c, x, own in zip("pqr", turning, COEFFICIENTS[3:]) if own in self.simulated}
        push = rb.thrust_force(ch["thrust"], aircraft.thrust.inclination)
        fx, fy, fz = ((predicted[c] * qS + x) / ch["mass"] for c, x in zip(COEFFICIENTS[:3], push))
        turned = (made["p_dot"], made["q_dot"], made["r_dot"])
        read = rb.acceleration_at_sensor(fx, fy, fz, rates, turned, aircraft.position("accelerometer"))
        return made | {c: x for c, x in zip(("ax", "ay", "az"), read) if c in self.recorded}

    def predicted(self, name: str) -> Array:
        """Simulated response at states without noise; the measured one where it is not simulated."""
        if self.surrogate is not None and name in self.surrogate.terms:
            if name not in self._predicted:
                self._predicted[name] = self.surrogate.evaluate(self, name)
            return self._predicted[name]
        return self.simulated.get(name, self.measured.get(name, np.zeros(len(self))))

    @cached_property
    def _predicted(self) -> dict[str, Array]:
        return {}

    @cached_property
    def forces(self) -> tuple[Array, Array, Array]:
        """Mass times specific force over qbar S along the body axes, simulated: aerodynamic force and thrust."""
        push = rb.thrust_force(self["CT"], self.aircraft.thrust.inclination)
        CX, CY, CZ = (self.predicted(c) + T for c, T in zip(COEFFICIENTS[:3], push))
        return CX, CY, CZ

    def between(self, first: int, last: int, name: str) -> Flight:
        """Samples `first` to `last`, the last not among them, as a flight of its own."""

        def cut(held: Mapping[str, Array]) -> dict[str, Array]:
            return {c: x[first:last] for c, x in held.items()}

        return replace(
            self, name=name, t=self.t[first:last], channels=cut(self.channels), raw=cut(self.raw),
            measured=cut(self.measured), simulated=cut(self.simulated), air=cut(self.air),
            integrated=cut(self.integrated),
        )  # fmt: skip

    def slope(self, response: str, channel: str) -> Array:
        """What the simulation's response gains per unit of a channel, along the flight; zero where it does not ask."""
        if (response, channel) not in self._slopes:
            made = np.zeros(len(self)) if self.surrogate is None else self.surrogate.slope(self, response, channel)
            self._slopes[response, channel] = made
        return self._slopes[response, channel]

    @cached_property
    def _slopes(self) -> dict[tuple[str, str], Array]:
        return {}


def prepare_flight(recording: Recording, aircraft: Aircraft, simulated: Mapping[str, Array]) -> Flight:
    """Smooth the channels of a manoeuvre, and compute the measured value of each simulated response.

    Parameters
    ----------
    recording : Recording
    aircraft : Aircraft
    simulated : mapping of response to (n,) array
        Coefficients, or channels of the recording, on its clock.

    Raises
    ------
    DataError
        Too few samples, gaps, samples that are not finite, or a response that the recording cannot give.
    """
    n = len(recording)
    if n < _LEAST_SAMPLES:
        raise DataError(f"'{recording.name}' has {n} samples; a comparison needs {_LEAST_SAMPLES}.")
    t = recording.t
    dt = recording.duration / (n - 1)
    raw = {name: np.asarray(recording[name], dtype=float) for name in recording.names}
    for name, x in raw.items():
        if not np.isfinite(x).all():
            i = int(np.argmin(np.isfinite(x)))
            raise DataError(
                f"'{recording.name}': channel '{name}' is {x[i]} at sample {i} (t = {t[i]:g} s).\n"
                "A comparison needs finite samples: take a segment without them, or correct the file."
            )
    for name in _ANGLES:
        if name in raw:
            raw[name] = np.unwrap(raw[name])
    aerodynamic = [name for name in simulated if name in COEFFICIENTS]
    smooth = smooth_channels(raw, t)
    air: dict[str, Array] = {}
    inertial: frozenset[str] = frozenset()
    integrated: dict[str, Array] = {}
    if set(OF_COEFFICIENTS) <= set(raw):
        _complete(smooth, raw, aircraft, recording.name)
        air, inertial, integrated = inertial_channels(smooth, raw, aircraft, t)
    elif aerodynamic:
        recording.require(*OF_COEFFICIENTS, by="compare")
    measured: dict[str, Array] = {}
    wanted = tuple(aerodynamic)
    if set(AIRFRAME) <= set(smooth):
        if aerodynamic:  # kinematics of a channel that is simulated would count it twice
            wanted += tuple(name for name, needs in KINEMATIC.items() if set(needs) <= set(raw))
        # A smoother would take more from some channels than from others. The responses are computed from the
        # readings, and compared in a band; only factors (dynamic pressure) are smooth.
        plain = {**smooth, **raw}
        plain |= {f"{rate}_dot": Rate(dt)(plain[rate]) for rate in ("p", "q", "r")}
        wanted = tuple(c for c in wanted if _can(c, raw, aircraft))
        measured = respond(plain, aircraft, dt, tuple(c for c in wanted if c in KINEMATIC))
        measured = respond({**plain, **air}, aircraft, dt, tuple(c for c in wanted if c in COEFFICIENTS)) | measured
    for name in simulated:
        if name not in COEFFICIENTS:
            measured[name] = recording[name]
    kept = {name: np.asarray(simulated[name], dtype=float) for name in simulated if name in measured}
    return Flight(
        recording.name, t, dt, aircraft, smooth, raw, measured, kept, frozenset(raw), inertial=inertial, air=air,
        integrated=integrated,
    )  # fmt: skip


def _can(name: str, raw: Mapping[str, Array], aircraft: Aircraft) -> bool:
    """Whether the recording gives a response."""
    needs = {"CY": ("ay",), "Cl": ("p", "r"), "Cm": ("q",), "Cn": ("p", "r")}.get(name, ())
    return set(needs) <= set(raw) and (name not in COEFFICIENTS[3:] or aircraft.inertia is not None)


def _complete(smooth: dict[str, Array], raw: Mapping[str, Array], aircraft: Aircraft, name: str) -> None:
    """Add what the responses need and the recording does not say."""
    n = len(smooth["V"])
    for channel in AIRFRAME:
        smooth.setdefault(channel, np.zeros(n))
    if "rho" not in smooth:
        smooth["rho"] = standard_atmosphere(smooth["h"])[2] if "h" in smooth else np.full(n, 1.225)
    if "qbar" in raw:
        ratio = raw["qbar"] / (0.5 * smooth["rho"] * raw["V"] ** 2)
        smooth["qbar_ratio"] = np.full(n, float(np.median(ratio)))
        smooth["qbar"] = smooth["qbar_ratio"] * 0.5 * smooth["rho"] * smooth["V"] ** 2
    else:
        smooth["qbar_ratio"] = np.ones(n)
    smooth.setdefault("thrust", np.zeros(n))
    if "mass" not in smooth:
        if aircraft.mass is None:
            raise DataError(f"'{name}' has no channel 'mass' [kg], and aircraft '{aircraft.name}' none either.")
        smooth["mass"] = np.full(n, aircraft.mass)
