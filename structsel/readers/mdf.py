"""Measurement data files of ASAM (MDF 3 and 4, ``.mf4``, ``.mdf``): every channel is a column on its group's clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.nomenclature import find_channel, is_known
from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_isolated
from structsel.readers.standard_maps import StandardChannel, densest_time, require_extra, with_standard_map
from structsel.readers.table import FileTable, split_header
from structsel.readers.units import is_convertible, is_unit

MAGIC = b"MDF     "
_UNFINISHED = b"UnFinMF "


def read_mdf(path: Path, options: FileOptions) -> FileTable:
    """Table of an MDF file: physical values, in the units the file states, invalidated samples NaN.

    A channel whose name an earlier group has taken is called ``name (group 3)``. Its standard map takes channels
    that are named as in the nomenclature, with or without their unit, and keeps the others; the clock is that of the
    group with the most samples among them.

    Raises
    ------
    DataError
        asammdf is not installed, or the file is no MDF file, cannot be read, or holds no channel of numbers.
    """
    with path.open("rb") as stream:
        begins = stream.read(8)
    if begins not in (MAGIC, _UNFINISHED):
        raise DataError(f"'{path}' is no MDF file: it does not begin as one.\nCheck that it is the right file.")
    require_extra("asammdf", "mdf", path, "an MDF file")
    table = _table(path, read_isolated(path, "mdf"))
    if not table.columns:
        raise DataError(
            f"'{path}' is an MDF file without a channel of numbers that has times.\n"
            f"Left out: {'; '.join(f'{name}: {why}' for name, why in list(table.unusable.items())[:5]) or 'nothing'}."
        )
    usual = []
    for column in table.columns:
        name = split_header(column)[0] if column in table.units else column
        unit = table.units.get(column)
        fits = is_known(name) and (unit is None or is_convertible(unit, find_channel(name).unit))
        if fits and name != "t":
            usual.append(StandardChannel(name, (column,)))
    known = [column for row in usual for column in row.columns if isinstance(column, str)]
    clock = densest_time(table.clocks, table.columns, known)
    return with_standard_map(table, "the nomenclature", (StandardChannel("t", (clock,)), *usual), others="keep")


def _table(path: Path, content: Any) -> FileTable:
    """Table of the channels, with the units that are stated or that their names have."""
    units = dict.fromkeys(content.clocks.values(), "s")
    for name, stated in content.stated.items():
        unit = split_header(name)[1] if stated is None else stated
        if unit and is_unit(unit):
            units[name] = unit
    return FileTable(str(path), content.columns, units=units, clocks=content.clocks, unusable=content.unusable)
