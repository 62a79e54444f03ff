"""NumPy files: named arrays in .npz, one matrix or structured array in .npy."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.readers.channel_map import FileOptions
from structsel.readers.compressed import require_bounded
from structsel.readers.matlab import choose
from structsel.readers.table import FileTable, table_from_arrays, table_from_matrix


def read_npz(path: Path, options: FileOptions) -> FileTable:
    """Table of an .npz file: an (n,) array is a column, an (n, k) array k columns.

    Raises
    ------
    DataError
        When the file is no .npz file, or holds pickled objects, which are never loaded.
    """
    content = _load(path)
    if isinstance(content, np.ndarray):
        return read_npy(path, options)
    return choose(path, content, options)


def read_npy(path: Path, options: FileOptions) -> FileTable:
    """Table of an .npy file: columns by number, or by name if the array is structured.

    Raises
    ------
    DataError
        When the file is no .npy file, or holds pickled objects, which are never loaded.
    """
    content = _load(path)
    if not isinstance(content, np.ndarray):
        return choose(path, content, options)
    if content.dtype.names:
        table = table_from_arrays(str(path), {name: content[name] for name in content.dtype.names})
        return table
    return table_from_matrix(str(path), content, transpose=options.transpose)


def _load(path: Path) -> Any:
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                for one in archive.infolist():
                    require_bounded(one.filename, one.compress_size, one.file_size)
        content = np.load(path, allow_pickle=False)
        if isinstance(content, np.ndarray):
            return content
        with content:
            return {name: content[name] for name in content.files}
    except Exception as error:  # zip, header and pickle errors are of many kinds
        raise DataError(f"'{path}' is no NumPy file that can be read: {error}") from error
