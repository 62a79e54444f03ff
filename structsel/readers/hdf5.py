"""HDF5 files: every dataset is a column, named by its path with dots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_isolated
from structsel.readers.matlab import choose
from structsel.readers.table import FileTable
from structsel.readers.units import is_unit


def read_hdf5(path: Path, options: FileOptions) -> FileTable:
    """Table of an HDF5 file; a dataset's attribute ``unit`` or ``units`` states its unit.

    Raises
    ------
    DataError
        When the file is no HDF5 file, or has no such variable.
    """
    content, texts = read_isolated(path, "h5")
    units = {name: text for name, found in texts.items() for text in found if is_unit(text)}
    table = choose(path, content, options)
    prefix = f"{options.variable}." if options.variable else ""
    stated = {name: units[prefix + name] for name in table.columns if prefix + name in units}
    return replace(table, units=table.units | stated)
