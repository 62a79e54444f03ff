"""Ranges of the channels a model was identified from, and how far a recording leaves them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from structsel.candidates.formula import get_channel
from structsel.errors import ModelError, StructselWarning
from structsel.nomenclature import unit_of


@dataclass(frozen=True)
class RangeExcursion:
    """How far one channel leaves the ranges the model was identified in.

    Attributes
    ----------
    channel : str
    low, high : float [the channel's SI unit]
        The recorded range.
    fraction : float
        Fraction of the samples outside, 0 to 1.
    below, above : float [the channel's SI unit]
        Largest distance below ``low`` and above ``high``; zero where there is none.
    """

    channel: str
    low: float
    high: float
    fraction: float
    below: float
    above: float

    def __str__(self) -> str:
        unit = unit_of(self.channel)
        parts = [f"{d:.3g} {side}" for d, side in ((self.below, "below"), (self.above, "above")) if d > 0]
        return (
            f"{self.channel} [{unit}] in {100 * self.fraction:.3g} % of samples, up to {' and '.join(parts)} "
            f"[{self.low:.4g}, {self.high:.4g}]"
        )


def recorded_ranges(sources: Iterable[Any], channels: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Least and greatest value of each channel over recordings.

    Parameters
    ----------
    sources : iterable of Recording or mapping of name to (n,) array [SI]
    channels : iterable of str

    Returns
    -------
    dict of channel to (least, greatest)

    Raises
    ------
    ChannelError, DataError
        A channel is missing, or not finite somewhere.
    """
    ranges: dict[str, tuple[float, float]] = {}
    names = sorted(set(channels))
    for source in sources:
        for name in names:
            values = get_channel(source, name, name)
            low, high = float(values.min()), float(values.max())
            if name in ranges:
                low, high = min(low, ranges[name][0]), max(high, ranges[name][1])
            ranges[name] = (low, high)
    return ranges


def find_excursions(source: Any, ranges: Mapping[str, tuple[float, float]]) -> tuple[RangeExcursion, ...]:
    """Channels of a recording that leave their ranges; those that the recording does not have are passed over."""
    out = []
    for name, (low, high) in ranges.items():
        if name not in source:
            continue
        values = np.asarray(source[name], dtype=float)
        outside = (values < low) | (values > high)
        if outside.any():
            below, above = max(low - values.min(), 0.0), max(values.max() - high, 0.0)
            out.append(RangeExcursion(name, low, high, float(outside.mean()), float(below), float(above)))
    return tuple(out)


def report_excursions(
    whose: str, excursions: Sequence[RangeExcursion], outside: Literal["warn", "raise"], stacklevel: int
) -> None:
    """Warn, or raise a ModelError, if a source leaves the ranges that a model was identified in."""
    if not excursions:
        return
    message = f"{whose} leaves the ranges the model was identified in: "
    message += "; ".join(map(str, excursions)) + ". The model is an extrapolation there."
    if outside == "raise":
        raise ModelError(message)
    warnings.warn(message, StructselWarning, stacklevel=stacklevel + 1)


def check_outside(outside: str) -> None:
    """Refuse a value of the option `outside` that is none."""
    if outside not in ("warn", "ignore", "raise"):
        raise ModelError(f"outside={outside!r} is not one of 'warn', 'ignore', 'raise'.")
