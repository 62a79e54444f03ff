"""Recordings left in their files: known by name, length and findings, read whenever their samples are wanted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.nomenclature import unit_of
from structsel.numerics.blocks import JobRunner, Progress
from structsel.readers.channel_map import ChannelMap, load_channel_map
from structsel.recording.checks import Finding
from structsel.recording.reading import list_files, load, read_recording
from structsel.recording.recording import Recording

Prepare = Callable[[Recording], Recording]


@dataclass(frozen=True, eq=False)
class Origin:
    """Where a manoeuvre comes from, and how it is made of what is read.

    Attributes
    ----------
    path : Path
    channel_map : ChannelMap, optional
    rows : (int, int), optional
        First sample and last plus one; all where absent.
    prepare : callable, optional
        Applied to the recording read.
    """

    path: Path
    channel_map: ChannelMap | None
    rows: tuple[int, int] | None
    prepare: Prepare | None

    def read(self) -> Recording:
        """The manoeuvre, not checked: it was when it was listed."""
        made = load(self.path, self.channel_map)
        if self.rows is not None:
            first, last = self.rows
            channels = {name: values[first:last] for name, values in made.channels.items()}
            made = replace(made, t=made.t[first:last], channels=channels, findings=())
        return made if self.prepare is None else self.prepare(made)


class _Recent(threading.local):
    """The manoeuvre a thread read last: a worker goes from one to the next, and memory holds one for each worker."""

    origin: Origin | None = None
    read: Recording | None = None


_recent = _Recent()


@dataclass(frozen=True, eq=False)
class StoredRecording:
    """A recording in its file; what is known of it without reading, and its channels, which are read when asked for.

    Attributes
    ----------
    name : str
    samples : int
    dt : float [s]
    names : tuple of str
        Channels, the clock not among them.
    units : mapping of str to str
        Of channels the nomenclature does not hold.
    provenance : tuple of str
    findings : tuple of Finding
    origin : Origin
    """

    name: str
    samples: int
    dt: float
    names: tuple[str, ...]
    units: Mapping[str, str]
    provenance: tuple[str, ...]
    findings: tuple[Finding, ...]
    origin: Origin

    def __len__(self) -> int:
        return self.samples

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.names

    __iter__ = None

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel by name, (n,), read-only."""
        return self._held()[name]

    def unit(self, name: str) -> str:
        """Unit of a channel; see `Recording.unit`."""
        return unit_of(name, self.units)

    def require(self, *names: str, finite: bool = False, by: str) -> None:
        """Refuse to go on without these channels; see `Recording.require`."""
        self._held().require(*names, finite=finite, by=by)

    def read(self) -> Recording:
        """The recording itself, with its findings."""
        made = self.origin.read()
        return replace(made, name=self.name, provenance=self.provenance, findings=self.findings)

    def _held(self) -> Recording:
        if _recent.origin is not self.origin:
            _recent.origin = _recent.read = None  # given up before the next is read
            made = self.origin.read()
            if len(made) != self.samples or not set(self.names) <= set(made.names):
                raise DataError(
                    f"'{self.origin.path}' is not what it was when it was listed: {len(made)} samples, not "
                    f"{self.samples}, or other channels.\nLet nothing write to the files, and start again."
                )
            _recent.read = replace(made, name=self.name, provenance=self.provenance, findings=())
            _recent.origin = self.origin
        assert _recent.read is not None
        return _recent.read


def stream_recordings(
    source: str | Path | Iterable[str | Path],
    channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None,
    *,
    prepare: Prepare | None = None,
    split: bool = False,
    workers: int = 2,
    client: Any = None,
    progress: Progress | None = None,
) -> list[StoredRecording]:
    """List the recordings of a folder, or of files, without holding their samples.

    Every file is read and checked once, one for each worker at a time, and again whenever something is made of it:
    `structsel.select` takes what comes back as it takes recordings, and needs memory for one manoeuvre for each worker.

    Parameters
    ----------
    source, channel_map
        As `read_recordings` takes them.
    prepare : callable, optional
        From the recording read to the one wanted: ``partial(compute_coefficients, aircraft=aircraft, V0=80.0)``. It is
        called at every reading; where it takes long, write the recordings it makes and stream those.
    split : bool
        Cut files at gaps in time, as `Recording.split`.
    workers : int
        Threads.
    client : distributed.Client, optional
        Of a Dask cluster, whose workers then read the files.
    progress : callable, optional
        Called with files done and files in all.

    Returns
    -------
    list of StoredRecording
        Sorted by the files' names; parts of one file in order of time.

    Raises
    ------
    DataError
        As `read_recordings`.
    """
    mapped = None if channel_map is None else load_channel_map(channel_map)
    paths = list_files(source)
    one = partial(_list_file, channel_map=mapped, prepare=prepare, split=split)
    listed = list(JobRunner(client).map(one, paths, workers, progress))
    by_name: dict[str, StoredRecording] = {}
    in_order = sorted(range(len(paths)), key=lambda i: paths[i].stem)
    for recording in (r for i in in_order for r in listed[i]):
        if recording.name in by_name:
            raise DataError(
                f"'{by_name[recording.name].origin.path}' and '{recording.origin.path}' would both be called "
                f"'{recording.name}'.\nRename one."
            )
        by_name[recording.name] = recording
    return list(by_name.values())


def _list_file(
    path: Path, *, channel_map: ChannelMap | None, prepare: Prepare | None, split: bool
) -> list[StoredRecording]:
    whole = read_recording(path, channel_map)
    parts = whole.split() if split else [whole]
    found = []
    for part in parts:
        made = part if prepare is None else prepare(part)
        if part is whole:
            rows = None
        else:
            first = int(np.searchsorted(whole.t, part.t[0]))
            rows = (first, first + len(part))
        origin = Origin(path, channel_map, rows, prepare)
        found.append(
            StoredRecording(
                part.name, len(made), made.dt, made.names, dict(made.units), made.provenance, made.findings, origin
            )
        )
    return found
