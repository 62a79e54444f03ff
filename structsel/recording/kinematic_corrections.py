"""Corrections of a recording that the kinematic checks try: a unit, a sign, two channels exchanged, the clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.formatting import join_names
from structsel.nomenclature import BODY_RATES, EULER_ANGLES
from structsel.readers.units import convert

_UNITS = {
    **dict.fromkeys(BODY_RATES, ("deg/s", "rpm")),
    **dict.fromkeys(EULER_ANGLES, ("deg", "mil")),
    "V": ("kt", "ft/s", "km/h", "mph"),
    "h": ("ft", "km"),
    "az": ("g", "ft/s^2"),
    "t": ("ms", "us", "ns", "min", "h"),
}
"""Wrong units that occur, by channel; "mil" is 1/1000 rad."""
_SI = {**dict.fromkeys(BODY_RATES, "rad/s"), **dict.fromkeys(EULER_ANGLES, "rad"), "V": "m/s", "h": "m",
       "az": "m/s^2", "t": "s"}  # fmt: skip
_WORDS = {"deg": "degrees", "deg/s": "degrees per second", "kt": "knots", "ft": "feet", "ms": "milliseconds",
          "us": "microseconds", "ns": "nanoseconds", "min": "minutes", "h": "hours"}  # fmt: skip
_NEAR = 1.25  # ratio of a scale to a unit within which it indicates that unit: scale errors of instruments
_RANKS = {"unit": 0, "sign": 0, "swap": 0, "scale": 1}


@dataclass(frozen=True)
class ChannelCorrection:
    """One correction.

    Attributes
    ----------
    kind : {"unit", "sign", "swap", "scale"}
    channels : tuple of str
        Those that it changes; ``t`` is the clock.
    factor : float
        By which they are multiplied; two channels of kind "swap" are exchanged instead.
    name : str
        Of the wrong unit.
    """

    kind: str
    channels: tuple[str, ...]
    factor: float
    name: str = ""

    @property
    def rank(self) -> int:
        """A named unit, sign or exchange comes before a factor without a name."""
        return _RANKS[self.kind]

    def apply(self, channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Corrected channels."""
        if self.kind == "swap":
            a, b = self.channels
            return {**channels, a: channels[b], b: channels[a]}
        return {**channels, **{name: self.factor * channels[name] for name in self.channels}}


def unit(channel: str, wrong: str, *others: str) -> ChannelCorrection:
    """Channels that are in another unit than the nomenclature's."""
    return ChannelCorrection("unit", (channel, *others), float(convert(np.ones(1), wrong, _SI[channel])[0]), wrong)


def sign(*channels: str) -> ChannelCorrection:
    """Channels with the opposite sign."""
    return ChannelCorrection("sign", channels, -1.0)


def swapped(one: str, other: str) -> ChannelCorrection:
    """Two channels in each other's place."""
    return ChannelCorrection("swap", (one, other), 1.0)


def scaled(channel: str, factor: float) -> list[ChannelCorrection]:
    """Units of a channel, or of the clock ``t``, that are near a factor; else the factor itself."""
    units = [unit(channel, name) for name in _UNITS[channel]]
    near = [one for one in units if max(one.factor / factor, factor / one.factor) < _NEAR]
    return near or [ChannelCorrection("scale", (channel,), factor)]


def clock(factors: Sequence[float]) -> list[ChannelCorrection]:
    """Units of the time axis near the median of some factors, else that factor; none without factors."""
    return scaled("t", float(np.median(factors))) if factors else []


def cause(alternatives: Sequence[ChannelCorrection]) -> str:
    """The likely cause; of equally likely ones, all: "p or phi seems to have the wrong sign"."""
    first = alternatives[0]
    names = [join_names(one.channels, 5) for one in alternatives]
    kinds = {one.kind for one in alternatives}
    plural = "" if len(first.channels) > 1 else "s"
    if kinds == {"unit"} and len(set(names)) == 1:
        return f"{names[0]} look{plural} like {' or '.join(_WORDS.get(one.name, one.name) for one in alternatives)}"
    if kinds == {"sign"}:
        return f"{' or '.join(names)} seem{plural} to have the wrong sign"
    if kinds == {"scale"}:
        return f"{' or '.join(names)} seems to be wrong by a factor of {max(first.factor, 1.0 / first.factor):.3g}"
    if kinds == {"swap"}:
        return f"{names[0]} seem to be exchanged"
    return ", or ".join(cause([one]) for one in alternatives)


def remedy(alternatives: Sequence[ChannelCorrection]) -> str:
    """What to do about it."""
    first = alternatives[0]
    names = " or ".join(dict.fromkeys(join_names(one.channels, 5) for one in alternatives))
    kinds = {one.kind for one in alternatives}
    if kinds == {"unit"}:
        units = " or ".join(dict.fromkeys(f'"{one.name}"' for one in alternatives))
        return f"set unit = {units} for {names} in the channel map"
    if kinds == {"sign"}:
        return f"set sign = -1 for {names} in the channel map"
    if kinds == {"scale"}:
        other = "the sampling rate" if first.channels == ("t",) else "unit, calibration and sampling rate"
        return f"check {other}, or set scale in the channel map"
    if kinds == {"swap"}:
        return "exchange their columns in the channel map"
    return ", or ".join(dict.fromkeys(remedy([one]) for one in alternatives))
