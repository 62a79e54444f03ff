"""Any plant: an answer that is no aerodynamic coefficient, and the force that its simulation lacks.

A linear plant ``y = G u`` with a force f(y) beside its input obeys ``y = G (u + f)``, so that what is measured less
what is simulated is G f, with f along the *measured* motion: no iteration, however far they part. G is found from the
simulation's own input and output. Errors of its stiffness, damping and gain go along, since whoever fitted a linear
plant to a bent one got them wrong.

A simulation may also state what accelerates a recorded motion, or the force that this motion needs, such as the current
of a motor. Then y and its rate are channels, and what is measured less what is simulated is the force itself. Without
such channels, and without inertia between force and response, no force is tried: it would be a function of the response
that it is to explain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.plant import Plant, answers, find_plant, find_plants
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.operators import spaced
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.dynamic_elements import delayed, first_order_lag

_GAIN = 0.3  # by which the gain may be off of a simulation fitted without the lag that is there
_REACHED = (0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.9995)
"""Quantiles of what a motion reaches, at which there may be a stop."""
_FILLED = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Quantiles of a state behind the input, at which it may overflow."""
_ROUNDINGS = (0.003, 0.01, 0.03, 0.1, 0.3)  # of dry friction, of the rms speed
_LATER = 1.2  # largest ratio of a lag to the next smaller one that is tried
_PATHS = (-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0)  # deg of delta over gamma; at 90 the force would be elastic


Force = Callable[[Array, Array], Array]  # of displacement and speed


def _forced(
    plant: Plant,
    parameter: EffectParameter,
    force: Force,
    about: str,
    shape: dict[str, float] | None = None,
    unit: str = "of the response's rms",
    alone: bool = False,
) -> Variant:
    """A missing force, with errors of stiffness, damping and gain, unless it is to be alone.

    With inertia as well, forces along the measured motion would give that motion back, and explain anything. A force
    that the motion needs is larger by what acts against it.
    """
    stiffness = EffectParameter("stiffness", "input per response", 0.2 * plant.stiffness)
    damping = EffectParameter("damping", "input per rate", 0.05 * plant.stiffness * plant.motion / plant.speed)
    off = [stiffness, damping] if plant.is_placed else [damping]
    further = off if plant.swings and not alone else []
    # A force that accelerates a motion differs from its own gain by noise only.
    gain = [EffectParameter("gain", "relative", 0.05)] if further and not plant.along else []
    parameters = (parameter, *further, *gain)

    def columns(flight: Flight) -> Columns:
        if plant.response not in flight.measured:
            return {}
        y, v = plant.path(flight)
        forces = [force(y, v), *([y, v] if plant.is_placed else [v])[: len(further)]]
        made = [plant.under(plant.sense * f) for f in forces]
        simulated = flight.simulated[plant.response]
        return {plant.response: np.column_stack([*made, *([simulated - simulated.mean()] if gain else [])])}

    units = dict.fromkeys(shape or {}, unit)
    of = next(filter(None, plant.along)) if plant.along else plant.response
    return Variant(parameters, columns, shape or {}, units, f"{about} of {of}")


def _pushed(flights: Flights, placed: bool = False) -> list[Plant]:
    """Plants on whose motion a force can act; `placed` where it depends on the displacement."""
    found = [plant for response in answers(flights) for plant in find_plants(flights, response)]
    return [plant for plant in found if plant.pushes_back and (plant.is_placed or not placed)]


def _stiffening(flights: Flights) -> list[Variant]:
    made = []
    for plant in _pushed(flights, placed=True):
        unit = plant.stiffness
        laws: tuple[tuple[str, int, Force], ...] = (
            ("cube", 3, lambda y, v: y**3),
            ("cube about its mean", 3, lambda y, v: (y - y.mean()) ** 3),
            ("square with sign", 2, lambda y, v: y * np.abs(y)),
            ("square", 2, lambda y, v: y**2),
        )
        for name, power, law in laws:
            sd = 0.2 * unit / plant.motion ** (power - 1)
            made.append(_forced(plant, EffectParameter("restoring", f"input per response^{power}", sd), law, name))
    return made


def _dry(y: Array, v: Array, slow: float) -> Array:
    return np.tanh(v / slow)


