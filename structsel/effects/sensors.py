"""Faults of instruments: each wrong reading is followed through measured coefficients, kinematics and simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.sensitivity import reading
from structsel.effects.base import Effect, EffectParameter, FittedEffect, Flights, Variant, of_shape
from structsel.effects.biases import bias_says, bias_variants, constant_biases
from structsel.effects.operators import spaced
from structsel.effects.readings import (
    AIR,
    ATTITUDE,
    INERTIAL,
    Errors,
    cannot_be_shifted,
    present,
    wrong_readings,
)
from structsel.effects.signals import UNITS, available, gathered
from structsel.effects.wording import INSTRUMENTS, capital, percent, shown, subject
from structsel.numerics.air_data import body_velocity, cross
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import delayed

_AXES = "xyz"
_ZEROS = {"V": (2.0, 6.0), "alpha": (0.05, 0.15), "beta": (0.05, 0.15)}
"""Readings about which a scale may be wrong, on either side of zero [m/s, rad]. A scale that is wrong about a reading
far outside these is a bias."""
_MIXED = (("ax", "az"), ("ay", "az"), ("r", "p"), ("p", "r"))
"""Channels that contain a fraction of another, which contains nothing of theirs."""


def _needs(channels: Sequence[str]) -> Callable[[Flights], str]:
    def needs(flights: Flights) -> str:
        if missing := cannot_be_shifted(flights):
            return missing
        if not present(flights, channels):
            return f"any of the channels {', '.join(channels)}, moving"
        return ""

    return needs


# Scales


def _scale_variants(flights: Flights) -> list[Variant]:
    made = []
    for channel in present(flights, (*AIR, *INERTIAL, *ATTITUDE)):
        sd = 0.1 if channel in ("alpha", "beta") else 0.04
        scale = EffectParameter("scale", "-", sd, -0.5, 0.5, of_outcome=_as_read(flights, channel))
        made.append(
            Variant(
                (scale,),
                wrong_readings(partial(_scaled, channel=channel)),
                about=INSTRUMENTS[channel],
            )
        )
        about = partial(_scaled_about, channel, scale)
        made += [of_shape(about, side * x) for x in _ZEROS.get(channel, ()) for side in (-1.0, 1.0)]
    return made


def _scaled_about(channel: str, scale: EffectParameter, zero: float) -> Variant:
    """A scale about a zero of its own: a bias comes with it."""

    def errors(flight: Flight) -> list[Errors]:
        (made,) = _scaled(flight, channel)
        return [{**made, channel: made[channel] - zero}]

    about = f"{INSTRUMENTS[channel]}, about a zero of its own"
    return Variant((scale,), wrong_readings(errors), {"zero": zero}, {"zero": UNITS[channel]}, about)


def _as_read(flights: Flights, channel: str) -> bool:
    """Whether a channel is known by its own reading alone."""
    return not any(channel in f.expected or channel in f.inertial for f in flights)


def _scaled(flight: Flight, channel: str) -> list[Errors]:
    errors: dict[str, Array | float] = {channel: reading(flight, channel)}
    if channel == "V" and "qbar" in flight.recorded:
        # The dynamic pressure has an instrument of its own, which stays right.
        errors["qbar_ratio"] = -2.0 * flight["qbar_ratio"]
    return [errors]


def _scale_says(found: FittedEffect) -> str:
    more = "too much" if found["scale"] >= 0.0 else "too little"
    return (
        f"{capital(subject(found))} reads {more}: {1.0 + found['scale']:.3f} of the truth ({percent(found, 'scale')})."
    )


# Delays


def _delay_variants(flights: Flights) -> list[Variant]:
    single = present(flights, (*AIR, *INERTIAL, *ATTITUDE, "de", "da", "dr"))
    groups: list[tuple[tuple[str, ...], str]] = [((c,), INSTRUMENTS[c]) for c in single]
    air = tuple(c for c in AIR if c in single)
    # A common delay of the gyros is a tolerance; their residual is noise.
    for channels, name in ((air, "the air data"), (INERTIAL[:3], "the accelerometers")):
        if len(channels) > 1 and set(channels) <= {*single}:
            groups.append((channels, name))
    made = []
    for channels, name in groups:
        for tau in spaced(max(0.02, 0.5 * flights[0].dt), 0.25, 4):
            made.append(
                Variant(
                    (EffectParameter("delay", "s", tau, 0.5 * tau, 1.6 * tau),),
                    wrong_readings(partial(_delayed_readings, channels=channels, tau=tau)),
                    about=name,
                    words={"be": "are" if len(channels) > 1 else "is"},
                )
            )
    return made


def _delayed_readings(flight: Flight, channels: Sequence[str], tau: float) -> list[Errors]:
    made: dict[str, Array | float] = {}
    for c in channels:
        x = reading(flight, c)
        # Predicted by others it is the value now, read `tau` later; a reading is the value `tau` ago.
        predicted = c in flight.inertial or c in flight.expected
        made[c] = (delayed(x, flight.dt, tau) - x if predicted else x - delayed(x, flight.dt, -tau)) / tau
    return [made]


def _delay_says(found: FittedEffect) -> str:
    return f"{capital(subject(found))} {found.variant.words['be']} delayed by {found.text('delay')}."


# Places


def _arm_at_accelerometer(flight: Flight, axis: int) -> Errors:
    d = np.eye(3)[axis]
    rates = (flight["p"], flight["q"], flight["r"])
    turning = (flight["p_dot"], flight["q_dot"], flight["r_dot"])
    added = [a + b for a, b in zip(cross(turning, d), cross(rates, cross(rates, d)))]
    return dict(zip(("ax", "ay", "az"), added))


def _arm_at_vane(flight: Flight, axis: int) -> Errors:
    V, alpha, beta = flight["V"], flight["alpha"], flight["beta"]
    du, dv, dw = cross((flight["p"], flight["q"], flight["r"]), np.eye(3)[axis])
    u, v, w = body_velocity(V, alpha, beta)
    level = u**2 + w**2
    dV = (u * du + v * dv + w * dw) / V
    return {"V": dV, "alpha": (u * dw - w * du) / level, "beta": (dv - v * dV / V) / np.sqrt(level)}


def _arm_of_one(flight: Flight, channel: str) -> list[Errors]:
    return [{channel: _arm_at_vane(flight, 0)[channel]}]


def _arms(flight: Flight, arm: Callable[[Flight, int], Errors], axes: Sequence[int]) -> list[Errors]:
    return [arm(flight, axis) for axis in axes]


def _position_variants(flights: Flights) -> list[Variant]:
    aircraft = flights[0].aircraft
    made = []
    for name, arm, sd in (
        ("the accelerometer", _arm_at_accelerometer, 0.15 * aircraft.cbar),
        ("the vane", _arm_at_vane, 0.5 * aircraft.cbar),
    ):
        for axis in range(3):
            made.append(
                Variant(
                    (EffectParameter(_AXES[axis], "m", sd, -10.0 * sd, 10.0 * sd),),
                    wrong_readings(partial(_arms, arm=arm, axes=(axis,))),
                    about=f"{name}, along body {_AXES[axis]}",
                    words={"instrument": name},
                )
            )
        if arm is _arm_at_vane:
            # Each vane may stand on a boom of its own.
            made += [
                Variant(
                    (EffectParameter("x", "m", sd, -10.0 * sd, 10.0 * sd),),
                    wrong_readings(partial(_arm_of_one, channel=channel)),
                    about=f"{INSTRUMENTS[channel]}, along body x",
                    words={"instrument": INSTRUMENTS[channel]},
                )
                for channel in ("alpha", "beta")
            ]
        made.append(
            Variant(
                tuple(EffectParameter(x, "m", sd, -10.0 * sd, 10.0 * sd) for x in _AXES),
                wrong_readings(partial(_arms, arm=arm, axes=(0, 1, 2))),
                about=f"{name}, along all axes",
                words={"instrument": name},
            )
        )
    return made


def _position_says(found: FittedEffect) -> str:
    where = ", ".join(f"{x} {found.text(x)}" for x in _AXES if x in found.estimates)
    return f"{capital(found.variant.words['instrument'])} stands elsewhere than stated, by {where} in body axes."


# Misalignments


def _turned(flight: Flight, channels: Sequence[str], axis: int) -> Errors:
    """A triad mounted turned by one radian (to first order) about a body axis reads v - e x v."""
    values = [reading(flight, c) for c in channels]
    return {c: -x for c, x in zip(channels, cross(np.eye(3)[axis], values))}


def _turnings(flight: Flight, triads: Sequence[Sequence[str]], axes: Sequence[int]) -> list[Errors]:
    return [{c: e for triad in triads for c, e in _turned(flight, triad, axis).items()} for axis in axes]


def _taken_in(flight: Flight, one: str, other: str) -> list[Errors]:
    return [{one: reading(flight, other)}]


def _rolled_boom(flight: Flight) -> Errors:
    return {"alpha": flight["beta"], "beta": -flight["alpha"]}


def _misalignment_variants(flights: Flights) -> list[Variant]:
    triads = {
        "the accelerometers": ("are", (INERTIAL[:3],)),
        "the gyros": ("are", (INERTIAL[3:],)),
        "the inertial unit": ("is", (INERTIAL[:3], INERTIAL[3:])),
    }
    turning = EffectParameter("fraction", "rad", 0.02, -0.15, 0.15)
    made = []
    for name, (be, parts) in triads.items():
        if not all(available(flights, c) for part in parts for c in part):
            continue

        for axes in ((0,), (1,), (2,), (0, 1, 2)):
            made.append(
                Variant(
                    tuple(EffectParameter(f"about {_AXES[i]}", "rad", 0.02, -0.15, 0.15) for i in axes),
                    wrong_readings(partial(_turnings, triads=parts, axes=axes)),
                    about=name,
                    words={"be": be},
                )
            )
    for one, other in _MIXED:
        if available(flights, one) and available(flights, other):
            taken = wrong_readings(partial(_taken_in, one=one, other=other))
            about, words = (
                f"{INSTRUMENTS[one]} alone, by a fraction of {other}",
                {"one": INSTRUMENTS[one], "other": other},
            )
            made.append(Variant((turning,), taken, about=about, words=words))
    if available(flights, "alpha") and available(flights, "beta"):
        made.append(
            Variant(
                (EffectParameter("about x", "rad", 0.04, -0.3, 0.3),),
                wrong_readings(lambda f: [_rolled_boom(f)]),
                about="the boom with its vanes",
                words={"be": "is"},
            )
        )
    return made


def _misalignment_says(found: FittedEffect) -> str:
    if "fraction" in found.estimates:
        one, other = found.variant.words["one"], found.variant.words["other"]
        return f"{capital(one)} contains a fraction of {other}, as if turned by {shown(found, 'fraction')}."
    by = ", ".join(f"{shown(found, f'about {x}')} about body {x}" for x in _AXES if f"about {x}" in found.estimates)
    return f"{capital(subject(found))} {found.variant.words['be']} mounted turned by {by}."


# Pitot and static


def _position_error_variants(flights: Flights) -> list[Variant]:
    factor = EffectParameter("factor", "-", 0.05, -0.3, 0.3)
    middle = float(gathered(flights, "alpha").mean())
    return [
        Variant(
            (factor,),
            wrong_readings(lambda f: [{"V": f["V"]}]),
            about="airspeed and dynamic pressure",
            words={"cause": "the pressures"},
        ),
        Variant(
            (EffectParameter("factor", "-", 0.1, -0.5, 0.5),),
            wrong_readings(lambda f: [{"qbar_ratio": f["qbar_ratio"]}]),
            about="dynamic pressure alone",
            words={"cause": "the density or the static pressure"},
        ),
        Variant(
            (EffectParameter("factor per rad", "1/rad", 0.3, -3.0, 3.0),),
            wrong_readings(lambda f: [{"V": f["V"] * (f["alpha"] - middle)}]),
            about="airspeed and dynamic pressure, with angle of attack",
        ),
    ]


def _position_error_says(found: FittedEffect) -> str:
    if "factor per rad" in found.estimates:
        per_degree = found.text("factor per rad", 100.0 * np.pi / 180.0, "% per deg")
        return f"{capital(found.variant.about)}: the error grows by {per_degree}."
    factor, cause = percent(found, "factor"), found.variant.words["cause"]
    return f"{capital(subject(found))} read too much by {factor}: {cause} are off, and all coefficients with them."


_SCALE_SEPARATED = "manoeuvres in which the channel moves at different speeds and powers, beside attitude and gyros"
EFFECTS: tuple[Effect, ...] = (
    Effect(
        "sensor-bias", "sensor", "An instrument is off by more than a free constant: too far, drifting or jumping.",
        _needs((*AIR, *INERTIAL, *ATTITUDE)), bias_variants, bias_says,
        look_alikes=("steady-wind", "asymmetry", "sensor-scale"), switched=constant_biases, may_end=False,
        separated_by="the same manoeuvre flown on opposite headings, and seconds of rest on the ground",
        check="the instrument's reading at rest before and after flight",
    ),
    Effect(
        "sensor-scale", "sensor", "An instrument reads too much or too little by a factor.",
        _needs((*AIR, *INERTIAL)), _scale_variants, _scale_says,
        look_alikes=("wrong-derivative", "sensor-position", "position-error", "mass-error"),
        separated_by=_SCALE_SEPARATED, check="the instrument's calibration, and the upwash at its place",
    ),
    Effect(
        "sensor-delay", "sensor", "An instrument's channel is late.",
        _needs((*AIR, *INERTIAL)), _delay_variants, _delay_says,
        look_alikes=("actuator-lag", "unsteady-lift", "downwash-lag", "sensor-position"),
        separated_by="sharp inputs on each control: only what comes from this channel is late",
        check="filters, tubing and time stamps of the channel",
    ),
    Effect(
        "sensor-position", "sensor", "An instrument stands elsewhere than stated.",
        _needs(("p", "q", "r")), _position_variants, _position_says,
        look_alikes=("inertia-error", "sensor-delay", "sensor-scale"),
        separated_by="fast pitching and rolling at the same angle of attack",
        check="where the instrument is, from the centre of gravity as it was loaded",
    ),
    Effect(
        "sensor-misalignment", "sensor", "Instruments are mounted turned, so that axes mix.",
        _needs((*INERTIAL, "alpha", "beta")), _misalignment_variants, _misalignment_says,
        look_alikes=("drag-polar", "missing-term", "cross-coupling"),
        separated_by="level accelerations and pull-ups: a turned triad mixes gravity as well as lift into its axes",
        check="the mounting of the instruments against the body axes",
    ),
    Effect(
        "position-error", "sensor", "Pitot, static or density are off, so that all coefficients scale alike.",
        _needs(("V",)), _position_error_variants, _position_error_says,
        look_alikes=("mass-error", "sensor-scale", "wrong-derivative"),
        separated_by="level runs at several speeds against ground speed, on opposite headings",
        check="the pitot-static calibration, and the density used",
    ),
)  # fmt: skip
