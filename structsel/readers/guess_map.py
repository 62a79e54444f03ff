"""Guess a channel map from the names, the units and the values of a file's columns, to be checked and edited."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import (
    BODY_RATES,
    CONTROL_SURFACES,
    EULER_ANGLES,
    SPECIFIC_FORCES,
    find_channel,
    is_known,
    list_channels,
)
from structsel.readers.aliases import AMBIGUOUS, BY_NAME, SIGN_REVERSED
from structsel.readers.channel_map import ChannelEntry, FileOptions
from structsel.readers.table import UNIT_SUFFIXES, FileTable, split_header
from structsel.readers.units import convert, is_convertible

SURE, LIKELY, UNSURE = "sure", "likely", "unsure"
_RANK = {SURE: 0, LIKELY: 1, UNSURE: 2}
_KINDS = (CONTROL_SURFACES, BODY_RATES, SPECIFIC_FORCES, ("alpha", "beta"), EULER_ANGLES)
_SPELT = Counter(channel.name.lower().replace("_", "") for channel in list_channels())
_ANY_CASE = {key: c.name for c in list_channels() if _SPELT[key := c.name.lower().replace("_", "")] == 1}
"""Channels by their names in lower case, except those that differ in case only (Cl and CL, V and v)."""
_ENOUGH = 20_000  # samples, from which a range is estimated
_SIDES = ("left", "right")


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


@dataclass(frozen=True)
class GuessedMap:
    """A guessed channel map; ``str()`` is the TOML to edit.

    Attributes
    ----------
    path : str
        The file it was guessed for.
    guesses : tuple of Guess
        In the nomenclature's order, the clock first.
    unplaced : dict of str to str
        Columns that are not recognised, with their range or the reason.
    file : FileOptions
        How the file is read.
    """

    path: str
    guesses: tuple[Guess, ...]
    unplaced: Mapping[str, str] = field(default_factory=dict)
    file: FileOptions = field(default_factory=FileOptions)

    def __str__(self) -> str:
        lines = [
            f"# Channel map guessed from the names, units and values of {Path(self.path).name!r}.",
            "# Check every line, and first those that are not sure: the unit, and that a positive control makes a",
            "# negative moment. Then look at the file through it: structsel describe FILE --map THIS",
            'schema = "structsel.map/1"',
            "",
            "[channels]",
        ]
        if not any(guess.channel == "t" for guess in self.guesses):
            lines.append('# t = { column = "..." }        # not found: name it here, or give [file] dt')
        texts = [f"{guess.channel} = {_toml(guess.entry)}" for guess in self.guesses]
        width = max(map(len, texts), default=0)
        lines += [f"{text:<{width}}  # {g.sure}: {g.why}" for text, g in zip(texts, self.guesses)]
        if options := self.file.model_dump(exclude_defaults=True):
            lines += ["", "[file]", *(f"{key} = {_value(value)}" for key, value in options.items())]
        if self.unplaced:
            kept = "kept under their own names" if self.file.others == "keep" else "left out"
            lines += ["", f"# Not recognised, and {kept}:"]
        lines += [f"#   {json.dumps(column, ensure_ascii=False)}: {what}" for column, what in self.unplaced.items()]
        return "\n".join(lines) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Lines and what is left, for machines."""
        return {
            "path": self.path,
            "channels": {
                g.channel: {**g.entry.model_dump(exclude_defaults=True), "sure": g.sure, "why": g.why}
                for g in self.guesses
            },
            "unplaced": dict(self.unplaced),
        }