def _stribeck(y: Array, v: Array, slow: float) -> Array:
    return np.tanh(v / (0.1 * slow)) * np.exp(-((v / slow) ** 2))


def _friction(flights: Flights) -> list[Variant]:
    made = []
    for plant in _pushed(flights):
        parameter = EffectParameter("force", "input", 0.3 * plant.size, 0.0)
        for fraction in _ROUNDINGS:
            smooth = fraction * plant.speed
            made.append(_forced(plant, parameter, partial(_dry, slow=smooth), "dry friction", {"rounding": fraction}))
        for fraction in (0.3, 1.0):
            law = partial(_stribeck, slow=fraction * plant.speed)
            made.append(_forced(plant, parameter, law, "friction that falls with speed", {"speed": fraction}))
    return [*made, *(v for response in answers(flights) for v in _braked(find_plant(flights, response), flights))]


def _braked(plant: Plant, flights: Flights) -> list[Variant]:
    """Dry friction of a speed that follows its input by a lag: along the simulated speed, which it does not explain."""
    held = [f for f in flights if plant.response in f.simulated]
    simulated = np.concatenate([f.simulated[plant.response] for f in held])
    if not plant.is_lag or simulated.min() * simulated.max() >= 0.0:
        return []
    parameter = EffectParameter("force", "input", 0.3 * plant.size, 0.0)
    made = []
    for fraction in _ROUNDINGS[1:]:
        slow = fraction * float(simulated.std())

        def columns(flight: Flight, slow: float = slow) -> Columns:
            if plant.response not in flight.measured:
                return {}
            speed = flight.simulated[plant.response]
            return {plant.response: plant.response_to(-_dry(speed, speed, slow))[:, None]}

        shape, units = {"rounding": fraction}, {"rounding": "of the response's rms"}
        made.append(Variant((parameter,), columns, shape, units, f"dry friction of {plant.response}"))
    return made


def _hysteresis(flights: Flights) -> list[Variant]:
    made = []
    for plant in _pushed(flights, placed=True):
        parameter = EffectParameter("force", "input per response", 0.5 * plant.stiffness)
        for fraction in spaced(0.2, 6.4, 6):
            for angle in np.radians(_PATHS):
                gamma, delta = float(np.cos(angle)), float(np.sin(angle))
                if gamma + delta < 0.0 and fraction < 1.0:
                    continue  # it hardens, within bounds only while the motion is small
                size = fraction * plant.motion

                def force(y: Array, v: Array, s: float = size, g: float = gamma, d: float = delta) -> Array:
                    made = np.empty(len(y))
                    _bouc_wen(np.ascontiguousarray(y), s, g, d, made)
                    return made

                shape = {"scale": fraction, "gamma": gamma, "delta": delta}
                made.append(_forced(plant, parameter, force, "force that depends on the path", shape))
    return made


@njit(cache=True)
def _bouc_wen(y, scale, gamma, delta, made):  # type: ignore[no-untyped-def]  # pragma: no cover
    """State ``z' = y' - |z| / scale (gamma |y'| sign(z) + delta y')``: rate independent, in the response's unit."""
    z = 0.0
    made[0] = z
    for k in range(1, y.size):
        travelled = y[k] - y[k - 1]
        parts = 2 + int(4.0 * abs(travelled) * (abs(gamma) + abs(delta)) / scale)
        step = travelled / parts
        for _ in range(parts):
            # Midpoint: the law bends at each reversal.
            half = z + 0.5 * (step - (gamma * abs(step) * z + delta * step * abs(z)) / scale)
            z += step - (gamma * abs(step) * half + delta * step * abs(half)) / scale
        made[k] = z


