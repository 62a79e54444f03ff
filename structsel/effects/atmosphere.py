"""Air that moves: wind, shear and gusts, as kinematics and forces see them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.moving_air import OVER_GROUND, Added, blown, channels_in_wind, frames
from structsel.effects.operators import more_and_more, pulse, pulses, shape_of, shared_pulses, spaced
from structsel.effects.readings import cannot_be_shifted, wrong_readings
from structsel.effects.signals import available, coefficients, gathered, moves, signature
from structsel.effects.wording import shown
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import flow_angle_rates
from structsel.numerics.arrays import Array, centred

_AXES = ("north", "east", "down")
_TAKEN_ALONG = (0.5, 25.0, 19)  # s, in which drag takes a vehicle along, and how many are tried
_RANGE = 15.0  # m of height below which a shear does not show
_LENGTHS = (0.4, 0.57, 0.8, 1.13, 1.6, 2.26, 3.2)  # s
_GUSTS = 6  # manoeuvres tried for each length
_SHARED_LENGTHS = (0.6, 1.2, 2.4)  # s, of a gust at one time of all manoeuvres
_SHARED_GUSTS = 2  # times tried for each of these lengths
_CHANNEL_LENGTHS = (0.8, 1.6, 3.2, 6.4)  # s, of gusts that channels show
_CHANNEL_GUSTS = 3  # manoeuvres tried for each of these lengths
_DIRECTIONS = ("to the north", "to the east", "downward")
_PERIODS, _STEP = (1.0, 25.0), 0.25  # of a periodic wind in the shortest manoeuvre, and the resolution
_OF_SAMPLING = 0.1  # of the sampling rate, up to which its frequency is sought
_FREQUENCIES = 2  # that are tried


def _along(axis: int, size: Array) -> Array:
    made = np.zeros((len(size), 3))
    made[:, axis] = size
    return made


# Steady wind


def _ground_speed_as_airspeed(flight: Flight) -> list[dict[str, Array]]:
    """Readings that are wrong because they were made from the motion over the ground, for 1 m/s of wind each way."""
    (u, v, w), frame = (lambda made: (made[0].T, made[1]))(frames(flight))
    made = []
    for axis in range(3):
        dalpha, dbeta, dV = flow_angle_rates(u, v, w, *frame[:, axis, :].T)
        made.append({"V": dV, "alpha": dalpha, "beta": dbeta})
    return made


def _wind_variants(flights: Flights) -> list[Variant]:
    level = tuple(EffectParameter(a, "m/s", 5.0, -50.0, 50.0) for a in _AXES[:2])
    # A wind of its own in each manoeuvre would be free; one wind for all can be determined.
    steady = blown(lambda f: [_along(i, np.ones(len(f))) for i in range(2)], channels_in_wind(flights))
    made = [Variant(level, steady, about="over the ground"), *_taken_along(flights, level)]
    if available(flights, "psi") and not cannot_be_shifted(flights):
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


def _taken_along(flights: Flights, level: tuple[EffectParameter, ...]) -> list[Variant]:
    """Velocities over the ground that a simulation integrates: drag takes the vehicle along with the wind.

    They begin as recorded. Where airspeed is recorded, they follow from it, and have the wind at once.
    """
    moved = {c: added for c, added in channels_in_wind(flights).items() if c in OVER_GROUND[:2]}
    if not moved or any("V" in f.recorded for f in flights):
        return []
    made = []
    for tau in spaced(*_TAKEN_ALONG):

        def winds(flight: Flight, tau: float = tau) -> list[Array]:
            taken = 1.0 - np.exp(-(flight.t - flight.t[0]) / tau)
            return [_along(i, taken) for i in range(2)]

        shape, units = {"time constant": tau}, {"time constant": "s"}
        made.append(Variant(level, blown(winds, moved), shape, units, "over the ground, taken along by drag"))
    return made


def _wind_needs(flights: Flights) -> str:
    if channels_in_wind(flights):
        return ""
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
    channels = channels_in_wind(flights)
    made = []
    if moves(flights, height):
        lowest = float(gathered(flights, height).min())
        middle = float(gathered(flights, height).mean())

        def linear(flight: Flight) -> Array:
            return (flight[height] - middle) / 100.0

        laws: dict[str, Callable[[Flight], Array]] = {}
        if height == "h_agl":
            laws["logarithmic with height"] = lambda f: np.log(np.maximum(f[height], 1.0) / 10.0)
            laws["a power of height"] = lambda f: (np.maximum(f[height], 1.0) / 10.0) ** 0.2
        else:
            laws["near the lowest height"] = lambda f: np.log1p(np.maximum(f[height] - lowest, 0.0) / 20.0)
        blows = available(flights, "psi") or bool(channels)
        if blows:
            made.append(_sheared(channels, linear, "linear with height", "m/s per 100 m"))
        for name, law in laws.items() if blows else ():
            made.append(_sheared(channels, law, name, "m/s"))
        if not cannot_be_shifted(flights):
            made += [_misjudged(linear, along) for along in (False, True) if along or available(flights, "psi")]
    if available(flights, "psi") or channels:
        made.append(_sheared(channels, lambda f: (f.t - f.t[0]) / 60.0, "linear with time", "m/s per min"))
    return made + _waves(flights, channels)


def _misjudged(law: Callable[[Flight], Array], along: bool) -> Variant:
    """Air data made from the motion over the ground in a wind that changes with height.

    The wind blows from the north and the east, or along the path of each flight, which needs no heading.
    """

    def errors(flight: Flight) -> list[dict[str, Array]]:
        each = _ground_speed_as_airspeed(flight)
        if along:
            heading = flight["psi"]
            directions = [{c: np.cos(heading) * e + np.sin(heading) * each[1][c] for c, e in each[0].items()}]
        else:
            directions = each[:2]
        size = law(flight)
        return [{c: size * e for c, e in direction.items()} for direction in directions]

    names = ("along the path",) if along else _AXES[:2]
    parameters = tuple(EffectParameter(a, "m/s per 100 m", 5.0, -60.0, 60.0) for a in names)
    return Variant(parameters, wrong_readings(errors), about="linear with height, air data made over the ground")


def _sheared(channels: Mapping[str, Added], law: Callable[[Flight], Array], name: str, unit: str) -> Variant:
    def winds(flight: Flight) -> list[Array]:
        size = law(flight)
        return [_along(i, size) for i in range(2)]

    parameters = tuple(EffectParameter(a, unit, 5.0, -60.0, 60.0) for a in _AXES[:2])
    return Variant(parameters, blown(winds, channels), about=name)


def _waves(flights: Flights, channels: Mapping[str, Added]) -> list[Variant]:
    """A wind that comes and goes with one frequency, in each manoeuvre with its own phase, as channels show it."""
    if not channels:
        return []
    duration = min(len(f) * f.dt for f in flights)
    tried = np.arange(_PERIODS[0], _PERIODS[1], _STEP) / duration
    tried = tried[tried < _OF_SAMPLING / max(f.dt for f in flights)]
    if not len(tried):
        return []
    left = np.array([sum(_periodic(f, channels, x)[1] for f in flights) for x in tried])
    made = []
    for frequency in tried[scipy.signal.argrelmin(np.pad(left, 1, constant_values=np.inf))[0] - 1]:
        made.append((float(left[tried == frequency][0]), float(frequency)))
    found = []
    for _, frequency in sorted(made)[:_FREQUENCIES]:
        amplitudes = {f.name: _periodic(f, channels, frequency)[0] for f in flights}
        for axis in range(2):
            crests = {
                f.name: _first_after(f.t[0], np.arctan2(*amplitudes[f.name][axis][::-1]), frequency) for f in flights
            }
            found += [_wave(channels, axes, frequency, crests) for axes in ((axis,), (0, 1))]
    return found


def _first_after(start: float, phase: float, frequency: float) -> float:
    """First time [s] after the start at which a wave of a frequency and a phase [rad] has its crest."""
    return float(start + (phase / (2.0 * np.pi * frequency) - start) % (1.0 / frequency))


def _periodic(flight: Flight, channels: Mapping[str, Added], frequency: float) -> tuple[Array, float]:
    """Amplitudes (axis; cosine, sine) of a periodic wind that channels show, and the fraction of their power left."""
    phase = 2.0 * np.pi * frequency * flight.t
    size = {r: float(np.std(flight.difference[r])) for r in channels if r in flight.measured}
    used = {r: channels[r] for r, x in size.items() if x > 0.0}
    if not used:
        return np.zeros((2, 2)), 0.0
    waves = [_along(axis, wave) for axis in range(2) for wave in (np.cos(phase), np.sin(phase))]
    each = [np.concatenate([centred([add(flight, w)]) / size[r] for r, add in used.items()]) for w in waves]
    y = np.concatenate([centred([flight.difference[r]]) / size[r] for r in used])
    X = np.column_stack(each)
    values = np.linalg.lstsq(X, y, rcond=None)[0]
    return values.reshape(2, 2), float(np.sum((y - X @ values) ** 2)) / len(y)


def _wave(
    channels: Mapping[str, Added], axes: tuple[int, ...], frequency: float, crests: Mapping[str, float]
) -> Variant:
    def winds(flight: Flight) -> list[Array]:
        wave = np.cos(2.0 * np.pi * frequency * (flight.t - crests[flight.name]))
        return [_along(i, wave) for i in axes]

    shape = {**shape_of(crests), "frequency": frequency}
    units = {**dict.fromkeys(shape_of(crests), "s"), "frequency": "Hz"}
    parameters = tuple(EffectParameter(_AXES[i], "m/s", 5.0, -60.0, 60.0) for i in axes)
    about = f"with a frequency of {frequency:.2g} Hz"
    return Variant(parameters, blown(winds, channels), shape, units, about, times=tuple(shape_of(crests)))


def _shear_needs(flights: Flights) -> str:
    if channels_in_wind(flights):
        return ""
    if missing := cannot_be_shifted(flights):
        return missing
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
        if len(flights) > 1:
            for length in _SHARED_LENGTHS:
                for when in shared_pulses(flights, responses, length, _SHARED_GUSTS):
                    made.append(_shared_gust(angle, when, length, name))
    channels = channels_in_wind(flights)
    for length in _CHANNEL_LENGTHS if channels else ():
        for times in more_and_more(pulses(flights, tuple(channels), length, _CHANNEL_GUSTS)):
            made += [_blown_gust(channels, axis, times, length) for axis in range(3)]
    return made


def _blown_gust(channels: Mapping[str, Added], axis: int, times: Mapping[str, float], length: float) -> Variant:
    def winds(flight: Flight) -> list[Array]:
        here = flight.name in times
        return [_along(axis, pulse(flight.t, times[flight.name], length) if here else np.zeros(len(flight)))]

    speed = EffectParameter("speed", "m/s", 4.0, -30.0, 30.0)
    shape = {**shape_of(times), "length": length}
    about = f"{_DIRECTIONS[axis]}, in {', '.join(map(repr, times))}"
    units, searched = dict.fromkeys(shape, "s"), tuple(shape_of(times))
    return Variant((speed,), blown(winds, channels), shape, units, about, times=searched)


def _gust(angle: str, times: Mapping[str, float], length: float, name: str) -> Variant:
    def columns(flight: Flight) -> Columns:
        here = flight.name in times
        form = pulse(flight.t, times[flight.name], length) / flight["V"] if here else np.zeros(len(flight))
        # The vane does not see it, so it is not in the simulation; the kinematics agree without it.
        parts = [(r, 0, flight.slope(r, angle) * form) for r in COEFFICIENTS]
        return signature(flight, 1, parts)

    shape = {**shape_of(times), "length": length}
    return Variant(
        (EffectParameter("speed", "m/s", 4.0, -30.0, 30.0),),
        columns,
        shape,
        dict.fromkeys(shape, "s"),
        f"{name}, in {', '.join(map(repr, times))}",
        times=tuple(shape_of(times)),
    )


def _shared_gust(angle: str, when: float, length: float, name: str) -> Variant:
    """One gust that each manoeuvre meets at the same time from its start: from a script, or a gust generator."""

    def columns(flight: Flight) -> Columns:
        form = pulse(flight.t - flight.t[0], when, length) / flight["V"]
        return signature(flight, 1, [(r, 0, flight.slope(r, angle) * form) for r in COEFFICIENTS])

    shape = {"time": when, "length": length}
    speed = EffectParameter("speed", "m/s", 4.0, -30.0, 30.0)
    units = dict.fromkeys(shape, "s")
    return Variant((speed,), columns, shape, units, f"{name}, in every manoeuvre", times=("time",))


def _gust_needs(flights: Flights) -> str:
    if channels_in_wind(flights):
        return ""
    if not coefficients(flights):
        return "simulated coefficients"
    return "" if any(available(flights, c) for c in ("alpha", "beta")) else "channel alpha or beta"


def _gust_says(found: FittedEffect) -> str:
    when = [f"{found[name]:.1f} s" for name in found.variant.shape if name != "length"]
    some, act = ("A gust", "acts") if len(when) == 1 else ("Gusts", "act")
    return (
        f"{some} of {shown(found, 'speed')} {found.variant.about}, {found.text('length')} long at t = "
        f"{', '.join(when)}, {act} on the aircraft and not on the vane."
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
