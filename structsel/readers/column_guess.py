"""The channel that one column may be, by its name, its unit and the size of its values."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from structsel.nomenclature import (
    BODY_RATES,
    CONTROL_SURFACES,
    find_channel,
    is_known,
    list_channels,
)
from structsel.readers.aliases import AMBIGUOUS, BY_NAME, SIGN_REVERSED
from structsel.readers.channel_map import ChannelEntry
from structsel.readers.table import UNIT_SUFFIXES, FileTable, split_header
from structsel.readers.units import convert, is_convertible

SURE, LIKELY, UNSURE = "sure", "likely", "unsure"
RANK = {SURE: 0, LIKELY: 1, UNSURE: 2}
_SPELT = Counter(channel.name.lower().replace("_", "") for channel in list_channels())
_ANY_CASE = {key: c.name for c in list_channels() if _SPELT[key := c.name.lower().replace("_", "")] == 1}
"""Channels by their names in lower case, except those that differ in case only (Cl and CL, V and v)."""
_ENOUGH = 20_000  # samples, from which a range is estimated


@dataclass(frozen=True)
class Guess:
    """One line of a guessed map.

    Attributes
    ----------
    channel : str
    entry : ChannelEntry
    sure : {"sure", "likely", "unsure"}
    why : str
        Reason of the guess, and what to check.
    """

    channel: str
    entry: ChannelEntry
    sure: str
    why: str

    @property
    def columns(self) -> list[str]:
        """Columns of the channel."""
        return [str(self.entry.column)] if self.entry.column is not None else list(self.entry.columns or ())


def guess_by_name(table: FileTable, column: str, against: dict[str, str]) -> Guess | None:
    """Channel of a column by its name; None, with the reason in `against`, if the unit is of another quantity."""
    name, tail = name_and_unit(column)
    stated = table.units.get(column, tail)
    key = re.sub(r"[^a-z0-9]", "", name.lower())
    sure, sign, assumption = SURE, 1, ""
    if is_known(name):
        channel = name
    elif key in BY_NAME or key in _ANY_CASE:
        channel = BY_NAME.get(key) or _ANY_CASE[key]
    elif key in SIGN_REVERSED:
        (channel, assumption), sure, sign = SIGN_REVERSED[key], LIKELY, -1
    elif key in AMBIGUOUS:
        (channel, assumption), sure = AMBIGUOUS[key], UNSURE
    else:
        return None
    target = find_channel(channel).unit
    if stated is not None and not is_convertible(stated, target):
        against[column] = f"may be {channel}, but [{stated}] measures something else than [{target}]"
        return None
    unit, why = (
        (stated, f"the name, and the file's unit [{stated}]") if stated else unit_by_size(table, column, channel)
    )
    if stated is None and target != "-":
        sure = max(sure, LIKELY if why else UNSURE, key=RANK.__getitem__)
        why = f"the name; no unit stated, {why or f'[{unit}] assumed'}"
    elif stated is None:
        why = f"the name{f'; {why}' if why else ''}"
    elif target != "-" and is_convertible(stated, "-"):
        sure, assumption = UNSURE, assumption or f"a fraction of which value, in [{target}]?"
    values = convert(finite_sample(table.columns[column]), unit, target)
    row = find_channel(channel)
    if channel == "az" and values.size and np.median(values) > 0.0:
        sign, assumption = -1, "it reads up, as load factors do, so its sign is reversed; are ax and ay reversed too?"
        sure = max(sure, LIKELY, key=RANK.__getitem__)
    if values.size and np.mean((values < row.low) | (values > row.high)) > 0.01:
        sure, assumption = UNSURE, assumption or f"values out of what is plausible; {row.hint or 'a wrong unit'}?"
    if channel in CONTROL_SURFACES:
        sure = max(sure, LIKELY, key=RANK.__getitem__)
        assumption = assumption or "is a positive one a negative moment?"
    if not values.size:
        return None
    entry = ChannelEntry(column=column, unit=None if unit == stated and stated == table.units.get(column) else unit,
                         sign=-1 if sign == -1 else 1)  # fmt: skip
    return Guess(channel, entry, sure, "; ".join(filter(None, (why, assumption))))


def name_and_unit(column: str) -> tuple[str, str | None]:
    """Name and unit of a header, a topic's name before it and a unit after an underscore taken off."""
    name, unit = split_header(column)
    if unit is None:
        name = re.split(r"[./]", name)[-1] if not is_known(name) else name
        for tail in sorted(UNIT_SUFFIXES, key=len, reverse=True):
            if name.endswith(f"_{tail}") and len(name) > len(tail) + 1 and not is_known(name):
                return name[: -len(tail) - 1], UNIT_SUFFIXES[tail]
    return name, unit


def unit_by_size(table: FileTable, column: str, channel: str) -> tuple[str, str]:
    """Unit that the size of the values indicates, and the reason; the SI unit without a reason if it indicates none."""
    values = finite_sample(table.columns[column])
    target = find_channel(channel).unit
    if not values.size:
        return target, ""
    size, typical = float(np.abs(values).max()), float(np.median(np.abs(values)))
    if target == "rad" and size > (6.4 if channel in ("phi", "psi") else 1.6):
        return "deg", f"up to {size:.3g}, so degrees"
    if target == "rad":
        return "rad", f"up to {size:.3g}, so radians"
    if target == "rad/s" and channel in BODY_RATES and size > 6.0:
        return "deg/s", f"up to {size:.3g}, so degrees per second"
    if channel == "az" and 0.5 < typical < 1.6:
        return "g", "about 1, so g"
    if channel == "az" and 6.0 < typical < 14.0:
        return "m/s^2", "about 9.8, so m/s^2"
    if channel == "t":
        step = (
            float(np.median(np.diff(np.asarray(table.columns[column], dtype=np.float64)))) if len(values) > 1 else 0.0
        )
        if step >= 1000.0:
            return "us", f"steps of {step:.4g}, so microseconds"
        return (
            ("ms", f"steps of {step:.4g}, so milliseconds")
            if step >= 2.0
            else ("s", f"steps of {step:.4g}, so seconds")
        )
    if target == "-" and channel in ("throttle", "gear") and size > 1.5:
        return "%", f"up to {size:.3g}, so percent"
    if channel == "temperature":
        return ("K", "so large it is kelvin") if typical > 150.0 else ("degC", "so small it is Celsius")
    if channel == "pressure" and typical < 1200.0:
        return "hPa", f"about {typical:.3g}, so hectopascal"
    return target, ""


def finite_sample(values: np.ndarray) -> np.ndarray:
    """Finite ones of about 20,000 evenly chosen values."""
    some = np.asarray(values[:: max(1, len(values) // _ENOUGH)], dtype=np.float64)
    return some[np.isfinite(some)]
