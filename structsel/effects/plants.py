"""Any plant: an answer that is no aerodynamic coefficient, and the force that its simulation lacks.

A linear plant ``y = G u`` with a force f(y) beside its input obeys ``y = G (u + f)``, so that what is measured less
what is simulated is G f, with f along the *measured* motion: no iteration, however far they part. G is found from the
simulation's own input and output. Errors of its stiffness, damping and gain go along, since whoever fitted a linear
plant to a bent one got them wrong.

A simulation may also state what accelerates a recorded motion, or the force that this motion needs, such as the current
of a motor. Then y and its rate are channels, and what is measured less what is simulated is the force itself. Without
such channels, and without inertia between force and response, a force along the measured response would be a function
of what it is to explain: only dry friction is tried then, along the simulated speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.plant import Plant, answers, find_plant
from structsel.effects.base import Columns, Effect, EffectParameter, Flights, Variant
from structsel.effects.operators import spaced
from structsel.effects.plant_forces import Force, forced, pushed
from structsel.effects.plant_limits import limit_says, limit_variants
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.dynamic_elements import delayed, first_order_lag

_GAIN = 0.3  # by which the gain may be off of a simulation fitted without the lag that is there
_ROUNDINGS = (0.003, 0.01, 0.03, 0.1, 0.3)  # of dry friction, of the rms speed
_LATER = 1.2  # largest ratio of a lag to the next smaller one that is tried
_PATHS = (-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0)  # deg of delta over gamma; at 90 the force would be elastic


def _stiffening(flights: Flights) -> list[Variant]:
    made = []
    for plant in pushed(flights, placed=True):
        unit = plant.stiffness
        laws: tuple[tuple[str, int, Force], ...] = (
            ("cube", 3, lambda y, v: y**3),
            ("cube about its mean", 3, lambda y, v: (y - y.mean()) ** 3),
            ("square with sign", 2, lambda y, v: y * np.abs(y)),
            ("square", 2, lambda y, v: y**2),
        )
        for name, power, law in laws:
            sd = 0.2 * unit / plant.motion ** (power - 1)
            made.append(forced(plant, EffectParameter("restoring", f"input per response^{power}", sd), law, name))
    return made


def _dry(y: Array, v: Array, slow: float) -> Array:
    return np.tanh(v / slow)


def _stribeck(y: Array, v: Array, slow: float) -> Array:
    return np.tanh(v / (0.1 * slow)) * np.exp(-((v / slow) ** 2))


def _friction(flights: Flights) -> list[Variant]:
    made = []
    for plant in pushed(flights):
        parameter = EffectParameter("force", "input", 0.3 * plant.size, 0.0)
        for fraction in _ROUNDINGS:
            smooth = fraction * plant.speed
            made.append(forced(plant, parameter, partial(_dry, slow=smooth), "dry friction", {"rounding": fraction}))
        for fraction in (0.3, 1.0):
            law = partial(_stribeck, slow=fraction * plant.speed)
            made.append(forced(plant, parameter, law, "friction that falls with speed", {"speed": fraction}))
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
    for plant in pushed(flights, placed=True):
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
                made.append(forced(plant, parameter, force, "force that depends on the path", shape))
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
        _needs, limit_variants, limit_says,
        look_alikes=("control-nonlinearity", "stiffening"),
        separated_by="inputs just below and well above the limit", check="overflows, end stops and ranges",
    ),
)  # fmt: skip
