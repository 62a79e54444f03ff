"""Limits of a plant: of its response, of its input, of a state between them, and stops of its motion."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.plant import Plant, answers, find_plant, find_plants
from structsel.effects.base import Columns, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.plant_forces import forced
from structsel.numerics.arrays import Array
from structsel.numerics.compiling import njit
from structsel.numerics.dynamic_elements import first_order_lag

_REACHED = (0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.9995)
"""Quantiles of what a motion reaches, at which there may be a stop."""
_FILLED = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Quantiles of a state behind the input, at which it may overflow."""


_PARTS = (0.4, 0.55, 0.7, 0.8, 0.9)  # of what a simulated response reaches, at which it may be limited
_INPUT_PARTS = tuple(0.05 * k for k in range(6, 20))  # the same of an input
_FRACTION = EffectParameter("fraction", "-", 1.0, 0.5, 1.5)


def limit_variants(flights: Flights) -> list[Variant]:
    """Forms: of each response, of what moves, of a state behind the input, of the input."""
    made = []
    for response in answers(flights):
        plant = find_plant(flights, response)
        held = [f for f in flights if response in f.simulated]
        made += _cut_responses(response, held)
        for moved in find_plants(flights, response):
            made += _end_stops(moved, held)
        made += _overflows(plant, held)
        if plant.source:
            largest = float(np.abs(np.concatenate([f.raw[plant.source] for f in held])).max())
            made += [_cut_input(plant, part * largest) for part in _INPUT_PARTS]
    return made


def _cut_responses(response: str, flights: Flights) -> list[Variant]:
    """A response that stops at a limit: at its upper or lower side, or either way about zero."""
    simulated = np.concatenate([f.simulated[response] for f in flights])
    read = np.concatenate([f.measured[response] for f in flights])
    middle = float(np.median(simulated))
    made = []
    for side, start, x, y in (
        ("upper side", middle, simulated, read),
        ("lower side", -middle, -simulated, -read),
        ("either side", 0.0, np.abs(simulated), np.abs(read)),
    ):
        levels = [start + part * (float(x.max()) - start) for part in _PARTS]
        beyond = x > y.max()  # of what nothing was read, all was limited
        levels.append(float(np.median(y[beyond])) if beyond.any() else float(y.max()))
        made += [_cut_response(response, side, level) for level in levels]
    return made


def _cut_response(response: str, side: str, level: float) -> Variant:
    low, high = {"upper side": (-np.inf, level), "lower side": (-level, np.inf)}.get(side, (-level, level))
    limit = -level if side == "lower side" else level

    def cut(f: Flight) -> Columns:
        if response not in f.simulated:
            return {}
        return {response: (np.clip(f.simulated[response], low, high) - f.simulated[response])[:, None]}

    words = {"channel": response, "side": side}
    return Variant((_FRACTION,), cut, {"limit": limit}, {"limit": ""}, f"{response}, {side}", words=words)


def _cut_input(plant: Plant, limit: float) -> Variant:
    def stopped(f: Flight) -> Columns:
        if plant.response not in f.simulated:
            return {}
        u = f.raw[plant.source]
        return {plant.response: plant.response_to(np.clip(u, -limit, limit) - u)[:, None]}

    words = {"channel": plant.source, "side": "the input, either way"}
    about = f"{plant.source}, the input, either way"
    return Variant((_FRACTION,), stopped, {"limit": limit}, {"limit": ""}, about, words=words)


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
                made.append(forced(plant, parameter, force, f"a stop {side}", {"limit": limit}, "", once))
    return made


def limit_says(found: FittedEffect) -> str:
    """The sentence of a limit."""
    if "stop" in found.estimates:
        return f"The motion runs into {found.variant.about} at {found.text('limit')}, where the simulation continues."
    words = found.variant.words
    limit = found.text("limit")
    return f"{words['channel']} stops at {limit} ({words['side']}), beyond which the simulation continues."
