"""Standard channel maps: the meaning of the names that every file of a format has."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from structsel.errors import DataError
from structsel.readers.channel_map import ChannelEntry, ChannelMap, FileOptions
from structsel.readers.table import FileTable


@dataclass(frozen=True)
class StandardChannel:
    """Columns that usually have one channel in a format.

    Attributes
    ----------
    channel : str
    columns : sequence of str, or of mappings of str to float
        Best first; the first the file has, with numbers in it, is taken. A mapping is a weighted sum.
    unit : str
        Of the columns.
    sign : 1 or -1
    hold : bool
        A command, see `ChannelEntry`.
    assumption : str
        Assumption about the channel, which is reported with it.
    """

    channel: str
    columns: Sequence[str | Mapping[str, float]]
    unit: str | None = None
    sign: Literal[1, -1] = 1
    hold: bool = False
    assumption: str = ""


def with_standard_map(
    table: FileTable, source: str, usual: Sequence[StandardChannel], *, others: str = "leave"
) -> FileTable:
    """Table with the standard channel map of its format, of the columns that the file has.

    Parameters
    ----------
    table : FileTable
    source : str
        Whose map it is, for messages: "PX4's usual topics".
    usual : sequence of StandardChannel
    others : {"leave", "keep"}
        Whether columns that the map does not list are left out or kept.
    """
    channels: dict[str, ChannelEntry] = {}
    assumptions: dict[str, str] = {}
    for row in usual:
        there = [
            column
            for column in row.columns
            if all(_has_numbers(table, name) for name in ([column] if isinstance(column, str) else column))
        ]
        if not there or row.channel in channels:
            continue
        where: dict[str, Any] = {"column": there[0]} if isinstance(there[0], str) else {"columns": dict(there[0])}
        channels[row.channel] = ChannelEntry(**where, unit=row.unit, sign=row.sign, hold=row.hold)
        if row.assumption:
            assumptions[row.channel] = row.assumption
    if not channels.keys() - {"t"} and others == "leave":
        return table
    standard = ChannelMap(channels=channels, file=FileOptions(others=others), source=source)  # type: ignore[arg-type]
    return replace(table, standard_map=standard, assumptions={**table.assumptions, **assumptions})


def _has_numbers(table: FileTable, column: str) -> bool:
    return column in table.columns and bool(np.isfinite(table.columns[column]).any())


def require_extra(module: str, extra: str, path: Path, kind: str) -> None:
    """Require the optional package that reads a format.

    Raises
    ------
    DataError
        When it is not installed; the message gives the command that installs it.
    """
    package = module.partition(".")[0]
    if find_spec(package) is None:
        raise DataError(
            f"'{path}' is {kind}, which structsel reads with the package {package}, which is not installed.\n"
            f'Install it with: pip install "structsel[{extra}]"'
        )


def densest_time(clocks: Mapping[str, str], columns: Mapping[str, np.ndarray], among: Collection[str] = ()) -> str:
    """Time column with the most samples among those of some columns (of all, if none are given)."""
    found = {clocks[column] for column in (among or clocks)}
    return max(sorted(found), key=lambda clock: len(columns[clock]))
