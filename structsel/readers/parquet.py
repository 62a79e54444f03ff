"""Parquet files: one column per signal; a column's metadata may state its ``unit``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from structsel.errors import DataError
from structsel.readers.channel_map import FileOptions
from structsel.readers.compressed import require_bounded
from structsel.readers.table import FileTable, as_float, channels_at_cg, require_schema, split_header
from structsel.readers.units import is_unit

METADATA = b"structsel"
"""Key of the metadata under which `write_recording` stores the provenance, as JSON."""


def read_parquet(path: Path, options: FileOptions) -> FileTable:
    """Table of a Parquet file; time stamps become seconds since the first sample.

    Raises
    ------
    DataError
        When the file is no Parquet file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # One file, by its handle: a path would let folders named key=value add columns.
        with path.open("rb") as stream:
            size = pq.read_metadata(stream)
            require_bounded("the table", path.stat().st_size, 8 * size.num_rows * size.num_columns)
            stream.seek(0)
            content = pq.read_table(stream)
        names = content.column_names
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise DataError(f"'{path}' is no Parquet file: {str(error).splitlines()[0]}") from error
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    unusable: dict[str, str] = {}
    notes: list[str] = []
    for name in names:
        kind = content.schema.field(name).type
        values = content.column(name)
        if pa.types.is_timestamp(kind):
            nanoseconds = values.cast(pa.timestamp("ns", tz=kind.tz)).cast(pa.int64()).to_numpy()
            columns[name] = as_float((nanoseconds - nanoseconds[0]) * 1e-9) if len(nanoseconds) else np.empty(0)
            notes.append(f"column '{name}' holds time stamps; read as seconds since the first")
        elif pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
            columns[name] = as_float(values.to_pandas().to_numpy(dtype=np.float64, na_value=np.nan))
        else:
            unusable[name] = f"it is of type {kind}"
        metadata = content.schema.field(name).metadata or {}
        stated = (metadata.get(b"unit") or metadata.get(b"units") or b"").decode(errors="replace")
        header_unit = split_header(name)[1]
        if stated and is_unit(stated):
            units[name] = stated
        elif header_unit is not None:
            units[name] = header_unit
    provenance, at_cg = _own_notes(path, content.schema.metadata or {})
    return FileTable(
        str(path),
        columns,
        units=units,
        numbers={j + 1: name for j, name in enumerate(names)},
        unusable=unusable,
        notes=tuple(notes),
        provenance=provenance,
        at_cg=at_cg,
    )


def _own_notes(path: Path, metadata: dict[bytes, bytes]) -> tuple[tuple[str, ...], frozenset[str]]:
    """Provenance, and channels at the centre of gravity, of a file that `write_recording` wrote; none of any other."""
    if METADATA not in metadata:
        return (), frozenset()
    try:
        held = json.loads(metadata[METADATA])
        schema, notes = str(held["schema"]), tuple(map(str, held["provenance"]))
        at_cg = frozenset(map(str, held["at_cg"])) if "at_cg" in held else channels_at_cg(notes)
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"'{path}': its metadata '{METADATA.decode()}' cannot be read.\nWrite it again.") from error
    require_schema(str(path), schema)
    return notes, at_cg