def _saturation(flights: Flights) -> list[Variant]:
    fraction = EffectParameter("fraction", "-", 1.0, 0.5, 1.5)
    made = []
    for response in answers(flights):
        plant = find_plant(flights, response)
        held = [f for f in flights if response in f.simulated]
        simulated = np.concatenate([f.simulated[response] for f in held])
        read = np.concatenate([f.measured[response] for f in held])
        for side, extreme in (("upper", np.max), ("lower", np.min)):
            middle, end = float(np.median(simulated)), float(extreme(simulated))
            levels = [middle + s * (end - middle) for s in (0.4, 0.55, 0.7, 0.8, 0.9)] + [float(extreme(read))]
            for level in levels:
                ends = (-np.inf, level) if side == "upper" else (level, np.inf)

                def cut(f: Flight, r: str = response, ends: tuple[float, float] = ends) -> Columns:
                    return {r: (np.clip(f.simulated[r], *ends) - f.simulated[r])[:, None]} if r in f.simulated else {}

                words = {"channel": response, "side": f"{side} side"}
                about = f"{response}, {side} side"
                made.append(Variant((fraction,), cut, {"limit": level}, {"limit": ""}, about, words=words))
        for moved in find_plants(flights, response):
            made += _end_stops(moved, held)
        made += _overflows(plant, held)
        if plant.source:
            largest = float(np.abs(np.concatenate([f.raw[plant.source] for f in held])).max())
            for s in (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9):

                def stopped(f: Flight, p: Plant = plant, x: float = s * largest) -> Columns:
                    if p.response not in f.simulated:
                        return {}
                    u = f.raw[p.source]
                    return {p.response: p.response_to(np.clip(u, -x, x) - u)[:, None]}

                made.append(
                    Variant(
                        (fraction,),
                        stopped,
                        {"limit": s * largest},
                        {"limit": ""},
                        f"{plant.source}, the input, either way",
                        words={"channel": plant.source, "side": "the input, either way"},
                    )
                )
    return made


def _overflows(plant: Plant, flights: Flights) -> list[Variant]:
    """A first state of a row of lags, as the level of an upper tank, that does not exceed a limit.

    Above it the state stays, and what the input adds overflows: some of it reaches the response at once, without the
    first lag, and what would have come through the first lag is missing.
    """
    tau = plant.time_constant(flights[0].dt)
    if not tau:
        return []
    gain = abs(float(plant.b.sum() / plant.a.sum()))
    parameters = tuple(EffectParameter(name, "response per input", gain) for name in ("overflow", "loss"))
    made = []
    for first in (0.5 * tau, tau, 2.0 * tau):
        reached = np.concatenate([first_order_lag(f.raw[plant.source], f.dt, first) for f in flights])
        for limit in sorted({float(x) for x in np.quantile(reached, _FILLED)}):
            for second in (0.5 * tau, tau, 2.0 * tau):

                def over(f: Flight, one: float = first, two: float = second, limit: float = limit) -> Columns:
                    if plant.response not in f.simulated:
                        return {}
                    spilled = np.zeros(len(f))
                    _overflow(np.ascontiguousarray(f.raw[plant.source]), f.dt, one, limit, spilled)
                    late = first_order_lag(spilled, f.dt, one)
                    each = [first_order_lag(x, f.dt, two) for x in (spilled, -late)]
                    return {plant.response: np.column_stack([x - x.mean() for x in each])}

                words = {"channel": f"A state between {plant.source} and {plant.response}", "side": "upper side"}
                shape = {"limit": limit, "lag before": first, "lag after": second}
                units = {"limit": f"in the unit of {plant.source}", "lag before": "s", "lag after": "s"}
                about = f"between {plant.source} and {plant.response}"
                made.append(Variant(parameters, over, shape, units, about, words=words))
    return made


@njit(cache=True)
def _overflow(u, dt, tau, limit, spilled):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """What a lag of `u` that stays at a limit does not take up, in the unit of `u`."""
    keep = np.exp(-dt / tau)
    state = min(u[0], limit)
    for k in range(1, u.size):
        state = keep * state + (1.0 - keep) * 0.5 * (u[k - 1] + u[k])
        if state > limit:
            spilled[k] = (state - limit) / (1.0 - keep)
            state = limit


