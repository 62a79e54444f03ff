"""MATLAB files, v4 to v7.3: one matrix, named vectors, or structs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import suggest
from structsel.readers.channel_map import FileOptions
from structsel.readers.isolated import read_isolated
from structsel.readers.table import FileTable, is_numeric, table_from_arrays, table_from_matrix


def read_matlab(path: Path, options: FileOptions) -> FileTable:
    """Table of a .mat file.

    A file of one matrix gives columns by number. Otherwise each vector is a column, named as in
    MATLAB: a field of a struct by its path, such as ``el_1.roll``. ``[file] variable`` picks one
    matrix or struct, within which names then start.

    Raises
    ------
    DataError
        When the file is no MATLAB file, or has no such variable.
    """
    return choose(path, read_isolated(path, "mat"), options)


def choose(path: Path, content: Mapping[str, Any], options: FileOptions) -> FileTable:
    """Table of nested named arrays, after ``[file] variable`` has picked among them."""
    chosen: Any = content
    if options.variable is not None:
        for part in options.variable.split("."):
            if not isinstance(chosen, Mapping) or part not in chosen:
                has = ", ".join(map(str, chosen)) if isinstance(chosen, Mapping) else "no parts"
                raise DataError(
                    f"[file] variable = '{options.variable}': '{path}' has none.\nIt has: {has}."
                    + (suggest(part, chosen) if isinstance(chosen, Mapping) else "")
                )
            chosen = chosen[part]
        if not isinstance(chosen, Mapping):
            return table_from_matrix(str(path), np.asarray(chosen), transpose=options.transpose)
    matrices = [value for value in chosen.values() if _is_matrix(value)]
    if len(chosen) == 1 and len(matrices) == 1:
        return table_from_matrix(str(path), matrices[0], transpose=options.transpose)
    return table_from_arrays(str(path), flatten(chosen))


def flatten(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Leaves of nested mappings and lists of them, by dotted path; list members by [number]."""
    flat: dict[str, Any] = {}
    for key, value in content.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{name}."))
        elif isinstance(value, list) and value and all(isinstance(member, Mapping) for member in value):
            for j, member in enumerate(value):
                flat.update(flatten(member, f"{name}[{j + 1}]."))
        else:
            try:
                flat[name] = np.asarray(value)
            except ValueError:  # a ragged list, as cell arrays give
                flat[name] = np.array(None)
    return flat


def _is_matrix(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and min(value.shape) > 1 and is_numeric(value)
