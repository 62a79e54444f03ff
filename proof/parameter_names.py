"""Injected parameters under the names and in the units in which a diagnosis states them."""

from __future__ import annotations

import math
from collections.abc import Callable

from proof.keys import EffectKey

_Convert = Callable[[float], float]


def _same(x: float) -> float:
    return x


def _less_one(x: float) -> float:
    return x - 1.0


def _inverse_less_one(x: float) -> float:
    return 1.0 / x - 1.0


def _in_hertz(x: float) -> float:
    return x / (2.0 * math.pi)


_RULES: dict[str, tuple[tuple[str, str, _Convert], ...]] = {
    "sensor-bias": (("bias", "bias", _same),),
    "sensor-scale": (("scale", "scale", _less_one),),
    "sensor-delay": (("delay", "delay", _same),),
    "sensor-position": (("x", "x", _same), *((f"d{c}", c, _same) for c in "xyz")),
    "position-error": (("V scale", "factor", _less_one), ("scale of V", "factor", _less_one)),
    "actuator-lag": (("lag", "lag", _same), ("tau", "lag", _same), ("delay", "delay", _same)),
    "actuator-rate-limit": (("rate", "rate", _same),),
    "backlash": (("width", "width", _same),),
    "augmentation": tuple((f"gain on {c}", f"gain of {c}", _same) for c in "pqr"),
    "thrust-line": (("z", "offset down", _same),),
    "thrust-scale": (("scale", "fraction", _less_one),),
    "thrust-lag": (("tau", "lag", _same),),
    "mass-error": (("stated over true", "fraction", _inverse_less_one), ("factor", "fraction", _less_one)),
    "inertia-error": tuple((c, c, _less_one) for c in ("Ix", "Iy", "Iz")),
    "cg-shift": (("x", "x", _same), ("y", "y", _same)),
    "engine-gyroscopic": (("I_rotor", "angular momentum", _same),),
    "structural-mode": (("frequency", "frequency", _same), ("frequency in Hz", "frequency", _same)),
    "slosh": (("frequency in Hz", "frequency", _same), ("slosh_frequency", "frequency", _in_hertz)),
    "static-stall": (("stall_alpha", "stall angle", _same), ("alpha", "stall angle", _same)),
    "stall-hysteresis": (("stall_alpha", "onset", _same), ("alpha*", "onset", _same), ("stall_tau1", "tau1", _same)),
    "reynolds": (("CX:lnRe", "drag per ln Re", _same), ("CZ:lnRe*alpha", "slope per ln Re", _same)),
    "gust": (("peak in m/s", "speed", _same),),
    "steady-wind": (("wind_n", "north", _same), ("wind_e", "east", _same)),
}
_TERMS = {"wrong-derivative": "_", "missing-term": ": ", "cross-coupling": ": ", "slipstream": " per "}
"""Effects whose parameters are values of terms, and what stands between response and term in a diagnosis."""
_THIRD = {
    frozenset(pair): axis
    for pair, axis in ((("ax", "az"), "y"), (("ay", "az"), "x"), (("p", "r"), "y"), (("alpha", "beta"), "x"))
}


def sizes_put_in(effect: EffectKey) -> dict[str, float]:
    """What a diagnosis should find for an effect, where names correspond.

    Sizes without signs: what is positive is a matter of how the truth was written down.

    Returns
    -------
    mapping of a diagnosis' parameter to float
    """
    held = effect.parameters
    made: dict[str, float] = {}
    for name, found, convert in _RULES.get(effect.effect, ()):
        if isinstance(x := held.get(name), float):
            made[found] = abs(convert(x))
    if effect.effect in _TERMS:
        for name, x in held.items():
            response, colon, term = name.partition(":")
            if colon and isinstance(x, float):
                made[f"{response}{_TERMS[effect.effect]}{term}"] = abs(x)
    if effect.effect == "sensor-misalignment" and isinstance(x := held.get("angle"), float):
        # Two channels mix where their triad, or the boom, is turned about the third axis.
        pair = str(held.get("channels", f"{held.get('channel')}, {held.get('of')}")).split(", ")
        made[f"about {_THIRD[frozenset(pair)]}"] = abs(x)
    # One moment of inertia, one feedback or one stop is named in addition to its size.
    if isinstance(moment := held.get("moment"), str) and isinstance(x := held.get("stated over true"), float):
        made[moment] = abs(_inverse_less_one(x))
    if isinstance(rate := held.get("rate"), str) and isinstance(x := held.get("gain"), float):
        made[f"gain of {rate}"] = abs(x)
    stops = [x for end in ("low", "high") if isinstance(x := held.get(end), float)]
    if effect.effect == "actuator-saturation" and len(stops) == 1:
        made["stop"] = abs(stops[0])
    return made
