"""The region a model was identified in, and how far a recording leaves it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from structsel.candidates.formula import get_channel
from structsel.nomenclature import unit_of


@dataclass(frozen=True)
class Excursion:
    """How far one channel leaves the region flown.

    Attributes
    ----------
    channel : str
    low, high : float [the channel's SI unit]
        The region flown.
    fraction : float
        Share of samples outside, 0 to 1.
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
        ways = [f"{d:.3g} {way}" for d, way in ((self.below, "below"), (self.above, "above")) if d > 0]
        return (
            f"{self.channel} [{unit}] in {100 * self.fraction:.3g} % of samples, up to {' and '.join(ways)} "
            f"[{self.low:.4g}, {self.high:.4g}]"
        )


def flown_region(sources: Iterable[Any], channels: Iterable[str]) -> dict[str, tuple[float, float]]:
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
    region: dict[str, tuple[float, float]] = {}
    names = sorted(set(channels))
    for source in sources:
        for name in names:
            values = get_channel(source, name, name)
            low, high = float(values.min()), float(values.max())
            if name in region:
                low, high = min(low, region[name][0]), max(high, region[name][1])
            region[name] = (low, high)
    return region


def leave(source: Any, region: Mapping[str, tuple[float, float]]) -> tuple[Excursion, ...]:
    """Return the channels of a recording that leave a region, those the recording does not hold apart."""
    out = []
    for name, (low, high) in region.items():
        if name not in source:
            continue
        values = np.asarray(source[name], dtype=float)
        outside = (values < low) | (values > high)
        if outside.any():
            below, above = max(low - values.min(), 0.0), max(values.max() - high, 0.0)
            out.append(Excursion(name, low, high, float(outside.mean()), float(below), float(above)))
    return tuple(out)
