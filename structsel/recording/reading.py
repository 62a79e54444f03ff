"""Reading files into Recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from structsel.errors import DataError
from structsel.files import path_text
from structsel.readers import READERS, format_of, read_table
from structsel.readers.channel_map import ChannelMap, FileOptions, load_channel_map
from structsel.recording.checks import require_time
from structsel.recording.mapping import to_channels
from structsel.recording.recording import Recording


def read_recording(
    path: str | Path,
    channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None,
    *,
    name: str | None = None,
) -> Recording:
    """Read one file: CSV and other text, Parquet, MATLAB v4 to v7.3, NumPy, HDF5, and logs.

    Logs are those of PX4 (ULog), ArduPilot (DataFlash) and ASAM (MDF). Their channels of several rates are resampled
    to one time axis: signals by linear interpolation, commands by zero-order hold, dropouts as missing samples. The
    findings describe the resampling. Logs need the extras ``ulog``, ``dataflash`` and ``mdf``.

    Parameters
    ----------
    path : str or Path
    channel_map : str, Path, mapping or ChannelMap, optional
        Assigns the columns of the file to channels. Without it, logs and the files of JSBSim and X-Plane are read with
        the standard channel map of the format. In other files the columns keep their names: those in the nomenclature
        are its channels, others have the unit in their header, or an unknown one.
    name : str, optional
        If absent, the file name without its suffix.

    Returns
    -------
    Recording
        With findings, which ``str()`` lists. The provenance of a file from `write_recording` begins with the
        provenance in the file.

    Raises
    ------
    DataError
        The file is missing, empty, unreadable or of an unknown format, or the package that reads it is not
        installed; it has no time, one sample, or time that does not increase strictly.
    MapError
        The map does not fit the file, or a unit does not fit its channel.
    ChannelError
        Without a map, the unit in a header does not fit its channel.
    """
    mapped = None if channel_map is None else load_channel_map(channel_map)
    return load(Path(path), mapped, name).check()


def load(path: Path, mapped: ChannelMap | None, name: str | None = None) -> Recording:
    """Recording of a file, without findings from its samples."""
    table = read_table(path, mapped.file if mapped is not None else FileOptions())
    channels = to_channels(table, mapped)
    require_time(channels.t, table.path)
    through = f" through '{path_text(mapped.source)}'" if mapped is not None else ""
    origin = f"read from '{path_text(path)}'{through}"
    return Recording(
        name or path_text(_stem(path)),
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
        In a folder, the files in a known format.
    channel_map : optional
        One map for all files, as in `read_recording`.

    Returns
    -------
    list of Recording
        Sorted by name.

    Raises
    ------
    DataError
        There is no file, two recordings have one name, or a file cannot be read (`read_recording`).
    """
    return [recording.check() for recording in load_recordings(source, channel_map)]


def load_recordings(
    source: str | Path | Iterable[str | Path],
    channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None,
) -> list[Recording]:
    """Recordings of files as by `read_recordings`, without findings from their samples."""
    paths = list_files(source)
    mapped = None if channel_map is None else load_channel_map(channel_map)
    read = [load(path, mapped) for path in paths]
    remedy = "Rename one, or read them one by one with read_recording(path, name=...)."
    refuse_same_name(((recording.name, path) for recording, path in zip(read, paths)), remedy)
    return sorted(read, key=lambda recording: recording.name)


def refuse_same_name(named: Iterable[tuple[str, Path]], remedy: str) -> None:
    """Raise an error if recordings of two files have one name."""
    by_name: dict[str, Path] = {}
    for name, path in named:
        if name in by_name:
            raise DataError(f"'{by_name[name]}' and '{path}' would both be called '{name}'.\n{remedy}")
        by_name[name] = path


def files_read(folder: Path) -> list[Path]:
    """Files of a folder in a known format, sorted, without hidden files."""
    known = (p for p in sorted(folder.iterdir()) if p.is_file() and format_of(p) in READERS)
    return [p for p in known if not p.name.startswith(".")]


def list_files(source: str | Path | Iterable[str | Path]) -> list[Path]:
    """Files of a folder in a known format, sorted; or the one file, or those of the list.

    Raises
    ------
    DataError
        There is no file.
    """
    if isinstance(source, str | Path):
        folder = Path(source)
        if folder.is_dir():
            paths = files_read(folder)
            if not paths:
                raise DataError(f"folder '{folder}' contains no recordings.\nFormats read: {', '.join(READERS)}.")
            return paths
        return [folder]
    paths = [Path(path) for path in source]
    if not paths:
        raise DataError("read_recordings was given no files.")
    return paths
