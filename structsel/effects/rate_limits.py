"""Surfaces that move no faster than their actuators can."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import FittedEffect, Flights, ModelCase, ModelForm, Variant, of_shape
from structsel.effects.inputs import DrivenChannel, channels_with_input
from structsel.effects.model_forms import MakeModel, state_after
from structsel.effects.operators import spaced
from structsel.effects.signals import gathered
from structsel.effects.surfaces import (
    ALL,
    FRACTION,
    Follow,
    Operator,
    actuated,
    departure,
    displaced,
    followed,
    used_controls,
)
from structsel.effects.wording import SURFACES, shown, subject
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit

_LONGEST = 1.5  # s, that a surface takes at most through all it is asked
_LAGGING = 0.05  # s, of a limited actuator that lags as well; chosen, not critical
_LAGGED = "with a lag"
_PART = 0.2  # of a recording, that an input takes at most through its range
_FINE = 1.3  # ratio of one rate tried to the next


def rate_variants(flights: Flights) -> list[Variant]:
    """Forms: of each surface, one way only, with a lag, of all."""
    made = []
    for control in used_controls(flights):
        fastest = max(float(np.abs(f.rate(f[control])).max()) for f in flights)
        # A step within a sample is faster than any limit: what counts there is how long its size takes.
        slowest = min(0.12 * fastest, float(np.ptp(gathered(flights, control))) / _LONGEST)
        count = 1 + int(np.ceil(np.log(0.85 * fastest / slowest) / np.log(_FINE)))
        model = state_after([control], "rate limit", "limited", lambda case: {"rate": case.quantity("rate")})
        form = partial(_limiting, partial(followed, control), SURFACES[control], "rad/s", model)
        made += [of_shape(form, x) for x in spaced(slowest, 0.85 * fastest, count)]
        for limit in spaced(2.0 * slowest, 0.7 * fastest, 3):
            made += [of_shape(partial(_one_way, control, way), limit) for way in ("up", "down")]
            made.append(of_shape(partial(_lagging, control), limit))
    controls = used_controls(flights)
    if len(controls) > 1:
        fastest = max(float(np.abs(f.rate(f[c])).max()) for f in flights for c in controls)
        every = partial(_every, tuple(controls))
        made += [of_shape(every, x) for x in spaced(0.12 * fastest, 0.85 * fastest, 5)]
    return made + [v for one in channels_with_input(flights) for v in _limits_of_input(flights, one)]


def _limiting(follow: Follow, about: str, unit: str, model: MakeModel | None, limit: float) -> Variant:
    columns = follow(partial(actuated, rate=limit))
    return Variant((FRACTION,), columns, {"rate": limit}, {"rate": unit}, about, model=model)


def _one_way(control: str, way: str, limit: float) -> Variant:
    up, down = (limit, np.inf) if way == "up" else (np.inf, limit)
    return _rated((control,), partial(_slewing, up=up, down=down), limit, f", {way} only")


def _lagging(control: str, limit: float) -> Variant:
    return _rated((control,), partial(actuated, lag=_LAGGING, rate=limit), limit, f", {_LAGGED}")


def _every(controls: Sequence[str], limit: float) -> Variant:
    return _rated(controls, partial(actuated, rate=limit), limit)


def _limits_of_input(flights: Flights, one: DrivenChannel) -> list[Variant]:
    """The input of a simulated channel, which drives it no faster than at some rate."""
    recorded = [f.raw[one.control] for f in flights]
    fastest = max(float(np.abs(f.rate(x)).max()) for f, x in zip(flights, recorded))
    slowest = min(0.05 * fastest, float(np.ptp(np.concatenate(recorded))) / (_PART * flights[0].dt * len(flights[0])))
    count = 1 + int(np.ceil(np.log(0.85 * fastest / slowest) / np.log(_FINE)))
    form = partial(_limiting, one.behind, one.control, "per s", None)
    return [of_shape(form, x) for x in spaced(slowest, 0.85 * fastest, count)]


def _rated(controls: Sequence[str], operator: Operator, limit: float, more: str = "") -> Variant:
    columns = displaced(*((c, 0, departure(c, operator)) for c in controls))
    about = (SURFACES[controls[0]] if len(controls) == 1 else ALL) + more
    return Variant((FRACTION,), columns, {"rate": limit}, {"rate": "rad/s"}, about, model=_no_model)


def _no_model(case: ModelCase) -> ModelForm | None:
    """A model has no state of this kind."""
    return None


def _slewing(x: Array, flight: Flight, up: float, down: float) -> Array:
    made = np.empty(len(x))
    _slew(np.ascontiguousarray(x), up * flight.dt, down * flight.dt, made)
    return made


@njit(cache=True)
def _slew(x, up, down, made):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Position that follows x with steps between -down and up [x's unit per sample]."""
    made[0] = x[0]
    for k in range(1, x.size):
        made[k] = made[k - 1] + min(max(x[k] - made[k - 1], -down), up)


def rate_says(found: FittedEffect) -> str:
    """The sentence of a rate limit."""
    if found.variant.about == ALL:
        return f"Each surface moves no faster than {shown(found, 'rate')}, slower than its command."
    return f"The {subject(found)} moves no faster than {shown(found, 'rate')}, slower than its command."
