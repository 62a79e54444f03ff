"""Writing Recordings to files, with their provenance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from structsel.errors import DataError
from structsel.files import replacing
from structsel.nomenclature import UNKNOWN, is_known
from structsel.readers.parquet import METADATA
from structsel.readers.table import SCHEMA
from structsel.readers.text import AT_CG, PROVENANCE
from structsel.recording.arguments import as_one_recording
from structsel.recording.recording import Recording

if TYPE_CHECKING:
    import pandas as pd


def write_recording(recording: Recording, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a recording as CSV or Parquet, with its provenance.

    A CSV file begins with lines that start with ``#``: the schema, one note on each line as a JSON string, and in the
    line ``# at_cg:`` the channels that are at the centre of gravity. A program that skips these lines can read the
    table (``pandas.read_csv(path, comment="#")``). A Parquet file has the same content as metadata of its schema.
    The header has the units of channels that are not in the nomenclature. `read_recording` restores the notes, so that
    no correction is applied twice. Findings are not written: reading computes them again.

    Parameters
    ----------
    recording : Recording
    path : str or Path
        The suffix, ``.csv`` or ``.parquet``, is the format.
    overwrite : bool
        Replace an existing file, after the new one is complete.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ArgumentError
        It is no recording.
    DataError
        The file exists and `overwrite` is False, the suffix is not one of these, or the file cannot be written.
    """
    recording = as_one_recording(recording, "write_recording(recording, path)")
    path = Path(path)
    write = {".csv": _write_csv, ".parquet": _write_parquet}.get(path.suffix.lower())
    if write is None:
        raise DataError(f"write_recording was given '{path}'; it writes .csv and .parquet.\nUse one of these suffixes.")
    if path.exists() and not overwrite:
        raise DataError(
            f"'{path}' exists already.",
            remedy="Choose another name, or pass overwrite=True.",
            cli_remedy="Choose another name, or pass --overwrite.",
        )
    own = {
        name: f"{name} [{recording.unit(name)}]"
        for name in recording.names
        if not is_known(name) and recording.unit(name) not in (UNKNOWN, "-")
    }
    try:
        with replacing(path) as partial:
            write(recording.to_frame().rename(columns=own), recording, partial)
    except OSError as error:
        raise DataError(f"'{path}' cannot be written: {error.strerror or error}.") from error
    return path


def _write_csv(frame: pd.DataFrame, recording: Recording, path: Path) -> None:
    """Table with the provenance in comment lines."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"# {SCHEMA}\n")
        stream.writelines(f"{PROVENANCE}{json.dumps(note, ensure_ascii=False)}\n" for note in recording.provenance)
        if recording.at_cg:
            stream.write(f"{AT_CG}{json.dumps(sorted(recording.at_cg))}\n")
        frame.to_csv(stream, index=False, lineterminator="\n")


def _write_parquet(frame: pd.DataFrame, recording: Recording, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.Table.from_pandas(frame, preserve_index=False)
    about = {"schema": SCHEMA, "provenance": recording.provenance, "at_cg": sorted(recording.at_cg)}
    metadata = json.dumps(about, ensure_ascii=False).encode()
    with path.open("wb") as stream:
        pq.write_table(table.replace_schema_metadata({**(table.schema.metadata or {}), METADATA: metadata}), stream)
