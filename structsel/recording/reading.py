"""Reading files into Recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.readers import READERS, format_of, read_table
from structsel.readers.channel_map import ChannelMap, FileOptions, load_channel_map
from structsel.recording.checks import require_clock
from structsel.recording.mapping import to_channels
from structsel.recording.recording import Recording


def read_recording(
    path: str | Path,
    channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None,
    *,
    name: str | None = None,
) -> Recording:
    """Read one file: CSV and other text, Parquet, MATLAB v4 to v7.3, NumPy, HDF5, and logs.

    Logs are those of PX4 (ULog), ArduPilot (DataFlash) and ASAM (MDF), whose many rates are brought to one clock:
    signals in straight lines between neighbouring samples, commands held, nothing across a silence. The findings say
    what was done. They need the extras ``ulog``, ``dataflash`` and ``mdf``.

    Parameters
    ----------
    path : str or Path
    channel_map : str, Path, mapping or ChannelMap, optional
        How the file's columns become ours. Without it a log, and what JSBSim and X-Plane write, is read by the
        standard channel map of its format; otherwise names are taken as they are: those of the nomenclature are ours,
        others are kept with the unit their header states, or an unknown one.
    name : str, optional
        The file's name without its suffix, if not given.

    Returns
    -------
    Recording
        Checked: ``str()`` of it lists what was found. The provenance of a file that `write_recording` wrote
        begins with its own.

    Raises
    ------
    DataError
        The file is missing, empty, unreadable or of an unknown format, or the package that reads it is not
        installed; it has no clock, one sample, or a time that repeats or runs backward.
    MapError
        The map does not fit the file, or a unit does not fit its channel.
    ChannelError
        Without a map, the unit in a header does not fit its channel.
    """
    mapped = None if channel_map is None else load_channel_map(channel_map)
    return load(Path(path), mapped, name).check()


def load(path: Path, mapped: ChannelMap | None, name: str | None = None) -> Recording:
    """What a file gives, as `read_recording`, but with no check of its samples."""
    table = read_table(path, mapped.file if mapped is not None else FileOptions())
    channels = to_channels(table, mapped)
    require_clock(channels.t, table.path)
    origin = f"read from '{path}'" + (f" through '{mapped.source}'" if mapped is not None else "")
    return Recording(
        name or _stem(path),
        channels.t,
        channels.values,
        channels.units,
        (*table.provenance, origin, *channels.notes),
        tuple(channels.findings),
        table.at_cg,
    )


def _stem(path: Path) -> str:
    return Path(path.stem).stem if path.suffix == ".gz" else path.stem


def read_recordings(
    source: str | Path | Iterable[str | Path],
    channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None,
) -> list[Recording]:
    """Read every file of a folder, or of a list, sorted by name.

    Parameters
    ----------
    source : folder, file, or iterable of files
        Of a folder, the files whose suffix a reader knows.
    channel_map : optional
        One map for all; as `read_recording` takes it.

    Returns
    -------
    list of Recording
        Sorted by name.

    Raises
    ------
    DataError
        No file to read, two recordings of one name, or whatever `read_recording` raises.
    """
    paths = list_files(source)
    mapped = None if channel_map is None else load_channel_map(channel_map)
    read = [read_recording(path, mapped) for path in paths]
    by_name: dict[str, Path] = {}
    for recording, path in zip(read, paths):
        if recording.name in by_name:
            raise DataError(
                f"'{by_name[recording.name]}' and '{path}' would both be called '{recording.name}'.\n"
                "Rename one, or read them one by one with read_recording(path, name=...)."
            )
        by_name[recording.name] = path
    return sorted(read, key=lambda recording: recording.name)


def files_read(folder: Path) -> list[Path]:
    """Files of a folder that a reader knows, sorted; hidden ones are not read."""
    known = (p for p in sorted(folder.iterdir()) if p.is_file() and format_of(p) in READERS)
    return [p for p in known if not p.name.startswith(".")]


def list_files(source: str | Path | Iterable[str | Path]) -> list[Path]:
    """Files of a folder that a reader knows, sorted; or the one file, or those given.

    Raises
    ------
    DataError
        There is none.
    """
    if isinstance(source, str | Path):
        folder = Path(source)
        if folder.is_dir():
            paths = files_read(folder)
            if not paths:
                raise DataError(f"folder '{folder}' holds no recordings.\nFormats read: {', '.join(READERS)}.")
            return paths
        return [folder]
    paths = [Path(path) for path in source]
    if not paths:
        raise DataError("read_recordings was given no files.")
    return paths
