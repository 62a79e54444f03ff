"""Recordings that stay in their files: name, length and findings are in memory, samples are read when needed."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.formatting import count_of
from structsel.nomenclature import unit_of
from structsel.numerics.blocks import JobRunner, Progress
from structsel.readers.channel_map import ChannelMap, load_channel_map
from structsel.recording.finding import Finding
from structsel.recording.reading import list_files, load, read_recording, refuse_same_name
from structsel.recording.recording import Recording

Prepare = Callable[[Recording], Recording]


@dataclass(frozen=True, eq=False)
class Origin:
    """File of a manoeuvre, and the steps from the file to the recording.

    Attributes
    ----------
    path : Path
    channel_map : ChannelMap, optional
    rows : (int, int), optional
        First and last-plus-one sample; all if absent.
    prepare : callable, optional
        Applied to the recording that was read.
    """

    path: Path
    channel_map: ChannelMap | None
    rows: tuple[int, int] | None
    prepare: Prepare | None

    def read(self) -> Recording:
        """The manoeuvre, without new findings: those are from the listing."""
        recording = load(self.path, self.channel_map)
        if self.rows is not None:
            first, last = self.rows
            channels = {name: values[first:last] for name, values in recording.channels.items()}
            recording = replace(recording, t=recording.t[first:last], channels=channels, findings=())
        return recording if self.prepare is None else self.prepare(recording)


def channel_digests(recording: Recording) -> dict[str, str]:
    """Digest of the samples of each channel that varies; equal for equal samples."""
    return {
        name: hashlib.blake2b(values.tobytes(), digest_size=16).hexdigest()
        for name, values in recording.channels.items()
        if len(values) and np.any(values != values[0])
    }


class _Cache(threading.local):
    """The last manoeuvre that a thread read, so that memory contains one for each worker."""

    origin: Origin | None = None
    recording: Recording | None = None


_cache = _Cache()


@dataclass(frozen=True, eq=False, repr=False)
class StoredRecording:
    """A recording that stays in its file; its channels are read when they are needed.

    Attributes
    ----------
    name : str
    samples : int
    dt : float [s]
    names : tuple of str
        Channels, without the time axis.
    units : mapping of str to str
        Of channels that are not in the nomenclature.
    provenance : tuple of str
    findings : tuple of Finding
    origin : Origin
    digests : mapping of str to str
        Digests of the samples of each channel that varies; see `channel_digests`.
    """

    name: str
    samples: int
    dt: float
    names: tuple[str, ...]
    units: Mapping[str, str]
    provenance: tuple[str, ...]
    findings: tuple[Finding, ...]
    origin: Origin
    digests: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        channels = count_of(len(self.names), "channel")
        return f"<StoredRecording {self.name}: {count_of(self.samples, 'sample')}, {channels} in {self.origin.path}>"

    def __len__(self) -> int:
        return self.samples

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.names

    __iter__ = None

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel by name, (n,), read-only."""
        return self._load()[name]

    def unit(self, name: str) -> str:
        """Unit of a channel; see `Recording.unit`."""
        return unit_of(name, self.units)

    def require(self, *names: str, finite: bool = False, by: str) -> None:
        """Raise an error if a channel is missing; see `Recording.require`."""
        self._load().require(*names, finite=finite, by=by)

    def read(self) -> Recording:
        """The recording in memory, with its findings."""
        return replace(self.origin.read(), name=self.name, provenance=self.provenance, findings=self.findings)

    def _load(self) -> Recording:
        """The recording without findings, from memory if it is the last one that was read."""
        if _cache.origin is not self.origin:
            _cache.origin = _cache.recording = None  # frees the memory before the next is read
            recording = self.origin.read()
            if len(recording) != self.samples or not set(self.names) <= set(recording.names):
                raise DataError(
                    f"'{self.origin.path}' has changed since it was listed: {len(recording)} samples, not "
                    f"{self.samples}, or other channels.\nStart again, and do not write to the files in use."
                )
            _cache.recording = replace(recording, name=self.name, provenance=self.provenance, findings=())
            _cache.origin = self.origin
        assert _cache.recording is not None
        return _cache.recording


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
    """List the recordings of a folder, or of files, without their samples in memory.

    Each worker reads and checks one file after another, and reads a file again whenever its samples are needed.
    `structsel.select` accepts the result in place of recordings, and needs memory for one manoeuvre for each worker.

    Parameters
    ----------
    source, channel_map
        As in `read_recordings`.
    prepare : callable, optional
        Applied to each recording that is read: ``partial(compute_coefficients, aircraft=aircraft, V0=80.0)``. It is
        called at every reading; if it takes long, write its results to files and stream those.
    split : bool
        Split files at gaps in time, as `Recording.split`.
    workers : int
        Threads.
    client : distributed.Client, optional
        Client of a Dask cluster, whose workers then read the files.
    progress : callable, optional
        Called with the number of files done and the number of all files.

    Returns
    -------
    list of StoredRecording
        Sorted by file name; parts of one file in order of time.

    Raises
    ------
    DataError
        As `read_recordings`.
    """
    mapped = None if channel_map is None else load_channel_map(channel_map)
    paths = list_files(source)
    one = partial(_list_file, channel_map=mapped, prepare=prepare, split=split)
    listed = list(JobRunner(client).map(one, paths, workers, progress))
    in_order = sorted(range(len(paths)), key=lambda i: paths[i].stem)
    recordings = [recording for i in in_order for recording in listed[i]]
    refuse_same_name(((recording.name, recording.origin.path) for recording in recordings), "Rename one.")
    return recordings


def _list_file(
    path: Path, *, channel_map: ChannelMap | None, prepare: Prepare | None, split: bool
) -> list[StoredRecording]:
    """Recordings of one file."""
    complete = read_recording(path, channel_map)
    listed = []
    for part in complete.split() if split else [complete]:
        rows = None
        if part is not complete:
            first = int(np.searchsorted(complete.t, part.t[0]))
            rows = (first, first + len(part))
        origin = Origin(path, channel_map, rows, prepare)
        one = part if prepare is None else prepare(part)
        listed.append(
            StoredRecording(
                part.name,
                len(one),
                one.dt,
                one.names,
                dict(one.units),
                one.provenance,
                one.findings,
                origin,
                channel_digests(one),
            )
        )
    return listed