def _end_stops(plant: Plant, flights: Flights) -> list[Variant]:
    """What moves runs into a stiff spring: at either end, or at one."""
    if not plant.pushes_back or not plant.is_placed:
        return []
    paths = [plant.path(f)[0] for f in flights]
    y = np.concatenate(paths)
    parameter = EffectParameter("stop", "input per response", 10.0 * plant.stiffness, 0.0)
    made = []
    sides: tuple[tuple[str, Array, Callable[..., Array]], ...] = (
        ("at either end", np.abs(y), lambda y, v, limit: np.sign(y) * np.maximum(np.abs(y) - limit, 0.0)),
        ("at the upper end", y, lambda y, v, limit: np.maximum(y - limit, 0.0)),
        ("at the lower end", -y, lambda y, v, limit: -np.maximum(-y - limit, 0.0)),
    )
    for side, reach, law in sides:
        for limit in sorted({float(x) for x in np.quantile(reach, _REACHED)}):
            if limit > 0.0:
                force = partial(law, limit=limit)
                # A stop that one manoeuvre reaches is an event: no other predicts it.
                once = sum(bool(force(x, x).any()) for x in paths) == 1
                made.append(_forced(plant, parameter, force, f"a stop {side}", {"limit": limit}, "", once))
    return made


_LATE: Mapping[str, Callable[..., Array]] = {"lag": first_order_lag, "delay": delayed}


def delayed_answers(
    flights: Flights, about: str = "actuator that drives {}", operators: Sequence[str] = tuple(_LATE)
) -> list[Variant]:
    """Lags and delays of a plant's input; through a linear or quasi-steady plant they are those of its answer.

    With the gain: a simulation that was fitted without the lag answers too weakly.

    Parameters
    ----------
    flights : sequence of Flight
    about : str
        What is late, with {} for the response.
    operators : sequence of str
        Of "lag" and "delay".
    """
    made = []
    for response in answers(flights):
        first = next(f for f in flights if response in f.simulated)
        low, high = 0.75 * first.dt, 0.05 * first.dt * len(first)
        count = 1 + math.ceil(math.log(high / low) / math.log(_LATER))
        for name in operators:
            for tau in spaced(low, high, count):

                def behind(f: Flight, r: str = response, g: Callable = _LATE[name], x: float = tau) -> Columns:
                    if r not in f.simulated:
                        return {}
                    simulated = f.simulated[r]
                    answer = g(simulated, f.dt, x)
                    return {r: np.column_stack([(answer - simulated) / x, answer])}

                parameters = (
                    EffectParameter(name, "s", tau, 0.5 * tau, 1.5 * tau),
                    EffectParameter("gain", "relative", _GAIN),
                )
                made.append(Variant(parameters, behind, about=about.format(response)))
    return made


def _needs(flights: Flights) -> str:
    return "" if answers(flights) else "a simulated channel that is no coefficient"


def _limit_says(found: FittedEffect) -> str:
    if "stop" in found.estimates:
        return f"The motion runs into {found.variant.about} at {found.text('limit')}, where the simulation continues."
    words = found.variant.words
    limit = found.text("limit")
    return f"{words['channel']} stops at {limit} ({words['side']}), beyond which the simulation continues."


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "stiffening", "static", "A restoring force that grows faster than the displacement.",
        _needs, _stiffening,
        lambda found: f"Beyond the linear restoring force there is a {found.variant.about}: {found.text('restoring')}.",
        look_alikes=("missing-term", "saturation"),
        separated_by="the same input at two amplitudes", check="the static characteristic of the spring",
    ),
    Effect(
        "friction", "actuator", "A force against the motion that hardly depends on the speed.",
        _needs, _friction,
        lambda found: f"There is {found.variant.about}: a force of {found.text('force')} against the motion.",
        look_alikes=("backlash", "mechanical-hysteresis"),
        separated_by="slow reversals at small amplitude, where the motion sticks", check="bearings and seals",
    ),
    Effect(
        "mechanical-hysteresis", "memory", "A restoring force that depends on the path, not on the speed.",
        _needs, _hysteresis,
        lambda found: f"A {found.variant.about}, with an internal state: {found.text('force')}, "
        f"within {found.text('scale')}.",
        look_alikes=("friction", "backlash", "stiffening"),
        separated_by="the same loop run slowly and fast: it keeps its area",
        check="joints and materials that slip or yield",
    ),
    Effect(
        "saturation", "static", "An output, or what drives it, stops at a limit.",
        _needs, _saturation, _limit_says,
        look_alikes=("control-nonlinearity", "stiffening"),
        separated_by="inputs just below and well above the limit", check="overflows, end stops and ranges",
    ),
)  # fmt: skip
