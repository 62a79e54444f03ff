"""Measurement data files of ASAM (MDF 3 and 4, ``.mf4``, ``.mdf``): every channel is a column on its group's clock."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import find_channel, is_known
from structsel.readers.channel_map import FileOptions
from structsel.readers.standard_maps import StandardChannel, densest_time, import_extra, with_standard_map
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
    asammdf = import_extra("asammdf", "mdf", path, "an MDF file")
    table, wrong = _read(path, asammdf)
    if table is None:
        raise DataError(f"'{path}' is no MDF file that can be read: {wrong}\nWrite it again.")
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


def _read(path: Path, asammdf: ModuleType) -> tuple[FileTable | None, str]:
    """Table, or what is wrong with the file.

    What asammdf has half opened complains, as it is thrown away, of what it does not have; nobody need hear that.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        with asammdf.MDF(path) as content:
            return _table(path, content), ""
    except Exception as error:  # asammdf's own, and struct.error, ValueError, KeyError, ... of a broken file
        wrong = str(error)
    finally:
        gc.collect()
        sys.unraisablehook = hook
    return None, wrong


def _table(path: Path, content: Any) -> FileTable:
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    unusable: dict[str, str] = {}
    for g, group in enumerate(content.groups):
        master = content.masters_db.get(g)
        clock = f"t (group {g + 1})" if len(content.groups) > 1 else "t"
        for c, channel in enumerate(group.channels):
            if c == master:
                continue
            taken = {*columns, *unusable, clock}
            name = channel.name if channel.name not in taken else f"{channel.name} (group {g + 1})"
            signal = content.get(group=g, index=c, ignore_invalidation_bits=True)
            values = np.asarray(signal.samples)
            if values.dtype.kind not in "biuf" or values.ndim != 1 or master is None or not len(values):
                unusable[name] = "no times" if master is None else f"of type {values.dtype}, {len(values)} samples"
                continue
            invalid = getattr(signal, "invalidation_bits", None)
            if invalid is not None:
                values = np.where(np.asarray(invalid), np.nan, values)
            if clock not in columns:
                columns[clock], units[clock], clocks[clock] = np.asarray(signal.timestamps), "s", clock
            columns[name], clocks[name] = values, clock
            stated = signal.unit.strip() if signal.unit else split_header(name)[1]
            if stated and is_unit(stated):
                units[name] = stated
    return FileTable(str(path), columns, units=units, clocks=clocks, unusable=unusable)
