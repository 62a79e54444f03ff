"""HDF5 files: every dataset is a column, named by its path with dots."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from structsel.errors import DataError
from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_apart_first
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
    units: dict[str, str] = {}
    read_apart_first(path, "h5")
    try:
        with h5py.File(path, "r") as stream:
            content = _walk(stream, "", units)
    except Exception as error:  # OSError, RuntimeError, KeyError, ... of a broken file; groups that hold themselves
        raise DataError(f"'{path}' is no HDF5 file that can be read: {error}") from error
    table = choose(path, content, options)
    prefix = f"{options.variable}." if options.variable else ""
    stated = {name: units[prefix + name] for name in table.columns if prefix + name in units}
    return replace(table, units=table.units | stated)


def _walk(group: h5py.Group, prefix: str, units: dict[str, str]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, member in group.items():
        if isinstance(member, h5py.Group):
            content[name] = _walk(member, f"{prefix}{name}.", units)
        elif isinstance(member, h5py.Dataset) and member.shape is not None:
            content[name] = np.asarray(member[()])
            for attribute in ("unit", "units"):
                text = member.attrs.get(attribute)
                text = text.decode() if isinstance(text, bytes) else text
                if isinstance(text, str) and is_unit(text):
                    units[f"{prefix}{name}"] = text
    return content
