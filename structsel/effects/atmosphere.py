"""Air that moves: wind, shear and gusts, as kinematics and forces see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.operators import more_and_more, pulse, pulses, shape_of
from structsel.effects.readings import cannot_be_shifted, wrong_readings
from structsel.effects.signals import available, coefficients, gathered, moves, signature
from structsel.effects.wording import shown
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import body_to_earth, body_velocity, flow_angle_rates
from structsel.numerics.arrays import Array

_OVER_GROUND = ("vn", "ve", "vd")
_AXES = ("north", "east", "down")
_RANGE = 15.0  # m of height below which a shear does not show
_LENGTHS = (0.4, 0.57, 0.8, 1.13, 1.6, 2.26, 3.2)  # s
_GUSTS = 6  # manoeuvres tried for each length


def _frames(flight: Flight) -> tuple[Array, Array]:
    """(n, 3) air-relative velocity in body axes and (n, 3, 3) body to earth."""
    body = np.stack(body_velocity(flight["V"], flight["alpha"], flight["beta"]), axis=-1)
    return body, body_to_earth(flight["phi"], flight["theta"], flight["psi"])


def moving_air(flight: Flight, wind: Array) -> dict[str, Array]:
    """What a wind that changes in time adds to the kinematic responses.

    Parameters
    ----------
    flight : Flight
    wind : (n, 3) array [m/s]
        Velocity of the air over the ground, north, east, down.
    """
    (u, v, w), frame = (lambda made: (made[0].T, made[1]))(_frames(flight))
    # The instruments feel the motion through space; that through the air also loses what the air gains.
    gains = np.column_stack([flight.rate(x) for x in wind.T])
    ud, vd, wd = -np.einsum("nji,nj->in", frame, gains)
    alpha_dot, beta_dot, V_dot = flow_angle_rates(u, v, w, ud, vd, wd)
    made = {
        "k_V": V_dot,
        "k_alpha": alpha_dot,
        "k_beta": beta_dot,
        "k_h": wind[:, 2] * -1.0,
        **{f"k_{name}": x for name, x in zip(_OVER_GROUND, wind.T)},
    }
    return {r: x for r, x in made.items() if r in flight.measured}


def _blown(winds: Callable[[Flight], list[Array]]) -> Callable[[Flight], Columns]:
    def columns(flight: Flight) -> Columns:
        each = [moving_air(flight, wind) for wind in winds(flight)]
        return {r: np.column_stack([made[r] for made in each]) for r in each[0]}

    return columns


def _along(axis: int, size: Array) -> Array:
    made = np.zeros((len(size), 3))
    made[:, axis] = size
    return made


# Steady wind


def _ground_speed_as_airspeed(flight: Flight) -> list[dict[str, Array]]:
    """Readings that are wrong because they were made from the motion over the ground, for 1 m/s of wind each way."""
    (u, v, w), frame = (lambda made: (made[0].T, made[1]))(_frames(flight))
    made = []
    for axis in range(3):
        dalpha, dbeta, dV = flow_angle_rates(u, v, w, *frame[:, axis, :].T)
        made.append({"V": dV, "alpha": dalpha, "beta": dbeta})
    return made


def _wind_variants(flights: Flights) -> list[Variant]:
    level = tuple(EffectParameter(a, "m/s", 5.0, -50.0, 50.0) for a in _AXES[:2])
    # In each manoeuvre a wind of its own would be free; one for all is what can be told.
    made = [Variant(level, _blown(lambda f: [_along(i, np.ones(len(f))) for i in range(2)]), about="over the ground")]
    if available(flights, "psi"):
        made.append(
            Variant(
                level,
                wrong_readings(lambda f: _ground_speed_as_airspeed(f)[:2]),
                about="airspeed and angles made from the motion over the ground",
            )
        )
        made.append(
            Variant(
                level,
                wrong_readings(lambda f: [{"V": e["V"]} for e in _ground_speed_as_airspeed(f)[:2]]),
                about="airspeed made from ground speed",
            )
        )
    return made


def _wind_needs(flights: Flights) -> str:
    if missing := cannot_be_shifted(flights):
        return missing
    if not all(any(available(flights, c) for c in pair) for pair in (("vn", "x"), ("ve", "y"))):
        return "velocity or position over the ground (vn, ve or x, y)"
    return ""


def _wind_says(found: FittedEffect) -> str:
    winds = ", ".join(f"{found.text(p.name)} {p.name}" for p in found.variant.parameters)
    return f"A steady wind of {winds} parts air data from the motion over the ground ({found.variant.about})."


# Shear


def _shear_variants(flights: Flights) -> list[Variant]:
    height = "h_agl" if available(flights, "h_agl") else "h"
    made = []
    if moves(flights, height):
        lowest = float(gathered(flights, height).min())
        middle = float(gathered(flights, height).mean())
        laws: dict[str, Callable[[Flight], Array]] = {"linear with height": lambda f: (f[height] - middle) / 100.0}
        if height == "h_agl":
            laws["logarithmic with height"] = lambda f: np.log(np.maximum(f[height], 1.0) / 10.0)
            laws["a power of height"] = lambda f: (np.maximum(f[height], 1.0) / 10.0) ** 0.2
        else:
            laws["near the lowest height"] = lambda f: np.log1p(np.maximum(f[height] - lowest, 0.0) / 20.0)
        for name, law in laws.items():
            unit = "m/s per 100 m" if name.startswith("linear") else "m/s"
            made.append(_sheared(law, name, unit))
    made.append(_sheared(lambda f: (f.t - f.t[0]) / 60.0, "linear with time", "m/s per min"))
    return made


def _sheared(law: Callable[[Flight], Array], name: str, unit: str) -> Variant:
    def winds(flight: Flight) -> list[Array]:
        size = law(flight)
        return [_along(i, size) for i in range(2)]

    return Variant(tuple(EffectParameter(a, unit, 5.0, -60.0, 60.0) for a in _AXES[:2]), _blown(winds), about=name)


def _shear_needs(flights: Flights) -> str:
    if missing := cannot_be_shifted(flights):
        return missing
    if not available(flights, "psi"):
        return "channel psi"
    if not any("k_V" in f.measured or "k_vn" in f.measured for f in flights):
        return "channels V, ax and theta"
    spans = [np.ptp(f["h"]) for f in flights if "h" in f.recorded]
    if available(flights, "vn") or (spans and max(spans) > _RANGE):
        return ""
    return f"a change of height above {_RANGE:.0f} m"


def _shear_says(found: FittedEffect) -> str:
    winds = ", ".join(f"{found.text(p.name)} {p.name}" for p in found.variant.parameters)
    return f"The wind changes, {found.variant.about}: {winds}."


# Gusts


def _gust_variants(flights: Flights) -> list[Variant]:
    made = []
    for angle, responses, name in (("alpha", ("CZ",), "upward"), ("beta", ("CY",), "from the right")):
        if not available(flights, angle):
            continue
        for length in _LENGTHS:
            for times in more_and_more(pulses(flights, responses, length, _GUSTS)):
                made.append(_gust(angle, times, length, name))
    return made


def _gust(angle: str, times: Mapping[str, float], length: float, name: str) -> Variant:
    def columns(flight: Flight) -> Columns:
        here = flight.name in times
        form = pulse(flight.t, times[flight.name], length) / flight["V"] if here else np.zeros(len(flight))
        # The vane does not see it, so the simulation was not told; kinematics closes without it.
        parts = [(r, 0, flight.slope(r, angle) * form) for r in COEFFICIENTS]
        return signature(flight, 1, parts)

    shape = {**shape_of(times), "length": length}
    return Variant(
        (EffectParameter("speed", "m/s", 4.0, -30.0, 30.0),),
        columns,
        shape,
        dict.fromkeys(shape, "s"),
        f"{name}, in {', '.join(map(repr, times))}",
    )


def _gust_needs(flights: Flights) -> str:
    if not coefficients(flights):
        return "simulated coefficients"
    return "" if any(available(flights, c) for c in ("alpha", "beta")) else "channel alpha or beta"


def _gust_says(found: FittedEffect) -> str:
    when = [f"{found[name]:.1f} s" for name in found.variant.shape if name != "length"]
    some, are = ("A gust", "is") if len(when) == 1 else ("Gusts", "are")
    return (
        f"{some} {found.variant.about} of {shown(found, 'speed')}, {found.text('length')} long about t = "
        f"{', '.join(when)}, {are} felt by the aircraft and not by the vane."
    )


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "steady-wind", "atmospheric", "The air moves over the ground.",
        _wind_needs, _wind_variants, _wind_says,
        look_alikes=("sensor-bias", "position-error", "wind-shear"),
        separated_by="the same run on opposite headings",
        check="the wind of the day, and what the airspeed was made from",
    ),
    Effect(
        "wind-shear", "atmospheric", "The wind changes with height or time.",
        _shear_needs, _shear_variants, _shear_says,
        look_alikes=("ground-effect", "steady-wind", "sensor-bias"),
        separated_by="climbs and descents through the same heights on opposite headings", check="soundings of the day",
    ),
    Effect(
        "gust", "atmospheric", "A discrete gust that the vane misses.",
        _gust_needs, _gust_variants, _gust_says,
        look_alikes=("configuration-change", "turbulence"),
        separated_by="repeating the manoeuvre: a gust does not come back", check="a second vane, if there is one",
        # The moment is the one that fits best of all.
        log_prior=-3.0, event=True,
    ),
)  # fmt: skip