def guess_map(table: FileTable, options: FileOptions | None = None) -> GuessedMap:
    """Guess a channel map for a table.

    The standard channel map of a format is kept. Other columns are placed by name; their unit is what the file states,
    else what their size suggests.

    Parameters
    ----------
    table : FileTable
    options : FileOptions, optional
        How the file was read, for the map to say as well.

    Raises
    ------
    DataError
        When no column is recognised; the message lists the columns of the file.
    """
    standard = table.standard_map.channels if table.standard_map is not None else {}
    placed: dict[str, list[Guess]] = {}
    for channel, entry in standard.items():
        assumption = table.assumptions.get(channel)
        why = assumption or f"{table.standard_map.source if table.standard_map else ''} have it there"
        placed[channel] = [Guess(channel, entry, LIKELY if assumption else SURE, why)]
    taken = {column for guesses in placed.values() for guess in guesses for column in guess.columns}
    against: dict[str, str] = {}
    for column in table.columns if table.named else ():
        guess = _by_name(table, column, against) if column not in taken else None
        if guess is None or guess.channel in standard:
            continue
        if standard:
            guess = replace(guess, sure=UNSURE, why=f"{guess.why}; not among the format's usual columns")
        placed.setdefault(guess.channel, []).append(guess)
    _combine_left_right(table, placed)
    if "t" not in placed:
        named = {column for guesses in placed.values() for guess in guesses for column in guess.columns}
        placed |= {"t": clocks} if (clocks := _time_by_values(table, named)) else {}
    chosen = _harmonise_units(table, [_choose(guesses) for guesses in placed.values()])
    if not chosen:
        raise DataError(
            f"no column of '{table.path}' is recognised by its name.\nIt has: {table.describe()}.\n"
            "Write the map by hand: [channels] alpha = { column = ..., unit = ... }."
        )
    order = {name: i for i, name in enumerate(["t", *BY_NAME.values()])}
    chosen.sort(key=lambda guess: order.get(guess.channel, len(order)))
    used = {column for guess in chosen for column in guess.columns}
    used |= {table.numbers[int(c)] for c in used if c.isdigit() and int(c) in table.numbers}
    times = set(table.clocks.values())
    unplaced = {c: against.get(c, _range(table.columns[c])) for c in table.columns if c not in used | times}
    unplaced |= table.unusable
    file = options or FileOptions()
    if table.standard_map is not None and table.standard_map.file.others == "keep":
        file = file.model_copy(update={"others": "keep"})
    return GuessedMap(table.path, tuple(chosen), unplaced, file)


def _by_name(table: FileTable, column: str, against: dict[str, str]) -> Guess | None:
    name, tail = _name_and_tail(column)
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
        (stated, f"the name, and the file's unit [{stated}]") if stated else _unit_by_size(table, column, channel)
    )
    if stated is None and target != "-":
        sure = max(sure, LIKELY if why else UNSURE, key=_RANK.__getitem__)
        why = f"the name; no unit stated, {why or f'[{unit}] assumed'}"
    elif stated is None:
        why = f"the name{f'; {why}' if why else ''}"
    elif target != "-" and is_convertible(stated, "-"):
        sure, assumption = UNSURE, assumption or f"a fraction of which value, in [{target}]?"
    values = convert(_some(table.columns[column]), unit, target)
    row = find_channel(channel)
    if channel == "az" and values.size and np.median(values) > 0.0:
        sign, assumption = -1, "it reads up, as load factors do, so its sign is reversed; are ax and ay reversed too?"
        sure = max(sure, LIKELY, key=_RANK.__getitem__)
    if values.size and np.mean((values < row.low) | (values > row.high)) > 0.01:
        sure, assumption = UNSURE, assumption or f"values out of what is plausible; {row.hint or 'a wrong unit'}?"
    if channel in CONTROL_SURFACES:
        sure = max(sure, LIKELY, key=_RANK.__getitem__)
        assumption = assumption or "is a positive one a negative moment?"
    if not values.size:
        return None
    entry = ChannelEntry(column=column, unit=None if unit == stated and stated == table.units.get(column) else unit,
                         sign=-1 if sign == -1 else 1)  # fmt: skip
    return Guess(channel, entry, sure, "; ".join(filter(None, (why, assumption))))


def _name_and_tail(column: str) -> tuple[str, str | None]:
    """Name and unit of a header, a topic's name before it and a unit after an underscore taken off."""
    name, unit = split_header(column)
    if unit is None:
        name = re.split(r"[./]", name)[-1] if not is_known(name) else name
        for tail in sorted(UNIT_SUFFIXES, key=len, reverse=True):
            if name.endswith(f"_{tail}") and len(name) > len(tail) + 1 and not is_known(name):
                return name[: -len(tail) - 1], UNIT_SUFFIXES[tail]
    return name, unit


