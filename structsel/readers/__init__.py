"""Readers of recording files, one module for each format; each returns the columns of a file unchanged.

`read_table` chooses the reader by the suffix of the file.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path

from structsel.errors import DataError
from structsel.readers.channel_map import FileOptions
from structsel.readers.dataflash import read_dataflash
from structsel.readers.hdf5 import read_hdf5
from structsel.readers.jsbsim import with_jsbsim_map
from structsel.readers.matlab import read_matlab
from structsel.readers.mdf import read_mdf
from structsel.readers.numpy_files import read_npy, read_npz
from structsel.readers.parquet import read_parquet
from structsel.readers.table import FileTable
from structsel.readers.text import read_text
from structsel.readers.ulog import read_ulog
from structsel.readers.xplane import with_xplane_map

log = logging.getLogger(__name__)

READERS: dict[str, Callable[[Path, FileOptions], FileTable]] = {
    ".csv": read_text,
    ".tsv": read_text,
    ".txt": read_text,
    ".asc": read_text,
    ".dat": read_text,
    ".parquet": read_parquet,
    ".mat": read_matlab,
    ".npz": read_npz,
    ".npy": read_npy,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".ulg": read_ulog,
    ".bin": read_dataflash,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
}


def format_of(path: Path) -> str:
    """Suffix that states the format, in lower case; ``.csv.gz`` counts as ``.csv``."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes[-1:] == [".gz"] and READERS.get("".join(suffixes[-2:-1])) is read_text:
        return suffixes[-2]
    return suffixes[-1] if suffixes else ""


def read_table(path: Path, options: FileOptions) -> FileTable:
    """Columns of a file, unchanged.

    Parameters
    ----------
    path : Path
    options : FileOptions
        The ``[file]`` table of a channel map.

    Raises
    ------
    DataError
        When the file is missing, empty, unreadable, or of a format that has no reader.
    """
    if not path.exists():
        raise DataError(f"there is no file '{path}'.")
    if path.is_dir():
        raise DataError(f"'{path}' is a folder; read_recordings() reads one.")
    if not path.is_file():
        raise DataError(
            f"'{path}' is a pipe or a device, which cannot be read twice. Write its content to a file, and give that."
        )
    reader = READERS.get(format_of(path))
    if reader is None:
        raise DataError(
            f"'{path}' has suffix '{path.suffix}', which no reader knows.\n"
            f"Formats read: {', '.join(READERS)}. Convert the file, or rename it if the suffix is wrong."
        )
    if path.stat().st_size == 0:
        raise DataError(f"'{path}' is empty (0 bytes).")
    start = time.perf_counter()
    table = reader(path, options)
    longest = max(map(len, table.columns.values()), default=0)
    log.info(
        "read '%s': %d columns, %d rows, in %.2f s", path, len(table.columns), longest, time.perf_counter() - start
    )
    if not table.columns:
        left = "; ".join(f"'{name}': {why}" for name, why in list(table.unusable.items())[:5])
        raise DataError(f"'{path}' has no columns of numbers." + (f" Left out: {left}." if left else ""))
    return with_xplane_map(with_jsbsim_map(table)) if reader is read_text else table
