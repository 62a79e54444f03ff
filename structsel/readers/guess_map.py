"""Guess a channel map from the names, the units and the values of a file's columns, to be checked and edited."""

from __future__ import annotations

import json
import re
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
)
from structsel.readers.aliases import BY_NAME
from structsel.readers.channel_map import ChannelEntry, FileOptions
from structsel.readers.column_guess import (
    LIKELY,
    RANK,
    SURE,
    UNSURE,
    Guess,
    finite_sample,
    guess_by_name,
    name_and_unit,
    unit_by_size,
)
from structsel.readers.table import FileTable
from structsel.readers.units import is_convertible

_KINDS = (CONTROL_SURFACES, BODY_RATES, SPECIFIC_FORCES, ("alpha", "beta"), EULER_ANGLES)
_SIDES = ("left", "right")


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
        guess = guess_by_name(table, column, against) if column not in taken else None
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


def _combine_left_right(table: FileTable, placed: dict[str, list[Guess]]) -> None:
    """Aileron from a left and a right one, where there is no single one."""
    if "da" in placed:
        return
    found: dict[str, str] = {}
    for column in table.columns:
        key = re.sub(r"[^a-z0-9]", "", name_and_unit(column)[0].lower())
        for side in _SIDES:
            if re.fullmatch(rf"({side}|{side[0]})(aileron|ail)|(aileron|ail)({side}|{side[0]})", key):
                found[side] = column
    if len(found) < 2:
        return
    left, right = found["left"], found["right"]
    unit = table.units.get(left) or name_and_unit(left)[1] or unit_by_size(table, left, "da")[0]
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
    best = min(guesses, key=lambda guess: RANK[guess.sure])
    others = [repr(str(g.entry.column)) for g in guesses if g is not best and RANK[g.sure] <= RANK[best.sure] + 1]
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
    return any(column in table.units or name_and_unit(column)[1] is not None for column in columns)


def _range(values: np.ndarray) -> str:
    some = finite_sample(values)
    return f"{some.min():.4g} to {some.max():.4g}" if some.size else "no numbers"


def _toml(entry: ChannelEntry) -> str:
    parts = [f"{key} = {_value(value)}" for key, value in entry.model_dump(exclude_defaults=True).items()]
    return "{ " + ", ".join(parts) + " }"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k, ensure_ascii=False)} = {v:g}" for k, v in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