def _unit_by_size(table: FileTable, column: str, channel: str) -> tuple[str, str]:
    """Unit that the size of the values indicates, and the reason; the SI unit without a reason if it indicates none."""
    values = _some(table.columns[column])
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


def _combine_left_right(table: FileTable, placed: dict[str, list[Guess]]) -> None:
    """Aileron from a left and a right one, where there is no single one."""
    if "da" in placed:
        return
    found: dict[str, str] = {}
    for column in table.columns:
        key = re.sub(r"[^a-z0-9]", "", _name_and_tail(column)[0].lower())
        for side in _SIDES:
            if re.fullmatch(rf"({side}|{side[0]})(aileron|ail)|(aileron|ail)({side}|{side[0]})", key):
                found[side] = column
    if len(found) < 2:
        return
    left, right = found["left"], found["right"]
    unit = table.units.get(left) or _name_and_tail(left)[1] or _unit_by_size(table, left, "da")[0]
    if is_convertible(unit, "rad"):
        entry = ChannelEntry(columns={left: -0.5, right: 0.5}, unit=unit)
        placed["da"] = [Guess("da", entry, UNSURE, "half of right less left, if both are positive trailing edge down")]


def _time_by_values(table: FileTable, used: Collection[str]) -> list[Guess]:
    """First column that increases evenly, as a time does, and is not another channel."""
    for number, (column, values) in enumerate(table.columns.items(), 1):
        if column in used or not is_convertible(table.units.get(column, "s"), "s"):
            continue
        steps = np.diff(np.asarray(values, dtype=np.float64))
        if (
            len(steps) > 2
            and np.isfinite(steps).all()
            and (steps > 0.0).all()
            and np.ptp(steps) <= 0.5 * np.median(steps)
        ):
            entry = ChannelEntry(column=column if table.named else number)
            return [Guess("t", entry, UNSURE, f"it increases evenly, by {np.median(steps):.4g}")]
    return []


def _choose(guesses: list[Guess]) -> Guess:
    """Best of the columns that may be one channel; it is unsure if there are others."""
    best = min(guesses, key=lambda guess: _RANK[guess.sure])
    others = [repr(str(g.entry.column)) for g in guesses if g is not best and _RANK[g.sure] <= _RANK[best.sure] + 1]
    if not others:
        return best
    return Guess(best.channel, best.entry, UNSURE, f"{best.why}; or {', '.join(others[:3])}")


def _harmonise_units(table: FileTable, chosen: list[Guess]) -> list[Guess]:
    """Guesses in which channels of one kind without a stated unit have the unit that one of them indicates."""
    unstated = {g.channel: g for g in chosen if g.entry.unit is not None and not _is_stated(table, g.columns)}
    for kind in _KINDS:
        indicated = {
            unstated[c].entry.unit: c for c in kind if c in unstated and unstated[c].entry.unit != find_channel(c).unit
        }
        if len(indicated) != 1:
            continue
        unit, source = next(iter(indicated.items()))
        for i, guess in enumerate(chosen):
            if guess.channel in kind and guess.channel in unstated and guess.entry.unit != unit:
                entry = guess.entry.model_copy(update={"unit": unit})
                chosen[i] = Guess(guess.channel, entry, UNSURE, f"the name; no unit stated, [{unit}] as {source}")
    return chosen


def _is_stated(table: FileTable, columns: list[str]) -> bool:
    return any(column in table.units or _name_and_tail(column)[1] is not None for column in columns)


def _some(values: np.ndarray) -> np.ndarray:
    some = np.asarray(values[:: max(1, len(values) // _ENOUGH)], dtype=np.float64)
    return some[np.isfinite(some)]


def _range(values: np.ndarray) -> str:
    some = _some(values)
    return f"{some.min():.4g} to {some.max():.4g}" if some.size else "no numbers"


def _toml(entry: ChannelEntry) -> str:
    parts = [f"{key} = {_value(value)}" for key, value in entry.model_dump(exclude_defaults=True).items()]
    return "{ " + ", ".join(parts) + " }"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k, ensure_ascii=False)} = {v:g}" for k, v in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
